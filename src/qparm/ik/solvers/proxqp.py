"""ProxQP (ProxSuite): the default solver, dense, through one persistent workspace."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from qparm.errors import SolverUnavailable
from qparm.ik.closed_form import M
from qparm.ik.kkt import STEP_TOLERANCE, check_optimality
from qparm.ik.solvers.slack_form import SolvedStep, check_size, slack_form_kernel, step_from_slack_kernel

if TYPE_CHECKING:
    from qparm.ik.step import StepProblem

__all__ = ["ProxqpSolver"]

# ProxQP takes anything beyond this as no bound.
_INFINITY = 1e20


class ProxqpSolver:
    """ProxQP on steps of ``n`` joints.

    The duality gap is checked because a warm start may otherwise return a point of the last problem
    as solved. After any status but solved the workspace is set up anew: the warm start left by a
    problem that failed poisons the ones after it.
    """

    name = "proxqp"

    def __init__(self, n: int) -> None:
        try:
            from proxsuite import proxqp
        except ImportError:
            raise SolverUnavailable("proxqp", ("auto", "osqp")) from None
        self._proxqp = proxqp
        self._n = n
        self._A, self._b = np.zeros((M, n + M)), np.zeros(M)
        self._lo, self._hi = np.zeros(n + M), np.zeros(n + M)
        self._fresh = True
        # the Hessian is the identity, and saying so saves a twentieth
        qp = proxqp.dense.QP(n + M, M, 0, True, proxqp.dense.HessianType.Diagonal)
        settings = qp.settings
        settings.eps_abs = 1e-9
        settings.eps_rel = 0.0
        settings.check_duality_gap = True
        settings.eps_duality_gap_abs = 1e-9
        settings.eps_duality_gap_rel = 0.0
        settings.max_iter = 100
        settings.compute_timings = False
        settings.initial_guess = proxqp.InitialGuess.WARM_START_WITH_PREVIOUS_RESULT
        self._qp = qp
        self._H, self._g = np.eye(n + M), np.zeros(n + M)

    def update(self) -> None:
        """Hand the assembled rows and bounds to the workspace."""
        if self._fresh:
            self._qp.cleanup()
            self._qp.init(
                H=self._H,
                g=self._g,
                A=self._A,
                b=self._b,
                C=None,
                l=None,
                u=None,
                l_box=self._lo,
                u_box=self._hi,
            )
            self._fresh = False
        else:
            self._qp.update(A=self._A, b=self._b, l_box=self._lo, u_box=self._hi)

    def solve(self, step: StepProblem) -> SolvedStep:
        """Solve one step."""
        check_size(step, self._n)
        unit = slack_form_kernel(
            step.JT, step.S, step.c, step.e, math.sqrt(step.lam2), step.lb, step.ub, _INFINITY,
            self._A, self._b, self._lo, self._hi,
        )  # fmt: skip
        self.update()
        self._qp.solve()
        results = self._qp.results
        claimed = results.info.status == self._proxqp.PROXQP_SOLVED
        self._fresh = not claimed
        d, z = np.empty(step.n), np.empty(M)
        step_from_slack_kernel(step.S, step.c, results.x, results.y, unit, d, z)
        optimality = check_optimality(step, d, z)
        return SolvedStep(d, z, claimed, optimality, claimed and optimality.holds(STEP_TOLERANCE))
