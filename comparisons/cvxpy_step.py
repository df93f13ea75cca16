"""The bounded step in cvxpy: parametrised once (DPP), solved again for every step."""

from __future__ import annotations

import math

import numpy as np

from comparisons.extras import load
from qparm.ik import StepProblem

__all__ = ["CvxpyStep"]

cp = load("cvxpy")

_TYPICAL_STEP = 5e-3
_UNBOUNDED = 1e6  # in typical steps: where S is zero or tiny


class CvxpyStep:
    """min 1/2 |y|^2 + 1/2 |w|^2  s.t.  J S y + lambda w = e - J c,  lb - c <= S y <= ub - c, in typical steps."""

    def __init__(self, n: int, solver: str) -> None:
        self.solver = solver
        self._B, self._r, self._lam = cp.Parameter((6, n)), cp.Parameter(6), cp.Parameter(nonneg=True)
        self._lo, self._hi = cp.Parameter(n), cp.Parameter(n)
        self._y, w = cp.Variable(n), cp.Variable(6)
        objective = cp.Minimize(0.5 * cp.sum_squares(self._y) + 0.5 * cp.sum_squares(w))
        constraints = [self._B @ self._y + self._lam * w == self._r, self._y >= self._lo, self._y <= self._hi]
        self._problem = cp.Problem(objective, constraints)
        assert self._problem.is_dpp()

    def solve(self, step: StepProblem) -> np.ndarray | None:
        """Return the step, None if cvxpy does not call it solved."""
        movable = step.S > 0
        S = np.where(movable, step.S, 1.0)
        self._B.value, self._lam.value = step.J * step.S, math.sqrt(step.lam2)
        self._r.value = (step.e - step.J @ step.c) / _TYPICAL_STEP
        lo, hi = ((bound - step.c) / S / _TYPICAL_STEP for bound in (step.lb, step.ub))
        self._lo.value = np.where(movable, np.maximum(lo, -_UNBOUNDED), -_UNBOUNDED)
        self._hi.value = np.where(movable, np.minimum(hi, _UNBOUNDED), _UNBOUNDED)
        try:
            self._problem.solve(solver=self.solver, warm_start=False)
        except cp.SolverError:
            return None
        if self._problem.status != cp.OPTIMAL:
            return None
        return step.c + step.S * self._y.value * _TYPICAL_STEP
