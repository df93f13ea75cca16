"""The reverse strategy: what it calls reached is exact, what it calls free of jumps is, and each branch is taken."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import qparm
from conftest import cell_data
from qparm.errors import InvalidInput
from qparm.ik import PoseStatus
from qparm.path import Row, ToolPath, Transition
from qparm.planning import PathProblem, problem_of
from qparm.planning.paper.follow import Follower, Stop
from qparm.planning.paper.jump import jump_criteria
from qparm.planning.paper.reverse import reverse
from qparm.planning.paper.reverse_record import Repair, ReversePath
from qparm.robot import Joint, SerialChain
from qparm.verify.kinematics import joint_transforms, rotation_angle

POSITION, ROTATION = 1e-8, 1e-7


def plan_cell(cell: qparm.Cell, seed: int = 0, **options: Any) -> ReversePath:
    return reverse(held_to(problem_of(cell, seed=seed)), **options)


def held_to(problem: PathProblem) -> PathProblem:
    return replace(problem, position_tolerance=POSITION, rotation_tolerance=ROTATION)


def small_dome(**process: Any) -> qparm.Cell:
    data = cell_data()
    data["process"] |= {"rows": 2} | process
    return qparm.Cell.load(data)


# --- a small arm whose elbow decides ------------------------------------------------------------------------

ELBOW = np.radians(50.0)


def turn(angle: float, x: float = 0.0, y: float = 0.0) -> NDArray[np.float64]:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0, x], [s, c, 0.0, y], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])


@cache
def planar_arm(wrist: float = 60.0) -> SerialChain:
    """Return two links of 1 m and a wrist that turns by so many degrees: two solutions a pose, elbow up and down."""
    names, lengths = ("shoulder", "elbow", "wrist"), (0.0, 1.0, 1.0)
    limits = (np.pi / 2, np.pi / 2, np.radians(wrist))
    joints = tuple(
        Joint(name, "revolute", turn(0.0, length), (-limit, limit), 1.0, 3.0, 30.0)
        for name, length, limit in zip(names, lengths, limits, strict=True)
    )
    return SerialChain("planar", joints, np.eye(4), np.eye(4), characteristic_length=1.0)


def turning_rows(*rows: tuple[float, float, int], self_motion_points: int = 0) -> ToolPath:
    """Return rows (first angle, last angle, points) in which the tool turns where it stands.

    With the elbow bent by 50 degrees one family holds the wrist at the row's angle (degrees), the other at 50 less.
    """
    reach = 2.0 * np.cos(ELBOW / 2)

    def row(first: float, last: float, points: int) -> Row:
        s = np.linspace(0.0, 0.01 * (points - 1), points)
        angles = np.radians(np.linspace(first, last, points)) - ELBOW / 2
        poses = np.array([turn(angle, reach) for angle in angles])
        return Row(s, poses, lambda _: poses)

    made = tuple(row(*one) for one in rows)
    between = Transition(0.01, np.empty(0), np.empty((0, 4, 4)), lambda _: np.empty((0, 4, 4)), lifted=False)
    return ToolPath(made, (between,) * (len(made) - 1), np.eye(4), self_motion_points)


def plan_turning(tool_path: ToolPath, arm: SerialChain | None = None, **options: Any) -> ReversePath:
    arm = planar_arm() if arm is None else arm
    problem = PathProblem(arm, tool_path, np.zeros(3), options.pop("jump", np.full(3, np.radians(20.0))), seed=3)
    path = reverse(held_to(problem), **options)
    require_true(path, arm, tool_path, problem.criteria)
    return path


def repairs(path: ReversePath) -> list[tuple[Repair, int, int]]:
    return [(jump.repair, jump.row, jump.place) for jump in path.statistics.jumps]


def require_true(path: ReversePath, arm: SerialChain, tool_path: ToolPath, criteria: NDArray[np.float64]) -> None:
    """Require what every plan must keep: reached is exact and within limits, jumps inside rows are breaks."""
    E = arm.pose_error(arm.forward(path.q), tool_path.poses)[path.reached]
    assert np.linalg.norm(E[:, :3], axis=1).max(initial=0.0) <= POSITION
    assert np.linalg.norm(E[:, 3:], axis=1).max(initial=0.0) <= ROTATION
    assert arm.within_limits(path.q).all()
    ratio = (np.abs(np.diff(path.q, axis=0)) / criteria).max(axis=1)
    both = path.reached[1:] & path.reached[:-1] & (np.diff(tool_path.row_of_point) == 0)
    np.testing.assert_array_equal(path.breaks, np.flatnonzero(both & (ratio > 1)) + 1)
    for k, point in enumerate(path.points):
        assert (point.status is PoseStatus.REACHED) == path.reached[k]
        E = arm.pose_error(arm.forward(path.q[k]), tool_path.poses[k])
        np.testing.assert_allclose([point.position_error, point.rotation_error],
                                   [np.linalg.norm(E[:3]), np.linalg.norm(E[3:])], atol=1e-12)  # fmt: skip


def test_a_row_that_can_be_followed_is() -> None:
    path = plan_turning(turning_rows((0.0, 40.0, 21)))
    assert path.reached.all()
    assert repairs(path) == []
    assert path.statistics.poses_solved == 50 + 21


def test_reverse_planning_moves_the_jump_to_the_rows_start() -> None:
    """The wrist starts in its middle and ends beyond its limit, 60 degrees; with the other elbow it fits."""
    path = plan_turning(turning_rows((1.0, 81.0, 41)))
    assert path.reached.all()
    assert repairs(path) == [(Repair.REVERSE, 0, 30)]
    (jump,) = path.statistics.jumps
    assert (jump.step, jump.moved_to, jump.moved_step) == (None, 0, None)
    np.testing.assert_allclose(np.degrees(path.q[[0, -1], 2]), [-49.0, 31.0], atol=1e-4)


def test_a_moved_jump_is_reported_with_its_size_at_the_row_end() -> None:
    path = plan_turning(turning_rows((0.0, 10.0, 6), (10.0, 0.0, 6), (1.0, 81.0, 41)))
    assert repairs(path) == [(Repair.REVERSE, 2, 30)]
    statistics = path.statistics
    (jump,) = statistics.jumps
    assert jump.moved_to == 12
    assert jump.moved_step == statistics.row_ends[1]
    assert jump.moved_step is not None
    assert jump.moved_step.joint == "elbow"
    assert np.degrees(jump.moved_step.size) == pytest.approx(100.0, abs=0.1)
    assert jump.moved_step.ratio == pytest.approx(5.0, abs=0.01)
    assert statistics.row_end_reconfigurations == 1
    assert statistics.count(Repair.REVERSE) == 1


@pytest.mark.parametrize("options", [{}, {"join": False}, {"solver": "proxqp"}, {"method": "dls"}])
def test_where_neither_elbow_fits_the_whole_row_it_breaks_once(options: dict[str, Any]) -> None:
    tool_path = turning_rows((-20.0, 100.0, 41))
    path = plan_turning(tool_path, **options)
    assert path.reached.all()
    assert repairs(path) == [(Repair.SACRIFICE, 0, 27)]
    np.testing.assert_array_equal(path.breaks, [27])
    assert not path.breaks_in_area.any()


def test_a_break_may_lie_in_a_self_motion_area_inside_the_row() -> None:
    """The second row's start fits one elbow only: reverse planning ends among its first points, and may."""
    rows = ((0.0, 0.0, 6), (-20.0, 100.0, 41))
    path = plan_turning(turning_rows(*rows, self_motion_points=6))
    assert repairs(path) == [(Repair.REVERSE, 1, 27)]
    np.testing.assert_array_equal(path.breaks, [6 + 4])
    assert path.breaks_in_area.all()
    assert path.statistics.jumps[0].moved_to == 10
    assert repairs(plan_turning(turning_rows(*rows))) == [(Repair.SACRIFICE, 1, 27)]


