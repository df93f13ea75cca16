"""Rows and turns as one curve: without a stop, on the surface between waypoints too, at the feed to the rows' ends."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import qparm
from conftest import cell_data, few_rows
from qparm.path import SegmentKind
from qparm.robot import MotionLimits
from qparm.timing import quintic_trajectory, ruckig_trajectory

FORMS = {"quintic": quintic_trajectory, "ruckig": ruckig_trajectory}


@pytest.fixture(scope="module")
def flowing() -> qparm.Plan:
    return qparm.plan(few_rows(self_motion={"row_end": "flow"}))


def test_all_rows_and_turns_are_one_run(flowing: qparm.Plan) -> None:
    path = flowing.joint_path
    (run,) = [run for run in path.runs if len(run) > 1]
    kinds = [path.segments[index].kind for index in run]
    assert kinds == [SegmentKind.ROW, SegmentKind.TRANSITION] * 2 + [SegmentKind.ROW]
    assert [path.segments[index].flows for index in run] == [True] * 4 + [False]
    assert not any(motion.kind is SegmentKind.BREAK for motion in flowing.breaks)


def test_the_curve_keeps_the_tool_on_rows_and_turns_and_is_smooth_where_they_meet(flowing: qparm.Plan) -> None:
    path, chain, tool_path = flowing.joint_path, flowing.chain, flowing.tool_path
    before = end = None
    for index, segment in enumerate(path.segments):
        if segment.kind not in (SegmentKind.ROW, SegmentKind.TRANSITION):
            continue
        s = np.linspace(path.parameters[index][0], path.parameters[index][-1], 1001)
        curve = path.curve(index)
        np.testing.assert_allclose(curve(path.parameters[index]), path.q[segment.first : segment.last + 1], atol=1e-11)
        if segment.kind is SegmentKind.ROW:
            target = tool_path.pose(segment.row, s)
        else:
            target = tool_path.pose_base_workpiece @ tool_path.transitions[segment.row].curve(s)
        E = chain.pose_error(chain.forward(curve(s)), target)
        assert np.linalg.norm(E[:, :3], axis=1).max() <= 5e-6
        assert np.linalg.norm(E[:, 3:], axis=1).max() <= 20e-6
        for order in range(5):
            here = curve(s[0], order)
            if before is not None:
                there = before(end, order)
                np.testing.assert_allclose(here, there, rtol=1e-6, atol=1e-6 * np.abs(there).max())
        before, end = curve, s[-1]


@pytest.mark.parametrize("form", FORMS)
def test_it_does_not_stop_and_keeps_limits_path_and_feed(flowing: qparm.Plan, form: str) -> None:
    chain, path, feed = flowing.chain, flowing.joint_path, 0.02
    trajectory = FORMS[form](chain, path, feed=feed)
    verified = trajectory.verify(MotionLimits.of(chain), path=path, chain=chain, tool_path=flowing.tool_path, feed=feed)
    assert verified.problems(share=1 + 1e-6, tool=5e-6) == ()
    rows = [segment for segment in trajectory.segments if segment.kind is SegmentKind.ROW]
    # the tool never stands between the first row's start and the last row's end
    t = np.linspace(rows[0].start + 0.2, rows[-1].end - 0.2, 20_001)
    d = 1e-4
    p = [chain.forward(trajectory(t + x))[:, :3, 3] for x in (-d, d)]
    speed = np.linalg.norm(p[1] - p[0], axis=1) / (2 * d)
    assert speed.min() > 0.99 * feed
    # at the feed to both ends of the row in the middle; profiles swing a little about it where they begin
    inside = (t > rows[1].start + 0.05) & (t < rows[1].end - 0.05)
    at_feed = np.abs(speed[inside] / feed - 1) <= 1e-3
    assert at_feed.all() if form == "quintic" else at_feed.mean() > 0.99
    lengths = sum(flowing.tool_path.rows[segment.row].length for segment in rows)
    assert sum(segment.end - segment.start for segment in rows) < lengths / feed + 0.3


def test_with_stops_at_the_row_ends_the_rows_take_longer(flowing: qparm.Plan) -> None:
    chain, path = flowing.chain, flowing.joint_path
    stopping = replace(path, segments=tuple(replace(segment, flows=False) for segment in path.segments))
    times = []
    for one in (path, stopping):
        segments = quintic_trajectory(chain, one, feed=0.02).segments
        times.append(sum(s.end - s.start for s in segments if s.kind is SegmentKind.ROW))
    assert times[0] + 0.15 < times[1]


def test_the_report_measures_the_curve_across_the_row_ends(flowing: qparm.Plan) -> None:
    report = qparm.report(flowing)
    assert report.executable, report.reasons
    between = report.figures.between
    rows, turns = (
        sum(segment.last - segment.first for segment in flowing.joint_path.segments if segment.kind is kind)
        for kind in (SegmentKind.ROW, SegmentKind.TRANSITION)
    )
    assert (between.gaps, between.transition_gaps) == (rows, turns)
    assert between.off_gaps == between.transition_off_gaps == 0
    timing = report.to_dict()["timing"]
    assert timing["intervals"] >= len(flowing.joint_path.q) - 1
    assert len(report.figures.feed.rows) == 3
    assert 0.0 <= timing["feed_lost"] < 0.3
    assert "s lost on rows" in report.text()


@pytest.mark.parametrize(
    ("rows", "points", "overrun"), [(3, 15, "10 mm"), (5, 15, "10 mm"), (3, 21, "10 mm"), (4, 61, "1 mm")]
)
@pytest.mark.slow
def test_coarse_rows_and_tight_turns_are_followed_as_with_stops(rows: int, points: int, overrun: str) -> None:
    """Waypoints were added on the limits, where no curve keeps them, and corners outweighed the rows in smoothing."""
    data = cell_data()
    data["process"] |= {"rows": rows, "points": points}
    stopping = qparm.plan(data)
    data["process"]["self_motion"] |= {"row_end": "flow", "overrun": overrun}
    plan = qparm.plan(data)
    assert not any(motion.kind is SegmentKind.BREAK for motion in (*plan.breaks, *stopping.breaks))
    (run,) = [run for run in plan.joint_path.runs if len(run) > 1]
    assert len(run) == 2 * rows - 1
    report = qparm.report(plan)
    assert report.executable, report.reasons
    assert min(row.kept for row in report.figures.feed.rows) > 0.98
    # what the rows bend is that of the rows by themselves
    assert plan.smoothing is not None
    assert stopping.smoothing is not None
    bends, given = (one.smoothing.second_differences[1] for one in (plan, stopping))
    # ... but for what it takes to lead into turns: 9 % more at most on these (root mean square)
    assert bends[0] < 1.1 * given[0]
    assert bends[1] < 1.3 * given[1]


def test_a_turn_that_the_arm_cannot_follow_is_left_at_rest() -> None:
    """Far beyond the rows the surface is out of reach: the arm lifts off there and goes on with the next row."""
    data = few_rows(rows=2, self_motion={"row_end": "flow", "overrun": "52 mm"})
    data["workpiece"] |= {"azimuth": ["40 deg", "60 deg"], "elevation": ["50 deg", "60 deg"]}
    plan = qparm.plan(data)
    assert qparm.report(plan).executable
    ends = [motion for motion in plan.breaks if motion.kind is SegmentKind.BREAK]
    assert ends
    assert all(motion.place == "row end" and not motion.failure for motion in ends)
    at_rest = [plan.trajectory.segments[run[-1]].end for run in plan.joint_path.runs]
    np.testing.assert_allclose(plan.trajectory(at_rest, 1), 0.0, atol=1e-9)
