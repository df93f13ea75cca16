"""What is not valid is refused with the key and a code, and nothing half written is left behind."""

from __future__ import annotations

import json
import math
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import tomli_w

import qparm
from conftest import DOME, cell_data
from qparm import cli
from qparm.errors import PackageMissing, SolverUnavailable
from qparm.ik.solvers.generic import GenericSolver
from qparm.ik.solvers.proxqp import ProxqpSolver
from qparm.verify import Figures, measure, read_knots, read_samples, read_waypoints

Edit = Callable[[dict[str, Any]], object]
PROMISED = (
    "acceleration.png",
    "joint_path.csv",
    "joints.png",
    "report.json",
    "surface.png",
    "trajectory.csv",
    "trajectory.json",
    "velocity.png",
)
# what the installed command runs
# as in the foreground of a terminal: what a shell starts in the background inherits an ignored SIGINT
FOREGROUND = (
    "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); from qparm.cli import main; main()"
)
QPARM = (sys.executable, "-c", FOREGROUND)


def run_qparm(*arguments: str | Path, cwd: Path, **options: Any) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*QPARM, *map(str, arguments)],
        cwd=cwd,
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
        **options,
    )


def save_cell(edit: Edit, path: Path) -> Path:
    data = cell_data()
    edit(data)
    path.write_text(tomli_w.dumps(data), encoding="utf-8")
    return path


def few_points(data: dict[str, Any]) -> None:
    data["process"].update(rows=2, points=5)


def names_in(folder: Path) -> set[str]:
    return {entry.name for entry in folder.iterdir()} if folder.exists() else set()


def joint(data: dict[str, Any], number: int) -> dict[str, Any]:
    return data["arm"]["joints"][number]


# --- cells ------------------------------------------------------------------------------------------

BAD_CELLS: list[tuple[str, Edit, str]] = [
    ("unknown key", lambda d: d["process"].update(row=3), "process.row: unknown key; did you mean 'rows'"),
    ("unknown key called prismatic", lambda d: d.update(prismatic=1), "prismatic: unknown key"),
    ("wrong unit", lambda d: d["workpiece"].update(radius="600 deg"), "workpiece.radius: 'deg' is not a unit"),
    ("missing unit", lambda d: d["process"].update(feed="20"), "process.feed: '20' has no unit"),
    (
        "limits reversed",
        lambda d: joint(d, 1).update(position=["170 deg", "-170 deg"]),
        "arm.joints[1].position: the limits are reversed",
    ),
    ("zero rows", lambda d: d["process"].update(rows=0), "process.rows: "),
    ("nan", lambda d: d["workpiece"].update(radius="nan mm"), "workpiece.radius: 'nan mm' is not finite"),
    ("home too short", lambda d: d["arm"]["home"].pop(), "arm.home: the arm has 8 joints, home has 7 values"),
    ("missing key", lambda d: joint(d, 4).pop("jerk"), "arm.joints[4].jerk: is missing"),
    ("points beyond memory", lambda d: d["process"].update(points=10**15), "process"),
]


@pytest.mark.parametrize(("edit", "part"), [case[1:] for case in BAD_CELLS], ids=[case[0] for case in BAD_CELLS])
def test_a_bad_cell_exits_2_and_names_the_key(edit: Edit, part: str, tmp_path: Path) -> None:
    cell = save_cell(edit, tmp_path / "cell.toml")
    run = run_qparm("plan", cell, "--out", "out", cwd=tmp_path)
    assert "Traceback" not in run.stderr
    assert run.returncode == 2
    assert run.stderr.startswith(f"qparm: {cell} has 1 problem\n  ")
    assert part in run.stderr
    assert run.stdout == ""
    assert names_in(tmp_path / "out") == set()


