"""The report judges the feed as `verify_motion` judges a file of the same motion."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import qparm
from conftest import few_rows
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
    faults = [one for one in verified.violations if "feed" in one.what]
    assert report.executable == (not what)
    assert bool(faults) == bool(what)
    assert {fault.row for fault in report.figures.feed.faults} == ({0, 1, 2} if what else set())
    assert all(what in sentence for sentence in report.figures.feed.problems())
    if what:
        assert report.figures.feed.deviation == pytest.approx(abs(20.0 / feed - 1), rel=0.02)
    else:
        assert report.figures.feed.deviation < 1e-3


def test_rows_of_two_points_are_no_trouble() -> None:
    plan = qparm.plan(few_rows(rows=2, points=2))
    assert qparm.report(plan).figures.feed.faults == ()
