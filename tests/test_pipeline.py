"""The pipeline from Python: the README's script, the layers, what an import costs."""

from __future__ import annotations

import ast
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import qparm
from conftest import DOME, ROOT, cell_data, few_rows
from qparm.errors import InvalidInput
from qparm.verify import read_samples, read_waypoints

SOURCES = ROOT / "src" / "qparm"

# Each folder or file may import what stands before it, itself, and errors and units.
LAYERS = ["errors", "choices", "lazy_names", "names", "stopping", "units", "extras", "files", "arrays", "compiled",
          "banded", "robot", "path", "surface", "cell", "ik", "reach", "planning", "timing", "verify", "pipeline",
          "reports", "design", "view", "export", "cli", "__main__"]  # fmt: skip
FORBIDDEN = [("planning", "timing"), ("timing", "planning"), ("timing", "ik"), ("verify", "ik"), ("verify", "planning"),
             ("verify", "timing"), ("verify", "robot"), ("robot", "path")]  # fmt: skip


def readme_script() -> str:
    return re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), re.S)[0]


@pytest.mark.slow
def test_the_readmes_script_is_equal_to_the_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    script = readme_script()
    assert len([line for line in script.splitlines() if line.strip()]) <= 10
    monkeypatch.chdir(ROOT)
    names: dict[str, Any] = {}
    exec(compile(script, "README.md", "exec"), names)
    printed = capsys.readouterr().out
    run = subprocess.run(
        [sys.executable, "-m", "qparm.cli", "plan", str(DOME), "--out", str(tmp_path), "-q"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (run.returncode, run.stdout) == (0, "")
    plan, report = names["plan"], names["report"]
    waypoints, samples = read_waypoints(tmp_path / "joint_path.csv"), read_samples(tmp_path / "trajectory.csv")
    np.testing.assert_array_equal(waypoints.q, plan.joint_path.q)
    np.testing.assert_array_equal(waypoints.index, plan.joint_path.point)
    # at the times that were sampled, whole nanoseconds: jerk times less than one is not nothing
    t = np.round(plan.trajectory.sample_times(0.02), 9)
    np.testing.assert_allclose(samples.t, t, rtol=1e-11)
    for order in range(4):
        np.testing.assert_allclose(samples.derivatives[order], plan.trajectory(t, order), rtol=1e-10, atol=1e-9)
    import json

    written = json.loads((tmp_path / "report.json").read_text(encoding="utf-8"))
    assert written["measured"]["reached"] == report.figures.reached == names["reached"]
    assert [jump["first"] for jump in written["measured"]["jumps"]] == [jump.first for jump in report.figures.jumps]
    assert f"{names['reached']} of 915 points" in printed


@pytest.mark.slow
def test_planning_prints_nothing_and_opens_no_file(
    dome: qparm.Cell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    plan = qparm.plan(dome, seed=1)
    qparm.report(plan)
    assert capfd.readouterr() == ("", "")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_the_same_seed_gives_the_same_plan_and_another_seed_another(dome: qparm.Cell, dome_plan: qparm.Plan) -> None:
    again, other = qparm.plan(dome, seed=0), qparm.plan(dome, seed=2)
    np.testing.assert_array_equal(again.joint_path.q, dome_plan.joint_path.q)
    np.testing.assert_array_equal(again.trajectory.knots, dome_plan.trajectory.knots)
    assert not np.array_equal(other.solution.q, again.solution.q)


@pytest.mark.slow
def test_progress_is_told_stage_by_stage() -> None:
    told: list[tuple[str, int, int]] = []
    data = cell_data()
    data["process"] |= {"rows": 2, "points": 11}
    qparm.plan(data, progress=lambda *news: told.append(news))
    assert [name for name, done, _ in told if done == 0] == [
        "cell", "kernels", "tool path", "joint path", "smoothing", "between points", "reach", "trajectory",
        "verdict",
    ]  # fmt: skip
    assert ("joint path", 11, 22) in told
    assert all(done <= total for _, done, total in told)


@pytest.mark.parametrize(
    ("option", "words"),
    [
        ({"strategy": "best"}, "strategy must be one of graph, reverse, general"),
        ({"method": "newton"}, "method must be one of"),
        ({"timing": "cubic"}, "timing must be one of quintic, ruckig"),
        ({"seed": -1}, "seed"),
        ({"seed": 1.5}, "seed"),
    ],
)
def test_unusable_options_are_refused_by_name(dome: qparm.Cell, option: dict, words: str) -> None:
    with pytest.raises(qparm.InvalidInput, match=words):
        qparm.plan(dome, **option)


@pytest.mark.parametrize("solver", ["proxqp", "osqp"])
@pytest.mark.slow
def test_every_step_can_be_sent_to_a_solver(solver: str) -> None:
    data = cell_data()
    data["process"] |= {"rows": 2, "points": 61}
    expected = qparm.plan(data, strategy="general")
    got = qparm.plan(data, strategy="general", solver=solver)
    assert got.record.counts.closed_form == got.record.counts.active_set == 0
    assert got.record.counts.solver > 0.9 * got.record.counts.total
    assert len(got.record.unreached) == len(expected.record.unreached)
    np.testing.assert_allclose(got.joint_path.q, expected.joint_path.q, atol=1e-6)


def test_kernels_compile_where_nothing_can_be_cached(monkeypatch: pytest.MonkeyPatch) -> None:
    """In a container neither the source's folder nor the user's may be writable."""
    import numba.core.caching
    from numba import types

    from qparm.compiled.kernels import kernel

    monkeypatch.setattr(numba.core.caching.CacheImpl, "_locator_classes", [])

    @kernel(types.float64(types.float64))
    def twice(x: float) -> float:
        return 2 * x

    assert twice(2.0) == 4.0


@pytest.mark.slow
def test_a_cache_from_before_a_module_was_renamed_is_replaced(tmp_path: Path) -> None:
    """Updating qparm leaves the caches of kernels that call into such a module through a third."""
    room = tmp_path / "room"
    room.mkdir()
    (room / "__init__.py").write_text("")
    helper = "from qparm.compiled.kernels import kernel_helper\n\n@kernel_helper\ndef {}(x):\n    return {}\n"
    (room / "lowest.py").write_text(helper.format("twice", "2.0 * x"))
    middle = "from room.{} import twice\n" + helper.format("more", "twice(x) + 1.0")
    (room / "middle.py").write_text(middle.format("lowest"))
    (room / "top.py").write_text(
        "from qparm.compiled.kernels import f8, kernel\nfrom room.middle import more\n\n"
        "@kernel(f8(f8))\ndef value(x):\n    return more(x)\n\nprint(value(3.0))\n"
    )
    command = [sys.executable, "-c", "import room.top"]
    environment = os.environ | {"PYTHONPATH": f"{tmp_path}{os.pathsep}{SOURCES.parent}"}

    def run() -> subprocess.CompletedProcess[str]:
        return subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)

    assert run().stdout == "7.0\n"
    index = next((room / "__pycache__").glob("top.value*.nbi"))
    (room / "lowest.py").rename(room / "renamed.py")
    (room / "middle.py").write_text(middle.format("renamed"))
    before = index.stat().st_mtime_ns
    done = run()
    assert (done.stdout, done.stderr) == ("7.0\n", "")
    after = index.stat().st_mtime_ns
    assert after > before, "compiled anew, and kept"
    assert run().stdout == "7.0\n"
    assert index.stat().st_mtime_ns == after, "and then no more"


def test_a_seed_may_be_any_whole_number(dome: qparm.Cell) -> None:
    assert qparm.Options(seed=np.int64(3)).seed == 3


# --- structure ------------------------------------------------------------------------------------------


def imported_rooms(file: Path) -> set[str]:
    """Return the parts of qparm that a file imports when it runs (not for type checking)."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            node.body = []
    modules = [node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.module]
    modules += [alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names]
    return {module.split(".")[1] for module in modules if module.startswith("qparm.")}


def test_lower_rooms_never_import_higher_ones() -> None:
    checked = 0
    for file in SOURCES.rglob("*.py"):
        room = file.relative_to(SOURCES).parts[0].removesuffix(".py")
        if room == "__init__":
            continue
        for other in imported_rooms(file) - {room}:
            assert LAYERS.index(other) < LAYERS.index(room), f"{file.name} imports {other}"
            assert (room, other) not in FORBIDDEN, f"{file.name} imports {other}"
            checked += 1
    assert checked > 50


@pytest.mark.parametrize("command", [["-c", "import qparm"], ["-m", "qparm.cli", "--help"]])
def test_nothing_heavy_is_loaded_before_it_is_used(command: list[str]) -> None:
    """The bar is half a second; what is asserted is its cause, the modules, not the clock."""
    run = subprocess.run([sys.executable, "-X", "importtime", *command], capture_output=True, text=True, check=True)
    loaded = {line.rsplit("|", 1)[1].strip() for line in run.stderr.splitlines() if line.startswith("import time")}
    for heavy in (
        "numpy",
        "scipy",
        "numba",
        "pydantic",
        "matplotlib",
        "rich",
        "osqp",
        "proxsuite",
        "qpsolvers",
        "yaml",
        "pyarrow",
    ):
        assert heavy not in loaded, heavy


def test_public_names_are_all_there() -> None:
    assert all(getattr(qparm, name) is not None for name in qparm.__all__)
    assert sorted(qparm.__all__) == dir(qparm)
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        qparm.nothing  # noqa: B018


@pytest.mark.slow
def test_code_is_clean_and_typed() -> None:
    for command in (["ruff", "check", "."], ["ruff", "format", "--check", "."], ["basedpyright", "src"]):
        run = subprocess.run([sys.executable, "-m", *command], cwd=ROOT, capture_output=True, text=True, check=False)
        assert run.returncode == 0, run.stdout[-3000:]


@pytest.mark.parametrize("what", ["strategy", "method", "timing"])
@pytest.mark.parametrize("value", ["fast", 5, None, ["graph"]])
def test_what_is_no_choice_is_refused_with_those_that_are(what: str, value: Any) -> None:
    with pytest.raises(InvalidInput, match=f"{what} must be one of [a-z, ]+, not "):
        qparm.plan(few_rows(), **{what: value})