def test_all_problems_of_a_cell_are_told_at_once_by_check_too(tmp_path: Path) -> None:
    def edit(data: dict[str, Any]) -> None:
        data["process"].update(rows=0, feed="20")
        data["workpiece"].update(radius="nan mm")

    run = run_qparm("check", save_cell(edit, tmp_path / "cell.toml"), "--out", "out", cwd=tmp_path)
    assert "Traceback" not in run.stderr
    assert run.returncode == 2
    assert "has 3 problems" in run.stderr
    for key in ("process.rows", "process.feed", "workpiece.radius"):
        assert f"  {key}: " in run.stderr
    assert names_in(tmp_path / "out") == set()


@pytest.mark.parametrize("command", ["plan", "check"])
def test_a_missing_cell_file(command: str, tmp_path: Path) -> None:
    run = run_qparm(command, "none.toml", "--out", "out", cwd=tmp_path)
    assert "Traceback" not in run.stderr
    assert run.returncode == 2
    assert "none.toml" in run.stderr
    assert "no such file" in run.stderr
    assert names_in(tmp_path / "out") == set()


@pytest.mark.parametrize(
    ("content", "part"), [(b"schema = = 1\n", "not valid TOML"), (b'name = "d\xf4me"\n', "not UTF-8")]
)
def test_a_cell_file_that_cannot_be_parsed(content: bytes, part: str, tmp_path: Path) -> None:
    (tmp_path / "cell.toml").write_bytes(content)
    run = run_qparm("plan", "cell.toml", "--out", "out", cwd=tmp_path)
    assert "Traceback" not in run.stderr
    assert run.returncode == 2
    assert "cell.toml" in run.stderr
    assert part in run.stderr


ODD_NUMBERS: list[tuple[str, Edit, str]] = [
    ("radius", lambda d: d["workpiece"].update(radius="1e300 m"), "workpiece"),
    ("position", lambda d: d["workpiece"]["pose"].update(position=["1e308 m"] * 3), "workpiece"),
    ("velocity", lambda d: joint(d, 1).update(velocity="1e-300 rad/s"), "velocity"),
    ("jerk", lambda d: joint(d, 1).update(jerk="1e-300 rad/s^3"), "jerk"),
]


@pytest.mark.parametrize(("edit", "key"), [case[1:] for case in ODD_NUMBERS], ids=[case[0] for case in ODD_NUMBERS])
def test_absurd_magnitudes_end_in_a_sentence(edit: Edit, key: str, tmp_path: Path) -> None:
    def both(data: dict[str, Any]) -> None:
        few_points(data)
        edit(data)

    run = run_qparm("plan", save_cell(both, tmp_path / "cell.toml"), "--out", "out", "-q", cwd=tmp_path)
    assert "Traceback" not in run.stderr
    assert run.returncode in (2, 3)
    if run.returncode == 2:
        assert key in run.stderr
    assert names_in(tmp_path / "out") == (set() if run.returncode == 2 else set(PROMISED))


@pytest.mark.parametrize("name", ["a,b", "a[1]", '"a', "$\\foo$", "#thetä 2"])
def test_any_joint_name_is_planned_or_refused_with_its_key(name: str, tmp_path: Path) -> None:
    def edit(data: dict[str, Any]) -> None:
        few_points(data)
        joint(data, 1)["name"] = name
        data["name"] = name

    run = run_qparm("plan", save_cell(edit, tmp_path / "cell.toml"), "--out", "out", "-q", cwd=tmp_path)
    assert "Traceback" not in run.stderr
    if run.returncode == 2:
        assert "arm.joints[1].name: " in run.stderr
        assert names_in(tmp_path / "out") == set()
    else:
        assert run.returncode == 3
        assert names_in(tmp_path / "out") == set(PROMISED)
        assert read_waypoints(tmp_path / "out" / "joint_path.csv").joints[1] == name


