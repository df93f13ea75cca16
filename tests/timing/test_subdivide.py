"""How far a form is off: against the nearest place of the path, found among many."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import qparm
from qparm.timing.subdivide import tool_deviation

# The share of a tolerance that a form may use.
SHARE = 0.6


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("off", [0.0, 3e-7])
def test_rotation_is_compared_where_the_path_is_nearest(chain: qparm.SerialChain, seed: int, off: float) -> None:
    """A tool that is ahead by micrometres, beside its path or not, on paths that turn by some ten radians a metre."""
    rng = np.random.default_rng(seed)
    middle = rng.uniform(0.7 * chain.lower + 0.3 * chain.upper, 0.3 * chain.lower + 0.7 * chain.upper)
    velocity = rng.normal(size=chain.n)
    J = chain.jacobian(middle)
    # a tenth of the speed that the joints give it: so the rotation counts
    velocity -= np.linalg.pinv(J) @ np.append(0.9 * (J @ velocity)[:3], np.zeros(3))
    bend = rng.normal(size=chain.n)

    def path(t: np.ndarray) -> np.ndarray:
        return middle + t[:, None] * velocity + t[:, None] ** 2 * bend

    speed = np.linalg.norm((J @ velocity)[:3])
    ahead = 2e-6 / speed
    form = path(np.array([ahead])) + off * rng.normal(size=chain.n)
    pose = chain.forward(form)[0]
    t = np.linspace(-5 * ahead, 5 * ahead, 20001)
    way = chain.forward(path(t))
    nearest = way[np.linalg.norm(way[:, :3, 3] - pose[:3, 3], axis=1).argmin()]
    turned = Rotation.from_matrix(nearest[:3, :3] @ pose[:3, :3].T).magnitude()
    at_the_time = Rotation.from_matrix(chain.forward(middle)[:3, :3] @ pose[:3, :3].T).magnitude()
    assert at_the_time > 5e-6

    deviation = tool_deviation(chain, position=1.0, rotation=20e-6)
    states = np.stack([middle[None], velocity[None]])
    found = deviation(np.stack([form, velocity[None]]), states)
    np.testing.assert_allclose(found * SHARE * 20e-6, turned, rtol=5e-3, atol=3e-8)
    # the place is that of the time: never nearer than the path
    deviation = tool_deviation(chain, position=5e-6, rotation=1.0)
    missed = np.linalg.norm(chain.forward(middle)[:3, 3] - pose[:3, 3])
    np.testing.assert_allclose(deviation(np.stack([form, velocity[None]]), states) * SHARE * 5e-6, missed, rtol=1e-6)


def test_on_the_spot_the_rotation_is_that_of_the_time(chain: qparm.SerialChain) -> None:
    """The last joint turns the tool about itself: there no place is nearest."""
    q, velocity = 0.5 * (chain.lower + chain.upper), np.zeros(chain.n)
    velocity[-1] = 1.0
    assert np.abs(chain.jacobian(q)[:3, -1]).max() < 1e-12
    form = q + 1e-5 * velocity
    found = tool_deviation(chain, position=5e-6, rotation=20e-6)(
        np.stack([form[None], velocity[None]]), np.stack([q[None], velocity[None]])
    )
    np.testing.assert_allclose(found * SHARE * 20e-6, 1e-5, rtol=1e-6)
