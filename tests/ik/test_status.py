"""Verdicts and statuses are true whatever the input, and nothing unusable becomes a joint."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import qparm
from qparm.ik import (
    DifferentialIK,
    PoseStatus,
    StepProblem,
    StepStatus,
    active_set,
    check_optimality,
    make_solver,
    solve_pose,
    solve_poses,
)
from qparm.ik.solvers import SolvedStep
from qparm.robot.reach import excess_of_reach
from qparm.verify.kinematics import joint_transforms, rotation_angle

METHODS = ["dls", "wln", "cwln", "gpm"]
SEEDS = st.integers(0, 10**9)


def drawn(chain: qparm.SerialChain, seed: int, *, farther: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Return a start, some joints of it outside their limits at times, and a target, out of reach at times."""
    rng = np.random.default_rng(seed)
    q, target = chain.random(rng, 1)[0], chain.forward(chain.random(rng, 1)[0])
    outside = rng.random(8) < 0.1
    q[outside] += (chain.upper - chain.lower)[outside] * rng.choice([-1.1, 1.1], outside.sum())
    target[:3, 3] *= farther
    return q, target


@settings(max_examples=300, deadline=None)
@given(
    seed=SEEDS,
    method=st.sampled_from(METHODS),
    farther=st.sampled_from([1.0, 1.5, 4.0]),
    most=st.sampled_from([1, 5, 200]),
)
def test_a_verdict_is_what_the_configuration_says(
    chain: qparm.SerialChain, dome: qparm.Cell, seed: int, method: str, farther: float, most: int
) -> None:
    start, target = drawn(chain, seed, farther=farther)
    found = solve_pose(chain, target, start, method=method, max_iterations=most)
    pose = joint_transforms(dome, found.q[None])[0][0]
    position = float(np.linalg.norm(pose[:3, 3] - target[:3, 3]))
    rotation = float(rotation_angle((target[:3, :3] @ pose[:3, :3].T)[None])[0])
    assert found.position_error == pytest.approx(position, abs=1e-12)
    assert found.rotation_error == pytest.approx(rotation, abs=1e-7)
    inside = bool(chain.within_limits(found.q).all())
    assert found.reached == (found.position_error <= 1e-9 and found.rotation_error <= 1e-9 and inside)
    assert found.counts.total == found.iterations <= most
    match found.status:
        case PoseStatus.UNREACHABLE:
            assert excess_of_reach(chain, target) > 0
        case PoseStatus.NOT_CONVERGED:
            assert found.iterations == most
        case PoseStatus.AT_LIMITS:
            assert inside
            assert found.active_limits
        case PoseStatus.STUCK:
            assert inside
            assert found.active_limits == ()


@settings(max_examples=100, deadline=None)
@given(seed=SEEDS, method=st.sampled_from(METHODS))
def test_at_rest_where_the_pose_is_reached(chain: qparm.SerialChain, seed: int, method: str) -> None:
    q, target = drawn(chain, seed)
    found = solve_pose(chain, target, q, method=method)
    if not found.reached:
        return
    again = solve_pose(chain, target, found.q, method=method)
    assert again.iterations == 0
    np.testing.assert_array_equal(again.q, found.q)
    ik, q = DifferentialIK(chain, time_step=0.05, method=method), found.q
    statuses = []
    for _ in range(30):
        step = ik.step(q, target)
        q = step.q
        statuses.append(step.status)
    assert statuses[-1] in (StepStatus.REACHED, StepStatus.AT_REST)
    assert set(statuses) <= {StepStatus.MOVING, statuses[-1]}
    np.testing.assert_allclose(q, found.q, atol=1e-6)


@settings(max_examples=300, deadline=None)
@given(seed=SEEDS, method=st.sampled_from(METHODS), solver=st.sampled_from(["auto", "proxqp"]))
def test_a_steps_status_is_what_it_does(chain: qparm.SerialChain, seed: int, method: str, solver: str) -> None:
    q, target = drawn(chain, seed)
    ik = DifferentialIK(chain, time_step=0.05, method=method, solver=solver)
    step = ik.step(q, target)
    assert np.isfinite(step.q).all()
    assert (np.abs(step.velocity) <= chain.velocity * (1 + 1e-9)).all()
    assert (step.status is StepStatus.RETURNING) == (not chain.within_limits(q).all())
    if step.status is StepStatus.MOVING:
        after = ik.step(step.q, target)
        L = chain.characteristic_length
        assert np.hypot(after.position_error / L, after.rotation_error) < np.hypot(
            step.position_error / L, step.rotation_error
        )
    elif step.status is not StepStatus.RETURNING:
        np.testing.assert_array_equal(step.q, q)


