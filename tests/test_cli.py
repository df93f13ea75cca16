"""The whole program through the command line: what it writes, prints and exits with."""

from __future__ import annotations

import csv
import json
import math
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import entry_points
from importlib.resources import files
from pathlib import Path
from typing import Any

import matplotlib.image
import numpy as np
import pytest
import tomli_w
from matplotlib.colors import to_hex
from numpy.typing import NDArray

import qparm
from conftest import DOME, cell_data
from made_arm import elsewhere_data, pose_list, row_of_poses
from qparm.view import joints, scene
from qparm.view.style import SELF_MOTION

pytestmark = pytest.mark.slow

PICTURES = ("joints.png", "velocity.png", "acceleration.png", "surface.png")
PROMISED = {"joint_path.csv", "trajectory.csv", "trajectory.json", "report.json", *PICTURES}
DOME_JOINTS = ("d1", *(f"theta{k}" for k in range(2, 9)))
UNITS = {"d1": "m"}

Array = NDArray[np.float64]


def run_qparm(*arguments: str | Path, cwd: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "qparm.cli", *map(str, arguments)]
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True, timeout=240, check=False)


def names_in(folder: Path) -> set[str]:
    return {entry.name for entry in folder.iterdir()}


def save_cell(data: dict[str, Any], path: Path) -> Path:
    path.write_text(tomli_w.dumps(data), encoding="utf-8")
    return path


@dataclass(frozen=True)
class Run:
    """A finished `qparm plan` and the folder it wrote."""

    process: subprocess.CompletedProcess[str]
    folder: Path

    @property
    def report(self) -> dict[str, Any]:
        """What report.json holds."""
        return json.loads((self.folder / "report.json").read_text(encoding="utf-8"))

    @property
    def message(self) -> dict[str, Any]:
        """What trajectory.json holds."""
        return json.loads((self.folder / "trajectory.json").read_text(encoding="utf-8"))

    def table(self, name: str) -> tuple[list[str], list[list[str]]]:
        """Return header and lines of a CSV file."""
        with (self.folder / name).open(newline="", encoding="utf-8") as file:
            header, *lines = csv.reader(file)
        return header, lines


@pytest.fixture(scope="module")
def dome_run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    folder = tmp_path_factory.mktemp("dome")
    return Run(run_qparm("plan", DOME, "--out", "tmp", cwd=folder), folder / "tmp")


@pytest.fixture(scope="module")
def general_run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Run the paper's baseline, which fails on the dome."""
    folder = tmp_path_factory.mktemp("general")
    return Run(run_qparm("plan", DOME, "--out", "tmp", "--strategy", "general", cwd=folder), folder / "tmp")


