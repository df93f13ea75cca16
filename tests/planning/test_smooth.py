"""Smoothing: poses stay exact, limits hold, the objective falls, and its model is the truth to first order."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import qparm
from qparm.path.relaxation import EXACT, Relaxation
from qparm.planning.search.projection import project, velocity_scale
from qparm.planning.smoothing import smooth as module
from qparm.planning.smoothing.smooth import Smoothed, smooth, smoothness, stencils
from qparm.robot import DHRow, chain_from_dh

N = 24


@pytest.fixture(scope="module")
def rough(dome: qparm.Cell, chain: qparm.SerialChain) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return s, poses and a path that wanders in the self-motion sets of part of a row."""
    tool_path = dome.tool_path()
    poses, s = tool_path.poses[430 : 430 + N], tool_path.s[430 : 430 + N]
    rng = np.random.default_rng(3)
    start = qparm.solve_pose(chain, poses[0], restarts=50, rng=rng).q
    q = [start]
    for pose in poses[1:]:
        near = q[-1] + 0.02 * rng.standard_normal(8) * velocity_scale(chain)
        moved, there = project(
            chain, pose[None], np.clip(near, chain.lower, chain.upper)[None], position_tolerance=1e-11,
            rotation_tolerance=1e-11, iterations=25,
        )  # fmt: skip
        assert there[0]
        q.append(moved[0])
    return s, np.ascontiguousarray(poses), np.array(q)


def smoothed(
    chain: qparm.SerialChain, s: np.ndarray, poses: np.ndarray, q: np.ndarray, *, step: float = np.inf,
    relaxation: Relaxation = EXACT, run: np.ndarray | None = None, linked: bool = False,
) -> Smoothed:  # fmt: skip
    run = np.zeros(len(q), dtype=np.int64) if run is None else run
    edges = (run[:-1] != run[1:]) & linked
    return smooth(
        chain, poses, q, s=s, run=run, linked=edges, step=np.full((len(q) - 1, chain.n), step), relaxation=relaxation
    )


def misses(chain: qparm.SerialChain, q: np.ndarray, poses: np.ndarray) -> float:
    return float(np.abs(chain.pose_error(chain.forward(q), poses)).max())


def test_poses_stay_exact_limits_hold_and_the_objective_falls(
    chain: qparm.SerialChain, rough: tuple[np.ndarray, np.ndarray, np.ndarray]
) -> None:
    s, poses, q = rough
    result = smoothed(chain, s, poses, q)
    assert misses(chain, result.q, poses) < 1e-9
    assert chain.within_limits(result.q).all()
    assert result.after < 0.2 * result.before
    run = np.zeros(N, dtype=np.int64)
    assert result.before == pytest.approx(smoothness(chain, s, run, q))
    assert result.after == pytest.approx(smoothness(chain, s, run, result.q))
    assert 0 < result.iterations <= 40
    assert (result.parameters == 0).all()


def test_the_objective_is_second_and_third_differences(
    chain: qparm.SerialChain, rough: tuple[np.ndarray, np.ndarray, np.ndarray]
) -> None:
    s, _, q = rough
    u = q / velocity_scale(chain)
    expected = (np.diff(u, 2, axis=0) ** 2).sum() + (np.diff(u, 3, axis=0) ** 2).sum()
    assert smoothness(chain, s, np.zeros(N, dtype=np.int64), q) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("order", [2, 3])
def test_uneven_spacing_does_not_see_a_polynomial(rng: np.random.Generator, order: int) -> None:
    """Divided differences of a polynomial of lower degree vanish wherever its points lie."""
    s = np.sort(rng.uniform(0, 1, 30))
    run = np.zeros(30, dtype=np.int64)
    first, rows = stencils(s, run, np.zeros(29, dtype=bool))
    of_order = np.count_nonzero(rows, axis=1) == order + 1
    p = np.polyval(rng.standard_normal(order), s)
    padded = np.append(p, np.zeros(3))
    values = sum(rows[:, i] * padded[first + i] for i in range(4))
    assert np.abs(values[of_order]).max() < 1e-6
    # and of the first power that it does see, it sees the same everywhere
    padded = np.append(s**order, np.zeros(3))
    values = sum(rows[:, i] * padded[first + i] for i in range(4))[of_order]
    np.testing.assert_allclose(values, values[0], rtol=1e-6)


