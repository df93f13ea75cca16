"""The best that each point's solutions have of a figure of single configurations, such as the compliance.

The best sample of every point is moved on. What counts of a design is its worst points, so there the search goes on:
the worst points are searched again, from many starts, until the worst one is among those that were. An under-searched
point would stand out as the worst, and the figure would be one of the draws.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from qparm.planning.search.projection import project, velocity_scale
from qparm.planning.tolerances import SEARCH_POSE

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.path.relaxation import Relaxation
    from qparm.planning.search.sampling import Layer
    from qparm.robot import SerialChain

__all__ = ["OfConfigurations", "best_of_points"]

# Of configurations (m, n) at poses with the normals (m, 3): (m,).
OfConfigurations = Callable[["SerialChain", "NDArray[np.float64]", "NDArray[np.float64]"], "NDArray[np.float64]"]

# A solution is moved on by so many displaced copies, ever less (velocity-scaled rad).
_WIDTHS, _BESIDE = np.radians([20.0, 10.0, 5.0, 2.5]), 4
# Points are searched again so many at a time, at most so often, from random starts and the solutions of the nearest
# points; the best few are moved on, farther down since they are few.
_WORST, _TIMES = 24, 6
_FRESH, _NEAR, _FEW = 60, 16, 4
_WIDTHS_AGAIN = np.radians([20.0, 10.0, 5.0, 2.5, 1.25])


def best_of_points(
    chain: SerialChain,
    poses: NDArray[np.float64],
    layers: list[Layer],
    of: OfConfigurations,
    relaxation: Relaxation,
    rng: np.random.Generator,
) -> NDArray[np.float64]:
    """Return the largest value found at each pose.

    Parameters
    ----------
    chain : SerialChain
    poses : (K, 4, 4) ndarray
        In the order of the path.
    layers : list of K Layer
        Solutions at each, one at least.
    of : callable
        The figure, the larger the better.
    relaxation : Relaxation
    rng : numpy.random.Generator

    Returns
    -------
    (K,) ndarray
    """
    normals = poses[:, :3, 2]
    told = [
        of(chain, layer.q, np.tile(normal, (len(layer.q), 1))) for normal, layer in zip(normals, layers, strict=True)
    ]
    best = [int(one.argmax()) for one in told]
    q = np.array([layer.q[k] for layer, k in zip(layers, best, strict=True)])
    rho = np.array([layer.rho[k] for layer, k in zip(layers, best, strict=True)])
    values = np.array([one[k] for one, k in zip(told, best, strict=True)])
    place = np.arange(len(q))
    along = np.stack([np.roll(place, 1), np.roll(place, -1)], axis=1)
    search = _Search(chain, of, relaxation, rng)
    q, rho, values = search.climbed(poses, q, rho, values, _WIDTHS, along)
    again = np.zeros(len(q), dtype=bool)
    for _ in range(_TIMES):
        worst = np.argsort(values, kind="stable")[:_WORST]
        if again[worst[0]]:
            break
        worst = worst[~again[worst]]
        again[worst] = True
        q[worst], rho[worst], values[worst] = search.again(poses, q, rho, values, worst)
    return values


class _Search:
    """Moves solutions of poses to better ones."""

    def __init__(
        self, chain: SerialChain, of: OfConfigurations, relaxation: Relaxation, rng: np.random.Generator
    ) -> None:
        self._chain, self._of, self._relaxation, self._rng = chain, of, relaxation, rng
        self._scale = velocity_scale(chain)

    def climbed(
        self,
        poses: NDArray[np.float64],
        q: NDArray[np.float64],
        rho: NDArray[np.float64],
        values: NDArray[np.float64],
        widths: NDArray[np.float64],
        others: NDArray[np.int64],
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return solutions (K, n) moved on: by little, and from those of other poses (K, m) by their place."""
        place = np.arange(len(q))
        for width in widths:
            shift = self._rng.standard_normal((len(q), _BESIDE, self._chain.n)) * self._scale * width
            lean = self._rng.standard_normal((len(q), _BESIDE, 3)) * width
            moved, leaning, told = self._onto(
                poses,
                np.concatenate([q[:, None] + shift, q[others]], axis=1),
                np.concatenate([rho[:, None] + lean, rho[others]], axis=1),
            )
            best = told.argmax(axis=1)
            better = told[place, best] > values
            q = np.where(better[:, None], moved[place, best], q)
            rho = np.where(better[:, None], leaning[place, best], rho)
            values = np.maximum(values, told.max(axis=1))
        return q, rho, values

    def again(
        self,
        poses: NDArray[np.float64],
        q: NDArray[np.float64],
        rho: NDArray[np.float64],
        values: NDArray[np.float64],
        at: NDArray[np.int64],
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return better solutions of the poses at some places, from many starts; theirs where there are none."""
        here, k, n = poses[at], len(at), self._chain.n
        apart = np.linalg.norm(poses[None, :, :3, 3] - here[:, None, :3, 3], axis=2)
        near = np.argsort(apart, axis=1, kind="stable")[:, 1 : _NEAR + 1]
        fresh = self._chain.random(self._rng, k * _FRESH).reshape(k, _FRESH, n)
        leans = self._relaxation.random(self._rng, k * _FRESH).reshape(k, _FRESH, 3)
        moved, leaning, told = self._onto(
            here, np.concatenate([q[near], fresh], axis=1), np.concatenate([rho[near], leans], axis=1)
        )
        Q, R = np.concatenate([q[at, None], moved], axis=1), np.concatenate([rho[at, None], leaning], axis=1)
        V = np.concatenate([values[at, None], told], axis=1)
        few = np.argsort(-V, axis=1, kind="stable")[:, :_FEW]
        Q, R = (np.take_along_axis(one, few[:, :, None], axis=1).reshape(-1, one.shape[2]) for one in (Q, R))
        Q, R, V = self.climbed(
            np.repeat(here, few.shape[1], axis=0), Q, R, np.take_along_axis(V, few, axis=1).ravel(), _WIDTHS_AGAIN,
            np.empty((few.size, 0), dtype=np.int64),
        )  # fmt: skip
        V = V.reshape(k, -1)
        first = np.arange(k) * V.shape[1] + V.argmax(axis=1)
        return Q[first], R[first], V.max(axis=1)

    def _onto(
        self, poses: NDArray[np.float64], tries: NDArray[np.float64], leaning: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return starts (K, m, n) moved onto their poses, how the tool leans there, and their values (K, m).

        The value of a start that does not arrive is minus infinity.
        """
        chain, relaxation = self._chain, self._relaxation
        leaning = relaxation.clipped(leaning, inner=True)
        moved, arrived = project(
            chain, poses, np.clip(tries, chain.lower, chain.upper),
            position_tolerance=SEARCH_POSE, rotation_tolerance=SEARCH_POSE,
            offsets=relaxation.rotations(leaning.reshape(-1, 3)) if relaxation.free else None, threads=1,
        )  # fmt: skip
        normals = np.repeat(poses[:, :3, 2], moved.shape[1], axis=0)
        told = self._of(chain, np.ascontiguousarray(moved.reshape(-1, chain.n)), normals)
        return moved, leaning, np.where(arrived, told.reshape(arrived.shape), -np.inf)
