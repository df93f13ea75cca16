"""The report judges the feed as `verify_motion` judges a file of the same motion."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import qparm
from conftest import few_rows
from qparm.timing import quintic_trajectory, ruckig_trajectory
from qparm.verify.feed import FeedFigures, LimitShares, SpeedTrace, judge_feed
from qparm.verify.readers import read_motion

SLOW = "slower than the feed although no joint limit requires it"


@pytest.fixture(scope="module")
def plan() -> qparm.Plan:
    return qparm.plan(few_rows())


@pytest.mark.parametrize(
    ("feed", "what"),
    [(20.0, ""), (20.3, SLOW), (19.7, "faster than the feed")],
)
@pytest.mark.slow
def test_report_and_verify_agree_on_the_feed(plan: qparm.Plan, tmp_path: Path, feed: float, what: str) -> None:
    data = few_rows(feed=f"{feed} mm/s")
    judged = replace(plan, cell=qparm.Cell.load(data))
    report = qparm.report(judged)
    qparm.write(judged, tmp_path)
    file = tmp_path / "trajectory.csv"
    verified = qparm.verify_motion(read_motion(file, judged.cell), judged.cell)
    faults = [one for one in verified.findings if "feed" in one.what]
    assert report.executable == (not what)
    assert bool(faults) == bool(what)
    assert {row for row, fault in report.figures.feed.faults} == ({0, 1, 2} if what else set())
    assert all(what in one.what for one in faults)
    assert [one for one in report.verdict.findings if one.code == "feed"] == [
        one for one in qparm.verify_motion(read_motion(tmp_path / "trajectory.json", judged.cell), judged.cell).findings
        if one.code == "feed"
    ]  # fmt: skip
    if what:
        assert report.figures.feed.deviation == pytest.approx(abs(20.0 / feed - 1), rel=0.02)
    else:
        assert report.figures.feed.deviation < 1e-3


@pytest.mark.parametrize("timing", ["quintic", "ruckig"])
@pytest.mark.parametrize("feed", [100, 150])
@pytest.mark.slow
def test_plan_and_verify_agree_on_fast_feeds(tmp_path: Path, feed: int, timing: Any) -> None:
    """The way in which the tool gets to the feed grows with it."""
    plan = qparm.plan(few_rows(feed=f"{feed} mm/s"), timing=timing)
    report = qparm.report(plan)
    assert report.figures.feed.faults == ()
    qparm.write(plan, tmp_path)
    for name in ("trajectory.csv", "trajectory.json"):
        verified = qparm.verify_motion(read_motion(tmp_path / name, plan.cell), plan.cell)
        assert [one for one in verified.findings if "feed" in one.what] == []
        assert verified.kept == report.executable


def figures(speed: np.ndarray, *, feed: float = 0.02, limits: list[tuple[float, float]] | None = None) -> FeedFigures:
    """Return the figures of 40 s at speeds (10,001,) over the feed, a joint being at a limit at times (from, to)."""
    t = np.linspace(0.0, 40.0, len(speed))
    spans = np.array([(-2.0, -1.0), *(limits or [])])
    share = np.zeros((3, len(spans), 2))
    share[0, 1:, 1] = 1.0
    found = judge_feed(
        SpeedTrace(t, feed * speed, *np.zeros((2, len(t)))), feed, LimitShares(spans[:, 0], spans[:, 1], share), 0.02
    )
    assert found is not None
    return found


def dipped(depth: float, first: float, last: float) -> np.ndarray:
    t = np.linspace(0.0, 40.0, 10_001)
    return 1.0 - depth * ((t >= first) & (t <= last))


@pytest.mark.parametrize(
    ("speed", "limits", "kept"),
    [
        (dipped(0.3, 20.0, 21.0), [], False),
        (dipped(0.3, 20.0, 21.0), [(20.0, 21.0)], True),
        (dipped(0.3, 20.0, 21.0), [(20.4, 20.6)], False),
        (dipped(0.3, 20.0, 21.0), [(20.1, 20.2), (20.4, 20.6), (20.8, 20.9)], True),
        (dipped(0.002, 20.0, 20.02), [], False),
        (dipped(0.0005, 20.0, 21.0), [], True),
        (dipped(0.002, 20.0, 20.02), [(20.1, 20.2)], True),
    ],
)
def test_the_tool_may_be_slower_only_while_a_joint_is_at_a_limit(
    speed: np.ndarray, limits: list[tuple[float, float]], kept: bool
) -> None:
    found = figures(speed, feed=0.3, limits=limits)
    assert found.too_fast is None
    if kept:
        assert found.too_slow is None
    else:
        assert found.too_slow is not None
        assert found.too_slow.speed == pytest.approx(0.3 * speed.min())


@pytest.mark.parametrize("at", [0.01, 20.0, 39.99])
def test_the_tool_is_never_faster_at_ends_of_rows_or_beside_a_limit(at: float) -> None:
    speed = 1.0 - dipped(0.002, at, at + 0.004) + 1.0
    found = figures(speed, limits=[(at - 0.1, at + 0.1)])
    assert found.too_fast is not None
    assert found.too_fast.time == pytest.approx(at, abs=0.005)
    assert found.largest == pytest.approx(0.02 * 1.002)


def test_the_slowest_place_lies_between_the_run_ups_and_names_what_binds() -> None:
    t = np.linspace(0.0, 40.0, 10_001)
    ends = np.minimum(np.minimum(t, 40.0 - t) / 2.0, 1.0)
    found = figures(np.minimum(ends, dipped(0.4, 20.0, 24.0)), limits=[(20.0, 24.0)])
    assert found.slowest is not None
    assert (found.slowest.joint, found.slowest.limit, found.slowest.share) == (1, "velocity", 1.0)
    assert found.slowest.speed == pytest.approx(0.6 * 0.02)
    assert found.kept / found.way == pytest.approx(32.0 / (2 * 1.0 + 32.0 + 4 * 0.6), abs=2e-3)
    # what never reaches the feed has no place between its run-ups
    short = figures(0.4 * np.minimum(t, 40.0 - t) / 20.0, limits=[(0.0, 40.0)])
    assert short.slowest is None or short.slowest.speed == pytest.approx(0.4 * 0.02, rel=1e-2)
    assert short.kept == 0.0
    assert short.too_slow is None


def timed_at(plan: qparm.Plan, feed: float, timing: str) -> qparm.Plan:
    """Return the plan's path timed at another feed (mm/s)."""
    cell = qparm.Cell.load(few_rows(feed=f"{feed} mm/s"))
    make = {"quintic": quintic_trajectory, "ruckig": ruckig_trajectory}[timing]
    trajectory = make(plan.chain, plan.joint_path, feed=feed * 1e-3)
    return replace(plan, cell=cell, trajectory=trajectory)


