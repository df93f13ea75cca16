"""QP solvers for the bounded step: one file a solver, all of one shape.

Each is an object with a ``name`` and ``solve(step) -> SolvedStep``; the KKT conditions are checked after
every solve, so what is *accepted* is proved, whatever the solver claimed.
"""

from qparm.ik.solvers.generic import GenericSolver
from qparm.ik.solvers.osqp import OsqpSolver
from qparm.ik.solvers.proxqp import ProxqpSolver
from qparm.ik.solvers.slack_form import SolvedStep, StepSolver

__all__ = ["GenericSolver", "OsqpSolver", "ProxqpSolver", "SolvedStep", "StepSolver", "make_solver"]


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
    SolverUnavailable
        If there is no such solver here; the error lists those there are.
    """
    if name == "proxqp":
        return ProxqpSolver(n)
    if name == "osqp":
        return OsqpSolver(n)
    return GenericSolver(name, n)
