"""`qparm verify` and `qparm plan --feed` through the command line: exit codes and what is said."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import tomli_w

import qparm
from conftest import DOME, few_rows
from qparm.verify.clearance import LINKS_NOT_CHECKED

pytestmark = pytest.mark.slow


def run_qparm(*arguments: str | Path, cwd: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "qparm.cli", *map(str, arguments)]
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True, timeout=240, check=False)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a small cell, what was planned of it, and the same at another feed."""
    folder = tmp_path_factory.mktemp("small")
    (folder / "cell.toml").write_text(tomli_w.dumps(few_rows()), encoding="utf-8")
    for options in (("--out", "out"), ("--out", "faster", "--feed", "25 mm/s")):
        planned = run_qparm("plan", "cell.toml", "--quiet", *options, cwd=folder)
        assert planned.returncode == 0, planned.stderr
    return folder


@pytest.mark.parametrize(
    ("file", "verdict"),
    [
        # samples at 20 ms leave open more than the 1 um of the cell, the points of quintics do not
        ("trajectory.csv", r"verdict: holds as far as the file tells: points known to \d\.\d um.*\n"),
        ("trajectory.json", r"verdict: every limit and tolerance holds\n"),
    ],
)
def test_what_was_planned_exits_0_with_the_table(folder: Path, file: str, verdict: str) -> None:
    done = run_qparm("verify", f"out/{file}", "--cell", "cell.toml", cwd=folder)
    assert (done.returncode, done.stderr) == (0, "")
    assert "tool orientation error on rows" in done.stdout
    assert re.search(rf"\n{verdict}{LINKS_NOT_CHECKED}\n\Z", done.stdout), done.stdout


def test_quiet_says_nothing_of_what_is_well(folder: Path) -> None:
    done = run_qparm("verify", "out/trajectory.csv", "--cell", "cell.toml", "--quiet", cwd=folder)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_an_altered_sample_exits_3_with_joint_time_amount_and_limit(folder: Path) -> None:
    lines = (folder / "out" / "trajectory.csv").read_text(encoding="utf-8").splitlines()
    header, middle = lines[0].split(","), len(lines) // 2
    at, values = header.index("q_theta4[rad]"), lines[middle].split(",")
    values[at] = repr(1.01 * float(values[at]))
    lines[middle] = ",".join(values)
    (folder / "altered.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    done = run_qparm("verify", "altered.csv", "--cell", "cell.toml", "--quiet", cwd=folder)
    assert (done.returncode, done.stderr) == (3, "")
    first = done.stdout.splitlines()[0]
    assert " s: joint 'theta4': " in done.stdout
    assert first.split(" s: ")[0].replace(".", "").isdigit()
    assert ", allowed " in first
    assert len(done.stdout.splitlines()) <= 11


def test_the_option_feed_is_the_cells_and_its_plan_breaks_the_cell_without_it(folder: Path) -> None:
    cell = qparm.Cell.load(folder / "cell.toml")
    slow, fast = (qparm.read_motion(folder / name / "trajectory.csv", cell) for name in ("out", "faster"))
    assert fast.t[-1] < slow.t[-1] - 3.0
    done = run_qparm("verify", "faster/trajectory.csv", "--cell", "cell.toml", cwd=folder)
    assert done.returncode == 3
    assert re.search(r"tool: faster than the feed on row 0: 2[45]\S* mm/s, allowed 20 mm/s", done.stdout)
    again = few_rows(feed="25 mm/s")
    (folder / "faster.toml").write_text(tomli_w.dumps(again), encoding="utf-8")
    done = run_qparm("verify", "faster/trajectory.csv", "--cell", "faster.toml", "--quiet", cwd=folder)
    assert (done.returncode, done.stdout) == (0, "")


@pytest.mark.parametrize("feed", ["0 mm/s", "-5 mm/s", "nan mm/s", "20 mm", "fast"])
def test_a_feed_that_is_none_exits_2_and_names_it(folder: Path, feed: str) -> None:
    done = run_qparm("plan", "cell.toml", "--feed", feed, "--out", "none", cwd=folder)
    assert (done.returncode, done.stdout) == (2, "")
    assert "feed" in done.stderr
    assert "Traceback" not in done.stderr
    assert not (folder / "none").exists()


def test_the_wrong_cell_exits_2_or_3(folder: Path) -> None:
    """Another arm's joints cannot be compared; another path of the same arm is not followed."""
    done = run_qparm("verify", "out/trajectory.csv", "--cell", DOME.with_name("six_axis.toml"), cwd=folder)
    assert (done.returncode, done.stdout) == (2, "")
    assert "joint" in done.stderr
    done = run_qparm("verify", "out/trajectory.csv", "--cell", DOME, cwd=folder)
    assert done.returncode == 3
    assert re.search(r"point \d+ of row \d+: the tool misses it by", done.stdout)


def test_joints_by_other_names_exit_2(folder: Path) -> None:
    text = (folder / "out" / "trajectory.csv").read_text(encoding="utf-8")
    (folder / "renamed.csv").write_text(text.replace("theta3", "elbow"), encoding="utf-8")
    done = run_qparm("verify", "renamed.csv", "--cell", "cell.toml", cwd=folder)
    assert (done.returncode, done.stdout) == (2, "")
    assert "elbow" in done.stderr
    assert "theta3" in done.stderr


@pytest.mark.parametrize("name", ["trajectory.csv", "trajectory.json"])
def test_a_file_cut_short_exits_2_and_is_named(folder: Path, name: str) -> None:
    whole = (folder / "out" / name).read_bytes()
    (folder / f"cut-{name}").write_bytes(whole[: len(whole) // 2])
    done = run_qparm("verify", f"cut-{name}", "--cell", "cell.toml", cwd=folder)
    assert (done.returncode, done.stdout) == (2, "")
    assert f"cut-{name}" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("arguments", [("none.csv", "cell.toml"), ("out/trajectory.csv", "none.toml")])
def test_a_missing_file_exits_2_and_is_named(folder: Path, arguments: tuple[str, str]) -> None:
    done = run_qparm("verify", arguments[0], "--cell", arguments[1], cwd=folder)
    assert (done.returncode, done.stdout) == (2, "")
    assert "none." in done.stderr
    assert "Traceback" not in done.stderr


def test_a_file_of_another_plan_is_told(folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder / "out", tmp_path / "out")
    file = tmp_path / "out" / "trajectory.csv"
    file.write_bytes(re.sub(rb"(\.\d+),", rb"\g<1>0,", file.read_bytes(), count=1))  # the same number
    done = run_qparm("verify", file, "--cell", folder / "cell.toml", "--quiet", cwd=tmp_path)
    assert done.returncode == 3
    assert done.stdout == "trajectory.csv is not the file that report.json beside it was written with\n"
