"""Any other solver by its name in the package qpsolvers: no workspace, a new problem each step."""

from __future__ import annotations

import math
import warnings
from typing import TYPE_CHECKING, Any

import numpy as np

from qparm.errors import SolverUnavailable
from qparm.ik.closed_form_step import M
from qparm.ik.kkt import STEP_TOLERANCE, check_optimality
from qparm.ik.solvers.slack_form import SolvedStep, check_size, slack_form_kernel, step_from_slack_kernel

if TYPE_CHECKING:
    from qparm.ik.step import StepProblem

__all__ = ["GenericSolver"]

# Settings that bring a solver to the accuracy a step needs; a solver without an entry runs as it comes,
# and the KKT check decides.
_SETTINGS: dict[str, dict[str, Any]] = {
    "clarabel": {"tol_gap_abs": 1e-10, "tol_gap_rel": 1e-10, "tol_feas": 1e-10},
    "daqp": {"primal_tol": 1e-9},
    # HiGHS' active set cycles for ever on some steps of rank less than six
    "highs": {"qp_iteration_limit": 1000},
    "osqp": {"eps_abs": 1e-9, "eps_rel": 0.0},
    "piqp": {"eps_abs": 1e-9, "eps_rel": 0.0, "eps_duality_gap_abs": 1e-9, "eps_duality_gap_rel": 0.0},
    "proxqp": {"eps_abs": 1e-9, "eps_rel": 0.0},
    "scs": {"eps_abs": 1e-9, "eps_rel": 0.0, "max_iters": 10_000},
}
_SPARSE_ONLY = frozenset({"clarabel", "gurobi", "highs", "mosek", "osqp", "qpalm", "qtqp", "scs", "sip"})


class GenericSolver:
    """A solver of the package qpsolvers on steps of ``n`` joints.

    Parameters
    ----------
    name : str
        One of ``qpsolvers.available_solvers``.
    n : int
        Joints.

    Raises
    ------
    SolverUnavailable
        If qpsolvers does not know the name here.
    """

    def __init__(self, name: str, n: int) -> None:
        import qpsolvers

        if name not in qpsolvers.available_solvers:
            raise SolverUnavailable(name, ("auto", *sorted({"proxqp", "osqp", *qpsolvers.available_solvers})))
        self.name = name
        self._n = n
        self._A, self._b = np.zeros((M, n + M)), np.zeros(M)
        self._lo, self._hi = np.zeros(n + M), np.zeros(n + M)
        self._P, self._q = np.eye(n + M), np.zeros(n + M)

    def solve(self, step: StepProblem) -> SolvedStep:
        """Solve one step, cold."""
        import qpsolvers

        check_size(step, self._n)
        unit = slack_form_kernel(
            step.JT, step.S, step.c, step.e, math.sqrt(step.lam2), step.lb, step.ub, math.inf,
            self._A, self._b, self._lo, self._hi,
        )  # fmt: skip
        P, A = self._P, self._A
        if self.name in _SPARSE_ONLY:
            from scipy import sparse

            P, A = sparse.csc_matrix(P), sparse.csc_matrix(A)
        problem = qpsolvers.Problem(P, self._q, A=A, b=self._b, lb=self._lo, ub=self._hi)
        x = y = None
        claimed = False
        try:
            # the KKT check decides, so what the package warns of is no news
            with warnings.catch_warnings(action="ignore"):
                solution = qpsolvers.solve_problem(problem, solver=self.name, **_SETTINGS.get(self.name, {}))
            x, y, claimed = solution.x, solution.y, bool(solution.found)
        except (qpsolvers.exceptions.QPError, ValueError, ArithmeticError):
            pass  # the solver gave up on this problem; what it says is "not solved"
        n = step.n
        if x is None or y is None or len(x) != n + M or len(y) != M:
            x, y, claimed = np.full(n + M, math.nan), np.full(M, math.nan), False
        d, z = np.empty(n), np.empty(M)
        step_from_slack_kernel(step.S, step.c, np.ascontiguousarray(x), np.ascontiguousarray(y), unit, d, z)
        optimality = check_optimality(step, d, z)
        return SolvedStep(d, z, claimed, optimality, claimed and optimality.holds(STEP_TOLERANCE))
