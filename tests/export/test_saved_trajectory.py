"""A plan's folder read back as a trajectory, and exported by the command."""

from __future__ import annotations

import json
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import qparm
from conftest import few_rows
from made_trajectory import RAIL_AND_SEVEN, RAIL_AND_SIX, cell_of, units_of
from qparm import cli
from qparm.errors import InvalidInput
from qparm.export import load_trajectory
from qparm.verify.kinematics import joint_transforms
from qparm.verify.readers import read_motion


@pytest.fixture(scope="module", params=["quintic", "ruckig"])
def plan(request: pytest.FixtureRequest) -> qparm.Plan:
    if request.param == "ruckig":
        pytest.importorskip("ruckig")
    return qparm.plan(few_rows(), timing=request.param)


@pytest.fixture(scope="module")
def folder(plan: qparm.Plan, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("plan")
    qparm.write(plan, folder, pictures=False)
    return folder


def test_the_trajectory_of_a_folder_is_that_of_the_plan(plan: qparm.Plan, folder: Path) -> None:
    saved = load_trajectory(folder)
    trajectory, source = saved.trajectory, plan.trajectory
    assert saved.units == plan.chain.units == units_of(RAIL_AND_SEVEN)
    assert (trajectory.joint_names, trajectory.timing) == (source.joint_names, source.timing)
    assert (trajectory.executable, trajectory.reasons) == (True, ())
    assert trajectory.duration == pytest.approx(source.duration, abs=1e-9)
    assert [(s.kind, s.row) for s in trajectory.segments] == [(s.kind, s.row) for s in source.segments]
    assert [s.end for s in trajectory.segments] == pytest.approx([s.end for s in source.segments], abs=1e-9)
    t = np.linspace(0.0, min(trajectory.duration, source.duration), 5001)
    # what nanoseconds leave open: a velocity's share of a position, and so on
    for order, within in enumerate((1e-8, 1e-6, 1e-4)):
        assert np.abs(trajectory(t, order) - source(t, order)).max() < within, order


def test_its_jerk_has_a_meaning_everywhere(plan: qparm.Plan, folder: Path) -> None:
    trajectory = load_trajectory(folder).trajectory
    knots = trajectory.knots
    # of either form: on shorter pieces the digits of a file would make jerk
    assert np.diff(knots).min() > 9e-5
    t = np.concatenate([knots[:-1] + np.diff(knots) * x for x in (0.01, 0.3, 0.7, 0.99)])
    limits = np.array([[joint.velocity, joint.acceleration, joint.jerk] for joint in plan.chain.joints]).T
    for order, limit in enumerate(limits, 1):
        assert (np.abs(trajectory(t, order)) <= limit * 1.0001).all(), order


def test_every_sample_of_the_plans_csv_is_on_it(folder: Path) -> None:
    trajectory = load_trajectory(folder).trajectory
    cell = qparm.Cell.load(few_rows())
    table = read_motion(folder / "trajectory.csv", cell)
    assert table.velocity is not None
    assert np.abs(table.q - trajectory(table.t)).max() < 1e-8
    assert np.abs(table.velocity - trajectory(table.t, 1)).max() < 1e-6
    knots = read_motion(folder / "trajectory.json", cell)
    assert knots.format == "json"
    assert np.abs(knots.q - trajectory(knots.t)).max() < 1e-14


def test_a_plan_that_failed_says_so(folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    change(tmp_path / "report.json", lambda r: r.update(executable=False, reasons=["3 points were not reached"]))
    assert load_trajectory(tmp_path).trajectory.reasons == ("3 points were not reached",)
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    change(tmp_path / "trajectory.json", lambda m: m.update(executable=False))
    saved = load_trajectory(tmp_path).trajectory
    assert (saved.executable, saved.reasons) == (False, ("trajectory.json says so",))


def change(file: Path, how: Callable[[dict[str, Any]], object]) -> None:
    data = json.loads(file.read_text(encoding="utf-8"))
    how(data)
    file.write_text(json.dumps(data), encoding="utf-8")


@pytest.mark.parametrize(
    ("name", "how", "sentence"),
    [
        ("trajectory.json", lambda m: m["points"].pop(), "not of one plan: no point at"),
        ("trajectory.json", lambda m: m["points"].reverse(), "point 1: the time .* does not come after"),
        ("trajectory.json", lambda m: m["joint_names"].reverse(), "are not of the same joints: d1"),
        ("trajectory.json", lambda m: m.pop("points"), "not a whole JointTrajectory"),
        ("report.json", lambda r: r["segments"].pop(), "not of one plan: they end at different times"),
        ("report.json", lambda r: r["segments"][0].update(end=0.123), "not of one plan: no point at 0.123"),
        (
            "report.json",
            lambda r: r["segments"][0].update(kind="dance"),
            "not a whole report: .dance. is not a valid SegmentKind",
        ),
        ("report.json", lambda r: r.pop("reasons"), "not a whole report: KeyError 'reasons'"),
    ],
)
def test_a_broken_folder_is_refused(
    name: str, how: Callable[[dict[str, Any]], object], sentence: str, folder: Path, tmp_path: Path
) -> None:
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    change(tmp_path / name, how)
    with pytest.raises(InvalidInput, match=sentence):
        load_trajectory(tmp_path)


def test_what_is_no_plans_folder_is_refused(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="does not exist; give the folder that `qparm plan` wrote"):
        load_trajectory(tmp_path / "nowhere")
    with pytest.raises(InvalidInput, match="is a file; give the folder"):
        load_trajectory(folder / "report.json")
    for name in ("trajectory.json", "joint_path.csv", "report.json"):
        shutil.copytree(folder, tmp_path / name, dirs_exist_ok=True)
        (tmp_path / name / name).unlink()
        with pytest.raises(InvalidInput, match=f"holds no {name}; give the folder"):
            load_trajectory(tmp_path / name)
    shutil.copytree(folder, tmp_path / "cut", dirs_exist_ok=True)
    text = (folder / "report.json").read_text(encoding="utf-8")
    (tmp_path / "cut" / "report.json").write_text(text[: len(text) // 2], encoding="utf-8")
    with pytest.raises(InvalidInput, match=r"report.json is not whole JSON"):
        load_trajectory(tmp_path / "cut")


def test_a_plan_that_reaches_nothing_is_one_point(tmp_path: Path) -> None:
    data = few_rows(rows=2, points=5)
    data["workpiece"]["pose"]["position"] = ["0 mm", "15 m", "360 mm"]
    plan = qparm.plan(data)
    qparm.write(plan, tmp_path, pictures=False)
    trajectory = load_trajectory(tmp_path).trajectory
    assert (trajectory.duration, trajectory.executable) == (0.0, False)
    assert np.array_equal(trajectory(0.0), plan.joint_path.q[0])


# --- the command ----------------------------------------------------------------------------------------


def run(*arguments: str | Path, cwd: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "qparm.cli", "export", "trajectory", *map(str, arguments)]
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True, timeout=240, check=False)


@pytest.fixture(scope="module")
def quintic_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("command")
    qparm.write(qparm.plan(few_rows()), folder / "out", pictures=False)
    return folder / "out"


@pytest.mark.slow
def test_the_command_writes_a_stream(quintic_folder: Path, tmp_path: Path) -> None:
    done = run(quintic_folder, "--to", "stream", "--out", "servo.csv", "--period", "8 ms", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    trajectory = load_trajectory(quintic_folder).trajectory
    table = read_motion(tmp_path / "servo.csv", qparm.Cell.load(few_rows()))
    assert np.diff(table.t) == pytest.approx(0.008, abs=1e-9)
    assert 0 <= table.t[-1] - trajectory.duration < 0.008
    assert np.abs(table.q - trajectory(np.minimum(table.t, trajectory.duration))).max() < 1e-10
    assert done.stdout == f"{len(table.t)} samples, {table.t[-1]:.6g} s\nwritten: servo.csv\n"
    quiet = run(quintic_folder, "--to", "rosbag2", "--out", "bag", "-q", cwd=tmp_path)
    assert (quiet.returncode, quiet.stdout, quiet.stderr) == (0, "", "")
    assert read_motion(tmp_path / "bag", qparm.Cell.load(few_rows())).format == "rosbag2"


@pytest.mark.parametrize(
    ("arguments", "code", "sentence"),
    [
        (["--to", "krl", "--out", "part.src"], 2, "A6 theta7, E1 d1; no place for theta8. Formats that take any arm"),
        (["--to", "rapid", "--out", "part.mod"], 2, "this arm has 7 revolute and 1 prismatic"),
        (["--to", "csv", "--out", "x.csv", "--period", "4"], 2, "--period: "),
        (["--to", "csv", "--out", "x.csv", "--period", "0.01 ms"], 2, "--period: must lie between 0.1 ms and 10 s"),
        (["--to", "excel", "--out", "x.xls"], 2, "'excel' is not one of 'csv', 'npz'"),
        (["--to", "npz", "--out", "x.csv"], 2, "must be named *.npz"),
        (["--to", "npz", "--out", "/proc/nowhere/x.npz"], 4, "cannot write to '/proc/nowhere'"),
    ],
)
def test_the_command_refuses_in_words(
    arguments: list[str],
    code: int,
    sentence: str,
    quintic_folder: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(signal, "signal", lambda *_: None)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as exited:
        cli.main(["export", "trajectory", str(quintic_folder), *arguments])
    assert exited.value.code == code
    assert sentence in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_the_command_marks_what_must_not_be_executed(quintic_folder: Path, tmp_path: Path) -> None:
    shutil.copytree(quintic_folder, tmp_path / "failed")
    change(tmp_path / "failed" / "report.json", lambda r: r.update(executable=False, reasons=["a jump"]))
    refused = run("failed", "--to", "json", "--out", "m.json", cwd=tmp_path)
    assert refused.returncode == 2
    assert refused.stderr.endswith("--allow-failures writes it all the same\n  - a jump\n")
    done = run("failed", "--to", "json", "--out", "m.json", "--allow-failures", cwd=tmp_path)
    assert done.returncode == 0
    assert "marked: must not be executed" in done.stdout
    assert json.loads((tmp_path / "m.json").read_text(encoding="utf-8"))["executable"] is False


@pytest.mark.slow
def test_a_missing_package_exits_5(quintic_folder: Path, tmp_path: Path) -> None:
    code = "import sys; sys.modules['pyarrow'] = None; from qparm.cli import main; main(sys.argv[1:])"
    arguments = ["export", "trajectory", str(quintic_folder), "--to", "parquet", "--out", "x.parquet"]
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 5
    assert done.stderr == (
        "qparm: the package 'pyarrow' is not installed; use --to npz, or install it: pip install 'qparm[parquet]'\n"
    )
    assert list(tmp_path.iterdir()) == []


@pytest.fixture(scope="module")
def rail_and_six_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Plan rows that six joints and the rail can do with a tool that may spin."""
    data = cell_of(RAIL_AND_SIX)
    data["workpiece"] |= {"elevation": ["25 deg", "40 deg"], "azimuth": ["-10 deg", "10 deg"]}
    data["process"] |= {"rows": 3, "points": 9, "tool_spin": "free"}
    folder = tmp_path_factory.mktemp("six")
    report = qparm.write(qparm.plan(data), folder / "out", pictures=False)
    assert report.executable, report.reasons
    return folder / "out"


@pytest.mark.parametrize(("to", "name"), [("krl", "part.src"), ("rapid", "part.mod")])
@pytest.mark.slow
def test_a_program_leads_the_tool_over_the_surface(
    to: str, name: str, rail_and_six_folder: Path, tmp_path: Path
) -> None:
    done = run(rail_and_six_folder, "--to", to, "--out", name, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    cell = qparm.Cell.load(cell_of(RAIL_AND_SIX))
    trajectory = load_trajectory(rail_and_six_folder).trajectory
    table = read_motion(tmp_path / name, cell)
    order = [RAIL_AND_SIX.index(joint) for joint in table.joints]
    assert table.t[-1] == pytest.approx(trajectory.duration, abs=1e-6)
    assert np.diff(table.t).max() <= 0.05 + 1e-6
    # positions as rounded, where the trajectory is in the microsecond of the time
    q = table.q[:, np.argsort(order)]
    slack = np.where(np.array(saved_units(rail_and_six_folder)) == "m", 0.5e-7, np.radians(0.5e-5))
    speed = np.abs(trajectory(np.linspace(0, trajectory.duration, 2000), 1)).max(axis=0)
    assert (np.abs(q - trajectory(np.minimum(table.t, trajectory.duration))) <= slack * 1.001 + 1e-6 * speed).all()
    # on the rows the tool is on the dome, by a kinematics that knows nothing of all this
    tool = joint_transforms(cell, q)[0][:, :3, 3]
    rows = [s for s in trajectory.segments if s.process_on]
    on = np.any([(table.t >= s.start - 1e-6) & (table.t <= s.end + 1e-6) for s in rows], axis=0)
    assert on.sum() > 100
    off = np.abs(np.linalg.norm(tool - [0.0, 1.5, 0.36], axis=1) - 0.6)
    assert off[on].max() < 1e-6
    assert off[~on].max() > 0.02


def saved_units(folder: Path) -> tuple[str, ...]:
    return load_trajectory(folder).units


# --- files of two plans -----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["trajectory.json", "joint_path.csv"])
def test_files_of_two_plans_are_not_executable(name: str, folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    report = json.loads((tmp_path / "report.json").read_text(encoding="utf-8"))
    assert set(report["files"]) == {"joint_path.csv", "trajectory.csv", "trajectory.json"}
    assert load_trajectory(tmp_path).trajectory.executable
    content = (tmp_path / name).read_bytes()
    (tmp_path / name).write_bytes(content + b"\n" if name.endswith("json") else content.replace(b"0.1", b"0.2", 1))
    trajectory = load_trajectory(tmp_path).trajectory
    assert trajectory.executable is False
    assert trajectory.reasons == (f"{name} is not the file that report.json was written with",)


def test_a_plan_without_pictures_removes_those_of_the_plan_before(plan: qparm.Plan, tmp_path: Path) -> None:
    (tmp_path / "joints.png").write_bytes(b"mine")
    qparm.write(plan, tmp_path, pictures=False)
    assert (tmp_path / "joints.png").read_bytes() == b"mine"  # no plan had been written there
    qparm.write(plan, tmp_path, pictures=False)
    assert not (tmp_path / "joints.png").exists()
