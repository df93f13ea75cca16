"""Our own controller programs are kept, with no more claimed than they tell; altered ones are not."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import qparm
from conftest import ROOT, cell_data
from qparm.export import export_trajectory
from qparm.verify import MotionReport, MotionTable, read_motion, verify_motion
from qparm.verify.clock import read_clock

ENDINGS = {"krl": ".src", "rapid": ".mod"}


@pytest.fixture(scope="module")
def plan() -> qparm.Plan:
    """Return a plan of six axes on a track: two rows of different lengths."""
    data = cell_data(ROOT / "examples" / "six_axis.toml")
    arm, first = data["arm"], data["arm"]["joints"][0]
    track = {
        "name": "track", "type": "prismatic",
        "dh": {"alpha": "-90 deg", "a": "0 mm", "d": "0 mm", "theta": "0 deg"},
        "position": ["0 mm", "800 mm"], "velocity": "200 mm/s", "acceleration": "600 mm/s^2", "jerk": "6000 mm/s^3",
    }  # fmt: skip
    arm["joints"] = [track, first | {"dh": first["dh"] | {"alpha": "90 deg", "theta": "90 deg"}}, *arm["joints"][1:]]
    arm["home"] = ["250 mm", *arm["home"]]
    arm["base"] = {"position": ["0 mm"] * 3, "rpy": ["0 deg"] * 3}
    data["workpiece"] |= {"elevation": ["20 deg", "30 deg"], "azimuth": ["-8 deg", "8 deg"]}
    data["process"] |= {"rows": 2, "points": 9}
    return qparm.plan(data)


def written(plan: qparm.Plan, to: str, folder: Path, period: float | None = None) -> Path:
    file = folder / f"motion{ENDINGS[to]}"
    export_trajectory(plan.trajectory, file, to=to, units=plan.chain.units, period=period)
    return file


def verdict(plan: qparm.Plan, file: Path) -> MotionReport:
    return verify_motion(read_motion(file, plan.cell), plan.cell)


@pytest.mark.parametrize("period", [None, 0.004, 0.037])
@pytest.mark.parametrize("to", ["krl", "rapid"])
def test_our_own_programs_are_kept(plan: qparm.Plan, to: str, period: float | None, tmp_path: Path) -> None:
    report = verdict(plan, written(plan, to, tmp_path, period))
    assert report.problems() == ()
    text = report.text()
    assert "every limit and tolerance holds" not in text
    known = re.search(r"verdict: holds as far as the file tells: points known to ([0-9.]+) (mm|um)", text)
    assert known is not None
    # of what the cell asks for, 1 um, the steps leave this much open
    assert (known[2], "feed not told" in text) == (("um", False) if period == 0.004 else ("mm", True))
    assert "  - not told: whether the controller keeps the times that the program asks for" in text
    assert ("zone z0" in text) == (to == "rapid")


def test_two_calls_swapped_are_not_kept(plan: qparm.Plan, tmp_path: Path) -> None:
    file = written(plan, "rapid", tmp_path)
    text = file.read_bytes().decode("ascii")
    calls = re.findall(r"    motion_\d+;\r\n", text)
    file.write_bytes(text.replace(calls[1] + calls[2], calls[2] + calls[1]).encode("ascii"))
    assert not verdict(plan, file).kept


def test_one_step_of_a_row_that_takes_longer_is_not_kept(plan: qparm.Plan, tmp_path: Path) -> None:
    file = written(plan, "rapid", tmp_path)
    lines = file.read_bytes().decode("ascii").split("\r\n")
    row = next(k for k, line in enumerate(lines) if "! row 1: " in line)
    (step,) = re.findall(r"\\T:=([0-9.]+)", lines[row + 6])
    lines[row + 6] = lines[row + 6].replace(step, f"{1.01 * float(step):.6f}")
    file.write_bytes("\r\n".join(lines).encode("ascii"))
    problems = verdict(plan, file).problems()
    assert len(problems) == 1
    assert "time: interval between samples" in problems[0]


# --- steps of their own -----------------------------------------------------------------------------------


def table(steps: list[float], stops: list[int] | None) -> MotionTable:
    t = np.concatenate([[0.0], np.cumsum(steps)]).round(6)
    q = np.zeros((len(t), 1))
    none = np.zeros(1)
    return MotionTable("rapid", ("a",), t, q, None, None, None, none, 0.5e-6,
                       stops=None if stops is None else np.array(stops))  # fmt: skip


@pytest.mark.parametrize(
    ("steps", "stops", "wrong"),
    [
        # nine of ten alike, the others of segments of their own
        ([0.04999] * 60 + [0.0438] * 5, [0, 60, 65], 0),
        ([0.04999] * 60 + [0.0438] * 5, None, 4),  # the last may be shorter
        # a short way between two rows is one step
        ([0.05] * 30 + [0.0371] + [0.05] * 30, [0, 30, 31, 61], 0),
        ([0.05] * 30 + [0.0371] + [0.05] * 30, [0, 61], 1),
        ([0.05] * 20 + [0.0505] + [0.05] * 40, [0, 61], 1),
        ([0.05] * 20 + [0.0505, 0.0495] + [0.05] * 39, [0, 61], 2),
        # a row end that flows through
        ([0.05] * 30 + [0.031] * 4 + [0.05] * 30, [0, 64], 0),
        ([0.05] * 64, [0, 64], 0),
    ],
)
def test_segments_of_a_program_have_steps_of_their_own(steps: list[float], stops: list[int] | None, wrong: int) -> None:
    clock = read_clock(table(steps, stops))
    assert sum(finding.count for finding in clock.findings) == wrong