def test_a_jump_met_in_a_self_motion_area_is_left_there() -> None:
    path = plan_turning(turning_rows((-20.0, 70.0, 31), (70.0, 100.0, 11), self_motion_points=6))
    assert repairs(path) == [(Repair.AT_ROW_END, 0, 27)]
    np.testing.assert_array_equal(path.breaks, [27])
    assert path.breaks_in_area.all()


def test_a_jump_left_in_a_self_motion_area_is_not_searched_for_a_way_round() -> None:
    tool_path = turning_rows((0.0, 20.0, 11), (20.0, 0.0, 11), self_motion_points=4)
    criteria = np.full((21, 3), np.radians(20.0))
    criteria[12] = np.radians(0.5)  # the steps are 2 degrees
    path = plan_turning(tool_path, jump=criteria)
    (jump,) = path.statistics.jumps
    assert (jump.repair, jump.point, jump.tries, jump.moved_to) == (Repair.AT_ROW_END, 13, 0, 13)
    assert jump.step is not None
    assert jump.moved_step is not None
    assert jump.step.ratio == pytest.approx(4.0)
    assert jump.moved_step.ratio == pytest.approx(4.0)
    np.testing.assert_array_equal(path.breaks, [13])


@pytest.mark.parametrize(("first", "last", "passed"), [(5, 2, [5, 4]), (2, 5, [2, 3])])
def test_an_edge_has_one_criterion_whichever_way_it_is_followed(first: int, last: int, passed: list[int]) -> None:
    tool_path = turning_rows((0.0, 20.0, 11))
    q = plan_turning(tool_path).q
    criteria = np.full((11, 3), np.radians(20.0))
    criteria[4] = np.radians(0.5)  # the edge between points 3 and 4
    for method in ("cwln", lambda chain, q, step: step):
        follower = Follower(
            planar_arm(), tool_path.poses, method=method, solver="auto",
            position_tolerance=POSITION, rotation_tolerance=ROTATION,
        )  # fmt: skip
        followed = follower.follow(q[first + (1 if last < first else -1)], first, last, criteria)
        assert followed.stop is Stop.JUMP
        np.testing.assert_allclose(followed.q, q[passed], atol=1e-6)
        assert followed.met[-1].max() == pytest.approx(np.radians(2.0))


