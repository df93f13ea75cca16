"""The harness runs and its verdict can fail."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from comparisons.recorded import recorded_steps
from comparisons.steps import compare
from comparisons.tables import shifted_geometric_mean, table

import qparm
from conftest import ROOT

pytestmark = pytest.mark.slow


def test_steps_are_compared_and_agree(tmp_path: Path) -> None:
    run = subprocess.run(
        [sys.executable, "-m", "comparisons.steps", "--limit", "60", "--out", str(tmp_path)],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert run.returncode == 0, run.stdout + run.stderr
    assert "truth lost on 0" in run.stdout
    assert {file.name for file in tmp_path.iterdir()} == {
        "steps.md", "steps.csv", "steps_by_damping.md", "steps_by_damping.csv",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("module", "package", "how"),
    [("comparisons.steps", "cvxpy", "'.[compare]'"), ("comparisons.speed", "pinocchio", "'.[compare]'")],
)
def test_a_package_that_is_missing_ends_with_how_to_install_it(module: str, package: str, how: str) -> None:
    script = f"import runpy, sys; sys.modules[{package!r}] = None; runpy.run_module({module!r}, run_name='__main__')"
    run = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=False)
    assert run.returncode == 1
    assert run.stderr == f"this comparison needs {package}: pip install {how}\n"


def test_a_wrong_path_fails_the_comparison(general_plan: qparm.Plan, monkeypatch: pytest.MonkeyPatch) -> None:
    import comparisons.steps

    right = comparisons.steps.active_set
    steps = recorded_steps(general_plan, limit=20)
    monkeypatch.setattr(comparisons.steps, "active_set", lambda step: right(step) + 1e-7)
    _, _, good = compare(steps)
    assert not good


def test_recorded_steps_are_those_of_the_plan(general_plan: qparm.Plan) -> None:
    steps = recorded_steps(general_plan)
    assert len(steps) == sum(point.iterations for point in general_plan.record.points)
    assert len(recorded_steps(general_plan, limit=7)) == 7


def test_tables() -> None:
    assert table(["a", "b"], [[1, "xy"]]) == "| a | b  |\n|---|----|\n| 1 | xy |"
    assert shifted_geometric_mean([3.0, 3.0], 1.0) == pytest.approx(3.0)
    assert shifted_geometric_mean(np.array([0.0, 8.0]), 1.0) == pytest.approx(2.0)
