"""OSQP through one persistent workspace: setup once, then matrix and bounds are updated in place."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from qparm.ik.closed_form_step import M
from qparm.ik.kkt import STEP_TOLERANCE, check_optimality
from qparm.ik.solvers.slack_form import SolvedStep, check_size, slack_form_kernel, step_from_slack_kernel

if TYPE_CHECKING:
    from qparm.ik.step import StepProblem

__all__ = ["OsqpSolver"]

_INFINITY = 1e30
_SOLVED = 1


class OsqpSolver:
    """OSQP on steps of ``n`` joints.

    Polishing stays off: it prints in spite of ``verbose=False`` and may accept a worse point. The
    inputs were validated before they come here: ``update`` drops reversed bounds without a word, and
    a NaN would poison the workspace.
    """

    name = "osqp"

    def __init__(self, n: int) -> None:
        self._n = n
        self._A, self._b = np.zeros((M, n + M)), np.zeros(M)
        self._lo, self._hi = np.zeros(n + M), np.zeros(n + M)
        # columns of [J S, lambda I; I, 0]: a joint's six task entries and its bound row, then lambda
        self._Ax = np.ones(n * (M + 1) + M)
        self._l, self._u = np.zeros(M + n), np.zeros(M + n)
        self._solver: Any = None  # made at the first solve: OSQP wants its data at setup

    def _made(self) -> Any:
        import osqp
        from scipy import sparse

        n = self._n
        indices = [row for i in range(n) for row in (*range(M), M + i)] + list(range(M))
        indptr = [*range(0, n * (M + 1) + 1, M + 1), *range(n * (M + 1) + 1, n * (M + 1) + M + 1)]
        A = sparse.csc_matrix((self._Ax, indices, indptr), shape=(M + n, n + M))
        solver = osqp.OSQP(algebra="builtin")
        solver.setup(
            P=sparse.eye(n + M, format="csc"),
            q=np.zeros(n + M),
            A=A,
            l=self._l,
            u=self._u,
            eps_abs=1e-9,
            eps_rel=0.0,
            check_termination=5,
            max_iter=4000,
            polishing=False,
            verbose=False,
        )
        return solver

    def solve(self, step: StepProblem) -> SolvedStep:
        """Solve one step."""
        n = self._n
        check_size(step, self._n)
        unit = slack_form_kernel(
            step.JT, step.S, step.c, step.e, math.sqrt(step.lam2), step.lb, step.ub, _INFINITY,
            self._A, self._b, self._lo, self._hi,
        )  # fmt: skip
        self._Ax[: n * (M + 1)].reshape(n, M + 1)[:, :M] = self._A[:, :n].T
        self._Ax[n * (M + 1) :] = self._A[0, n]
        self._l[:M] = self._u[:M] = self._b
        self._l[M:], self._u[M:] = self._lo[:n], self._hi[:n]
        if self._solver is None:
            self._solver = self._made()
        else:
            self._solver.update(Ax=self._Ax, l=self._l, u=self._u)
        solver: Any = self._solver
        results = solver.solve(raise_error=False)
        claimed = results.info.status_val == _SOLVED
        if not claimed:
            # an infeasible or unfinished solve leaves huge or NaN iterates as the next warm start
            solver.warm_start(x=np.zeros(n + M), y=np.zeros(M + n))
        d, z = np.empty(n), np.empty(M)
        x, y = np.ascontiguousarray(results.x), np.ascontiguousarray(results.y)
        step_from_slack_kernel(step.S, step.c, x, y, unit, d, z)
        optimality = check_optimality(step, d, z)
        return SolvedStep(d, z, claimed, optimality, claimed and optimality.holds(STEP_TOLERANCE))
