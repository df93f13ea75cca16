"""The verdicts of a look at a cell, and of a plan on what it misses: those of a tool that may spin or tilt."""

from __future__ import annotations

import numpy as np
import pytest

import qparm
from conftest import cell_data
from qparm.check import check_cell, check_text
from qparm.ik import ReachReason
from qparm.path.relaxation import Relaxation


def short_arm(**process: str) -> qparm.Cell:
    """Return a cell of which a short arm misses some points, whatever its tool may do."""
    data = cell_data()
    data["process"] |= {"rows": 5, "points": 13} | process
    data["arm"]["lengths"] |= {"L1": "360 mm", "L3": "340 mm"}
    return qparm.Cell.load(data)


def test_a_cell_says_what_its_tool_may_do() -> None:
    data = cell_data()
    assert qparm.Cell.load(data).relaxation() == Relaxation()
    data["process"] |= {"tool_spin": "free", "tool_tilt": "10 deg"}
    assert qparm.Cell.load(data).relaxation() == Relaxation(spin=True, tilt=np.radians(10.0))


def test_a_leaning_tool_reaches_more_and_the_verdict_names_it() -> None:
    drawn, leaning = check_cell(short_arm()), check_cell(short_arm(tool_tilt="10 deg"))
    before, after = (
        np.array([verdict.reason is ReachReason.WITHIN_REACH for verdict in one.reach]) for one in (drawn, leaning)
    )
    assert before.sum() < after.sum() < len(after)
    assert (after | ~before).all()
    text = check_text(leaning)
    assert "\ntool            free to lean by 10 deg\n" in text
    assert all(line.endswith(", the tool free to lean by 10 deg") for line in text.splitlines() if "  row " in line)
    assert "free to" not in check_text(drawn)
    both = ~after
    nearer = [was.excess - now.excess for was, now, k in zip(drawn.reach, leaning.reach, both, strict=True) if k]
    assert min(nearer) > 0, "the wrist of a tool that leans is nearer to where it would be reached"


@pytest.mark.parametrize("process", [{"tool_tilt": "10 deg"}, {"tool_spin": "free", "tool_tilt": "6 deg"}])
def test_a_plan_misses_what_the_check_says_it_must(process: dict[str, str]) -> None:
    cell = short_arm(**process)
    plan = qparm.plan(cell, seed=0)
    assert len(plan.record.unreached)
    checked = check_cell(cell)
    words = cell.relaxation().words
    # what a plan reaches is within reach: no verdict may deny it
    for k, verdict in enumerate(checked.reach):
        assert verdict.reason is ReachReason.WITHIN_REACH or k in plan.record.unreached
    for k, verdict in plan.reach.items():
        assert verdict.relaxed == words
        assert verdict.reason is checked.reach[k].reason
