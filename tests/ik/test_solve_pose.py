"""Poses: reached to 1e-9, and a true verdict where not."""

from __future__ import annotations

import numpy as np
import pytest

import qparm
from qparm.ik import PoseStatus, StepProblem, solve_pose
from qparm.verify.kinematics import joint_transforms

NINE_JOINTS = StepProblem(
    J=np.ones((6, 9)), e=np.ones(6), S=np.ones(9), c=np.zeros(9), lam2=1.0, lb=-np.ones(9), ub=np.ones(9)
)


def test_random_reachable_poses_are_reached_to_1e_9_with_few_restarts(
    chain: qparm.SerialChain, dome: qparm.Cell
) -> None:
    rng = np.random.default_rng(7)
    targets = chain.forward(chain.random(rng, 300))
    solutions = [solve_pose(chain, T, chain.random(rng, 1)[0], method="dls", restarts=20, rng=rng) for T in targets]
    assert sum(s.reached for s in solutions) == 300
    Q = np.array([s.q for s in solutions])
    poses, _ = joint_transforms(dome, Q)
    assert np.linalg.norm(poses[:, :3, 3] - targets[:, :3, 3], axis=1).max() <= 1.1e-9
    assert chain.within_limits(Q).all()
    assert all(s.position_error <= 1e-9 and s.rotation_error <= 1e-9 for s in solutions)


@pytest.mark.parametrize("method", ["dls", "wln", "cwln", "gpm"])
def test_every_method_converges_quadratically_near_the_pose(chain: qparm.SerialChain, method: str) -> None:
    q = 0.5 * (chain.lower + chain.upper)
    q[2], q[4] = 0.4, 0.9
    solution = solve_pose(chain, chain.forward(q), q + 0.05 * chain.scale, method=method)
    assert solution.reached
    assert solution.iterations <= 6


@pytest.mark.parametrize("solver", ["proxqp", "osqp", "daqp"])
def test_every_solver_leads_to_the_same_configuration(chain: qparm.SerialChain, solver: str) -> None:
    rng = np.random.default_rng(11)
    for _ in range(5):
        q = chain.random(rng, 1)[0]
        target, start = chain.forward(q), np.clip(q + 0.2 * rng.normal(size=8) * chain.scale, chain.lower, chain.upper)
        expected = solve_pose(chain, target, start)
        got = solve_pose(chain, target, start, solver=solver)
        assert got.status is expected.status
        assert got.counts.closed_form == got.counts.active_set == 0
        assert got.counts.solver + got.counts.fallback == got.iterations
        if expected.reached:
            np.testing.assert_allclose(got.q, expected.q, atol=1e-6)


def test_a_pose_beyond_the_links_is_unreachable(chain: qparm.SerialChain) -> None:
    target = np.eye(4)
    target[:3, 3] = 0.0, 3.0, 0.5
    solution = solve_pose(chain, target, restarts=5, rng=np.random.default_rng(0))
    assert solution.status is PoseStatus.UNREACHABLE
    assert solution.starts == 1, "what is proved out of reach is not tried again"
    assert chain.within_limits(solution.q).all()


def test_a_pose_held_off_by_limits_is_at_limits_and_names_them(dome: qparm.Cell) -> None:
    data = dome.to_dict()
    data["arm"]["joints"][0]["position"] = ["399 mm", "401 mm"]
    data["arm"]["home"][0] = "400 mm"
    for joint in (2, 6):
        data["arm"]["joints"][joint]["position"] = ["-20 deg", "20 deg"]
    chain, free = qparm.Cell.load(data).chain(), dome.chain()
    q = np.array([0.4, 0.3, 0.2, 0.1, 0.9, 0.2, -1.4, 0.3])
    # the wrist is needed at 80 deg; the tool's place is well within reach, which proves nothing about its direction
    solution = solve_pose(chain, free.forward(q), np.array([0.4, 0.3, 0.2, 0.1, 0.9, 0.2, -0.3, 0.3]), method="dls")
    assert solution.status is PoseStatus.AT_LIMITS
    assert "theta7 lower" in solution.active_limits
    assert not solution.reached


