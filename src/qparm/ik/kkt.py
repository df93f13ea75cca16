"""Whether a step is the optimum it claims to be: the KKT conditions, and an error bound from them.

With z the multiplier of the task, the optimum of

    min  1/2 |B y - r|^2 + 1/2 lambda^2 |y|^2   s.t.  lo <= y <= hi

is the only pair with ``y = clip(B^T z, lo, hi)`` and ``B y + lambda^2 z = r``. For *any* z the point
y_z = clip(B^T z, lo, hi) with residual rho = r - B y_z - lambda^2 z lies within |rho| / lambda of the optimum
(the problem in slack form is strongly convex with modulus 1). So after two Newton corrections of the
solver's z, which take rho to rounding,

    |y - y*|  <=  |y - y_z| + |rho| / lambda

is a bound on the error of the solver's y that does not rest on the solver's own word, status or residuals.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from qparm.compiled import c1, c2, f8, kernel, o1, void
from qparm.ik.active_set import dot_column, y_bounds
from qparm.ik.closed_form import M, cholesky, cholesky_solve, weighted_task

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.ik.step import StepProblem

__all__ = ["STEP_TOLERANCE", "Optimality", "check_optimality"]

# A solver's step is accepted if it is proved to lie this close to the optimum (scaled joints, rad).
STEP_TOLERANCE = 1e-9


@dataclass(frozen=True)
class Optimality:
    """How far a step is from satisfying the KKT conditions of its problem.

    Attributes
    ----------
    bound_violation : float
        Largest excess of d over its bounds (scaled joints).
    dual_residual : float
        max |y - clip(B^T z, lo, hi)| at the solver's own multiplier z: stationarity and
        complementarity in one (scaled joints).
    task_residual : float
        |B y + lambda^2 z - r|: the task rows of the slack form at the solver's own multiplier.
    error_bound : float
        Proved distance of d to the optimum (scaled joints); inf or NaN if nothing could be proved.
    """

    bound_violation: float
    dual_residual: float
    task_residual: float
    error_bound: float

    def holds(self, tolerance: float = STEP_TOLERANCE) -> bool:
        """Return whether the step is proved to lie within ``tolerance`` of the optimum and of its bounds."""
        return self.error_bound <= tolerance and self.bound_violation <= tolerance


@kernel(void(c2, c1, c1, c1, f8, c1, c1, c1, c1, o1))
def optimality_kernel(JT, S, c, e, lam2, lb, ub, d, z_solver, out):
    """Write bound violation, dual residual, task residual and error bound of a step d with multiplier z."""
    n = S.shape[0]
    BT, A, r, z, rho, y_z = (
        np.empty((n, M)),
        np.empty((M, M)),
        np.empty(M),
        np.empty(M),
        np.empty(M),
        np.empty(n),
    )
    lo, hi = np.empty(n), np.empty(n)
    weighted_task(JT, S, c, e, BT, r)
    y_bounds(S, c, lb, ub, lo, hi)
    for k in range(M):
        z[k] = z_solver[k]
    error_bound = math.inf
    for correction in range(3):
        for k in range(M):
            rho[k] = r[k] - lam2 * z[k]
        distance = 0.0
        for i in range(n):
            t = dot_column(BT, i, z)
            y_z[i] = min(max(t, lo[i]), hi[i])
            for k in range(M):
                rho[k] -= BT[i, k] * y_z[i]
            gap = d[i] - c[i] - S[i] * y_z[i]
            distance += gap * gap
        norm_rho = 0.0
        for k in range(M):
            norm_rho += rho[k] * rho[k]
        norm_rho = math.sqrt(norm_rho)
        distance = math.sqrt(distance)
        if correction == 0:
            violation = 0.0
            for i in range(n):
                violation = max(violation, lb[i] - d[i], d[i] - ub[i])
            out[0] = violation
            out[1] = distance
            out[2] = norm_rho
        # lambda = 0 (exact task): no strong convexity in w, the residual itself must vanish
        bound = distance + (norm_rho / math.sqrt(lam2) if lam2 > 0.0 else norm_rho)
        if not bound >= error_bound:
            error_bound = bound
        if correction == 2 or error_bound <= 1e-13:
            break
        for a in range(M):
            for b in range(a + 1):
                A[a, b] = 0.0
            A[a, a] = lam2
        for i in range(n):
            if lo[i] < y_z[i] < hi[i]:
                for a in range(M):
                    for b in range(a + 1):
                        A[a, b] += BT[i, a] * BT[i, b]
        if not cholesky(A, M):
            break
        cholesky_solve(A, M, rho)
        for k in range(M):
            z[k] += rho[k]
    out[3] = error_bound


def check_optimality(step: StepProblem, d: NDArray[np.float64], z: NDArray[np.float64]) -> Optimality:
    """Return the KKT residuals and the error bound of a step.

    Parameters
    ----------
    step : StepProblem
    d : (n,) ndarray
        The step, scaled joints.
    z : (6,) ndarray
        The multiplier of the task rows, so that y = clip((J S)^T z, lo, hi) at the optimum.

    Returns
    -------
    Optimality
    """
    out = np.empty(4)
    optimality_kernel(step.JT, step.S, step.c, step.e, step.lam2, step.lb, step.ub, d, z, out)
    return Optimality(*out.tolist())
