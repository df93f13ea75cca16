"""The quick runs of the harness work, their tables have their columns, and their verdicts can fail."""

from __future__ import annotations

import csv
import subprocess
import sys
from pathlib import Path

import comparisons.equivalence as equivalence
import comparisons.solvers as solvers
import numpy as np
import pytest
from comparisons.__main__ import PARTS
from comparisons.families import BOUNDS, DAMPINGS, METHODS, Case, exact_step, made_up_cases
from comparisons.recorded import recorded_steps

import qparm
from conftest import DOME, ROOT
from qparm.ik import active_set, closed_form

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def cases(chain: qparm.SerialChain) -> list[Case]:
    return list(made_up_cases(chain, seed=3, repetitions=1))


def _columns(path: Path) -> list[str]:
    with path.open(encoding="utf-8", newline="") as file:
        return next(csv.reader(file))


def test_families_are_what_they_say(cases: list[Case]) -> None:
    assert {case.method for case in cases} == set(METHODS)
    assert {case.bounds for case in cases} == set(BOUNDS)
    assert {case.step.lam2 for case in cases} == set(DAMPINGS)
    for case in cases:
        step, truth = case.step, exact_step(case.step)
        assert truth is not None
        assert 0.99e-4 <= np.linalg.norm(step.e) <= 0.1001
        sizes = np.linalg.svd(step.J, compute_uv=False)
        if case.family == "sigma_min 1e-4":
            assert sizes[-1] == pytest.approx(1e-4, rel=1e-6)
        if case.family.startswith("sigma_min 0"):
            assert (step.J[5] == -0.5 * step.J[0]).all()
            assert (step.e[5] == -0.5 * step.e[0]) == case.family.endswith("in range")
        if case.family == "joints at limits" and case.method == "cwln":
            assert (step.S == 0).any()
        if case.bounds == "inactive":
            assert not truth.active.any()
        elif case.bounds == "all":
            assert truth.active[step.S > 1e-6].all()
        else:
            assert truth.active.any()


def test_the_exact_step_is_the_closed_form_where_no_bound_is_active(cases: list[Case]) -> None:
    benign = [case.step for case in cases if case.bounds == "inactive" and case.family == "random J"]
    for step in benign:
        truth = exact_step(step)
        assert truth is not None
        np.testing.assert_allclose(np.asarray(truth.d, float), closed_form(step), atol=1e-13)


def test_equivalence_runs_and_nothing_accepted_is_wrong(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code = equivalence.main(["--quick", "--cell", str(DOME), "--out", str(tmp_path)])
    text = capsys.readouterr().out
    assert "truth lost on 0" in text
    assert "accepted by qparm's KKT check but off by more than 1e-8: none" in text
    assert code == 0
    assert "all bars hold" in text
    assert _columns(tmp_path / "equivalence.csv") == equivalence.HEADER
    for group, label in (("family", "family"), ("damping", "lambda^2"), ("bounds", "bounds"), ("method", "method")):
        assert _columns(tmp_path / f"equivalence_by_{group}.csv") == [label, *equivalence.HEADER]
    with (tmp_path / "equivalence.csv").open(encoding="utf-8", newline="") as file:
        table = {row["path"]: row for row in csv.DictReader(file)}
    assert {"closed form", "active set", "ProxQP, workspace", "OSQP, workspace", "cvxpy, DAQP"} <= set(table)
    assert {f"{name}, normal" for name in ("proxqp", "osqp", "daqp", "quadprog")} <= set(table)
    assert all(row["accepted but > 1e-8 off"] == "0" for row in table.values())
    assert {file.name for file in tmp_path.glob("*.png")} == {"equivalence_error.png", "weight_conventions.png"}


def test_a_wrong_active_set_fails_the_verdict(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(equivalence, "active_set", lambda step: active_set(step) + 1e-7)
    monkeypatch.setattr(equivalence, "QUICK", 15)
    assert equivalence.main(["--quick", "--cell", str(DOME), "--out", str(tmp_path)]) == 1
    assert "active set off by more than 1e-10: 15" in capsys.readouterr().out


def test_a_wrong_answer_that_the_check_lets_through_fails_the_verdict(
    cases: list[Case], monkeypatch: pytest.MonkeyPatch
) -> None:
    class Yes:
        def holds(self) -> bool:
            return True

    monkeypatch.setattr(equivalence, "check_optimality", lambda *_: Yes())
    monkeypatch.setattr(
        equivalence, "paths", lambda n: {"wrong": lambda step: equivalence.Answer(active_set(step) + 1e-7, True)}
    )
    _, _, results = equivalence.compare(cases[:5])
    assert (results["wrong"]["accepted"] & (results["wrong"]["distance"] > equivalence.ACCEPTED_DIFFERENCE)).all()


def test_solvers_take_turns_and_tell_their_time(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert solvers.main(["--quick", "--cell", str(DOME), "--out", str(tmp_path)]) == 0
    assert "accepted but off by more than 1e-8: none" in capsys.readouterr().out
    for name in ("solvers", "solvers_bounded"):
        assert _columns(tmp_path / f"{name}.csv") == solvers.HEADER
    with (tmp_path / "solvers.csv").open(encoding="utf-8", newline="") as file:
        table = {row["solver"]: row for row in csv.DictReader(file)}
    assert "eps_abs 0.003" in table["ProxQP, workspace"]["settings"]
    assert "check_termination 5" in table["OSQP, workspace"]["settings"]
    assert all(0.0 < float(row["own / call"]) < 1.0 for row in table.values() if row["own / call"] != "-")


def test_listening_leaves_the_solvers_as_they_were(general_plan: qparm.Plan) -> None:
    import osqp
    import qpsolvers
    from proxsuite import proxqp

    before = (osqp.OSQP.setup, osqp.OSQP.solve, qpsolvers.solve_problem, proxqp.dense.QP.solve)
    solvers.compare(recorded_steps(general_plan, limit=4))
    assert before == (osqp.OSQP.setup, osqp.OSQP.solve, qpsolvers.solve_problem, proxqp.dense.QP.solve)


def test_the_index_names_modules_that_are_there() -> None:
    for part in PARTS:
        place = ROOT / "comparisons" / part.module
        assert place.with_suffix(".py").is_file() or (place / "__main__.py").is_file(), part.module
    run = subprocess.run(
        [sys.executable, "-m", "comparisons", "--help"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert "--quick" in run.stdout