def test_across_a_gap_no_jump_is_tested() -> None:
    tool_path = turning_rows((0.0, 50.0, 26))
    tool_path.poses[5:16, 0, 3] = 2.5
    path = plan_turning(tool_path)  # 24 degrees from one side to the other
    assert {jump.repair for jump in path.statistics.jumps} == {Repair.UNREACHED}
    assert int((~path.reached).sum()) == len(path.statistics.jumps) == 11


def test_an_unreachable_pose_is_a_gap_and_the_row_goes_on_behind_it() -> None:
    tool_path = turning_rows((-20.0, 100.0, 41))
    for k in (28, 29):
        tool_path.poses[k, 0, 3] = 2.5
    path = plan_turning(tool_path)
    np.testing.assert_array_equal(np.flatnonzero(~path.reached), [28, 29])
    assert path.points[28].status is PoseStatus.UNREACHABLE
    # the elbow changes twice: at the limit before the gap, and nowhere behind it
    assert repairs(path)[0] == (Repair.SACRIFICE, 0, 27)
    assert [one for one in repairs(path) if one[0] is Repair.UNREACHED] == [
        (Repair.UNREACHED, 0, 28), (Repair.UNREACHED, 0, 29),
    ]  # fmt: skip
    np.testing.assert_array_equal(path.breaks, [27])


def test_a_gap_takes_the_jump_that_would_else_be_a_break() -> None:
    tool_path = turning_rows((-20.0, 100.0, 41))
    tool_path.poses[26:28, 0, 3] = 2.5
    path = plan_turning(tool_path)
    np.testing.assert_array_equal(np.flatnonzero(~path.reached), [26, 27])
    assert len(path.breaks) == 0
    assert repairs(path)[-1] == (Repair.RESTART, 0, 28)


def test_reverse_planning_may_end_at_a_gap() -> None:
    """Behind the gap both elbows fit; the one that is kept dead-ends, and the row is planned anew from the gap on."""
    tool_path = turning_rows((-20.0, 100.0, 41))
    tool_path.poses[15, 0, 3] = 2.5
    path = plan_turning(tool_path)
    assert repairs(path) == [(Repair.UNREACHED, 0, 15), (Repair.REVERSE, 0, 27)]
    assert len(path.breaks) == 0
    assert path.statistics.jumps[1].moved_to == 16
    assert path.statistics.jumps[1].moved_step is None


def test_nothing_reached_is_a_path_too() -> None:
    tool_path = turning_rows((0.0, 10.0, 3), (10.0, 0.0, 3))
    tool_path.poses[:, 0, 3] = 2.5
    path = plan_turning(tool_path)
    assert not path.reached.any()
    assert path.statistics.row_ends == (None,)
    assert path.statistics.row_end_reconfigurations == 0


# --- the reference arm --------------------------------------------------------------------------------------


def test_self_motion_repairs_near_misses() -> None:
    """With this seed the bounded steps take joint 5 by 55 to 68 degrees, three times in a row."""
    cell = small_dome()
    path = plan_cell(cell, seed=12)
    repaired = [jump for jump in path.statistics.jumps if jump.repair is Repair.SELF_MOTION and not jump.tries]
    assert len(repaired) >= 3
    criteria = jump_criteria(cell.chain(), cell.tool_path(), cell.jump(), feed=cell.process.feed)
    for jump in repaired:
        assert jump.step is not None
        assert jump.step.ratio > 1
        assert jump.step.size == pytest.approx(
            jump.step.ratio * criteria[jump.point - 1, cell.chain().index(jump.step.joint)]
        )
        assert (np.abs(path.q[jump.point] - path.q[jump.point - 1]) <= criteria[jump.point - 1]).all()
    require_true(path, cell.chain(), cell.tool_path(), criteria)


