"""Exact between points: waypoints are added until the curve keeps the path, measured by another kinematics."""

from __future__ import annotations

import numpy as np
import pytest
from comparisons.pinocchio_model import pinocchio_model

import qparm
from conftest import ROOT
from qparm.path import joint_curve
from qparm.path.relaxation import EXACT, Relaxation
from qparm.planning.interpolation.exact import (
    Stretch,
    _outside_limits,
    beyond_limits,
    exact_stretch,
    gap_deviations,
    is_exact,
)
from qparm.planning.search.projection import project

POSITION, ROTATION = 5e-6, 20e-6


@pytest.fixture(scope="module")
def coarse(dome: qparm.Cell, chain: qparm.SerialChain) -> tuple[qparm.ToolPath, np.ndarray, np.ndarray]:
    """Return the tool path, and a coarse part of its row 7: every fourth point, 84 mm apart."""
    tool_path = dome.tool_path()
    row = tool_path.rows[7]
    at = np.arange(20, 42, 3)
    poses = np.ascontiguousarray(tool_path.pose(7, row.s[at]))
    q = [qparm.solve_pose(chain, poses[0], restarts=50, rng=np.random.default_rng(1)).q]
    for pose in poses:
        moved, there = project(
            chain, pose[None], q[-1][None], position_tolerance=1e-11, rotation_tolerance=1e-11, iterations=30
        )
        assert there[0]
        q.append(moved[0])
    return tool_path, row.s[at], np.array(q[1:])


def stretch_of(
    chain: qparm.SerialChain, coarse: tuple[qparm.ToolPath, np.ndarray, np.ndarray], *, for_linear: bool = False,
    position: float = POSITION,
) -> Stretch:  # fmt: skip
    tool_path, s, q = coarse
    return exact_stretch(
        chain, s, q, np.zeros((len(s), 3)), lambda x: tool_path.pose(7, x), relaxation=EXACT, position=position,
        rotation=ROTATION, for_linear=for_linear,
    )  # fmt: skip