@pytest.fixture(scope="module")
def template(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("template")
    assert run_qparm("new", cwd=folder).returncode == 0
    return folder / "cell.toml"


@pytest.fixture(scope="module")
def template_run(template: Path) -> Run:
    return Run(run_qparm("plan", "cell.toml", cwd=template.parent), template.parent / "out")


@pytest.fixture(scope="module")
def ruckig_run(template: Path) -> Run:
    options = ("--timing", "ruckig", "--period", "50 ms", "--out", "ruckig", "--quiet")
    return Run(run_qparm("plan", "cell.toml", *options, cwd=template.parent), template.parent / "ruckig")


# --- a kinematics of the test's own, straight from the paper's table --------------------------------


def dome_forward(q: Array) -> Array:
    """Return tool poses (N, 4, 4) of the dome's arm: T = Rx(alpha) Tx(a) Rz(theta) Tz(d) a joint."""
    right = math.pi / 2
    #       alpha   a     d      theta
    table = [
        (-right, 0.0, 0.0, -right),
        (2 * right, 0.48, 0.0, 0.0),
        (right, 0.0, 0.0, right),
        (right, 0.0, 0.40, 0.0),
        (-right, 0.0, 0.0, 0.0),
        (right, 0.0, 0.418, 0.0),
        (-right, 0.0, 0.0, 0.0),
        (right, 0.0, 0.12, right),
    ]
    poses = np.empty((len(q), 4, 4))
    for k, row in enumerate(q):
        T = np.eye(4)
        for i, (alpha, a, d, theta) in enumerate(table):
            d, theta = (d + row[i], theta) if i == 0 else (d, theta + row[i])
            ct, st, ca, sa = math.cos(theta), math.sin(theta), math.cos(alpha), math.sin(alpha)
            T = T @ np.array(
                [
                    [ct, -st, 0.0, a],
                    [st * ca, ct * ca, -sa, -sa * d],
                    [st * sa, ct * sa, ca, ca * d],
                    [0.0, 0.0, 0.0, 1.0],
                ]
            )
        poses[k] = T
    return poses


def dome_target(index: int) -> Array:
    """Return the pose of a point of the dome's raster: 15 rows of 61 points, back and forth."""
    row, place = divmod(index, 61)
    along = place if row % 2 == 0 else 60 - place
    elevation, azimuth = math.radians(-10 + 5 * row), math.radians(-60 + 2 * along)
    outward = np.array(
        [
            math.cos(elevation) * math.sin(azimuth),
            -math.cos(elevation) * math.cos(azimuth),
            math.sin(elevation),
        ]
    )
    x = np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
    T = np.eye(4)
    T[:3, 0], T[:3, 1], T[:3, 2] = x, np.cross(-outward, x), -outward
    T[:3, 3] = np.array([0.0, 1.5, 0.36]) + 0.6 * outward
    return T


def angle_between(A: Array, B: Array) -> float:
    # the chord of the rotation, exact for small angles: |A - B| = 2 sqrt(2) sin(angle / 2)
    return 2 * math.asin(min(1.0, float(np.linalg.norm(A - B)) / math.sqrt(8)))


# --- the files of a plan ----------------------------------------------------------------------------


def test_the_command_is_installed() -> None:
    (script,) = entry_points(group="console_scripts", name="qparm")
    assert script.value == "qparm.cli:main"


def test_the_dome_exits_0_with_exactly_the_promised_files(dome_run: Run) -> None:
    assert dome_run.process.returncode == 0, dome_run.process.stdout + dome_run.process.stderr
    assert "Traceback" not in dome_run.process.stderr
    assert names_in(dome_run.folder) == PROMISED
    assert names_in(dome_run.folder.parent) == {"tmp"}


def test_the_whole_dome_is_covered_in_one_piece(dome_run: Run) -> None:
    report = dome_run.report
    measured = report["measured"]
    assert (report["executable"], report["reasons"], report["unreached"]) == (True, [], [])
    assert measured["reached"] == measured["points"] == 915
    assert measured["jumps"] == measured["reconfigurations"] == []
    assert measured["between"]["off_gaps"] == 0
    assert measured["between"]["position"] <= 5e-6
    assert measured["clearance"]["least_clearance"] >= 0.02 - 1e-6
    assert "break" not in {segment["kind"] for segment in report["segments"]}
    text = dome_run.process.stdout
    assert "points reached      915 of 915" in text
    assert "reconfigurations    0 inside rows, 0 at row ends, 0 across points not reached" in text
    assert "verdict: executable" in text


def test_the_general_method_exits_3_with_the_reasons(general_run: Run) -> None:
    assert general_run.process.returncode == 3, general_run.process.stderr
    text, report = general_run.process.stdout, general_run.report
    assert names_in(general_run.folder) == PROMISED
    assert 0 < report["measured"]["reached"] < 915
    assert f"points reached      {report['measured']['reached']} of 915" in text
    assert general_run.message["executable"] is False
    assert "verdict: NOT executable" in text
    assert "points are not reached" in report["reasons"][0]
    for reason in report["reasons"]:
        assert f"  - {reason}\n" in text
    lines = general_run.table("joint_path.csv")[1]
    indices = {int(line[0]) for line in lines if line[2] == "row" and int(line[0]) >= 0}
    assert indices | {point["index"] for point in report["unreached"]} == set(range(915))


def test_the_summary_names_the_files(dome_run: Run) -> None:
    text = dome_run.process.stdout
    for name in PROMISED:
        assert name in text.splitlines()[-1]


def test_joint_path_csv_has_the_columns_and_whole_numbers(dome_run: Run) -> None:
    header, lines = dome_run.table("joint_path.csv")
    assert header == ["index", "row", "kind", "status", "s[m]", *(f"{n}[{UNITS.get(n, 'rad')}]" for n in DOME_JOINTS)]
    assert {len(line) for line in lines} == {13}
    assert all(math.isfinite(float(x)) for line in lines for x in line[4:])
    assert {line[2] for line in lines} <= {"approach", "row", "transition", "retract"}
    for index, row, kind, _, *_ in lines:
        if kind == "row" and int(index) >= 0:
            assert int(index) // 61 == int(row)
        else:
            assert int(index) == -1
    assert lines[0][5:] == lines[-1][5:] == ["0.0"] * 8  # home
    for row in range(15):
        s = [float(line[4]) for line in lines if line[1:3] == [str(row), "row"]]
        assert s[0] == 0
        assert (np.diff(s) > 0).all()
        # the length of a circle of latitude, from -60 to 60 deg
        assert s[-1] == pytest.approx(0.6 * math.cos(math.radians(5 * row - 10)) * math.radians(120), rel=1e-12)
    assert [lines[0][2], lines[-1][2]] == ["approach", "retract"]


def test_trajectory_csv_has_the_columns_and_the_grid_of_20_ms(dome_run: Run) -> None:
    header, lines = dome_run.table("trajectory.csv")
    expected = ["t[s]"]
    for symbol, per in (("q", ""), ("qd", "/s"), ("qdd", "/s^2"), ("qddd", "/s^3")):
        expected += [f"{symbol}_{n}[{UNITS.get(n, 'rad')}{per}]" for n in DOME_JOINTS]
    assert header == [*expected, "row", "segment", "process_on"]
    assert {len(line) for line in lines} == {36}
    t = np.array([float(line[0]) for line in lines])
    assert t[:-1] == pytest.approx(0.02 * np.arange(len(t) - 1), abs=1e-9)
    assert 0 < t[-1] - t[-2] < 0.02 + 1e-9
    assert {line[-2] for line in lines} == {"approach", "row", "transition", "retract"}
    assert all((line[-1] == "1") == (line[-2] == "row") for line in lines)
    assert {line[-1] for line in lines} == {"0", "1"}


def test_trajectory_csv_passes_the_waypoints_within_the_limits(dome_run: Run) -> None:
    numbers = np.array([[float(x) for x in line[:33]] for line in dome_run.table("trajectory.csv")[1]])
    t, q = numbers[:, 0], numbers[:, 1:].reshape(-1, 4, 8)
    degree = math.pi / 180
    lower = np.array([0.0, *(-degree * np.array([170, 120, 170, 120, 170, 120, 175]))])
    upper = np.array([0.8, *(degree * np.array([170, 120, 170, 120, 170, 120, 175]))])
    assert (q[:, 0] >= lower - 1e-9).all()
    assert (q[:, 0] <= upper + 1e-9).all()
    for order, (rail, turn) in enumerate(((0.2, 60), (0.6, 180), (6.0, 1800)), start=1):
        limits = np.array([rail, *[turn * degree] * 7])
        assert (np.abs(q[:, order]) <= limits * (1 + 1e-6)).all()
    # every velocity is the slope of its position: the trapezium's error is bounded by h^3 jerk / 12
    h = np.diff(t)[:, None]
    error = np.abs(np.diff(q[:, 0], axis=0) - h / 2 * (q[1:, 1] + q[:-1, 1]))
    assert (error <= h**3 / 12 * np.array([6.0, *[1800 * degree] * 7]) + 1e-10).all()
    knots = dome_run.message["points"]
    times = np.array([p["time_from_start"]["sec"] + 1e-9 * p["time_from_start"]["nanosec"] for p in knots])
    positions = np.array([p["positions"] for p in knots])
    assert times[-1] == pytest.approx(t[-1], abs=1e-8)
    # a knot lies within half a period of a sample, and no joint moves farther than its speed allows
    nearest = np.abs(t[:, None] - times[None, :]).argmin(axis=0)
    away = np.abs(t[nearest] - times)[:, None]
    assert (np.abs(q[nearest, 0] - positions) <= away * np.array([0.2, *[60 * degree] * 7]) + 1e-9).all()


def test_trajectory_json_is_a_joint_trajectory(dome_run: Run) -> None:
    message = dome_run.message
    assert set(message) == {"header", "joint_names", "points"}
    assert message["header"] == {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
    assert message["joint_names"] == list(DOME_JOINTS)
    _, lines = dome_run.table("joint_path.csv")
    # the knots of the timing: all waypoints in order, and what lies between them
    passed = 0
    times = []
    for point in message["points"]:
        assert set(point) == {"positions", "velocities", "accelerations", "effort", "time_from_start"}
        assert [len(point[key]) for key in ("positions", "velocities", "accelerations")] == [8, 8, 8]
        assert point["effort"] == []
        # the message tells time in whole nanoseconds, and the state at that time
        waypoint = [float(x) for x in lines[passed][5:]] if passed < len(lines) else None
        passed += point["positions"] == pytest.approx(waypoint, abs=1e-9)
        time = point["time_from_start"]
        assert set(time) == {"sec", "nanosec"}
        assert type(time["sec"]) is type(time["nanosec"]) is int
        assert 0 <= time["nanosec"] < 10**9
        times.append(time["sec"] * 10**9 + time["nanosec"])
    assert passed == len(lines)
    assert times[0] == 0
    assert (np.diff(times) > 0).all()
    for end in (message["points"][0], message["points"][-1]):  # at rest, to rounding
        assert end["velocities"] == pytest.approx([0.0] * 8, abs=1e-8)


@pytest.mark.parametrize("name", ["dome_run", "general_run"])
def test_the_report_agrees_with_the_files_by_a_kinematics_of_the_tests_own(
    name: str, request: pytest.FixtureRequest
) -> None:
    run: Run = request.getfixturevalue(name)
    report, (_, lines) = run.report, run.table("joint_path.csv")
    at = [line for line in lines if line[2] == "row" and int(line[0]) >= 0]
    index = np.array([int(line[0]) for line in at])
    q = np.array([[float(x) for x in line[5:]] for line in at])
    poses = dome_forward(q)
    targets = np.array([dome_target(int(k)) for k in index])
    position = np.linalg.norm(poses[:, :3, 3] - targets[:, :3, 3], axis=1)
    rotation = np.array([angle_between(A[:3, :3], B[:3, :3]) for A, B in zip(poses, targets, strict=True)])
    good = (position <= 1e-6) & (rotation <= 1e-5)
    measured = report["measured"]
    assert measured["points"] == 915
    assert measured["reached"] == good.sum() > 0
    unreached = sorted(set(range(915)) - set(index[good].tolist()))
    assert [point["index"] for point in report["unreached"]] == unreached
    assert all(p["row"] == p["index"] // 61 and p["place_in_row"] == p["index"] % 61 for p in report["unreached"])
    assert measured["position_error_max"] == pytest.approx(position.max(), abs=1e-13)
    assert measured["position_error_mean"] == pytest.approx(position.mean(), abs=1e-13)
    assert measured["rotation_error_max"] == pytest.approx(rotation.max(), abs=1e-13)
    assert measured["rotation_error_mean"] == pytest.approx(rotation.mean(), abs=1e-13)

    step = np.abs(np.diff(q, axis=0))
    criterion = np.array([0.2 * 50 / 60, *[math.radians(50)] * 7])
    over = np.flatnonzero((step > criterion).any(axis=1))
    # every step over the criterion has a motion of its own
    assert measured["jumps"] == []
    large = [jump for jump in measured["reconfigurations"] if jump["ratio"] > 1]
    found = [(jump["first"], jump["last"], jump["joint"]) for jump in large]
    assert found == [(int(index[k]), int(index[k + 1]), DOME_JOINTS[int((step[k] / criterion).argmax())]) for k in over]
    assert [jump["step"] for jump in large] == pytest.approx(
        [step[k, (step[k] / criterion).argmax()] for k in over], rel=1e-12
    )
    near = (np.diff(index) == 1) & (index[1:] // 61 == index[:-1] // 61)
    assert measured["largest_step_prismatic"] == pytest.approx(step[near, 0].max(), rel=1e-12)
    assert measured["largest_step_revolute"] == pytest.approx(step[near, 1:].max(), rel=1e-12)
    assert list(report["jump_criterion"].values()) == pytest.approx(criterion, rel=1e-12)


def test_the_report_agrees_with_trajectory_csv(dome_run: Run) -> None:
    report = dome_run.report
    _, lines = dome_run.table("trajectory.csv")
    numbers = np.array([[float(x) for x in line[:33]] for line in lines])
    assert report["measured"]["duration"] == pytest.approx(numbers[-1, 0], abs=1e-8)
    on = np.array([line[-1] == "1" for line in lines])
    tool = dome_forward(numbers[on, 1:9])[:, :3, 3]
    off = np.abs(np.linalg.norm(tool - [0.0, 1.5, 0.36], axis=1) - 0.6)
    # measured at 32 places between every two points, not at the samples
    assert report["measured"]["surface_deviation"] == pytest.approx(off.max(), rel=0.01)
    limits = np.array([[0.2, 0.6, 6.0], *[np.radians([60, 180, 1800])] * 7])
    samples = np.abs(numbers[:, 1:]).reshape(-1, 4, 8).max(axis=0)
    knots = dome_run.message["points"]
    for i, joint in enumerate(report["joints"]):
        assert joint["name"] == DOME_JOINTS[i]
        velocity = max(samples[1, i], *(abs(p["velocities"][i]) for p in knots))
        acceleration = max(samples[2, i], *(abs(p["accelerations"][i]) for p in knots))
        # between the samples and knots the peaks are a little higher, never lower
        seen = np.array([velocity, acceleration, samples[3, i]]) / limits[i]
        told = np.array([joint[f"{order}_share"] for order in ("velocity", "acceleration", "jerk")])
        assert (told >= seen * (1 - 1e-9)).all()
        np.testing.assert_allclose(told, seen, rtol=0.05)


def test_the_report_says_how_it_was_made(dome_run: Run) -> None:
    report = dome_run.report
    assert report["options"] == {
        "strategy": "graph",
        "method": "cwln",
        "solver": "auto",
        "smooth": True,
        "for_linear": False,
        "timing": "quintic",
        "seed": 0,
        "period": 0.02,
    }
    assert report["cell"]["name"] == "dome"
    assert report["versions"]["python"].startswith("3.")
    assert report["segments"][0]["start"] == 0.0
    ends = [segment["end"] for segment in report["segments"]]
    assert [segment["start"] for segment in report["segments"][1:]] == ends[:-1]
    assert ends[-1] == pytest.approx(report["measured"]["duration"], abs=1e-8)


@pytest.mark.parametrize("name", PICTURES)
def test_the_pictures_are_not_blank(dome_run: Run, name: str) -> None:
    picture = matplotlib.image.imread(dome_run.folder / name)
    height, width = picture.shape[:2]
    assert min(height, width) >= 300
    grey = picture[..., :3].mean(axis=2)
    assert grey.std() > 0.02
    # something is drawn in every quarter, so an empty frame in a corner would not pass
    for part in (grey[: height // 2], grey[height // 2 :], grey[:, : width // 2], grey[:, width // 2 :]):
        assert part.std() > 0.01
    assert len(np.unique((picture[::4, ::4, :3] * 15).round().reshape(-1, 3), axis=0)) > 12


def test_the_same_seed_gives_the_same_bytes(dome_run: Run, tmp_path: Path) -> None:
    again = run_qparm("plan", DOME, "--out", "again", "--seed", "0", "--quiet", cwd=tmp_path)
    assert (again.returncode, again.stdout, again.stderr) == (0, "", "")
    for name in ("joint_path.csv", "trajectory.csv", "trajectory.json"):
        assert (tmp_path / "again" / name).read_bytes() == (dome_run.folder / name).read_bytes()


# --- a plan that may be executed --------------------------------------------------------------------


def test_the_template_is_planned_executable(template_run: Run) -> None:
    assert template_run.process.returncode == 0, template_run.process.stdout
    assert "verdict: executable" in template_run.process.stdout
    assert names_in(template_run.folder) == PROMISED
    report = template_run.report
    assert (report["executable"], report["reasons"], report["unreached"]) == (True, [], [])
    assert report["measured"]["reached"] == report["measured"]["points"] == 279
    assert set(template_run.message) == {"header", "joint_names", "points"}


def test_ruckig_keeps_the_waypoints_and_the_limits(ruckig_run: Run, template_run: Run) -> None:
    assert ruckig_run.process.returncode == 0, ruckig_run.process.stderr
    assert (ruckig_run.process.stdout, ruckig_run.process.stderr) == ("", "")
    report = ruckig_run.report
    assert report["options"]["timing"] == "ruckig"
    assert report["executable"] is True
    path = "joint_path.csv"
    assert (ruckig_run.folder / path).read_bytes() == (template_run.folder / path).read_bytes()
    assert ruckig_run.report["measured"]["duration"] != template_run.report["measured"]["duration"]
    _, lines = ruckig_run.table("trajectory.csv")
    q = np.array([[float(x) for x in line[1:29]] for line in lines]).reshape(-1, 4, 7)
    speed = np.radians([85, 85, 100, 75, 130, 135, 135])
    assert (np.abs(q[:, 1]) <= speed * (1 + 1e-6)).all()
    assert (np.abs(q[:, 2]) <= math.radians(300) * (1 + 1e-6)).all()
    assert (np.abs(q[:, 3]) <= math.radians(3000) * (1 + 1e-6)).all()


def test_the_period_is_that_of_the_option(ruckig_run: Run) -> None:
    t = np.array([float(line[0]) for line in ruckig_run.table("trajectory.csv")[1]])
    assert t[:-1] == pytest.approx(0.05 * np.arange(len(t) - 1), abs=1e-9)
    assert 0 < t[-1] - t[-2] < 0.05 + 1e-9


def test_a_plan_replaces_the_files_of_an_earlier_one_and_no_others(template: Path) -> None:
    folder = template.parent / "used"
    folder.mkdir()
    (folder / "joint_path.csv").write_text("old", encoding="utf-8")
    (folder / "notes.txt").write_text("mine", encoding="utf-8")
    data = cell_data(template)
    data["process"].update(rows=2, points=5)
    run = run_qparm("plan", save_cell(data, folder.parent / "few.toml"), "--out", folder, cwd=template.parent)
    assert "Traceback" not in run.stderr
    assert names_in(folder) == PROMISED | {"notes.txt"}
    assert (folder / "notes.txt").read_text(encoding="utf-8") == "mine"
    assert (folder / "joint_path.csv").read_text(encoding="utf-8").startswith("index,row,kind,status,s[m],a1[rad]")


def test_a_workpiece_wholly_out_of_reach_is_reported_not_raised(tmp_path: Path) -> None:
    data = cell_data()
    data["process"].update(rows=2, points=5)
    data["workpiece"]["pose"]["position"] = ["0 mm", "15 m", "360 mm"]
    run = run_qparm("plan", save_cell(data, tmp_path / "far.toml"), "--out", "far", cwd=tmp_path)
    assert "Traceback" not in run.stderr
    assert run.returncode == 3
    assert "points reached      0 of 10" in run.stdout
    assert names_in(tmp_path / "far") == PROMISED


# --- what the pictures show ---------------------------------------------------------------------------


def drawn(draw: Callable[[Path], None], module: Any, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Return the figure that is saved, laid out."""
    figures: list[Any] = []
    monkeypatch.setattr(module, "save", lambda figure, _: figures.append(figure))
    draw(Path("none.png"))
    (figure,) = figures
    figure.canvas.draw()
    return figure


def marked_plan(**changes: Any) -> qparm.Plan:
    data = cell_data()
    data["process"].update(rows=2, points=11, self_motion={"points": 2})
    data["workpiece"].update(azimuth=["-10 deg", "10 deg"])
    data["workpiece"]["pose"].update(changes)
    return qparm.plan(data)


def test_the_unrolled_rows_mark_the_points_of_self_motion_areas(monkeypatch: pytest.MonkeyPatch) -> None:
    plan = marked_plan()
    reached = np.ones(plan.tool_path.point_count, dtype=bool)
    reached[plan.record.unreached] = False
    expected = int((plan.tool_path.in_self_motion_area & reached).sum())
    assert expected > 0
    figure = drawn(lambda file: scene.draw_surface(plan, file), scene, monkeypatch)
    handles, labels = figure.axes[1].get_legend_handles_labels()
    marks = handles[labels.index(f"in self-motion areas ({expected})")]
    assert len(marks.get_offsets()) == expected
    assert to_hex(marks.get_facecolors()[0]) == SELF_MOTION
    assert figure.axes[0].get_title() == "dome: arm at the middle of its path"


def rows_of_poses(against: list[bool], *, ring: bool = False) -> qparm.Cell:
    """Return a cell of rows side by side, straight or nearly closed, some of them the other way."""
    share = np.linspace(0.0, 1.0, 9)
    data = elsewhere_data()
    rows = []
    for k, other in enumerate(against):
        poses, turn = row_of_poses(9, length=0.2), 6.0 * share
        if ring:
            poses[:, 0, 3], poses[:, 1, 3] = 0.5 + 0.1 * np.cos(turn), 0.1 * np.sin(turn)
        poses[:, 2, 3] += 0.02 * k
        rows.append(poses[::-1] if other else poses)
    data["workpiece"]["poses"] = pose_list(*rows)
    return qparm.Cell.load(data)


@pytest.mark.parametrize("ring", [False, True])
@pytest.mark.parametrize("against", [[False, True, False, True], [False, False, False], [False, True, True, False]])
def test_unrolled_rows_lie_side_by_side_whichever_way_they_run(against: list[bool], ring: bool) -> None:
    assert scene.backwards(rows_of_poses(against, ring=ring).tool_path()) == against


def test_transitions_of_a_back_and_forth_raster_are_drawn_at_the_ends(dome: qparm.Cell) -> None:
    assert scene.backwards(dome.tool_path()) == [bool(k % 2) for k in range(15)]


def test_a_plan_that_reaches_nothing_says_so_in_its_titles(monkeypatch: pytest.MonkeyPatch) -> None:
    plan = marked_plan(position=["0 mm", "15 m", "360 mm"])
    assert len(plan.record.unreached) == 22
    surface = drawn(lambda file: scene.draw_surface(plan, file), scene, monkeypatch)
    assert "nothing reached" in surface.axes[0].get_title()
    curves = drawn(lambda file: joints.draw_joints(plan, 0, file), joints, monkeypatch)
    assert "nothing reached" in curves.get_suptitle()


def test_a_space_axis_has_few_numbers(monkeypatch: pytest.MonkeyPatch, dome: qparm.Cell) -> None:
    figure = drawn(lambda file: scene.draw_arm(dome, file), scene, monkeypatch)
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
            low, high = sorted(axis.get_view_interval())
            assert sum(low <= tick <= high for tick in axis.get_majorticklocs()) <= 5


def test_many_joints_do_not_crush_the_axes(monkeypatch: pytest.MonkeyPatch) -> None:
    data = cell_data(files("qparm.cell").joinpath("new_cell.toml"))  # type: ignore[arg-type]
    first = data["arm"]["joints"][0]
    straight = {"alpha": "0 deg", "a": "10 mm", "d": "0 mm", "theta": "0 deg"}
    extra = [first | {"name": f"extra_{k}", "dh": straight} for k in range(30)]
    data["arm"]["joints"] += extra
    data["arm"]["home"] += ["0 deg"] * len(extra)
    data["process"].update(rows=1, points=2)
    plan = qparm.plan(data)
    figure = drawn(lambda file: joints.draw_joints(plan, 0, file), joints, monkeypatch)
    (axes,) = figure.axes
    legend = axes.get_legend().get_window_extent()
    assert legend.height < figure.bbox.height
    assert legend.x1 <= figure.bbox.width + 1
    assert axes.get_window_extent().height > 0.6 * figure.bbox.height
    assert axes.get_window_extent().width > 9 * figure.dpi


# --- the other commands -----------------------------------------------------------------------------


def test_check_says_that_the_dome_is_within_reach(tmp_path: Path) -> None:
    run = run_qparm("check", DOME, "--out", "look", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert "points within reach: 915 of 915" in run.stdout
    assert "jump criterion  50 deg, 166.7 mm" in run.stdout
    # d1 at its home of zero and the arm straight up: L1 + L2 + L3 + L4
    assert "tool at home    (0.000, 0.000, 1418.000) mm" in run.stdout
    assert names_in(tmp_path / "look") == {"arm.png"}
    picture = matplotlib.image.imread(tmp_path / "look" / "arm.png")
    assert picture[..., :3].std() > 0.02
    assert min(picture.shape[:2]) >= 300


def test_check_exits_3_and_names_the_points_out_of_reach(tmp_path: Path) -> None:
    data = cell_data()
    data["workpiece"]["azimuth"] = ["-75 deg", "75 deg"]
    data["process"]["points"] = 76
    run = run_qparm("check", save_cell(data, tmp_path / "wide.toml"), cwd=tmp_path)
    assert run.returncode == 3, run.stderr
    assert "points within reach: 1050 of 1140" in run.stdout
    named = [line for line in run.stdout.splitlines() if line.startswith("  row ") and " points " in line]
    assert named
    assert names_in(tmp_path / "out") == {"arm.png"}


def test_new_writes_a_cell_that_passes_check_and_does_not_overwrite_it(tmp_path: Path) -> None:
    first = run_qparm("new", "mine.toml", cwd=tmp_path)
    assert first.returncode == 0, first.stderr
    assert "qparm check mine.toml" in first.stdout
    assert names_in(tmp_path) == {"mine.toml"}
    checked = run_qparm("check", "mine.toml", cwd=tmp_path)
    assert checked.returncode == 0, checked.stderr
    assert "points within reach: 279 of 279" in checked.stdout

    (tmp_path / "mine.toml").write_text("changed", encoding="utf-8")
    second = run_qparm("new", "mine.toml", cwd=tmp_path)
    assert second.returncode == 2
    assert "Traceback" not in second.stderr
    assert "'mine.toml' exists already" in second.stderr
    assert (tmp_path / "mine.toml").read_text(encoding="utf-8") == "changed"


@pytest.mark.parametrize("module", ["qparm.reports.plan", "qparm.export", "qparm.reports.check"])
def test_the_packages_functions_stay_callable_whatever_was_imported_first(module: str, tmp_path: Path) -> None:
    # a module of the same name as a function would hide it once imported
    code = f"import qparm, {module}; print(callable(qparm.report), callable(qparm.plan))"
    run = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, timeout=240, check=False
    )
    assert (run.stdout, run.stderr) == ("True True\n", "")


def test_help_and_version(tmp_path: Path) -> None:
    told = run_qparm("--help", cwd=tmp_path)
    assert told.returncode == 0
    for command in ("plan", "check", "new"):
        assert command in told.stdout
    version = run_qparm("--version", cwd=tmp_path)
    assert version.returncode == 0
    assert version.stdout.startswith("qparm, version ")
