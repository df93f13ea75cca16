"""The report judges the feed as `verify_motion` judges a file of the same motion."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import qparm
from conftest import few_rows
from qparm.verify.feed import FeedFigures, measure_feed
from qparm.verify.readers import read_motion


@pytest.fixture(scope="module")
def plan() -> qparm.Plan:
    return qparm.plan(few_rows())


@pytest.mark.parametrize(("feed", "what"), [(20.0, ""), (20.3, "slow for no joint's sake"), (19.7, "too fast")])
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
    assert {fault.row for fault in report.figures.feed.faults} == ({0, 1, 2} if what else set())
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


def motion(feed: float, dip: float, at: float) -> FeedFigures:
    """Return the figures of 40 s at a feed, slower by a share at a time, 50 ms before a joint is at a limit for 1 s."""
    t = np.arange(0.0, 40.0, 0.004)
    speed = feed * (
        1.0 - np.where((t >= 20.0) & (t < 21.0), 0.3, 0.0) - np.where((t >= at) & (t < at + 0.02), dip, 0.0)
    )
    s = np.concatenate([[0.0], np.cumsum(0.004 * speed)[:-1]])
    figures = measure_feed(t, s, feed, 0.0, (t, np.where((t >= 20.0) & (t < 21.0), 1.0, 0.1)))
    assert figures is not None
    return figures


@pytest.mark.parametrize("feed", [0.02, 0.3])
@pytest.mark.parametrize(
    ("dip", "at", "kept"),
    [(0.004, 19.95, True), (0.006, 19.95, False), (0.004, 19.8, False), (0.004, 10.0, False), (0.004, 21.05, True)],
)
def test_only_next_to_a_slow_down_the_speed_may_ripple(feed: float, dip: float, at: float, kept: bool) -> None:
    assert (motion(feed, dip, at).too_slow == ()) == kept


@pytest.mark.parametrize(("feed", "way"), [(0.02, 0.01), (0.01, 0.01), (0.1, 0.05), (0.3, 0.15)])
def test_the_ends_of_a_row_are_half_a_second_at_the_feed_or_a_centimetre(feed: float, way: float) -> None:
    assert motion(feed, 0.004, way / feed - 0.1).too_slow == ()
    assert motion(feed, 0.004, way / feed + 0.1).too_slow


def test_rows_of_two_points_are_no_trouble() -> None:
    plan = qparm.plan(few_rows(rows=2, points=2))
    assert qparm.report(plan).figures.feed.faults == ()
