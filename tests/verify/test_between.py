"""Between the waypoints: a waypoint moved by a hair is caught though it is no point of the raster."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import PPoly

import qparm
from conftest import few_rows
from qparm.path import SegmentKind
from qparm.timing import quintic_trajectory
from qparm.verify.between import BetweenFigures, measure_between
from qparm.verify.files import WaypointTable


def table_of(plan: qparm.Plan) -> WaypointTable:
    path = plan.joint_path
    return WaypointTable(
        joints=path.joint_names, index=path.point, row=path.row, kind=np.array([kind.value for kind in path.kind]),
        status=np.array(path.status), s=path.s, q=path.q,
    )  # fmt: skip


def measured(plan: qparm.Plan, waypoints: WaypointTable) -> BetweenFigures:
    return measure_between(plan.cell, waypoints, plan.tool_path)


@pytest.fixture(scope="module")
def plan() -> qparm.Plan:
    return qparm.plan(few_rows(points=9))


def test_a_plan_is_exact_between_its_points(plan: qparm.Plan) -> None:
    figures = measured(plan, table_of(plan))
    assert figures.off_gaps == 0
    assert 0 < figures.position <= plan.cell.process.position_between
    assert 0 < figures.rotation <= plan.cell.process.rotation_between
    # many controllers interpolate linearly: that is another figure
    assert figures.linear_position > 20 * figures.position
    on_rows = [segment for segment in plan.joint_path.segments if segment.process_on]
    assert figures.gaps == sum(segment.last - segment.first for segment in on_rows)


def test_the_planner_and_the_measurement_agree(plan: qparm.Plan) -> None:
    """Each looks at places of its own, with a kinematics of its own."""
    rows = np.zeros(len(plan.joint_path.q) - 1, dtype=bool)
    for segment in plan.joint_path.segments:
        rows[segment.first : segment.last] = segment.process_on
    planned, figures = plan.joint_path.deviations, measured(plan, table_of(plan))
    assert planned is not None
    assert figures.position == pytest.approx(planned.curve_position[rows].max(), rel=0.1)
    assert figures.linear_position == pytest.approx(planned.linear_position[rows].max(), rel=0.1)
    assert figures.linear_rotation == pytest.approx(planned.linear_rotation[rows].max(), rel=0.1)
    assert np.isnan(planned.curve_position[0])


@pytest.mark.parametrize("joint", range(8))
def test_a_waypoint_moved_by_a_hair_is_caught(plan: qparm.Plan, joint: int) -> None:
    waypoints = table_of(plan)
    at = np.flatnonzero(waypoints.kind == "row")
    middle = int(at[len(at) // 2])
    q = waypoints.q.copy()
    q[middle, joint] += 1e-4
    figures = measured(plan, replace(waypoints, q=q))
    # the spline through the others feels it in the gaps beside it
    assert 2 <= figures.off_gaps <= 12
    assert figures.position > plan.cell.process.position_between or figures.rotation > 2e-5


def test_a_wrong_arc_length_is_caught(plan: qparm.Plan) -> None:
    waypoints = table_of(plan)
    at = np.flatnonzero(waypoints.kind == "row")
    s = waypoints.s.copy()
    s[at[5]] += 1e-4
    assert measured(plan, replace(waypoints, s=s)).off_gaps > 0


def test_a_break_is_no_gap(plan: qparm.Plan) -> None:
    """What is joined by a motion off the surface is not measured as a curve on it."""
    waypoints = table_of(plan)
    at = np.flatnonzero((waypoints.kind == "row") & (waypoints.row == 1))
    status = waypoints.status.astype("U12")
    status[at[4]] = "after jump"
    assert measured(plan, replace(waypoints, status=status)).gaps == measured(plan, waypoints).gaps - 1


def test_nothing_on_rows_is_told_as_nothing(plan: qparm.Plan) -> None:
    waypoints = table_of(plan)
    figures = measured(plan, replace(waypoints, kind=np.full(len(waypoints.q), "break")))
    assert figures.gaps == figures.off_gaps == 0
    assert np.isnan(figures.position)


def test_linear_interpolation_is_exact_where_it_was_asked_for() -> None:
    plan = qparm.plan(few_rows(points=9), for_linear=True)
    figures = measured(plan, table_of(plan))
    assert figures.linear_position <= plan.cell.process.position_between
    assert figures.linear_rotation <= plan.cell.process.rotation_between
    assert qparm.report(plan).executable


def test_an_altered_transition_is_seen_by_the_report(plan: qparm.Plan) -> None:
    """No point of the raster and no row knows of it."""
    path = plan.joint_path
    turn = next(one for one in path.segments if one.kind is SegmentKind.TRANSITION)
    assert turn.last - turn.first > 2
    q = path.q.copy()
    q[(turn.first + turn.last) // 2, 3] += 1e-4
    altered = replace(plan, joint_path=replace(path, q=q))
    trajectory = quintic_trajectory(plan.chain, altered.joint_path, feed=plan.cell.process.feed)
    report = qparm.report(replace(altered, trajectory=trajectory))
    assert not report.executable
    figures = report.figures.between
    assert figures.off_gaps == 0 < figures.transition_off_gaps
    assert any(one.code == "path" and "on transition after row" in one.place for one in report.verdict.findings)


def test_a_trajectory_that_leaves_a_transition_between_its_waypoints_is_seen_by_the_report(plan: qparm.Plan) -> None:
    """Though path and waypoints are right: a bump of 30 urad in one piece of one joint, joined with two derivatives."""
    turn = next(one for one in plan.trajectory.segments if one.kind is SegmentKind.TRANSITION)
    joint = 3
    polynomial = plan.trajectory.polynomials[joint]
    # a long one, which samples meet
    own = np.flatnonzero((polynomial.x[:-1] >= turn.start) & (polynomial.x[1:] <= turn.end))
    k = int(own[np.diff(polynomial.x)[own].argmax()])
    h = polynomial.x[k + 1] - polynomial.x[k]
    c = np.concatenate([np.zeros((1, polynomial.c.shape[1])), polynomial.c])
    c[:, k] += np.polymul(np.polymul([-1, h, 0], [-1, h, 0]), [-1, h, 0]) * 64 * 3e-5 / h**6
    polynomials = list(plan.trajectory.polynomials)
    polynomials[joint] = PPoly(c, polynomial.x)
    report = qparm.report(replace(plan, trajectory=replace(plan.trajectory, polynomials=tuple(polynomials))))
    assert not report.executable
    assert report.figures.between.off_gaps == report.figures.between.transition_off_gaps == 0
    assert report.figures.waypoint_deviation < 1e-8
    assert "files-differ" in [one.code for one in report.verdict.findings], "the points alone cannot tell it"
