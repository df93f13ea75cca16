"""Optimisers from elsewhere on the same problems: pymoo's and Optuna's, one evaluation counted like ours.

They get what they can take. Where constraints are accepted they get the graded violation as one; an invalid design has
no objectives, so all get a value beyond the reference point, the further the larger the violation. Every design they
evaluate counts, also those of a population thrown away.
"""

from __future__ import annotations

import importlib.util
import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from qparm.design import Problem

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from comparisons.design_problems import Task

__all__ = ["PEERS", "missing"]

Record = tuple["NDArray[np.float64]", "NDArray[np.float64]"]


def missing() -> list[str]:
    """Return which packages of peers are not installed."""
    return [package for package in ("pymoo", "optuna") if importlib.util.find_spec(package) is None]


class _Counted:
    """An evaluation that keeps what it was asked, up to a budget."""

    def __init__(self, task: Task, budget: int) -> None:
        self.task, self.budget = task, budget
        self.violation, self.F = np.empty(0), np.empty((0, 2))

    def __call__(self, X: NDArray[np.float64]) -> Record:
        violation, F = self.task.evaluate(X)
        reference = np.array(self.task.reference)
        F = np.where((violation == 0)[:, None], F, reference + np.abs(reference) * (0.1 + violation[:, None]))
        self.violation = np.concatenate([self.violation, violation])[: self.budget]
        self.F = np.vstack([self.F, F])[: self.budget]
        return violation, F


def _pymoo(make: Callable[[], object]) -> Callable[[Task, int, int], Record]:
    def run(task: Task, seed: int, budget: int) -> Record:
        from pymoo.core.problem import Problem as PymooProblem
        from pymoo.optimize import minimize

        counted, problem = _Counted(task, budget), task.problem

        class Asked(PymooProblem):
            def __init__(self) -> None:
                super().__init__(n_var=problem.d, n_obj=2, n_ieq_constr=1, xl=problem.lower, xu=problem.upper)

            def _evaluate(self, x: NDArray[np.float64], out: dict, *_: object, **__: object) -> None:
                violation, out["F"] = counted(x)
                out["G"] = violation[:, None]

        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            minimize(Asked(), make(), ("n_eval", budget), seed=seed, verbose=False)
        return counted.violation, counted.F

    return run


def _nsga2() -> object:
    from pymoo.algorithms.moo.nsga2 import NSGA2

    return NSGA2(pop_size=20)


def _sms_emoa() -> object:
    from pymoo.algorithms.moo.sms import SMSEMOA

    return SMSEMOA(pop_size=20)


def _mopso_cd() -> object:
    from pymoo.algorithms.moo.mopso_cd import MOPSO_CD

    return MOPSO_CD(pop_size=20)


def _cmopso() -> object:
    from pymoo.algorithms.moo.cmopso import CMOPSO

    return CMOPSO(pop_size=20)


def _optuna(make: Callable[[int], object]) -> Callable[[Task, int, int], Record]:
    def run(task: Task, seed: int, budget: int) -> Record:
        import optuna

        optuna.logging.set_verbosity(optuna.logging.ERROR)
        counted, problem = _Counted(task, budget), task.problem
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            study = optuna.create_study(directions=["minimize"] * 2, sampler=make(seed))  # type: ignore[arg-type]
            for _ in range(budget):
                trial = study.ask()
                x = [trial.suggest_float(v.name, v.lower, v.upper) for v in _named(problem)]
                violation, F = counted(np.array([x]))
                trial.set_constraint("violation", float(violation[0]))
                study.tell(trial, [float(f) for f in F[0]])
        return counted.violation, counted.F

    return run


def _named(problem: Problem) -> tuple:
    return problem.variables


def _tpe(seed: int) -> object:
    from optuna.samplers import TPESampler

    return TPESampler(seed=seed)


def _tpe_multivariate(seed: int) -> object:
    from optuna.samplers import TPESampler

    return TPESampler(seed=seed, multivariate=True)


def _optuna_nsga2(seed: int) -> object:
    from optuna.samplers import NSGAIISampler

    return NSGAIISampler(seed=seed, population_size=20)


PEERS: dict[str, tuple[str, Callable[[Task, int, int], Record]]] = {
    "pymoo NSGA2": ("pymoo", _pymoo(_nsga2)),
    "pymoo SMS-EMOA": ("pymoo", _pymoo(_sms_emoa)),
    "pymoo MOPSO_CD": ("pymoo", _pymoo(_mopso_cd)),
    "pymoo CMOPSO": ("pymoo", _pymoo(_cmopso)),
    "Optuna TPE": ("optuna", _optuna(_tpe)),
    "Optuna TPE, multivariate": ("optuna", _optuna(_tpe_multivariate)),
    "Optuna NSGA-II": ("optuna", _optuna(_optuna_nsga2)),
}