def measured(
    chain: qparm.SerialChain, tool_path: qparm.ToolPath, s: np.ndarray, q: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return deviations at places s in m and rad, by Pinocchio."""
    import pinocchio as pin

    model, data, frame = pinocchio_model(chain)
    targets = tool_path.pose(7, s)
    position, rotation = np.empty(len(s)), np.empty(len(s))
    for k, x in enumerate(q):
        pin.framesForwardKinematics(model, data, x)
        tool = data.oMf[frame]
        position[k] = np.linalg.norm(tool.translation - targets[k, :3, 3])
        rotation[k] = np.linalg.norm(pin.log3(targets[k, :3, :3].T @ tool.rotation))
    return position, rotation


def test_a_coarse_row_gets_waypoints_until_it_is_exact(
    chain: qparm.SerialChain, coarse: tuple[qparm.ToolPath, np.ndarray, np.ndarray]
) -> None:
    tool_path, s, q = coarse
    dense = np.linspace(s[0], s[-1], 4001)
    before = measured(chain, tool_path, dense, joint_curve(s, q)(dense))[0].max()
    assert before > POSITION, "too coarse to begin with"
    result = stretch_of(chain, coarse)
    assert len(result.s) > len(s)
    np.testing.assert_array_equal(result.s[result.given], s)
    np.testing.assert_array_equal(result.q[result.given], q)
    assert (np.diff(result.s) > 0).all()
    assert result.curve_position.max() <= POSITION
    position, rotation = measured(chain, tool_path, dense, joint_curve(result.s, result.q)(dense))
    assert position.max() <= POSITION
    assert rotation.max() <= ROTATION
    # the figure for each gap is what is found there
    gap = np.clip(np.searchsorted(result.s, dense, side="right") - 1, 0, len(result.s) - 2)
    for k in range(len(result.s) - 1):
        found = position[gap == k].max()
        assert result.curve_position[k] == pytest.approx(found, rel=0.15, abs=1e-10)


def test_added_waypoints_are_on_the_path(
    chain: qparm.SerialChain, coarse: tuple[qparm.ToolPath, np.ndarray, np.ndarray]
) -> None:
    result = stretch_of(chain, coarse)
    position, rotation = measured(chain, coarse[0], result.s, result.q)
    assert position.max() < 1e-9
    assert rotation.max() < 1e-9
    assert chain.within_limits(result.q).all()


def test_for_linear_holds_joint_linearly(
    chain: qparm.SerialChain, coarse: tuple[qparm.ToolPath, np.ndarray, np.ndarray]
) -> None:
    plain, linear = stretch_of(chain, coarse), stretch_of(chain, coarse, for_linear=True)
    assert plain.linear_position.max() > 20 * POSITION
    assert len(linear.s) > 3 * len(plain.s)
    dense = np.linspace(linear.s[0], linear.s[-1], 5001)
    q = np.stack([np.interp(dense, linear.s, column) for column in linear.q.T], axis=1)
    position, rotation = measured(chain, coarse[0], dense, q)
    assert position.max() <= POSITION
    assert rotation.max() <= ROTATION


def test_a_tighter_tolerance_takes_more_waypoints(
    chain: qparm.SerialChain, coarse: tuple[qparm.ToolPath, np.ndarray, np.ndarray]
) -> None:
    counts = [len(stretch_of(chain, coarse, position=x).s) for x in (5e-6, 1e-7, 1e-8)]
    assert counts[0] < counts[1] < counts[2]
    assert stretch_of(chain, coarse, position=1e-8).curve_position.max() <= 1e-8


def test_what_is_fine_is_left(chain: qparm.SerialChain, coarse: tuple[qparm.ToolPath, np.ndarray, np.ndarray]) -> None:
    fine = stretch_of(chain, coarse, position=1e-8)
    again = stretch_of(chain, (coarse[0], fine.s, fine.q))
    assert again.given.all()


def test_deviations_of_a_relaxed_tool_are_from_where_it_may_stand(
    chain: qparm.SerialChain, coarse: tuple[qparm.ToolPath, np.ndarray, np.ndarray]
) -> None:
    """A tool that spins evenly along the way is as exact as one that does not."""
    tool_path, s, _ = coarse
    relaxation = Relaxation(spin=True)
    rho = np.zeros((len(s), 3))
    rho[:, 2] = np.linspace(0.0, 0.3, len(s))
    start = np.tile(coarse[2][0], (len(s), 1))
    q = [coarse[2][0]]
    for k, target in enumerate(relaxation.targets(np.ascontiguousarray(tool_path.pose(7, s)), rho)):
        moved, there = project(
            chain, target[None], q[-1][None], position_tolerance=1e-11, rotation_tolerance=1e-11, iterations=40
        )
        assert there[0], k
        q.append(moved[0])
    assert len(start) == len(s)
    arguments = (chain, s, np.array(q[1:]), rho, lambda x: tool_path.pose(7, x))
    relaxed, exact = gap_deviations(*arguments, relaxation), gap_deviations(*arguments, EXACT)
    assert exact[1].max() == pytest.approx(0.3, rel=0.1)
    assert relaxed[1].max() < 1e-3
    result = exact_stretch(*arguments, relaxation=relaxation, position=POSITION, rotation=ROTATION)
    assert result.curve_position.max() <= POSITION
    assert result.curve_rotation.max() <= ROTATION


def test_a_tool_whose_waypoints_lie_on_the_edge_of_its_cone_stays_in_the_cone(
    chain: qparm.SerialChain, coarse: tuple[qparm.ToolPath, np.ndarray, np.ndarray]
) -> None:
    """A lean that grows, is held at the edge and shrinks again: its spline swings out of the cone."""
    tool_path, s, q = coarse
    relaxation = Relaxation(tilt=np.radians(3.0))
    rho = np.zeros((len(s), 3))
    rho[:, 0] = (
        relaxation.tilt * 0.999999 * np.minimum(1.0, 0.4 * np.minimum(np.arange(len(s)), np.arange(len(s))[::-1]))
    )
    targets = relaxation.targets(np.ascontiguousarray(tool_path.pose(7, s)), rho)
    q, there = project(chain, targets, q, position_tolerance=1e-11, rotation_tolerance=1e-11, iterations=40)
    assert there.all()
    result = exact_stretch(
        chain, s, q, rho, lambda x: tool_path.pose(7, x), relaxation=relaxation, position=POSITION, rotation=ROTATION
    )
    dense = np.linspace(s[0], s[-1], 4001)
    tool = chain.forward(joint_curve(result.s, result.q)(dense))
    axis = np.einsum("kji,kj->ki", tool_path.pose(7, dense)[:, :3, :3], tool[:, :3, 2])
    lean = np.arctan2(np.hypot(axis[:, 0], axis[:, 1]), axis[:, 2])
    assert lean.max() > relaxation.tilt * 0.999, "it is led along the edge"
    assert lean.max() <= relaxation.tilt + ROTATION
    assert result.curve_rotation.max() <= ROTATION


@pytest.mark.parametrize(("tilt", "seed"), [("1 deg", 0), ("5 deg", 2)])
@pytest.mark.slow
def test_a_plan_in_a_narrow_cone_is_as_exact_as_the_planner_says(tilt: str, seed: int) -> None:
    data = qparm.Cell.load(ROOT / "examples" / "dome.toml").to_dict()
    data["process"].update(rows=4, points=31, tool_tilt=tilt)
    plan = qparm.plan(data, seed=seed)
    report = qparm.report(plan)
    assert plan.trajectory.executable
    assert report.executable, report.reasons


def test_a_joint_that_is_held_at_its_limit_does_not_swing_beyond_it(dome: qparm.Cell, chain: qparm.SerialChain) -> None:
    """Seven points of a row; the curve through them leads theta4 beyond its limit."""
    tool_path = dome.tool_path()
    poses, s = np.ascontiguousarray(tool_path.pose(3, tool_path.rows[3].s)), tool_path.rows[3].s[::10]
    q = np.empty((61, chain.n))
    q[30] = qparm.solve_pose(chain, poses[30], restarts=50, rng=np.random.default_rng(1)).q
    for order, before in ((range(31, 61), -1), (range(29, -1, -1), 1)):
        for k in order:
            moved, there = project(
                chain, poses[k : k + 1], q[k + before][None], position_tolerance=1e-11, rotation_tolerance=1e-11,
                iterations=40,
            )  # fmt: skip
            assert there[0]
            q[k] = moved[0]
    q = np.ascontiguousarray(q[::10])
    upper = chain.upper.copy()
    upper[3] = q[:, 3].max() + 3e-4
    arm = chain.with_position_limits(chain.lower, upper)
    assert beyond_limits(arm, s, q)[:, 3].max() > 1e-3
    result = exact_stretch(
        arm, s, q, np.zeros((len(s), 3)), lambda x: tool_path.pose(3, x), relaxation=EXACT, position=POSITION,
        rotation=ROTATION,
    )  # fmt: skip
    np.testing.assert_array_equal(result.q[result.given], q)
    assert result.curve_position.max() <= POSITION
    dense = joint_curve(result.s, result.q)(np.linspace(s[0], s[-1], 400_001))
    assert arm.within_limits(dense).all()
    beyond = beyond_limits(arm, result.s, result.q).max(axis=0)
    np.testing.assert_allclose(beyond, np.maximum(arm.lower - dense, dense - arm.upper).max(axis=0), atol=1e-6)
    assert len(result.s) < 100, "it took 156 that did not suffice where all lay at the limit"


@pytest.mark.slow
def test_a_tool_that_may_spin_turns_where_a_joint_would_leave_its_limits() -> None:
    """Between two points of a row the spin in between would take a joint beyond its limit."""
    data = qparm.Cell.load(ROOT / "examples" / "six_axis.toml").to_dict()
    data["process"].update(rows=4, points=31, tool_spin="free")
    plan = qparm.plan(data)
    path = plan.joint_path
    for run in path.runs:
        assert beyond_limits(plan.chain, path.run_parameter(run), path.waypoints(run)).max() <= 1e-9
    assert not [one for one in plan.verdict.findings if one.code == "position"]
    assert plan.trajectory.reasons == qparm.report(plan).reasons


def test_a_curve_that_turns_back_beyond_a_limit_between_the_places_is_seen(chain: qparm.SerialChain) -> None:
    s, q = np.linspace(0.0, 1.0, 8), np.tile(0.5 * (chain.lower + chain.upper), (8, 1))
    q[:, 4] = chain.upper[4] - (s - 0.46) ** 2
    middle = (np.arange(8) + 0.5) / 8
    for beyond in (1e-8, -1e-8):
        moved = q.copy()
        moved[:, 4] += beyond
        looked_at = joint_curve(s, moved)((s[:-1, None] + np.diff(s)[:, None] * middle).ravel())
        assert chain.within_limits(looked_at, tolerance=1e-9).all(), "the places in the middle miss it"
        assert _outside_limits(chain, s, moved).any() == (beyond > 0)
        assert not _outside_limits(chain, s, moved)[[0, 1, 2, 4, 5, 6]].any()


def test_added_waypoints_keep_off_a_limit_that_the_given_ones_keep_off(
    chain: qparm.SerialChain, coarse: tuple[qparm.ToolPath, np.ndarray, np.ndarray]
) -> None:
    """Where the curve would lead beyond a limit, a waypoint on it leaves the curve beyond, however near the next is."""
    tool_path, s, q = coarse
    peaks = joint_curve(s, q)(np.linspace(s[0], s[-1], 2001))
    beyond = peaks.max(axis=0) - q.max(axis=0)
    joint = int(beyond.argmax())
    # the limit lies halfway between the waypoints and the peak of their curve
    upper = chain.upper.copy()
    upper[joint] = q[:, joint].max() + 0.5 * beyond[joint]
    arm = chain.with_position_limits(chain.lower, upper)
    stretch = stretch_of(arm, coarse)
    assert is_exact(arm, stretch, position=POSITION, rotation=ROTATION)
    assert (upper[joint] - stretch.q[~stretch.given, joint]).min() > 0.2 * beyond[joint]
    off, turned = measured(chain, tool_path, stretch.s, stretch.q)
    assert off.max() < 1e-9
    assert turned.max() < 1e-9


def test_a_lifted_transition_at_a_limit_can_be_executed() -> None:
    data = qparm.Cell.load(ROOT / "examples" / "dome.toml").to_dict()
    data["workpiece"]["elevation"] = ["50 deg", "60 deg"]
    data["process"].update(rows=3, points=31, self_motion={"points": 0, "transition": "lift", "lift": "30 mm"})
    plan = qparm.plan(data)
    assert qparm.report(plan).executable, qparm.report(plan).reasons
