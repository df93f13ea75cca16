"""The verdicts of a look at a cell, and of a plan on what it misses: those of a tool that may spin or tilt."""

from __future__ import annotations

import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

import qparm
from conftest import cell_data, few_rows
from qparm.cli.progress import LogLines, progress_bar
from qparm.path.relaxation import Relaxation
from qparm.reach import ReachReason
from qparm.reports.check import CheckedCell, check_cell, check_text, home_distance
from qparm.reports.early_reach import early_lines
from qparm.verify.clearance import LINKS_NOT_CHECKED


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
@pytest.mark.slow
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


# --- what else a look at a cell says ---------------------------------------------------------------------


def with_home_at(distance: float) -> qparm.Cell:
    """Return a cell whose tool point stands at a distance (m) from the dome at home, above its pole."""
    data = few_rows()
    home = qparm.Cell.load(data)
    x, y, z = home.chain().forward(home.home())[:3, 3]
    data["workpiece"]["pose"]["position"] = [f"{x} m", f"{y} m", f"{z - 0.6 - distance} m"]
    return qparm.Cell.load(data)


@pytest.mark.parametrize(
    ("distance", "said"),
    [
        (-0.1381, "home: the tool point lies 138.1 mm inside the workpiece"),
        (0.012, "home: the tool point lies 12.0 mm from the workpiece, within the clearance of 20 mm"),
        (0.021, ""),
    ],
)
def test_a_home_that_is_not_clear_of_the_workpiece_is_named(distance: float, said: str) -> None:
    checked = CheckedCell(with_home_at(distance), (), home_distance(with_home_at(distance)))
    assert checked.home_distance == pytest.approx(distance, abs=1e-9)
    assert checked.home_clear is not bool(said)
    assert [sentence.startswith(said) for sentence in checked.problems] == [True] * bool(said)


@pytest.mark.slow
def test_the_command_names_home_and_exits_3(tmp_path: Path) -> None:
    cell = with_home_at(-0.1381).to_dict()
    cell["process"] |= {"rows": 1, "points": 2}
    file = tmp_path / "cell.toml"
    qparm.Cell.load(cell).save(file)
    command = [sys.executable, "-m", "qparm.cli", "check", str(file), "--out", str(tmp_path / "out")]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert run.returncode == 3
    assert "\nhome: the tool point lies 138.1 mm inside the workpiece; choose another arm.home\n" in run.stdout
    assert f"\n{LINKS_NOT_CHECKED}\n" in run.stdout


def test_a_joint_that_turns_more_than_twice_between_its_limits_is_named() -> None:
    data = few_rows()
    data["arm"]["joints"][2]["position"] = ["-180 rad", "180 rad"]
    data["arm"]["joints"][3]["position"] = ["-360 deg", "360 deg"]
    cell = qparm.Cell.load(data)
    (warning,) = CheckedCell(cell, (), 1.0).warnings
    assert warning.startswith("joint 'theta3' may turn 57.3 times between its limits, -10313 to 10313 deg;")


# --- what a plan says before it searches -----------------------------------------------------------------


def half_out_of_reach(rows: int = 5) -> qparm.Cell:
    """Return a cell whose rows go on behind the dome, where the arm cannot reach."""
    data = cell_data()
    data["workpiece"] |= {"azimuth": ["-170 deg", "170 deg"]}
    data["process"] |= {"rows": rows, "points": 31}
    return qparm.Cell.load(data)


def test_points_out_of_reach_are_told_before_the_search() -> None:
    cell = half_out_of_reach()
    checked = check_cell(cell)
    missed = [verdict for verdict in checked.reach if verdict.reason is not ReachReason.WITHIN_REACH]
    assert 50 < len(missed) < 155
    head, *lines = early_lines(cell)
    told = int(head.removeprefix("at least ").split()[0])
    assert f"{told} of 155 points are out of reach" in head
    proved = sum(verdict.excess > 0 for verdict in missed)
    assert proved <= told <= len(missed)
    assert head.startswith("at least ") is (told < len(missed))
    assert lines[0].startswith("  row 0 points 0-")
    assert early_lines(qparm.Cell.load(few_rows())) == ()


def test_points_that_limits_put_out_of_reach_are_told_too() -> None:
    data = few_rows()
    for joint in (2, 3, 4, 5):
        data["arm"]["joints"][joint]["position"] = ["-5 deg", "5 deg"]
    cell = qparm.Cell.load(data)
    expected = {verdict.reason for verdict in check_cell(cell).reach}
    head, *lines = early_lines(cell)
    assert ReachReason.LIMITS in expected
    assert "points are out of reach" in head
    assert any("joint limits: reached without them, not with them" in line for line in lines)


@pytest.mark.slow
def test_quiet_plans_do_not_look_for_them(tmp_path: Path) -> None:
    file = tmp_path / "cell.toml"
    half_out_of_reach(1).save(file)
    for options, said in (((), True), (("--quiet",), False)):
        command = [sys.executable, "-m", "qparm.cli", "plan", str(file), "--out", str(tmp_path / "out"), *options]
        run = subprocess.run(command, capture_output=True, text=True, check=False)
        assert run.returncode == 3
        assert (" points are out of reach (all of them: qparm check):" in run.stderr) is said


def test_a_log_gets_a_line_of_progress_every_so_often() -> None:
    now, written = [100.0], list[str]()
    lines = LogLines(written.append, lambda: now[0])
    told = iter([None, ("joint path", 120, 915, ""), ("joint path", 915, 915, ""), ("smoothing", 0, 1, "")])

    def wait(seconds: float) -> bool:
        now[0] += seconds
        lines.now = next(told, None)
        return lines.now is None and len(written) > 0

    lines.run(wait)
    assert written == [
        "joint path: 120 of 915, 60 s since the start",
        "joint path: 915 of 915, 90 s since the start",
        "smoothing: 120 s since the start",
    ]


def test_a_short_run_leaves_a_log_empty(capsys: pytest.CaptureFixture[str]) -> None:
    before = threading.active_count()
    with progress_bar(False) as show:
        assert show is not None
        show("joint path", 120, 915)
    assert capsys.readouterr().err == ""
    assert threading.active_count() == before