# --- options ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "code", "parts"),
    [
        (("--period", "20"), 2, ("--period", "'20' has no unit", '"20 ms"')),
        (("--period", "0 ms"), 2, ("--period", "0 ms")),
        (("--period", "20 mm"), 2, ("--period", "not a unit of time")),
        (("--period", "nan ms"), 2, ("--period", "not finite")),
        (("--period", "1e308 min"), 2, ("--period", "1e308 min")),
        (("--strategy", "psychic"), 2, ("--strategy", "psychic", "graph")),
        (("--method", "newton"), 2, ("--method", "newton", "cwln")),
        (("--timing", "cubic"), 2, ("--timing", "cubic", "ruckig")),
        (("--seed", "-1"), 2, ("--seed", "-1")),
        (("--speed", "1"), 2, ("--speed",)),
        (("--solver", "abacus"), 5, ("'abacus'", "available: auto, ", "osqp", "proxqp")),
    ],
)
@pytest.mark.slow
def test_a_bad_option_is_named(options: tuple[str, str], code: int, parts: tuple[str, ...], tmp_path: Path) -> None:
    run = run_qparm("plan", DOME, "--out", "out", *options, cwd=tmp_path)
    assert "Traceback" not in run.stderr
    assert run.returncode == code
    for part in parts:
        assert part in run.stderr
    assert run.stdout == ""
    assert names_in(tmp_path / "out") == set()


@pytest.mark.parametrize("arguments", [("plan",), ("draw",)])
def test_a_command_without_sense(arguments: tuple[str, ...], tmp_path: Path) -> None:
    run = run_qparm(*arguments, cwd=tmp_path)
    assert "Traceback" not in run.stderr
    assert run.returncode == 2
    assert "Error: " in run.stderr
    assert names_in(tmp_path) == set()


# --- packages -----------------------------------------------------------------------------------------


def test_proxqp_that_is_not_installed_names_what_works(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "proxsuite", None)
    with pytest.raises(SolverUnavailable) as caught:
        ProxqpSolver(8)
    assert caught.value.available == ("auto", "osqp")


