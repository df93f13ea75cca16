"""The general method: what it reaches it reaches exactly, and what it does not is never hidden."""

from __future__ import annotations

from itertools import groupby, pairwise

import numpy as np

import qparm
from conftest import cell_data, few_rows
from qparm.ik import PoseStatus
from qparm.path import SegmentKind
from qparm.planning import problem_of
from qparm.planning.search.continuity import edge_is_continuous
from qparm.reach import ReachReason
from qparm.verify.kinematics import joint_transforms, rotation_angle


def test_every_point_has_a_waypoint_within_tolerance_or_is_recorded(general_plan: qparm.Plan) -> None:
    path, tool_path = general_plan.joint_path, general_plan.tool_path
    at = path.point[path.point >= 0]
    unreached = general_plan.record.unreached
    assert len(unreached) > 0, "the general method fails somewhere on this cell"
    np.testing.assert_array_equal(np.sort(np.concatenate([at, unreached])), np.arange(915))
    poses, _ = joint_transforms(general_plan.cell, path.q[path.point >= 0])
    targets = tool_path.poses[at]
    assert np.linalg.norm(poses[:, :3, 3] - targets[:, :3, 3], axis=1).max() <= 1e-8
    assert rotation_angle(targets[:, :3, :3] @ poses[:, :3, :3].transpose(0, 2, 1)).max() <= 1e-7
    assert general_plan.chain.within_limits(path.q).all()


def test_unreached_points_carry_a_true_status_and_reach(general_plan: qparm.Plan) -> None:
    record = general_plan.record
    poses, _ = joint_transforms(general_plan.cell, record.q_end)
    error = np.linalg.norm(poses[:, :3, 3] - general_plan.tool_path.poses[:, :3, 3], axis=1)
    for k, point in enumerate(record.points):
        assert (point.status is PoseStatus.REACHED) == (k not in general_plan.reach)
        np.testing.assert_allclose(point.position_error, error[k], atol=1e-9)
        if point.status is PoseStatus.AT_LIMITS:
            assert point.active_limits
    assert all(verdict.reason is ReachReason.WITHIN_REACH for verdict in general_plan.reach.values())


def test_gaps_and_jumps_are_breaks_and_nothing_else_is(general_plan: qparm.Plan) -> None:
    path, jump, broken = general_plan.joint_path, general_plan.cell.jump(), []
    for segment in path.segments:
        inside = path.q[segment.first : segment.last + 1]
        if segment.kind in (SegmentKind.ROW, SegmentKind.TRANSITION):
            assert (np.abs(np.diff(inside, axis=0)) <= jump).all()
        if segment.kind is SegmentKind.ROW:
            points = path.point[segment.first : segment.last + 1]
            # waypoints that are no points keep the curve on the surface
            np.testing.assert_array_equal(np.diff(points[points >= 0]), 1)
            assert (path.row[segment.first : segment.last + 1] == segment.row).all()
        if segment.kind is SegmentKind.BREAK:
            broken.append(segment)
    # a break is one motion in pieces: the tool leaves one point and comes back to another
    at = np.flatnonzero(path.point >= 0)
    for a, b in pairwise(at.tolist()):
        away = [segment for segment in broken if a <= segment.first and segment.last <= b]
        gap = path.point[b] > path.point[a] + 1
        assert bool(away) == (path.status[b] in ("after gap", "after jump"))
        assert not gap or path.status[b] == "after gap"
        if away and not gap and path.row[a] == path.row[b]:
            assert not edge_is_continuous(problem_of(general_plan.cell), general_plan.solution, int(path.point[a]))
    assert broken
    assert path.segments[0].kind is SegmentKind.APPROACH
    assert path.segments[-1].kind is SegmentKind.RETRACT
    np.testing.assert_array_equal(path.q[[0, -1]], [general_plan.cell.home()] * 2)
    assert not general_plan.trajectory.executable
    assert "points are not reached" in general_plan.trajectory.reasons[0]


def test_transitions_follow_the_surface(general_plan: qparm.Plan) -> None:
    path, cell = general_plan.joint_path, general_plan.cell
    via = np.array([kind is SegmentKind.TRANSITION for kind in path.kind])
    assert via.any()
    poses, _ = joint_transforms(cell, path.q[via])
    centre = cell.workpiece.pose.matrix()[:3, 3]
    assert np.abs(cell.workpiece.surface().distance(poses[:, :3, 3] - centre)).max() <= 1e-8


def test_a_step_over_the_criterion_that_can_be_followed_is_no_break() -> None:
    data = few_rows()
    data["process"] |= {"jump": "2 deg"}
    plan = qparm.plan(data, strategy="general")
    steps = np.abs(np.diff(plan.solution.q, axis=0))
    assert (steps > plan.cell.jump()).any(), "some steps are over a criterion of 2 deg"
    assert plan.solution.driven.all()
    assert plan.joint_path.breaks == ()


def test_a_path_without_failures_is_executable() -> None:
    plan = qparm.plan(few_rows(), strategy="general")
    assert plan.trajectory.executable
    assert plan.joint_path.breaks == ()
    report = qparm.report(plan)
    assert report.executable
    assert report.figures.reached == 33
    assert set(plan.joint_path.status) == {"reached"}
    # approach and retract are motions in pieces
    assert [kind for kind, _ in groupby(segment.kind.value for segment in plan.joint_path.segments)] == [
        "approach", "row", "transition", "row", "transition", "row", "retract",
    ]  # fmt: skip


def test_points_out_of_reach_are_named_with_their_reason() -> None:
    data = cell_data()
    data["workpiece"] |= {"azimuth": ["-75 deg", "75 deg"]}
    data["process"] |= {"rows": 3, "points": 76}
    plan = qparm.plan(data, strategy="general")
    beyond = [k for k, verdict in plan.reach.items() if verdict.reason is ReachReason.TOO_FAR]
    assert beyond
    assert all(plan.record.points[k].status is PoseStatus.UNREACHABLE for k in beyond)
    assert all(plan.reach[k].excess > 0 for k in beyond)
    text = qparm.report(plan).text()
    assert "too far: the wrist lies" in text


def test_nothing_reached_is_a_plan_too() -> None:
    data = cell_data()
    data["workpiece"]["pose"]["position"][1] = "9 m"
    data["process"] |= {"rows": 2, "points": 5}
    for timing in ("quintic", "ruckig"):
        plan = qparm.plan(data, strategy="general", timing=timing)
        assert plan.trajectory.duration == 0.0
        report = qparm.report(plan)
        assert report.figures.reached == 0
        assert "points reached      0 of 10" in report.text()