@pytest.mark.parametrize("timing", ["quintic", "ruckig"])
@pytest.mark.slow
def test_any_feed_is_judged_rightly_and_durations_never_rise_with_it(plan: qparm.Plan, timing: str) -> None:
    """From a feed that is kept nearly everywhere to one that no row ever reaches."""
    durations, kept = [], []
    for feed in (20.0, 60.0, 150.0, 400.0, 1000.0):
        timed = timed_at(plan, feed, timing)
        found = qparm.report(timed).figures.feed
        assert found.faults == ()
        assert max(row.largest for row in found.rows) < feed * 1e-3 * 1.001
        durations.append(timed.trajectory.duration)
        kept.append(found.kept)
    assert (np.diff(durations) <= 1e-9 * durations[0]).all()
    assert (np.diff(kept) <= 0).all()
    assert kept[0] > 0.98
    assert kept[-1] == 0.0


@pytest.mark.parametrize("feed", [20.0, 60.0, 150.0])
@pytest.mark.slow
def test_a_motion_drawn_out_in_time_is_refused(plan: qparm.Plan, tmp_path: Path, feed: float) -> None:
    timed = timed_at(plan, feed, "quintic")
    slower = replace(timed, trajectory=timed.trajectory.scaled(1 / 0.9))
    assert {row for row, fault in qparm.report(slower).figures.feed.faults} == {0, 1, 2}
    qparm.write(slower, tmp_path)
    for name in ("trajectory.csv", "trajectory.json"):
        verified = qparm.verify_motion(read_motion(tmp_path / name, slower.cell), slower.cell)
        slow = [one for one in verified.findings if SLOW in one.what]
        assert len(slow) == 3
        assert all(one.amount < 0.91 * feed * 1e-3 for one in slow)