def test_a_missing_package_exits_5_with_what_works_instead(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def missing(**_: object) -> None:
        raise PackageMissing("ruckig", "--timing quintic")

    monkeypatch.setattr(cli.cli, "main", missing)
    monkeypatch.setattr(signal, "signal", lambda *_: None)
    with pytest.raises(SystemExit) as exited:
        cli.main([])
    assert exited.value.code == 5
    assert capsys.readouterr().err == (
        "qparm: the package 'ruckig' is not installed; use --timing quintic, or install it\n"
    )
    error = PackageMissing("ruckig", "--timing quintic")
    assert (error.package, error.instead) == ("ruckig", "--timing quintic")
    assert isinstance(error, qparm.QparmError)
    assert isinstance(error, ImportError)


def test_warnings_of_qpsolvers_are_not_shown(chain: qparm.SerialChain, monkeypatch: pytest.MonkeyPatch) -> None:
    import qpsolvers

    q = [0.1] * 8
    step = qparm.step_problem(chain, q, chain.forward([0.11] * 8))
    expected, solve = GenericSolver("daqp", 8).solve(step), qpsolvers.solve_problem
    told: list[int] = []

    def warn(*arguments: Any, **options: Any) -> Any:
        told.append(1)
        warnings.warn("for performance, convert to sparse", stacklevel=2)
        return solve(*arguments, **options)

    monkeypatch.setattr(qpsolvers, "solve_problem", warn)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        got = GenericSolver("daqp", 8).solve(step)
    assert told
    assert got.d.tolist() == expected.d.tolist()


# --- folders ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("command", "below"), [("plan", ""), ("plan", "deep/er/out"), ("check", "out")])
@pytest.mark.slow
def test_a_folder_that_cannot_be_made_exits_4(command: str, below: str, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine", encoding="utf-8")
    out = tmp_path / "file" / below if below else tmp_path / "file"
    run = run_qparm(command, DOME, "--out", out, cwd=tmp_path)
    assert run.returncode == 4
    (line,) = run.stderr.splitlines()
    assert line.startswith(f"qparm: cannot write to '{out}': ")
    assert run.stdout == ""
    assert names_in(tmp_path) == {"file"}
    assert (tmp_path / "file").read_text(encoding="utf-8") == "mine"


def test_new_into_a_folder_that_does_not_exist_exits_4(tmp_path: Path) -> None:
    run = run_qparm("new", "none/cell.toml", cwd=tmp_path)
    assert run.returncode == 4
    (line,) = run.stderr.splitlines()
    assert line.startswith("qparm: cannot write to 'none/cell.toml': ")
    assert names_in(tmp_path) == set()


@pytest.mark.parametrize("arguments", [("check", DOME), ("plan", "cell.toml"), ("new",), ("--help",), ("--version",)])
@pytest.mark.parametrize("unbuffered", ["", "1"])
@pytest.mark.slow
def test_standard_output_that_is_full_exits_4_with_one_sentence(
    arguments: tuple[str | Path, ...], unbuffered: str, tmp_path: Path
) -> None:
    if arguments[0] == "plan":
        save_cell(few_points, tmp_path / "cell.toml")
    with Path("/dev/full").open("w") as full:
        run = subprocess.run(
            [*QPARM, *map(str, arguments)],
            cwd=tmp_path,
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            timeout=240,
            check=False,
            env=os.environ | {"PYTHONUNBUFFERED": unbuffered},
        )
    assert run.returncode == 4
    # a busy machine may be told that kernels are compiled
    said = [line for line in run.stderr.splitlines() if not line.startswith("compiling the numeric kernels")]
    assert said == ["qparm: cannot write to 'standard output': No space left on device"]


def test_an_error_of_the_system_inside_qparm_is_not_taken_for_one_of_standard_output(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def broken(**_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(cli.cli, "main", broken)
    monkeypatch.setattr(signal, "signal", lambda *_: None)
    with pytest.raises(OSError, match="No space"):
        cli.main([])


def old_files(folder: Path) -> dict[str, bytes]:
    """Put files as of an earlier run into a folder and return them."""
    folder.mkdir(exist_ok=True)
    for name in PROMISED:
        (folder / name).write_bytes(f"{name} of an earlier run".encode())
    return {name: (folder / name).read_bytes() for name in PROMISED}


def contents(folder: Path) -> dict[str, bytes]:
    return {entry.name: entry.read_bytes() for entry in folder.iterdir()}


@pytest.mark.slow
def test_a_disk_that_fills_up_exits_4_and_keeps_the_earlier_files(tmp_path: Path) -> None:
    before = old_files(tmp_path / "out")

    def no_large_files() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))

    cell = save_cell(few_points, tmp_path / "cell.toml")
    run = run_qparm("plan", cell, "--out", "out", cwd=tmp_path, preexec_fn=no_large_files)
    assert "Traceback" not in run.stderr
    assert run.returncode == 4
    assert "qparm: cannot write to 'out': " in run.stderr
    assert contents(tmp_path / "out") == before


@pytest.mark.slow
def test_a_file_that_cannot_be_replaced_leaves_all_the_others_as_they_were(tmp_path: Path) -> None:
    before = old_files(tmp_path / "out")
    del before["trajectory.csv"]
    (tmp_path / "out" / "trajectory.csv").unlink()
    (tmp_path / "out" / "trajectory.csv").mkdir()
    cell = save_cell(few_points, tmp_path / "cell.toml")
    run = run_qparm("plan", cell, "--out", "out", cwd=tmp_path)
    assert "Traceback" not in run.stderr
    assert run.returncode == 4
    assert "qparm: cannot write to 'out': " in run.stderr
    (tmp_path / "out" / "trajectory.csv").rmdir()
    assert contents(tmp_path / "out") == before


# --- signals ----------------------------------------------------------------------------------------


def wait_for(condition: Callable[[], bool], process: subprocess.Popen[str]) -> None:
    deadline = time.monotonic() + 120
    while not condition():
        assert process.poll() is None, "finished before it was interrupted"
        assert time.monotonic() < deadline
        time.sleep(0.01)


def interrupted(
    command: str, cell: Path, out: Path, number: signal.Signals, ready: Callable[[], bool], delay: float = 0.0
) -> None:
    """Start a command, signal it once it is ready, and check how it ends."""
    with subprocess.Popen(
        [*QPARM, *command.split(), str(cell), "--out", str(out)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            wait_for(ready, process)
            time.sleep(delay)
            assert process.poll() is None, "finished before it was interrupted"
            process.send_signal(number)
            stdout, stderr = process.communicate(timeout=60)
        finally:
            process.kill()
    assert "Traceback" not in stderr
    assert "Exception ignored" not in stderr
    assert process.returncode == 128 + number
    assert stdout == ""
    if number == signal.SIGINT:
        assert "interrupted" in stderr


@pytest.mark.parametrize(
    ("command", "delay", "number"),
    [
        ("plan", 0.2, signal.SIGINT),
        ("plan", 1.7, signal.SIGINT),
        ("plan", 1.7, signal.SIGTERM),
        ("check", 1.5, signal.SIGTERM),
    ],
)
@pytest.mark.slow
def test_a_signal_before_anything_is_written(
    command: str, delay: float, number: signal.Signals, tmp_path: Path
) -> None:
    # so many points that what comes before the writing takes longer than the delay
    large = save_cell(lambda data: data["process"].update(rows=150, points=1000), tmp_path / "cell.toml")
    out = tmp_path / "out"
    interrupted(command, large, out, number, out.exists, delay)
    assert names_in(out) == set()
    assert names_in(tmp_path) == {"cell.toml", "out"}


@pytest.mark.parametrize(("first", "number"), [("trajectory.csv", signal.SIGINT), ("velocity.png", signal.SIGTERM)])
@pytest.mark.slow
def test_a_signal_while_files_are_written_keeps_the_earlier_ones(
    first: str, number: signal.Signals, tmp_path: Path
) -> None:
    large = save_cell(lambda data: data["process"].update(rows=20, points=120), tmp_path / "cell.toml")
    out = tmp_path / "out"
    before = old_files(out)
    interrupted("plan --strategy general", large, out, number, lambda: any(out.glob(f".*/{first}")))
    assert contents(out) == before


# --- files read back --------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def small_cell() -> qparm.Cell:
    data = cell_data()
    few_points(data)
    return qparm.Cell.load(data)


@pytest.fixture(scope="module")
def written(small_cell: qparm.Cell, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("written")
    qparm.write(qparm.plan(small_cell), folder, pictures=False)
    return folder


@pytest.fixture
def folder(written: Path, tmp_path: Path) -> Path:
    """Return a copy of the written files to be spoilt."""
    return Path(shutil.copytree(written, tmp_path / "copy"))


def figures_of_files(cell: qparm.Cell, folder: Path) -> Figures:
    tables = (read_waypoints(folder / "joint_path.csv"), read_samples(folder / "trajectory.csv"))
    return measure(cell, *tables, read_knots(folder / "trajectory.json"))


READERS: dict[str, Callable[[Path], object]] = {
    "joint_path.csv": read_waypoints,
    "trajectory.csv": read_samples,
    "trajectory.json": read_knots,
}
FILES = pytest.mark.parametrize("name", READERS)
TABLES = pytest.mark.parametrize("name", ["joint_path.csv", "trajectory.csv"])


@FILES
def test_the_files_as_written_are_read(name: str, folder: Path) -> None:
    assert READERS[name](folder / name).joints == ("d1", *(f"theta{k}" for k in range(2, 9)))  # type: ignore[attr-defined]


@FILES
@pytest.mark.parametrize("content", [b"", b"\n", b"garbage", b"\xff\xfe\x00\x01", b"a,b,c\n1,2,3\n", b"[]"])
def test_a_file_of_something_else_is_refused_by_name(name: str, content: bytes, folder: Path) -> None:
    (folder / name).write_bytes(content)
    with pytest.raises(qparm.InvalidInput, match=name):
        READERS[name](folder / name)


@FILES
def test_a_missing_file_is_refused_by_name(name: str, folder: Path) -> None:
    (folder / name).unlink()
    with pytest.raises(qparm.InvalidInput, match=f"{name}: there is no such file"):
        READERS[name](folder / name)


@FILES
@pytest.mark.parametrize("share", [0.3, 0.5, 0.8, 0.99])
def test_a_file_cut_inside_a_line_is_refused_by_name(name: str, share: float, folder: Path) -> None:
    content = (folder / name).read_bytes()
    cut = int(len(content) * share)
    cut += content[cut - 1 : cut] == b"\n"
    (folder / name).write_bytes(content[:cut])
    with pytest.raises(qparm.InvalidInput, match=name):
        READERS[name](folder / name)


def test_a_joint_path_cut_inside_its_last_number_is_refused_by_name(folder: Path) -> None:
    file = folder / "joint_path.csv"
    lines = file.read_bytes().splitlines(keepends=True)
    last = next(k for k in range(len(lines) - 1, 0, -1) if len(lines[k].rpartition(b",")[2]) > 8)
    file.write_bytes(b"".join(lines[: last + 1])[:-6])  # still a number, of fewer digits
    with pytest.raises(qparm.InvalidInput, match=r"joint_path\.csv"):
        read_waypoints(file)


@TABLES
def test_a_table_of_the_header_alone_is_refused_by_name(name: str, folder: Path) -> None:
    header = (folder / name).read_text(encoding="utf-8").splitlines()[0]
    (folder / name).write_text(header + "\n", encoding="utf-8")
    with pytest.raises(qparm.InvalidInput, match=name):
        READERS[name](folder / name)


def measured(cell: qparm.Cell, folder: Path) -> Any:
    return measure(cell, *(READERS[name](folder / name) for name in READERS))  # type: ignore[arg-type]


@TABLES
def test_a_table_that_lacks_its_last_lines_does_not_pass_for_a_whole_one(
    name: str, folder: Path, small_cell: qparm.Cell
) -> None:
    assert measured(small_cell, folder).points == 10
    lines = (folder / name).read_text(encoding="utf-8").splitlines(keepends=True)
    (folder / name).write_text("".join(lines[:-2]), encoding="utf-8")
    with pytest.raises(qparm.InvalidInput):
        measured(small_cell, folder)


@TABLES
@pytest.mark.parametrize("value", ["nan", "inf", "-inf"])
@pytest.mark.parametrize("line", [2, 4])
def test_a_value_that_is_not_finite_is_refused_with_file_and_line(
    name: str, value: str, line: int, folder: Path
) -> None:
    lines = (folder / name).read_text(encoding="utf-8").splitlines()
    cells = lines[line - 1].split(",")
    cells[6] = value
    lines[line - 1] = ",".join(cells)
    (folder / name).write_text("\n".join(lines) + "\n", encoding="utf-8")
    with pytest.raises(qparm.InvalidInput, match=f"{name} line {line} has a value that is not finite"):
        READERS[name](folder / name)


@pytest.mark.parametrize("key", ["positions", "velocities", "accelerations"])
@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_knot_that_is_not_finite_is_refused_by_name(key: str, value: float, folder: Path) -> None:
    file = folder / "trajectory.json"
    message = json.loads(file.read_text(encoding="utf-8"))
    message["points"][1][key][2] = value
    file.write_text(json.dumps(message), encoding="utf-8")
    with pytest.raises(qparm.InvalidInput, match=r"trajectory\.json"):
        read_knots(file)


def test_a_knot_that_lacks_a_joint_is_refused_by_name(folder: Path) -> None:
    file = folder / "trajectory.json"
    message = json.loads(file.read_text(encoding="utf-8"))
    message["points"][1]["positions"].pop()
    file.write_text(json.dumps(message), encoding="utf-8")
    with pytest.raises(qparm.InvalidInput, match=r"trajectory\.json"):
        read_knots(file)


@TABLES
def test_a_word_in_place_of_a_number_is_refused_by_name(name: str, folder: Path) -> None:
    lines = (folder / name).read_text(encoding="utf-8").splitlines()
    cells = lines[3].split(",")
    cells[6] = "many"
    lines[3] = ",".join(cells)
    (folder / name).write_text("\n".join(lines) + "\n", encoding="utf-8")
    with pytest.raises(qparm.InvalidInput, match=f"{name}.*many"):
        READERS[name](folder / name)
