"""Names from elsewhere: one rule wherever they enter, so that none becomes a command of a program."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import qparm
from conftest import cell_data
from made_arm import URDF, elsewhere_data
from made_trajectory import RAIL_AND_SIX, made_trajectory, units_of
from qparm.cli import cli
from qparm.errors import CellError, InvalidInput
from qparm.export import export_trajectory
from qparm.export.controller_program import remark
from qparm.names import LONGEST_NAME, wrong_joint_name, wrong_joint_names, wrong_name
from qparm.robot import MotionLimits
from qparm.timing import time_waypoints

HOSTILE = [
    "x\nLIN {X 1000,Y 0,Z 0,A 0,B 0,C 0}\n; ",
    "x\r\n  MoveL p9,v1000,z0,tool0;\r\n  ! ",
    "x\u2028LIN Q[3]",
    "x\x85LIN Q[3]",
    "x\x1b[2Jy",
    "x\0y",
    "x" * (LONGEST_NAME + 1),
    " x",
    "",
]
NO_JOINT = ["a,2", "a[1]", 'a"b', "a;b", "a!b", "time", "T", "row", "process_on"]


@pytest.mark.parametrize("name", ["a1", "arm/joint-1", "shoulder pan", "Gelenk_ä", "関節1", "x" * LONGEST_NAME])
def test_names_that_people_give_are_taken(name: str) -> None:
    assert wrong_name(name) == wrong_joint_name(name) == ""


@pytest.mark.parametrize("name", [*HOSTILE, 3, None, True])
def test_what_is_no_printable_line_is_no_name(name: object) -> None:
    assert wrong_name(name)
    assert wrong_joint_name(name)


@pytest.mark.parametrize("name", NO_JOINT)
def test_what_cannot_head_a_column_of_its_own_is_no_joint(name: str) -> None:
    assert wrong_name(name) == ""
    assert wrong_joint_name(name)


def test_the_names_of_a_motion_differ() -> None:
    assert wrong_joint_names(["a", "b"]) == ""
    assert "repeated: a" in wrong_joint_names(["a", "b", "a"])


# --- every border -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [*HOSTILE, *NO_JOINT])
def test_a_cell_with_such_a_joint_is_refused(name: str) -> None:
    data = cell_data()
    data["arm"]["joints"][2]["name"] = name
    with pytest.raises(CellError, match=r"arm\.joints\[2\]\.name"):
        qparm.Cell.load(data)


@pytest.mark.parametrize("place", [("name",), ("arm", "name"), ("arm", "base_link")])
@pytest.mark.parametrize("name", HOSTILE)
def test_a_cell_of_such_a_name_is_refused(place: tuple[str, ...], name: str) -> None:
    data: dict[str, Any] = elsewhere_data()
    table = data
    for key in place[:-1]:
        table = table[key]
    table[place[-1]] = name
    with pytest.raises(CellError, match=place[-1]):
        qparm.Cell.load(data)


def test_a_length_of_such_a_name_is_refused() -> None:
    data = cell_data()
    data["arm"]["lengths"]["L9\nL10"] = "1 mm"
    with pytest.raises(CellError, match=r"arm\.lengths\.'L9\\nL10': .* cannot be printed"):
        qparm.Cell.load(data)


@pytest.mark.parametrize("name", ["a&#10;LIN Q[3]", "a&#x1b;[2J", "a,2", "row"])
def test_a_urdf_with_such_a_joint_is_refused(name: str) -> None:
    data = elsewhere_data()
    data["arm"]["urdf"] = URDF.replace('"a3"', f'"{name}"')
    with pytest.raises(CellError, match=r"arm\.urdf"):
        qparm.Cell.load(data)
    with pytest.raises(InvalidInput):
        qparm.chain_from_urdf(data["arm"]["urdf"], base="floor", tip="tip",
                              revolute=qparm.JointLimits(acceleration=5.0, jerk=50.0))  # fmt: skip


@pytest.mark.parametrize("name", [*HOSTILE, *NO_JOINT])
def test_motions_with_such_a_joint_are_not_made(name: str, tmp_path: Path) -> None:
    with pytest.raises(InvalidInput):
        replace(made_trajectory(RAIL_AND_SIX), joint_names=(*RAIL_AND_SIX[:-1], name))
    limits = MotionLimits(velocity=[1.0] * 2, acceleration=[1.0] * 2, jerk=[1.0] * 2)
    with pytest.raises(InvalidInput):
        time_waypoints(np.array([[0.0, 0.0], [1.0, 1.0]]), limits, names=("a", name))


def plan_folder(folder: Path, name: str) -> Path:
    """Write a plan's folder whose first joint has a name of its files' own."""
    trajectory = made_trajectory(RAIL_AND_SIX)
    folder.mkdir()
    export_trajectory(trajectory, folder / "trajectory.json", to="json", units=units_of(RAIL_AND_SIX))
    message = json.loads((folder / "trajectory.json").read_text(encoding="utf-8"))
    message["joint_names"][0] = name
    (folder / "trajectory.json").write_text(json.dumps(message), encoding="utf-8")
    heads = [f"{joint}[{unit}]" for joint, unit in zip([name, *RAIL_AND_SIX[1:]], units_of(RAIL_AND_SIX), strict=True)]
    with (folder / "joint_path.csv").open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerow(["index", "row", "kind", "status", "s[m]", *heads])
    segments = [{"kind": s.kind.value, "row": s.row, "end": s.end} for s in trajectory.segments]
    report = {"segments": segments, "executable": True, "reasons": [], "options": {"timing": "quintic"}}
    (folder / "report.json").write_text(json.dumps(report), encoding="utf-8")
    return folder


@pytest.mark.parametrize("name", [*HOSTILE, *NO_JOINT])
def test_a_plan_with_such_a_joint_is_not_exported(name: str, tmp_path: Path) -> None:
    folder = plan_folder(tmp_path / "plan", name)
    for to, ending in (("krl", "src"), ("rapid", "mod"), ("csv", "csv")):
        done = CliRunner().invoke(cli, ["export", "trajectory", str(folder), "--to", to,
                                        "--out", str(tmp_path / f"p.{ending}")], standalone_mode=False)  # fmt: skip
        assert isinstance(done.exception, InvalidInput)
        assert "trajectory.json: " in str(done.exception)
    assert [entry.name for entry in tmp_path.iterdir()] == ["plan"]


@pytest.mark.parametrize(("to", "ending"), [("krl", "src"), ("rapid", "mod")])
def test_a_name_that_is_taken_stays_in_its_comment(to: str, ending: str, tmp_path: Path) -> None:
    folder = plan_folder(tmp_path / "plan", "d1 ä/LIN")
    done = CliRunner().invoke(cli, ["export", "trajectory", str(folder), "--to", to,
                                    "--out", str(tmp_path / f"p.{ending}")], standalone_mode=False)  # fmt: skip
    assert done.exception is None
    lines = (tmp_path / f"p.{ending}").read_bytes().decode("ascii").split("\r\n")
    (told,) = [line for line in lines if "LIN" in line.replace("SPLINE", "")]
    assert told.strip()[0] in ";!"
    assert "d1 ?/LIN" in told


def test_a_remark_is_one_line_of_ascii_whatever_it_is_made_of() -> None:
    assert remark("a\nLIN\r\u2028\x00ä") == "a?LIN????"
    assert len(remark("x" * 5000)) == 200