def test_uneven_points_are_smoothed_as_a_curve(
    chain: qparm.SerialChain, rough: tuple[np.ndarray, np.ndarray, np.ndarray]
) -> None:
    s, poses, q = rough
    keep = np.array([0, 1, 2, 4, 5, 8, 9, 10, 13, 15, 16, 20, 21, 23])
    result = smoothed(chain, s[keep], poses[keep], q[keep])
    assert result.after < 0.2 * result.before
    assert misses(chain, result.q, poses[keep]) < 1e-9
    # slopes, not differences, change evenly: those of the long gaps are no larger than those of the short ones
    slope = np.diff(result.q / velocity_scale(chain), axis=0) / np.diff(s[keep])[:, None]
    assert np.abs(np.diff(slope, axis=0)).max() < 0.4 * np.abs(slope).max()


def test_a_straight_line_is_left_alone(chain: qparm.SerialChain) -> None:
    q = 0.5 * (chain.lower + chain.upper) + np.linspace(0, 1, 15)[:, None] * np.linspace(0.1, 0.4, 8)
    s = np.linspace(0, 1, 15)
    result = smoothed(chain, s, np.ascontiguousarray(chain.forward(q)), q)
    assert result.before < 1e-20
    assert np.abs(result.q - q).max() < 1e-6
    assert result.after <= result.before


def test_steps_grow_no_larger_than_allowed(
    chain: qparm.SerialChain, rough: tuple[np.ndarray, np.ndarray, np.ndarray]
) -> None:
    s, poses, q = rough
    free = smoothed(chain, s, poses, q)
    largest = np.abs(np.diff(free.q, axis=0)).max(axis=0)
    bound = np.maximum(0.9 * largest, np.abs(np.diff(q, axis=0)).max(axis=0) * 0.5)
    step = np.tile(bound, (N - 1, 1))
    run = np.zeros(N, dtype=np.int64)
    bounded = smooth(chain, poses, q, s=s, run=run, linked=np.zeros(N - 1, dtype=bool), step=step)
    before, after = np.abs(np.diff(q, axis=0)), np.abs(np.diff(bounded.q, axis=0))
    assert (after <= np.maximum(step, before) + 1e-8).all()
    assert bounded.after < bounded.before


def test_runs_are_smoothed_apart_and_linked_ones_drawn_together(
    chain: qparm.SerialChain, rough: tuple[np.ndarray, np.ndarray, np.ndarray]
) -> None:
    s, poses, q = rough
    run = (np.arange(N) >= 12).astype(np.int64)
    apart = smoothed(chain, s, poses, q, run=run)
    alone = smoothed(chain, s[:12], poses[:12], q[:12])
    assert np.abs(apart.q[:12] - alone.q).max() < 0.02
    together = smoothed(chain, s, poses, q, run=run, linked=True)
    gap = [np.linalg.norm((x.q[12] - x.q[11]) / velocity_scale(chain)) for x in (apart, together)]
    assert gap[1] < gap[0]


def test_relaxed_spin_is_smoother_and_stays_in_the_cone(
    chain: qparm.SerialChain, rough: tuple[np.ndarray, np.ndarray, np.ndarray]
) -> None:
    s, poses, q = rough
    exact = smoothed(chain, s, poses, q)
    for relaxation in (Relaxation(spin=True), Relaxation(tilt=np.radians(5.0)), Relaxation(spin=True, tilt=0.1)):
        result = smoothed(chain, s, poses, q, relaxation=relaxation)
        assert result.after < exact.after
        assert misses(chain, result.q, relaxation.targets(poses, result.parameters)) < 1e-9
        assert chain.within_limits(result.q).all()
        lean = np.hypot(result.parameters[:, 0], result.parameters[:, 1])
        assert lean.max() <= relaxation.tilt
        held = [i for i in range(3) if i not in relaxation.free]
        assert (result.parameters[:, held] == 0).all()
        assert np.abs(result.parameters).max() > 1e-3


