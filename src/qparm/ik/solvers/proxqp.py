"""ProxQP (ProxSuite): the default solver, dense, through persistent workspaces.

A step goes to it in normal form first, to a tolerance that settles which joints are at their bounds and no more;
the optimum on that face is proved or refused by the KKT check. Refused, ProxQP goes on from where it is, tighter.
Refused again, the step goes to it in slack form, to full accuracy.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from qparm.errors import SolverUnavailable
from qparm.ik.closed_form_step import M
from qparm.ik.kkt import STEP_TOLERANCE, Optimality, check_optimality
from qparm.ik.solvers.slack_form import SolvedStep, check_size, slack_form_kernel, step_from_slack_kernel

if TYPE_CHECKING:
    from qparm.ik.step import StepProblem

__all__ = ["ProxqpSolver"]

# ProxQP takes anything beyond this as no bound.
_INFINITY = 1e20
# In units of the task. At the first the face is right on six in seven bounded steps of the reference plan.
_FACE_TOLERANCES = (3e-3, 1e-4, 1e-6)
# Bounds ten times stiffer than ProxQP's default: fewer iterations on every kind of step measured.
_FACE_MU = 1e-2


class ProxqpSolver:
    """ProxQP on steps of ``n`` joints.

    The duality gap is checked because a warm start may otherwise return a point of the last problem
    as solved. After any status but solved a workspace is set up anew: the warm start left by a
    problem that failed poisons the ones after it. The normal form starts every step from ProxQP's own
    guess, so nothing of one step reaches the next.
    """

    name = "proxqp"

    def __init__(self, n: int) -> None:
        try:
            from proxsuite import proxqp
        except ImportError:
            raise SolverUnavailable("proxqp", ("auto", "osqp")) from None
        # compiled where ProxQP is asked for, not by every plan
        from qparm.ik.solvers.normal_form import face_step_kernel, normal_form_kernel

        self._normal_form, self._face_step = normal_form_kernel, face_step_kernel
        self._solved = proxqp.PROXQP_SOLVED
        self._n = n
        self._own_guess = proxqp.InitialGuess.EQUALITY_CONSTRAINED_INITIAL_GUESS
        self._go_on = proxqp.InitialGuess.WARM_START_WITH_PREVIOUS_RESULT
        # bounds as rows of C take ProxQP a tenth less time than as a box
        self._normal: Any = proxqp.dense.QP(n, 0, n, False, proxqp.dense.HessianType.Dense)
        self._normal.settings.initial_guess = self._own_guess
        self._normal.settings.default_mu_in = _FACE_MU
        # the Hessian is the identity, and saying so saves a twentieth
        self._slack: Any = proxqp.dense.QP(n + M, M, 0, True, proxqp.dense.HessianType.Diagonal)
        self._slack.settings.initial_guess = self._go_on
        for qp, tolerance in ((self._normal, _FACE_TOLERANCES[0]), (self._slack, 1e-9)):
            settings = qp.settings
            settings.eps_abs = settings.eps_duality_gap_abs = tolerance
            settings.eps_rel = settings.eps_duality_gap_rel = 0.0
            settings.check_duality_gap = True
            settings.max_iter = 100
            settings.compute_timings = False
        self._normal_fresh = self._slack_fresh = True
        self._H, self._g, self._C = np.zeros((n, n)), np.zeros(n), np.eye(n)
        self._lo, self._hi = np.zeros(n), np.zeros(n)
        self._A, self._b = np.zeros((M, n + M)), np.zeros(M)
        self._slack_lo, self._slack_hi = np.zeros(n + M), np.zeros(n + M)
        self._out = np.empty(4)

    def solve(self, step: StepProblem) -> SolvedStep:
        """Solve one step."""
        check_size(step, self._n)
        answer = self._solve_by_face(step)
        return self._solve_in_slack_form(step) if answer is None else answer

    def _solve_by_face(self, step: StepProblem) -> SolvedStep | None:
        """Return the optimum on the face that ProxQP finds in normal form, or None if none is proved."""
        qp, H, g, lo, hi, out = self._normal, self._H, self._g, self._lo, self._hi, self._out
        JT, S, c, e, lam2, lb, ub = step.JT, step.S, step.c, step.e, step.lam2, step.lb, step.ub
        unit = self._normal_form(JT, S, c, e, lam2, lb, ub, _INFINITY, H, g, lo, hi)
        if self._normal_fresh:
            qp.cleanup()
            qp.init(H=H, g=g, A=None, b=None, C=self._C, l=lo, u=hi)
        else:
            qp.update(H=H, g=g, l=lo, u=hi)
        d, z = np.empty(self._n), np.empty(M)
        found, tolerance = None, _FACE_TOLERANCES[0]
        for tolerance in _FACE_TOLERANCES:
            if tolerance != _FACE_TOLERANCES[0]:
                self._set_normal(tolerance, self._go_on)
            qp.solve()
            results = qp.results
            self._normal_fresh = results.info.status != self._solved
            if self._normal_fresh:
                break
            self._face_step(JT, S, c, e, lam2, lb, ub, results.x, results.z, unit, d, z, out)
            optimality = Optimality(*out.tolist())
            if optimality.holds():
                found = SolvedStep(d, z, True, optimality, True)
                break
        if tolerance != _FACE_TOLERANCES[0]:
            self._set_normal(_FACE_TOLERANCES[0], self._own_guess)
        return found

    def _set_normal(self, tolerance: float, guess: Any) -> None:
        settings = self._normal.settings
        settings.eps_abs = settings.eps_duality_gap_abs = tolerance
        settings.initial_guess = guess

    def _solve_in_slack_form(self, step: StepProblem) -> SolvedStep:
        qp, lo, hi = self._slack, self._slack_lo, self._slack_hi
        unit = slack_form_kernel(
            step.JT, step.S, step.c, step.e, math.sqrt(step.lam2), step.lb, step.ub, _INFINITY, self._A, self._b, lo, hi
        )
        if self._slack_fresh:
            qp.cleanup()
            identity = np.eye(self._n + M)
            qp.init(H=identity, g=np.zeros(len(identity)), A=self._A, b=self._b, C=None, l=None, u=None,
                    l_box=lo, u_box=hi)  # fmt: skip
        else:
            qp.update(A=self._A, b=self._b, l_box=lo, u_box=hi)
        qp.solve()
        results = qp.results
        claimed = results.info.status == self._solved
        self._slack_fresh = not claimed
        d, z = np.empty(step.n), np.empty(M)
        step_from_slack_kernel(step.S, step.c, results.x, results.y, unit, d, z)
        optimality = check_optimality(step, d, z)
        return SolvedStep(d, z, claimed, optimality, claimed and optimality.holds(STEP_TOLERANCE))