@pytest.mark.parametrize("stand_off", ["0 mm", "50 mm"])
@pytest.mark.slow
def test_the_feed_is_the_speed_of_the_tool_point(stand_off: str) -> None:
    """Measured apart from everything: by differences of the arm's poses at times of their own."""
    plan = qparm.plan(few_rows(stand_off=stand_off))
    found = qparm.report(plan).figures
    for segment in plan.trajectory.segments:
        if segment.process_on:
            t = np.linspace(segment.start, segment.end, 4001)[1:-1]
            ahead, behind = (plan.chain.forward(plan.trajectory(t + d))[:, :3, 3] for d in (1e-4, -1e-4))
            speed = np.linalg.norm(ahead - behind, axis=1) / 2e-4
            assert speed.max() < 0.02 * (1 + 5e-4)
            assert np.median(speed) == pytest.approx(0.02, rel=2e-4)
    assert found.tool_speed_max == pytest.approx(0.02, rel=5e-4)
    assert found.feed.faults == ()


def test_the_highest_feed_of_a_row_is_that_which_its_curve_allows(plan: qparm.Plan) -> None:
    """Compared with the largest derivatives of the rows' curves, looked at closely."""
    rows = {row.row: row for row in qparm.report(plan).figures.feed.rows}
    table = np.stack([plan.chain.velocity, plan.chain.acceleration, plan.chain.jerk])
    for index, segment in enumerate(plan.joint_path.segments):
        if not segment.process_on:
            continue
        curve, s = plan.joint_path.curve(index), plan.joint_path.parameters[index]
        fine = np.linspace(s[0], s[-1], 40_001)
        speeds = np.stack([(table[k - 1] / np.abs(curve(fine, k)).max(axis=0)) ** (1 / k) for k in (1, 2, 3)])
        order, joint = divmod(int(speeds.argmin()), speeds.shape[1])
        row = rows[segment.row]
        assert row.highest_feed == pytest.approx(speeds.min(), rel=1e-6)
        assert row.highest_joint == plan.chain.names[joint]
        assert row.highest_limit == ("velocity", "acceleration", "jerk")[order]
    lowest = min(row.highest_feed for row in rows.values())
    assert qparm.report(plan).figures.feed.highest == lowest


def test_the_report_says_where_the_feed_gives_way(plan: qparm.Plan) -> None:
    timed = timed_at(plan, 300.0, "quintic")
    report = qparm.report(timed)
    found = report.figures.feed
    slowest = min((row for row in found.rows if row.joint), key=lambda row: row.slowest)
    (line,) = [line for line in report.text().splitlines() if line.startswith("feed ")]
    assert f"kept on {found.kept:.0%} of the way" in line
    assert f"row {slowest.row}: joint {slowest.joint}, {slowest.slowest * 1e3:.3g} mm/s at worst" in line
    data = report.to_dict()["measured"]["feed"]
    assert len(data["rows"]) == 3
    assert {"kept", "slowest", "joint", "limit", "highest_feed", "highest_joint"} <= set(data["rows"][0])
    # no slower than the limits ask: what binds is at its limit there
    assert slowest.slowest >= slowest.highest_feed * 0.97
    # and a feed that is kept has nothing to say of joints
    kept = qparm.report(plan)
    (line,) = [line for line in kept.text().splitlines() if line.startswith("feed ")]
    assert "joint" not in line.split(";")[0]


def test_rows_of_two_points_are_no_trouble() -> None:
    plan = qparm.plan(few_rows(rows=2, points=2))
    assert qparm.report(plan).figures.feed.faults == ()
