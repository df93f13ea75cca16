"""QP solvers for the bounded step: one file per solver, all of one shape.

Each is an object with a ``name`` and ``solve(step) -> SolvedStep``; the KKT conditions are checked after
every solve, so what is *accepted* is proved, whatever the solver claimed.
"""

import numpy as np

from qparm.errors import InvalidInput
from qparm.ik.solvers.checked_solver import CheckedSolver
from qparm.ik.solvers.generic import GenericSolver
from qparm.ik.solvers.osqp import OsqpSolver
from qparm.ik.solvers.proxqp import ProxqpSolver
from qparm.ik.solvers.slack_form import SolvedStep, StepSolver

__all__ = [
    "CheckedSolver",
    "GenericSolver",
    "OsqpSolver",
    "ProxqpSolver",
    "SolvedStep",
    "StepSolver",
    "checked",
    "make_solver",
]


def make_solver(name: str, n: int) -> StepSolver:
    """Return a solver for steps of ``n`` joints by name.

    Parameters
    ----------
    name : str
        ``"proxqp"`` and ``"osqp"`` keep a warm-started workspace; any other name goes through the
        package qpsolvers.
    n : int

    Raises
    ------
    InvalidInput
        If ``n`` is not a positive integer, or the name is "auto", which is not a solver.
    SolverUnavailable
        If there is no such solver here; the error lists those there are.
    """
    if isinstance(n, bool) or not isinstance(n, (int, np.integer)) or n < 1:
        raise InvalidInput(f"n must be a whole number of joints from 1, not {n!r}")
    if name == "auto":
        raise InvalidInput('"auto" is the closed form and the active set; no solver stands for it')
    if name == "proxqp":
        return ProxqpSolver(n)
    if name == "osqp":
        return OsqpSolver(n)
    return GenericSolver(name, n)


def checked(solver: StepSolver) -> StepSolver:
    """Return a solver whose answers are checked here: one of ours as it is, any other in a :class:`CheckedSolver`."""
    if type(solver) in (CheckedSolver, GenericSolver, OsqpSolver, ProxqpSolver):
        return solver
    return CheckedSolver(solver)


def __dir__() -> list[str]:
    return sorted(__all__)
