"""The best singularity margin of a pose: what it says is true, and no sample of the self-motion set is better."""

from __future__ import annotations

import numpy as np
import pytest

import qparm
from made_arm import elsewhere_data, row_of_poses
from qparm.errors import InvalidInput
from qparm.ik import solve_poses
from qparm.reach import attainable_margin
from qparm.reach.margin import ascent, soft_margin, symmetric_eigen
from qparm.robot.kernels import forward_and_jacobian
from qparm.verify.kinematics import joint_transforms, rotation_angle, scaled_singular_values


@pytest.fixture(scope="module")
def poses(dome: qparm.Cell) -> np.ndarray:
    return dome.tool_path().poses[::30]


def test_the_margin_is_that_of_a_configuration_at_the_pose(
    dome: qparm.Cell, chain: qparm.SerialChain, poses: np.ndarray
) -> None:
    found = attainable_margin(chain, poses)
    there, axes = joint_transforms(dome, found.q)
    np.testing.assert_allclose(scaled_singular_values(dome, there, axes), found.margin, atol=1e-9)
    assert np.linalg.norm(there[:, :3, 3] - poses[:, :3, 3], axis=1).max() <= 1.001e-6
    assert rotation_angle(poses[:, :3, :3] @ there[:, :3, :3].transpose(0, 2, 1)).max() <= 1.001e-5
    assert chain.within_limits(found.q).all()


def test_hardly_any_of_many_random_configurations_is_better(chain: qparm.SerialChain, poses: np.ndarray) -> None:
    some = poses[::6]
    found = attainable_margin(chain, poses).margin[::6]
    sampled = solve_poses(chain, some, restarts=1500, rng=np.random.default_rng(0), every_start=True)
    for k in range(len(some)):
        q = sampled.q[k][sampled.reached[k]]
        assert len(q) > 300
        margins = np.linalg.svd(chain.scaled_jacobian(q), compute_uv=False)[:, -1]
        assert found[k] >= 0.99 * margins.max()


def test_poses_of_their_own_have_at_least_the_margin_they_came_with() -> None:
    """Seven joints: the self-motion set is a curve, or several."""
    arm = qparm.Cell.load(elsewhere_data()).chain()
    Q = arm.random(np.random.default_rng(2), 60)
    own = np.linalg.svd(arm.scaled_jacobian(Q), compute_uv=False)[:, -1]
    found = attainable_margin(arm, arm.forward(Q), climbs=12).margin
    assert (found >= 0.999 * own).mean() >= 0.95
    assert np.median(found / own) > 1.2


def test_what_is_out_of_reach_has_none(chain: qparm.SerialChain, poses: np.ndarray) -> None:
    far = poses[:6].copy()
    far[3, 0, 3] += 9.0
    found = attainable_margin(chain, far)
    assert np.isnan(found.margin).tolist() == [False, False, False, True, False, False]
    assert np.isnan(found.q[3]).all()
    assert attainable_margin(chain, np.empty((0, 4, 4))).margin.shape == (0,)
    assert attainable_margin(chain, poses[:1]).margin.shape == (1,)


def test_climbs_may_start_from_configurations_that_are_known(chain: qparm.SerialChain, poses: np.ndarray) -> None:
    known = attainable_margin(chain, poses, climbs=2)
    again = attainable_margin(chain, poses, starts=known.q[:, None], climbs=1)
    assert (again.margin >= 0.999 * known.margin).all()
    with pytest.raises(InvalidInput, match="starts must be"):
        attainable_margin(chain, poses, starts=known.q)
    broken = known.q[:, None].copy()
    broken[4, 0, 1] = np.nan
    with pytest.raises(InvalidInput, match="starts of pose 4 are not finite"):
        attainable_margin(chain, poses, starts=broken)


def test_the_same_bits_on_any_number_of_threads_and_again(chain: qparm.SerialChain, poses: np.ndarray) -> None:
    first = attainable_margin(chain, poses, threads=1)
    for threads in (2, 3):
        again = attainable_margin(chain, poses, threads=threads)
        np.testing.assert_array_equal(first.margin, again.margin)
        np.testing.assert_array_equal(first.q, again.q)


def test_the_gradient_is_that_of_differences(chain: qparm.SerialChain, rng: np.random.Generator) -> None:
    def value(q: np.ndarray, power: float) -> float:
        sigma = np.linalg.svd(chain.scaled_jacobian(q), compute_uv=False)
        return float((sigma ** (-2 * power)).sum() ** (-0.5 / power))

    for q in chain.random(rng, 5):
        pose, raw = np.empty((4, 4)), np.empty((8, 6))
        forward_and_jacobian(chain.fixed, chain.prismatic, q, pose, raw)
        JT = np.ascontiguousarray(chain.scaled_jacobian(q).T)
        A, V, sigma, G, g = np.empty((6, 6)), np.empty((6, 6)), np.empty(6), np.empty((8, 6)), np.empty(8)
        f, least = soft_margin(JT, 4.0, A, V, sigma)
        assert f == pytest.approx(value(q, 4.0), rel=1e-10)
        assert least == pytest.approx(np.linalg.svd(JT, compute_uv=False)[-1], rel=1e-9)
        ascent(JT, raw, chain.scale, chain.characteristic_length, 4.0, f, V, sigma, G, g)
        h = 1e-6 * np.diag(chain.scale)
        differences = [(value(q + h[i], 4.0) - value(q - h[i], 4.0)) / 2e-6 for i in range(8)]
        np.testing.assert_allclose(g, differences, atol=1e-8)


def test_eigenvalues_and_vectors_of_a_symmetric_matrix(rng: np.random.Generator) -> None:
    for rank in (6, 4, 1):
        B = rng.normal(size=(6, rank))
        A, V = B @ B.T, np.empty((6, 6))
        original = A.copy()
        symmetric_eigen(A, V)
        np.testing.assert_allclose(V @ np.diag(np.diag(A)) @ V.T, original, atol=1e-12)
        np.testing.assert_allclose(V.T @ V, np.eye(6), atol=1e-13)


@pytest.mark.parametrize(
    ("option", "value"), [("climbs", 0), ("seed", -1), ("threads", 0), ("position_tolerance", np.inf)]
)
def test_an_option_that_is_none_is_refused(chain: qparm.SerialChain, option: str, value: object) -> None:
    with pytest.raises(InvalidInput, match=option):
        attainable_margin(chain, row_of_poses(2), **{option: value})  # type: ignore[arg-type]
    with pytest.raises(InvalidInput, match=r"\(P, 4, 4\)"):
        attainable_margin(chain, np.eye(4))
