"""The command: what it says of its journal, what it leaves in the folder, what it refuses."""

import os
import signal
import subprocess
import sys
import time

import pytest
from click.testing import CliRunner

from conftest import ROOT
from design.made_cells import small
from qparm.cell import Cell
from qparm.cli import cli
from qparm.design.space import DesignSpace
from qparm.errors import CellError, QparmError

pytestmark = pytest.mark.slow

GRID = ("--method", "grid", "--budget", "54", "--border", "40", "--plans", "0", "--workers", "1")


@pytest.fixture(scope="module")
def cell(tmp_path_factory):
    return saved(tmp_path_factory.mktemp("cells") / "cell.toml", small())


def saved(path, data):
    import tomli_w

    path.write_text(tomli_w.dumps(data))
    return path


def run(*arguments):
    return CliRunner().invoke(cli, ["design", *map(str, arguments)], standalone_mode=False)


def test_a_mistyped_command_leaves_the_journal_and_a_second_one_overwrites_no_earlier(tmp_path, cell):
    journal = tmp_path / "journal.jsonl"
    assert run(cell, "--out", tmp_path, *GRID).return_value == 0
    night = journal.read_bytes()
    for wrong in (
        (cell, "--vary", "arm.lengths.L9=1 mm:2 mm"),
        (tmp_path / "missing.toml",),
        (cell, "--level", "reach", "--method", "paper"),
        (cell, "--cluster", "tcp://127.0.0.1:1"),
    ):
        assert isinstance(run(*wrong, "--out", tmp_path).exception, (QparmError, OSError)), wrong
        assert journal.read_bytes() == night
    for k in (1, 2):
        assert run(cell, "--out", tmp_path, *GRID, "--seed", k).return_value == 0
        assert (tmp_path / "journal.before-1.jsonl").read_bytes() == night
    found = run(cell, "--out", tmp_path, *GRID, "--seed", "5", "--resume")
    assert "0 of this problem (" in found.stderr
    assert "of another cell, seed, version or other variables)" in found.stderr
    assert "earlier journals there: journal.before-1.jsonl, journal.before-2.jsonl" in found.stderr


def test_resume_says_what_it_goes_on_from(tmp_path, cell):
    run(cell, "--out", tmp_path, *GRID)
    journal = tmp_path / "journal.jsonl"
    lines = journal.read_bytes().splitlines(keepends=True)
    journal.write_bytes(b"".join(lines[:5]) + lines[5][:40])
    found = run(cell, "--out", tmp_path, *GRID, "--resume")
    assert found.stderr.startswith("journal: 5 evaluations, 5 of this problem; 1 torn line passed over\n")


def test_files_of_an_earlier_study_do_not_stay_beside_another(tmp_path, cell):
    run(cell, "--out", tmp_path, *GRID)
    assert {"chosen.toml", "map.png"} <= {file.name for file in tmp_path.iterdir()}
    (tmp_path / "mine.png").write_bytes(b"")
    data = small()
    data["workpiece"]["pose"]["position"] = ["0 mm", "2300 mm", "360 mm"]
    far = saved(tmp_path / "far.toml", data)
    assert run(far, "--out", tmp_path, "--method", "sobol", "--budget", "4", "--workers", "1").return_value == 3
    assert {file.name for file in tmp_path.iterdir()} == {
        "designs.csv", "design.json", "designs.png", "journal.jsonl", "journal.before-1.jsonl", "far.toml", "mine.png",
    }  # fmt: skip


def test_a_folder_that_holds_no_study_keeps_its_files(tmp_path, cell):
    (tmp_path / "front.png").write_bytes(b"mine")
    run(cell, "--out", tmp_path, *GRID)
    assert (tmp_path / "front.png").read_bytes() == b"mine"


def test_an_interrupt_says_that_what_is_finished_is_kept(tmp_path, cell):
    command = [sys.executable, "-m", "qparm.cli", "design", str(cell), *GRID[:2], "--budget", "900", "--workers", "1"]
    process = subprocess.Popen(
        [*command, "--out", str(tmp_path)], cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    )
    journal = tmp_path / "journal.jsonl"
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline and (not journal.exists() or journal.read_bytes().count(b"\n") < 8):
        time.sleep(0.01)
    os.kill(process.pid, signal.SIGTERM)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 143
    assert f"finished designs kept in {journal}; --resume goes on" in said
    assert "compiling" not in said


def test_lengths_of_links_are_not_negative():
    negative = small()["design"]["variables"] | {"arm.lengths.L1": {"range": ["-100 mm", "600 mm"]}}
    with pytest.raises(CellError, match="L1 is the length of a link, which is not negative"):
        Cell.load(small(variables=negative))
    extended = {"arm.lengths.L1": {"range": ["0 mm", "600 mm"], "extend": ["-1 mm", "600 mm"]}}
    with pytest.raises(CellError, match="extend"):
        Cell.load(small(variables=extended))
    Cell.load(small(variables={"arm.lengths.L1": {"range": ["0 mm", "600 mm"]}}))


def test_names_of_variables_say_what_they_are():
    ranges = {
        "arm.joints.d1.position[1]": ("1 m", "2 m"),
        "workpiece.pose.position[1]": ("1 m", "2 m"),
    }
    assert DesignSpace.of(small(), ranges=ranges).names == (
        "L1", "L3", "d1.position[1]", "workpiece.pose.position[1]",
    )  # fmt: skip
