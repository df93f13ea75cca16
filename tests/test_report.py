"""The report in words and as data: one name for each figure, all of them documented, and what is worth a warning."""

from __future__ import annotations

import re
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

import qparm
from conftest import ROOT, few_rows
from qparm.ik import StepCounts
from qparm.path import SegmentKind
from qparm.planning import BreakRecord, GraphRecord, ReverseStatistics, SearchCount, SmoothRecord
from qparm.planning.paper.reverse_record import MetJump, Step
from qparm.reports.warnings import limit_warnings
from qparm.reports.words import micrometres, microradians, time_words
from qparm.verify.clearance import LINKS_NOT_CHECKED, ClearanceFault
from qparm.verify.figures import Figures, JointFigures, Jump
from qparm.verify.row_feed import FeedFault


@pytest.fixture(scope="module")
def small_plan() -> qparm.Plan:
    return qparm.plan(few_rows())


@pytest.fixture(scope="module")
def small_report(small_plan: qparm.Plan) -> qparm.Report:
    return qparm.report(small_plan)


def keys_of(data: Any) -> set[str]:
    """Return every key of plain data, nested ones too."""
    if isinstance(data, list):
        return set().union(*(keys_of(value) for value in data))
    if isinstance(data, dict):
        return set(data).union(*(keys_of(value) for value in data.values()))
    return set()


def test_every_key_of_the_report_is_documented(small_report: qparm.Report) -> None:
    text = (ROOT / "docs" / "files.md").read_text(encoding="utf-8")
    documented = set(re.findall(r"`(\w+)`", text[text.index("**`report.json`**") : text.index("**Pictures**")]))
    data = small_report.to_dict()
    # what is in these is named by the cell, the packages, the joints and the stages
    data |= dict.fromkeys(("cell", "versions", "jump_criterion", "stages"))
    written = keys_of(data)
    parts = (Figures, JointFigures, Jump, FeedFault, ClearanceFault, BreakRecord, GraphRecord, SearchCount,
             ReverseStatistics, MetJump, Step, SmoothRecord, StepCounts)  # fmt: skip
    written |= {field.name for part in parts for field in fields(part)}
    assert len(written) > 100
    assert written <= documented, sorted(written - documented)


def test_times_of_motions_are_those_of_the_trajectory(small_plan: qparm.Plan, small_report: qparm.Report) -> None:
    driven = dict.fromkeys(SegmentKind, 0.0)
    for segment in small_plan.trajectory.segments:
        driven[segment.kind] += segment.end - segment.start
    assert [motion.kind for motion in small_plan.breaks] == [SegmentKind.APPROACH, SegmentKind.RETRACT]
    for motion, written in zip(small_plan.breaks, small_report.to_dict()["motions"], strict=True):
        assert motion.time == written["time"] == pytest.approx(driven[motion.kind], abs=1e-9)


def test_a_step_in_joints_and_one_scaled_by_velocity_have_names_of_their_own(small_report: qparm.Report) -> None:
    text = small_report.text()
    assert "largest velocity-scaled step" in text
    assert "\nlargest joint step  " in text
    assert "largest_step" not in small_report.to_dict()["smoothing"]


# --- warnings -------------------------------------------------------------------------------------------


def moved_limits(
    report: qparm.Report, joint: int, *, lower: float | None = None, upper: float | None = None
) -> tuple[str, ...]:
    """Return the warnings of a plan if one joint's limits lay so far (m, rad) from where the joint goes."""
    plan = report.plan
    q = plan.trajectory(plan.trajectory.boundaries)[:, joint]
    low, high = np.full(plan.chain.n, -9.0), np.full(plan.chain.n, 9.0)
    low[joint] = -9.0 if lower is None else q.min() - lower
    high[joint] = 9.0 if upper is None else q.max() + upper
    room = min(x for x in (lower, upper, 1.0) if x is not None)
    joints = tuple(
        replace(one, limit_distance_waypoints=room, limit_distance_trajectory=room)
        if k == joint
        else replace(one, limit_distance_waypoints=1.0, limit_distance_trajectory=1.0)
        for k, one in enumerate(report.figures.joints)
    )
    moved = replace(plan, chain=plan.chain.with_position_limits(low, high))
    return limit_warnings(replace(report.figures, joints=joints), moved)


def test_a_joint_near_its_limit_is_named_with_limit_and_distance(small_report: qparm.Report) -> None:
    upper = np.degrees(
        small_report.plan.trajectory(small_report.plan.trajectory.boundaries)[:, 4].max() + np.radians(0.05)
    )
    (sentence,) = moved_limits(small_report, 4, upper=float(np.radians(0.05)))
    assert sentence.startswith(f"joint 'theta5' comes within 0.05 deg of its upper limit of {upper:.3g} deg")
    (sentence,) = moved_limits(small_report, 4, lower=float(np.radians(0.15)))
    assert "comes within 0.15 deg of its lower limit" in sentence
    (sentence,) = moved_limits(small_report, 0, upper=0.0)
    assert sentence.startswith("joint 'd1' touches its upper limit of ")
    assert moved_limits(small_report, 4, lower=float(np.radians(0.25))) == ()
    assert moved_limits(small_report, 0, lower=0.0015) == ()
    assert moved_limits(small_report, 4, lower=-1e-3) == (), "beyond a limit is a reason, not a warning"


def test_the_summary_warns_of_home_on_a_limit(small_report: qparm.Report) -> None:
    expected = "joint 'd1' touches its lower limit of 0 mm, at home only"
    assert expected in small_report.warnings
    assert f"  - {expected}\n" in small_report.text()
    assert "a position limit, where a soft limit of the controller" in small_report.text()
    assert small_report.to_dict()["warnings"] == list(small_report.warnings)
    assert small_report.executable, "a warning is no reason"


def test_every_verdict_says_that_links_are_not_checked(small_report: qparm.Report) -> None:
    verdict = small_report.text()[small_report.text().index("verdict: executable") :]
    assert LINKS_NOT_CHECKED in verdict
    assert small_report.to_dict()["not_checked"] == [LINKS_NOT_CHECKED]
    assert "links are not checked against the workpiece" in (ROOT / "README.md").read_text(encoding="utf-8").replace(
        "\n", " "
    )


# --- figures in words -----------------------------------------------------------------------------------


def test_figures_are_shown_in_a_unit_that_fits_them() -> None:
    assert [micrometres(x) for x in (1.77e-6, 0.00053, 0.9998e-3, 2.11e-3)] == ["1.77 um", "530 um", "1 mm", "2.11 mm"]
    assert [microradians(x) for x in (8.01e-6, 0.9998e-3, 3.68e-3)] == ["8.01 urad", "0.0573 deg", "0.211 deg"]
    assert [time_words(x) for x in (0.0123, 0.9998, 76.0, 119.0, 1234.0)] == [
        "12.3 ms", "1 s", "76 s", "119 s", "20.6 min",
    ]  # fmt: skip
    assert micrometres(float("nan")) == microradians(float("nan")) == "-"