def test_rows_are_free_of_jumps_exact_and_within_limits(dome: qparm.Cell) -> None:
    """Measured by the verifier's own kinematics, against both forms of the criterion."""
    tool_path = dome.tool_path()
    path = plan_cell(dome)
    assert path.reached.all()
    assert len(path.breaks) == 0
    poses, _ = joint_transforms(dome, path.q)
    assert np.linalg.norm(poses[:, :3, 3] - tool_path.poses[:, :3, 3], axis=1).max() <= POSITION
    R = tool_path.poses[:, :3, :3] @ poses[:, :3, :3].transpose(0, 2, 1)
    assert rotation_angle(R).max() <= 2 * ROTATION
    assert dome.chain().within_limits(path.q).all()
    inside = np.diff(tool_path.row_of_point) == 0
    steps = np.abs(np.diff(path.q, axis=0))[inside]
    seconds = np.abs(np.diff(tool_path.s))[inside] / dome.process.feed
    assert (steps <= dome.jump()).all()
    assert (steps <= dome.chain().velocity * seconds[:, None]).all()


def test_the_letter_of_the_paper_breaks_where_joining_does_not() -> None:
    cell = small_dome()
    joined, letter = plan_cell(cell), plan_cell(cell, join=False)
    assert Repair.JOINED in {jump.repair for jump in joined.statistics.jumps}
    assert len(joined.breaks) == 0
    assert len(letter.breaks) == 1
    for path in (joined, letter):
        criteria = jump_criteria(cell.chain(), cell.tool_path(), cell.jump(), feed=cell.process.feed)
        require_true(path, cell.chain(), cell.tool_path(), criteria)


def test_a_rule_of_ones_own_takes_the_same_way_as_the_compiled_one() -> None:
    cell = small_dome(points=31)
    ours = plan_cell(cell, method="dls")
    own = plan_cell(cell, method=lambda chain, q, step: step)
    assert ours.statistics.jumps
    assert repairs(own) == repairs(ours)
    np.testing.assert_allclose(own.q, ours.q, atol=1e-6)
    assert own.statistics.poses_solved == ours.statistics.poses_solved
    assert own.counts.total == pytest.approx(ours.counts.total, rel=0.01)


def test_the_same_seed_gives_the_same_path_and_another_seed_another() -> None:
    cell = small_dome(points=31)
    first, again, other = plan_cell(cell), plan_cell(cell), plan_cell(cell, seed=5)
    np.testing.assert_array_equal(first.q, again.q)
    assert first.statistics == again.statistics
    assert not np.array_equal(first.q, other.q)


def test_progress_is_told_row_by_row() -> None:
    told: list[tuple[int, int]] = []
    plan_cell(small_dome(points=11), progress=lambda *news: told.append(news))
    assert told == [(11, 22), (22, 22)]


# --- what is refused, and the criterion ---------------------------------------------------------------------


def test_the_criterion_is_the_smaller_of_the_angle_and_what_the_time_allows(dome: qparm.Cell) -> None:
    chain, tool_path = dome.chain(), dome.tool_path()
    criteria = jump_criteria(chain, tool_path, dome.jump(), feed=dome.process.feed)
    # a row end: so much for each step from one via pose to the next
    np.testing.assert_allclose(criteria[60], dome.jump() * (1 + len(tool_path.transitions[0].s)))
    assert len(tool_path.transitions[0].s) > 0
    np.testing.assert_allclose(criteria[0], dome.jump())  # 21 mm at 20 mm/s and 60 deg/s: 62 degrees
    seconds = np.radians(2.0) * 0.6 * np.cos(np.radians(60.0)) / 0.020
    np.testing.assert_allclose(criteria[-1], chain.velocity * seconds)
    assert (criteria[-1] < dome.jump()).all()


@pytest.mark.parametrize(
    ("jump", "words"),
    [
        (np.ones(7), r"jump must be \(8,\) or \(121, 8\)"),
        (np.zeros(8), "'d1': 0.0 is not positive"),
        (np.full((121, 8), np.nan), "edge 0, joint 'd1': nan"),
    ],
)
def test_a_criterion_that_is_none_is_refused(jump: NDArray[np.float64], words: str) -> None:
    with pytest.raises(InvalidInput, match=words):
        reverse(replace(problem_of(small_dome()), jump=jump))


@pytest.mark.parametrize("feed", [0.0, -1.0, np.nan])
def test_a_feed_that_is_none_is_refused(dome: qparm.Cell, feed: float) -> None:
    with pytest.raises(InvalidInput, match="feed must be"):
        jump_criteria(dome.chain(), dome.tool_path(), dome.jump(), feed=feed)