def test_an_arm_of_six_joints_has_nothing_to_choose(rng: np.random.Generator) -> None:
    alpha = [0.0, -np.pi / 2, 0.0, -np.pi / 2, np.pi / 2, -np.pi / 2]
    a, d = [0.0, 0.0, 0.4, 0.02, 0.0, 0.0], [0.3, 0.0, 0.1, 0.4, 0.0, 0.1]
    rows = [DHRow(f"j{k}", "revolute", alpha[k], a[k], d[k], 0.0, (-3.0, 3.0), 1, 3, 30) for k in range(6)]
    six = chain_from_dh(rows, convention="modified")
    q = np.array([0.1, -0.5, 0.4, 0.2, 0.7, 0.0]) + 0.02 * np.cumsum(rng.standard_normal((10, 6)), axis=0)
    s, poses = np.linspace(0, 1, 10), np.ascontiguousarray(six.forward(q))
    result = smoothed(six, s, poses, q)
    np.testing.assert_array_equal(result.q, q)
    assert result.iterations == 0
    # with a free spin there is
    result = smoothed(six, s, poses, q, relaxation=Relaxation(spin=True))
    assert result.after < result.before
    # the last joint turns about the tool's axis: it alone is free, and made straight
    assert np.abs(result.q[:, :5] - q[:, :5]).max() < 1e-9
    assert np.abs(np.diff(result.q[:, 5], 2)).max() < 0.02 * np.abs(np.diff(q[:, 5], 2)).max()
    assert misses(six, result.q, Relaxation(spin=True).targets(poses, result.parameters)) < 1e-9


@pytest.mark.parametrize("relaxation", [EXACT, Relaxation(spin=True, tilt=0.1)], ids=["exact", "relaxed"])
def test_the_subproblem_predicts_the_gain(
    chain: qparm.SerialChain, rough: tuple[np.ndarray, np.ndarray, np.ndarray], relaxation: Relaxation
) -> None:
    """Within a small trust region the path gains what the model says: its gradient is the objective's."""
    s, poses, q = rough
    run, linked = np.zeros(N, dtype=np.int64), np.zeros(N - 1, dtype=bool)
    D = velocity_scale(chain)
    first, rows = stencils(s, run, linked)
    K = module._couplings(N, first, rows)
    rho = np.zeros((N, 3))
    free = np.full((N - 1, chain.n), np.inf)
    subproblem = module._Subproblem(chain, poses, q, rho, relaxation, D, K, free)

    def value(x: np.ndarray, parameters: np.ndarray) -> float:
        return smoothness(chain, s, run, x) + module._WEIGHT_NOMINAL * float((parameters**2).sum())

    before = value(q, rho)
    for trust in (1e-3, 1e-4):
        r = 2 + relaxation.freedom
        d, d_rho = subproblem.solve(trust, np.zeros(N * r))
        assert np.abs(d).max() <= trust + module._QP_TOLERANCE
        moved, there = project(
            chain, relaxation.targets(poses, rho + d_rho), q + D * d, position_tolerance=1e-12, rotation_tolerance=1e-12
        )
        assert there.all()
        predicted, actual = before - value(q + D * d, rho + d_rho), before - value(moved, rho + d_rho)
        assert predicted > 0
        assert actual == pytest.approx(predicted, rel=20 * trust + 1e-3)
        # the joints leave the straight line by the square of the step only
        assert np.abs((moved - q) / D - d).max() < 30 * trust**2


def test_a_rotation_of_the_base_changes_nothing(
    chain: qparm.SerialChain, rough: tuple[np.ndarray, np.ndarray, np.ndarray]
) -> None:
    from dataclasses import replace

    s, poses, q = rough
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix()
    turned = replace(chain, transform_base=T @ chain.transform_base)
    a = smoothed(chain, s, poses, q)
    b = smoothed(turned, s, np.ascontiguousarray(T @ poses), q)
    assert b.after == pytest.approx(a.after, rel=1e-2)