def test_a_singular_start_that_cannot_move_is_stuck() -> None:
    """A planar arm stretched along its target's direction: the gradient vanishes, no limit is active."""
    from qparm.robot import DHRow, chain_from_dh

    rows = [DHRow(f"j{k}", "revolute", 0.0, 1.0 if k else 0.0, 0.0, 0.0, (-3.0, 3.0), 1, 1, 1) for k in range(3)]
    tool = np.eye(4)
    tool[0, 3] = 1.0
    chain = chain_from_dh(rows, convention="modified", transform_tool=tool)
    target = np.eye(4)
    target[0, 3] = 2.0
    solution = solve_pose(chain, target, np.zeros(3), method="dls")
    assert solution.status is PoseStatus.STUCK
    assert solution.active_limits == ()


def test_too_few_iterations_is_not_converged(chain: qparm.SerialChain, rng: np.random.Generator) -> None:
    q = chain.random(rng, 1)[0]
    start = np.clip(q + 0.5, chain.lower, chain.upper)
    solution = solve_pose(chain, chain.forward(q), start, max_iterations=1)
    assert solution.status is PoseStatus.NOT_CONVERGED
    assert solution.iterations == 1


def test_a_start_outside_the_limits_comes_back_inside(chain: qparm.SerialChain) -> None:
    q = 0.5 * (chain.lower + chain.upper)
    q[2], q[4] = 0.4, 0.9
    start = q.copy()
    start[3], start[0] = chain.upper[3] + 1.0, -0.3
    solution = solve_pose(chain, chain.forward(q), start, method="dls")
    assert solution.reached
    assert chain.within_limits(solution.q).all()


def test_reached_configurations_never_leave_the_limits_on_the_way(chain: qparm.SerialChain) -> None:
    rng = np.random.default_rng(5)
    for _ in range(40):
        target = chain.forward(chain.random(rng, 1)[0])
        solution = solve_pose(chain, target, chain.random(rng, 1)[0], keep_trace=True)
        assert chain.within_limits(solution.trace).all()
        assert len(solution.trace) == solution.iterations


def test_the_same_seed_gives_the_same_answer(chain: qparm.SerialChain) -> None:
    target = chain.forward(chain.random(np.random.default_rng(1), 1)[0])
    runs = [solve_pose(chain, target, restarts=20, rng=np.random.default_rng(2)) for _ in range(2)]
    np.testing.assert_array_equal(runs[0].q, runs[1].q)
    assert runs[0].starts == runs[1].starts


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"target": np.full((4, 4), np.nan)}, "target has an entry that is not finite"),
        ({"target": np.eye(3)}, r"\(4, 4\)"),
        ({"target": 2 * np.eye(4)}, "rigid transform"),
        ({"q_start": np.zeros(7)}, "has 8 joints"),
        ({"q_start": np.array([0, 0, np.nan, 0, 0, 0, 0, 0.0])}, "theta3"),
        ({"method": "newton"}, "method must be one of"),
        ({"method": ["cwln"]}, "method must be one of"),
        ({"method": lambda *_: NINE_JOINTS}, "StepProblem of 8 joints, not 9"),
        ({"gain": None}, "gain must be finite"),
        ({"position_tolerance": 0.0}, "position_tolerance"),
        ({"position_tolerance": None}, "position_tolerance"),
        ({"rotation_tolerance": np.nan}, "rotation_tolerance"),
        ({"max_iterations": 0}, "max_iterations"),
        ({"restarts": 3}, "restarts need rng"),
        ({"restarts": -1}, "must not be negative"),
    ],
)
def test_unusable_input_is_refused_by_name(chain: qparm.SerialChain, change: dict, words: str) -> None:
    arguments = {"target": np.eye(4), "q_start": np.zeros(8)} | change
    with pytest.raises(qparm.InvalidInput, match=words):
        solve_pose(chain, **arguments)
