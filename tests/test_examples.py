"""The examples run, are short, and do what they say: anyone can bring a step, a solver, a planner."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import qparm
from conftest import ROOT, cell_data

pytestmark = pytest.mark.slow

EXAMPLES = sorted((ROOT / "examples").glob("own_*.py"))


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_is_short_and_runs(example: Path) -> None:
    assert len(example.read_text(encoding="utf-8").splitlines()) <= 28
    run = subprocess.run([sys.executable, str(example)], cwd=ROOT, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    what = {
        "own_step": "step lazy_rail",
        "own_solver": "solver projected gradient",
        "own_planner": "strategy nearest_to_home",
        "own_timing": "timing gentle",
        "own_format": "lines, the first:",
        "own_surface": "executable)",
    }
    assert what[example.stem] in run.stdout
    if example.stem == "own_solver":
        failed = int(run.stdout.split(" solver, ")[1].split(" solver failed")[0])
        assert failed > 1000, "what the solver gets wrong is caught by the KKT check and counted"
    if example.stem == "own_planner":
        assert "155 of 155" in run.stdout


def test_there_are_six_examples() -> None:
    names = ["own_format", "own_planner", "own_solver", "own_step", "own_surface", "own_timing"]
    assert [path.stem for path in EXAMPLES] == names


def small() -> dict:
    data = cell_data()
    data["process"] |= {"rows": 2, "points": 11}
    return data


def test_a_rule_that_returns_the_step_itself_is_taken() -> None:
    from qparm.ik import closed_form

    def plain(chain: qparm.SerialChain, q: np.ndarray, step: qparm.ik.StepProblem) -> np.ndarray:
        return np.clip(closed_form(step), step.lb, step.ub)

    plan = qparm.plan(small(), strategy="general", method=plain)
    assert plan.options.method == "plain"
    assert plan.record.counts.closed_form == plan.record.counts.total > 0


def test_what_a_rule_or_planner_brings_is_checked() -> None:
    with pytest.raises(qparm.InvalidInput, match="the rule must return"):
        qparm.plan(small(), strategy="general", method=lambda chain, q, step: np.full(8, np.nan))
    with pytest.raises(qparm.InvalidInput, match=r"the planner must return \(22, 8\)"):
        qparm.plan(small(), strategy=lambda chain, tool_path, home, rng: np.zeros((3, 8)))


def test_a_planner_that_is_wrong_is_found_out() -> None:
    """Whatever a planner claims, a configuration counts only if its pose is within tolerance."""

    def nowhere(chain: qparm.SerialChain, tool_path: qparm.ToolPath, home: np.ndarray, rng: object) -> np.ndarray:
        return np.zeros((tool_path.point_count, chain.n))

    report = qparm.report(qparm.plan(small(), strategy=nowhere))
    assert report.figures.reached == 0
    assert not report.executable


def test_a_rule_agrees_with_the_method_it_copies() -> None:
    same = qparm.plan(small(), strategy="general", method=lambda chain, q, step: step)
    ours = qparm.plan(small(), strategy="general", method="dls")
    np.testing.assert_allclose(same.joint_path.q, ours.joint_path.q, atol=1e-9)
