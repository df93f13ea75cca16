"""Cells of a URDF and a pose list: read, checked, saved, planned and measured like any other."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import qparm
from conftest import ROOT
from made_arm import LIMITS, URDF, elsewhere_data, pose_list, row_of_poses
from qparm.reports.check import check_cell
from qparm.verify.kinematics import joint_transforms, scaled_singular_values

Edit = Callable[[dict[str, Any]], object]


@pytest.fixture(scope="module")
def cell() -> qparm.Cell:
    return qparm.Cell.load(elsewhere_data())


@pytest.fixture(scope="module")
def planned(cell: qparm.Cell) -> qparm.Plan:
    return qparm.plan(cell)


def problems(data: dict[str, Any]) -> dict[str, str]:
    with pytest.raises(qparm.CellError) as caught:
        qparm.Cell.load(data)
    found = dict(caught.value.problems)
    assert len(found) == len(caught.value.problems)
    return found


def in_files(folder: Path) -> dict[str, Any]:
    """Write URDF and pose list into a folder and return a cell that names them from there."""
    folder.mkdir(parents=True)
    data = elsewhere_data()
    (folder / "arm.urdf").write_text(data["arm"]["urdf"], encoding="utf-8")
    (folder / "poses.csv").write_text(data["workpiece"]["poses"], encoding="utf-8")
    data["arm"]["urdf"], data["workpiece"]["poses"] = "arm.urdf", "poses.csv"
    return data


def saved(data: dict[str, Any], file: Path) -> Path:
    import tomli_w

    file.write_text(tomli_w.dumps(data), encoding="utf-8")
    return file


# --- what a cell holds ------------------------------------------------------------------------------


def test_the_arm_has_the_urdfs_limits_and_the_cells() -> None:
    data = elsewhere_data()
    data["arm"]["limits"] |= {
        "joints": [{"name": "a7", "type": "revolute", "position": ["-175 deg", "175 deg"], "velocity": "100 deg/s"}]
    }
    cell = qparm.Cell.load(data)
    chain = cell.chain()
    assert chain.n == len(cell.arm.joints) == 7
    assert chain.joints[6].position == cell.arm.joints[6].position == (np.radians(-175), np.radians(175))
    np.testing.assert_allclose(chain.velocity, [2, 2, 2, 2, 3, 3, np.radians(100)])
    np.testing.assert_allclose(chain.acceleration, np.full(7, np.radians(300)))
    np.testing.assert_array_equal(chain.continuous, [True, False, True, False, True, False, False])
    np.testing.assert_array_equal(cell.jump(), np.full(7, np.radians(50)))


def test_base_and_tool_stand_where_the_cell_says() -> None:
    data = elsewhere_data()
    data["arm"] |= {"base": {"position": ["1 m", "0 m", "0 m"]}, "tool": {"position": ["0 mm", "0 mm", "70 mm"]}}
    plain, moved = qparm.Cell.load(elsewhere_data()), qparm.Cell.load(data)
    q = plain.home()
    expected = moved.arm.base.matrix() @ plain.chain().forward(q) @ moved.arm.tool.matrix()
    np.testing.assert_allclose(moved.chain().forward(q), expected, atol=1e-14)


def test_a_cell_comes_back_to_the_same_bits(cell: qparm.Cell) -> None:
    again = qparm.Cell.load(cell.to_dict())
    assert again == cell
    assert again.to_dict() == cell.to_dict()


def test_files_are_found_from_the_cells_folder(
    cell: qparm.Cell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = saved(in_files(tmp_path / "one"), tmp_path / "one" / "cell.toml")
    monkeypatch.chdir(tmp_path)
    for source in (file, "one/cell.toml", qparm.Cell.load(file).to_dict()):
        loaded = qparm.Cell.load(source)
        np.testing.assert_array_equal(loaded.tool_path().poses, cell.tool_path().poses)
        np.testing.assert_array_equal(loaded.chain().fixed, cell.chain().fixed)
    (tmp_path / "two").mkdir()
    loaded.save("two/cell.toml")
    assert 'urdf = "../one/arm.urdf"' in (tmp_path / "two" / "cell.toml").read_text(encoding="utf-8")
    assert qparm.Cell.load("two/cell.toml") == loaded


def test_a_cell_keeps_what_it_read(tmp_path: Path, cell: qparm.Cell) -> None:
    file = saved(in_files(tmp_path / "one"), tmp_path / "one" / "cell.toml")
    loaded = qparm.Cell.load(file)
    loaded.chain()
    for name in ("arm.urdf", "poses.csv"):
        (tmp_path / "one" / name).unlink()
    np.testing.assert_array_equal(loaded.chain().fixed, cell.chain().fixed)
    np.testing.assert_array_equal(loaded.tool_path().poses, cell.tool_path().poses)
    poses, _ = joint_transforms(loaded, loaded.home()[None])
    np.testing.assert_allclose(poses[0], loaded.chain().forward(loaded.home()), atol=1e-14)


# --- what can be wrong ------------------------------------------------------------------------------

ONE = {"name": "a7", "type": "revolute"}
BAD: list[tuple[str, Edit, str, str]] = [
    ("no such file", lambda d: d["arm"].update(urdf="none.urdf"), "arm.urdf", "there is no URDF file"),
    ("no such link", lambda d: d["arm"].update(tip_link="tipp"), "arm.urdf", "no link 'tipp'; did you mean 'tip'?"),
    ("no link", lambda d: d["arm"].pop("tip_link"), "arm.tip_link", "is missing"),
    ("mimic", lambda d: d["arm"].update(urdf=URDF.replace('<axis xyz="0 1 0"/>', '<mimic joint="a1"/>')), "arm.urdf",
     "joint 'a2' mimics"),
    ("no acceleration", lambda d: d["arm"].pop("limits"), "arm.urdf", "joint 'a1': a URDF has no limit of accel"),
    ("unknown key of the urdf's arm", lambda d: d["arm"].update(joints=[]), "arm.joints", "known here: name, char"),
    ("near miss", lambda d: d["arm"].update(tiplink="tip"), "arm.tiplink", "did you mean 'tip_link'?"),
    ("wrong unit", lambda d: d["arm"]["limits"].update(revolute={"jerk": "1 m/s^3"}), "arm.limits.revolute.jerk",
     "'m/s^3' is not a unit of angular jerk"),
    ("no unit", lambda d: d["arm"]["limits"].update(joints=[ONE | {"velocity": "2"}]),
     "arm.limits.joints[0].velocity", "'2' has no unit"),
    ("limit zero", lambda d: d["arm"]["limits"].update(joints=[ONE | {"velocity": "0 rad/s"}]),
     "arm.limits.joints[0].velocity", "must be greater than zero"),
    ("limits reversed", lambda d: d["arm"]["limits"].update(joints=[ONE | {"position": ["1 rad", "0 rad"]}]),
     "arm.limits.joints[0].position", "reversed"),
    ("no type", lambda d: d["arm"]["limits"].update(joints=[{"name": "a7"}]), "arm.limits.joints[0].type", "is miss"),
    ("other type", lambda d: d["arm"]["limits"].update(joints=[ONE | {"type": "prismatic"}]), "arm.urdf",
     "joint 'a7' is revolute in the URDF, not prismatic"),
    ("no such joint", lambda d: d["arm"]["limits"].update(joints=[ONE | {"name": "a8"}]), "arm.urdf", "joint 'a8'"),
    ("twice", lambda d: d["arm"]["limits"].update(joints=[ONE, ONE]), "arm.limits.joints", "repeated: a7"),
    ("a name for no column", lambda d: d["arm"].update(urdf=URDF.replace('"a2"', '"a,2"')), "arm.urdf",
     "joint 'a,2': 'a,2' cannot be a joint's name"),
    ("limits of no arm", lambda d: d["arm"].update(urdf=URDF.replace('upper="2.2"', 'upper="2e3"')), "arm.urdf",
     "joint 'a4': its position limits lie beyond 1000"),
    ("home too short", lambda d: d["arm"]["home"].pop(), "arm.home", "the arm has 7 joints, home has 6 values"),
    ("home outside", lambda d: d["arm"]["home"].__setitem__(1, "3 rad"), "arm.home", "value 1 (a2): 3 rad lies outs"),
    ("no such list", lambda d: d["workpiece"].update(poses="none.csv"), "workpiece.poses", "there is no pose list"),
    ("a bad list", lambda d: d["workpiece"].update(poses="x,y\n0,0\n"), "workpiece.poses", "missing: z, qw"),
    ("name of no file", lambda d: d["workpiece"].update(poses="a\0b"), "workpiece.poses", "cannot be"),
    ("no list", lambda d: d["workpiece"].pop("poses"), "workpiece.poses", "is missing"),
    ("of another shape", lambda d: d["workpiece"].update(elevation=1), "workpiece.elevation", "known here: shape, po"),
    ("no shape", lambda d: d["workpiece"].pop("shape"), "workpiece.shape", "is missing: 'sphere zone' or 'pose list'"),
    ("rows", lambda d: d["process"].update(rows=2), "process.rows", "rows and points of its own"),
    ("points", lambda d: d["process"].update(points=21), "process.points", "rows and points of its own"),
    ("stand-off", lambda d: d["process"].update(stand_off="1 mm"), "process.stand_off", "no surface to stand off"),
    ("lift", lambda d: d["process"].update(self_motion={"transition": "lift", "lift": "1 mm"}), "process.self_motion",
     "no surface to lift off"),
    ("self-motion", lambda d: d["process"].update(self_motion={"points": 11}), "process", "between 0 and 10"),
]  # fmt: skip


@pytest.mark.parametrize(("edit", "key", "words"), [case[1:] for case in BAD], ids=[case[0] for case in BAD])
def test_a_problem_is_reported_with_its_key(edit: Edit, key: str, words: str) -> None:
    data = elsewhere_data()
    edit(data)
    found = problems(data)
    assert list(found) == ([key] if key != "workpiece.shape" else [key, "process.rows", "process.points"])
    assert words in found[key]


def test_a_raster_needs_its_rows_and_points(dome: qparm.Cell) -> None:
    data = dome.to_dict()
    del data["process"]["rows"], data["process"]["points"]
    assert problems(data) == {"process.rows": "is missing", "process.points": "is missing"}


def test_everything_wrong_is_reported_together() -> None:
    data = elsewhere_data()
    data["arm"].update(urdf="none.urdf", home=["0 deg"])
    data["workpiece"]["turning_radius"] = "-1 mm"
    data["process"].update(rows=3, feed="20")
    assert set(problems(data)) == {"arm.urdf", "workpiece.turning_radius", "process.rows", "process.feed"}


# --- planned and measured ---------------------------------------------------------------------------


def test_the_plain_kinematics_agree_with_the_chain(rng: np.random.Generator) -> None:
    data = elsewhere_data()
    slide = '<joint name="a6" type="prismatic">'
    data["arm"]["urdf"] = URDF.replace('<joint name="a6" type="revolute">', slide)
    data["arm"]["limits"] = {**LIMITS, "prismatic": {"acceleration": "1 m/s^2", "jerk": "10 m/s^3"}}
    data["arm"]["home"][5] = "0 m"
    data["arm"] |= {"base": {"position": ["1 m", "2 m", "0 m"], "rpy": ["10 deg", "20 deg", "30 deg"]}}
    data["arm"] |= {"tool": {"position": ["0 m", "2 cm", "3 cm"], "rpy": ["0 deg", "20 deg", "-30 deg"]}}
    for cell in (qparm.Cell.load(data), qparm.Cell.load(elsewhere_data())):
        chain = cell.chain()
        Q = chain.random(rng, 50)
        poses, axes = joint_transforms(cell, Q)
        np.testing.assert_allclose(poses, chain.forward(Q), atol=1e-13)
        expected = np.linalg.svd(chain.scaled_jacobian(Q), compute_uv=False)[:, -1]
        np.testing.assert_allclose(scaled_singular_values(cell, poses, axes), expected, atol=1e-12)


def test_a_cell_from_elsewhere_is_planned_to_the_end(planned: qparm.Plan) -> None:
    report = qparm.report(planned)
    figures = report.figures
    assert report.executable, report.reasons
    assert (figures.points, figures.reached, len(figures.jumps)) == (42, 42, 0)
    assert figures.position_error_max < 1e-6
    assert np.isnan(figures.surface_deviation)
    assert report.to_dict()["measured"]["surface_deviation"] is None
    assert "not known: a pose list has no surface" in report.text()
    # 0.4 m forth and back at 50 mm/s and the way between
    assert planned.tool_path.rows[0].length == pytest.approx(0.4)
    assert 0.04 < figures.tool_speed_mean < 0.05


@pytest.mark.slow
def test_a_continuous_joint_turns_on_past_a_whole_turn() -> None:
    data = elsewhere_data()
    data["workpiece"]["poses"] = pose_list(row_of_poses(181, turn=3 * np.pi, length=0.0))
    plan = qparm.plan(data)
    report = qparm.report(plan)
    assert report.executable, report.reasons
    at = plan.joint_path.point >= 0
    turned = np.ptp(plan.joint_path.q[at], axis=0)
    assert turned[[0, 2, 4, 6]].max() > np.pi
    # the same arm whose last axis ends after a turn cannot without turning back
    assert plan.tool_path.rows[0].length == pytest.approx(3 * np.pi * 0.1)
    assert np.abs(np.diff(plan.joint_path.q[at], axis=0)).max() < np.radians(20)


@pytest.mark.slow
def test_check_and_plan_run_on_files(tmp_path: Path) -> None:
    saved(in_files(tmp_path / "cells"), tmp_path / "cells" / "cell.toml")
    for command, said in (("check", "points within reach: 42 of 42"), ("plan", "verdict: executable")):
        run = subprocess.run(
            [sys.executable, "-m", "qparm.cli", command, "cells/cell.toml", "--out", "out"],
            cwd=tmp_path, capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert run.returncode == 0, run.stdout + run.stderr
        assert said in run.stdout
        if command == "check":
            assert "URDF, floor to tip" in run.stdout
            assert "a1           continuous" in run.stdout
            assert "2 of 21 points, 20.0 to 20.0 mm apart" in run.stdout
    assert {"arm.png", "surface.png", "report.json"} <= {file.name for file in (tmp_path / "out").iterdir()}


def test_a_cell_with_one_bad_file_ends_in_a_sentence(tmp_path: Path) -> None:
    data = in_files(tmp_path / "cells")
    saved(data, tmp_path / "cells" / "cell.toml")
    (tmp_path / "cells" / "poses.csv").write_text("x,y,z,qw,qx,qy,qz\n0,0,0,1,0,0", encoding="utf-8")
    run = subprocess.run(
        [sys.executable, "-m", "qparm.cli", "plan", "cells/cell.toml", "--out", "out"],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert run.returncode == 2
    assert "workpiece.poses: line 2 of the pose list does not end" in run.stderr
    assert "Traceback" not in run.stderr


def test_a_row_that_begins_where_the_last_one_ends_needs_no_lift() -> None:
    data = elsewhere_data()
    first = row_of_poses(11)
    second = np.tile(first[-1], (11, 1, 1))
    second[:, 2, 3] += np.linspace(0.0, 0.1, 11)
    data["workpiece"]["poses"] = pose_list(first, second)
    plan = qparm.plan(data)
    assert plan.tool_path.transitions[0].length == 0
    assert [motion.kind.value for motion in plan.breaks] == ["approach", "retract"]
    assert qparm.report(plan).executable


# --- the example ------------------------------------------------------------------------------------------


def test_the_page_shows_the_example_that_is_shipped() -> None:
    page = (ROOT / "docs" / "elsewhere.md").read_text(encoding="utf-8")
    (shown,) = re.findall(r"```toml\n(.*?)```", page, re.S)
    example = ROOT / "examples" / "elsewhere.toml"
    assert example.read_text(encoding="utf-8").endswith(shown)
    for line in (ROOT / "examples" / "poses.csv").read_text(encoding="utf-8").splitlines()[1:5]:
        assert f"\n    {line}\n" in page
    cell = qparm.Cell.load(example)
    checked = check_cell(cell)
    assert checked.all_reached
    assert cell.chain().forward(cell.home())[2, 2] == pytest.approx(-1.0), "the tool points down at home"
    assert (cell.tool_path().poses[:, 2, 2] < -0.999).all(), "and into the surface on the path"