@settings(max_examples=100, deadline=None)
@given(
    seed=SEEDS,
    value=st.sampled_from([np.nan, np.inf, -np.inf, 1e160, -1e308]),
    place=st.integers(0, 23),
    solver=st.sampled_from(["auto", "proxqp"]),
)
def test_what_is_not_finite_is_refused_by_name_and_index(
    chain: qparm.SerialChain, seed: int, value: float, place: int, solver: str
) -> None:
    rng = np.random.default_rng(seed)
    q, target = chain.random(rng, 1)[0], chain.forward(chain.random(rng, 1)[0])
    if place < 8:
        q[place] = value
        words = rf"joint '{chain.names[place]}'.* (not finite|beyond 1e\+100)"
    else:
        row, column = divmod(place - 8, 4)
        target[row, column] = value
        words = rf"target.* has an entry that is (not finite|beyond 1e\+100) at \({row}, {column}\)"
    for call in (
        lambda: DifferentialIK(chain, time_step=0.05, solver=solver).step(q, target),
        lambda: solve_pose(chain, target, q, solver=solver),
        lambda: solve_poses(chain, target[None], q[None], restarts=0),
    ):
        with pytest.raises(qparm.InvalidInput, match=words):
            call()


@pytest.mark.parametrize("solver", ["auto", "proxqp"])
@pytest.mark.parametrize(
    "target", [np.zeros((4, 4)), 2 * np.eye(4), np.diag([1.0, 1.0, -1.0, 1.0]), np.eye(4) + np.eye(4)[::-1]]
)
def test_a_target_that_is_no_pose_is_refused(chain: qparm.SerialChain, solver: str, target: np.ndarray) -> None:
    with pytest.raises(qparm.InvalidInput, match="target is not a rigid transform"):
        DifferentialIK(chain, time_step=0.05, solver=solver).step(np.zeros(8), target)


@pytest.mark.parametrize("name", ["proxqp", "osqp", "daqp", "quadprog"])
def test_open_bounds_closed_bounds_and_rank_zero_are_handled(name: str) -> None:
    rng = np.random.default_rng(0)
    solver, open_, narrow = make_solver(name, 8), np.full(8, np.inf), np.full(8, 1e-3)
    for J in (rng.normal(size=(6, 8)), np.zeros((6, 8))):
        for lb, ub in ((-open_, open_), (-narrow, open_), (-narrow, narrow), (narrow, narrow)):
            for S in (np.ones(8), np.zeros(8)):
                step = StepProblem(J=J, e=np.full(6, 0.1), S=S, c=np.zeros(8), lam2=1e-4, lb=lb, ub=ub)
                answer = solver.solve(step)
                assert answer.accepted
                np.testing.assert_allclose(answer.d, active_set(step), atol=1e-8)


@pytest.mark.parametrize("name", ["proxqp", "osqp", "daqp"])
@pytest.mark.parametrize("n", [0, -1, 2.5, True, "8"])
def test_a_solver_for_no_joints_is_refused(name: str, n: object) -> None:
    with pytest.raises(qparm.InvalidInput, match="n must be a whole number of joints from 1"):
        make_solver(name, n)  # type: ignore[arg-type]


def test_auto_is_no_solver() -> None:
    with pytest.raises(qparm.InvalidInput, match="auto"):
        make_solver("auto", 8)


class _Liar:
    name = "liar"

    def solve(self, step: StepProblem) -> SolvedStep:
        """Claim the lower corner of the bounds."""
        optimality = check_optimality(step, step.lb.copy(), np.zeros(6))
        return SolvedStep(step.lb.copy(), np.zeros(6), True, optimality, optimality.holds())


def test_a_differential_step_of_a_liar_is_the_active_sets_and_counted(chain: qparm.SerialChain) -> None:
    honest, lied_to = DifferentialIK(chain, time_step=0.05), DifferentialIK(chain, time_step=0.05, solver="proxqp")
    lied_to._solver = _Liar()
    rng = np.random.default_rng(8)
    for _ in range(20):
        q, target = chain.random(rng, 1)[0], chain.forward(chain.random(rng, 1)[0])
        np.testing.assert_allclose(lied_to.step(q, target).q, honest.step(q, target).q, atol=1e-9)
    assert (lied_to.solved, lied_to.fallbacks) == (0, 20)


def test_one_object_serves_many_threads(chain: qparm.SerialChain) -> None:
    rng = np.random.default_rng(9)
    Q, T = chain.random(rng, 400), chain.forward(chain.random(rng, 400))
    ik = DifferentialIK(chain, time_step=0.05)
    alone = [ik.step(q, target).q for q, target in zip(Q, T, strict=True)]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda k: ik.step(Q[k], T[k]).q, range(400)))
    np.testing.assert_array_equal(together, alone)
