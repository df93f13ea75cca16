"""The optimality check of a step: the KKT conditions, and an error bound from them.

With z the multiplier of the task, the optimum of

    min  1/2 |B y - r|^2 + 1/2 lambda^2 |y|^2   s.t.  lo <= y <= hi

is the only pair with ``y = clip(B^T z, lo, hi)`` and ``B y + lambda^2 z = r``. For *any* z the point
y_z = clip(B^T z, lo, hi) with residual rho = r - B y_z - lambda^2 z lies within |rho| / lambda of the optimum
(the problem in slack form is strongly convex with modulus 1). So after a few Newton corrections of the
solver's z, which take rho to rounding,

    |y - y*|  <=  |y - y_z| + |rho| / lambda

is a bound on the error of the solver's y that does not rest on the solver's own word, status or residuals.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from qparm.compiled.kernels import c1, c2, f8, kernel, kernel_helper, o1, void
from qparm.errors import InvalidInput
from qparm.ik.active_set_step import dot_column, y_bounds
from qparm.ik.closed_form_step import M, cholesky, cholesky_solve, weighted_task

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.ik.step import StepProblem

__all__ = ["STEP_TOLERANCE", "Optimality", "check_optimality"]

# A solver's step is accepted if it is proved to lie this close to the optimum (scaled joints, rad).
STEP_TOLERANCE = 1e-9
_CORRECTIONS = 5
# A joint this close to a bound (scaled) is taken to be meant at it.
_AT_BOUND = 1e-10
# Units in the last place, relative to the terms of r - B y.
_ROUNDING = 2e-15


@dataclass(frozen=True)
class Optimality:
    """How far a step is from satisfying the KKT conditions of its problem.

    Attributes
    ----------
    bound_violation : float
        Largest excess of d over its bounds (scaled joints); inf where d is NaN.
    dual_residual : float
        |S (y - clip(B^T z, lo, hi))| at the solver's own multiplier z: stationarity and complementarity
        in one (scaled joints).
    task_residual : float
        |B clip(B^T z, lo, hi) + lambda^2 z - r|: the task rows of the slack form at the solver's own multiplier.
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


@kernel_helper
def clipped_primal(BT, r, lam2, lo, hi, z, y_z, rho):
    """Write y_z = clip(B^T z, lo, hi) and rho = r - B y_z - lambda^2 z; return |rho|."""
    for k in range(M):
        rho[k] = r[k] - lam2 * z[k]
    for i in range(BT.shape[0]):
        y_z[i] = min(max(dot_column(BT, i, z), lo[i]), hi[i])
        for k in range(M):
            rho[k] -= BT[i, k] * y_z[i]
    size = 0.0
    for k in range(M):
        size += rho[k] * rho[k]
    return math.sqrt(size)


@kernel_helper
def proved_bound(BT, r, lam2, lo, hi, S, c, d, z, A, y_z, rho):
    """Return the least error bound over some Newton corrections of the multiplier z, which is overwritten."""
    bound = math.inf
    for _ in range(_CORRECTIONS):
        size = clipped_primal(BT, r, lam2, lo, hi, z, y_z, rho)
        distance = 0.0
        for i in range(S.shape[0]):
            gap = d[i] - c[i] - S[i] * y_z[i]
            distance += gap * gap
        # lambda = 0 (exact task): no strong convexity in w, the residual itself must vanish
        candidate = math.sqrt(distance) + (size / math.sqrt(lam2) if lam2 > 0.0 else size)
        if candidate < bound:
            bound = candidate
        elif candidate != candidate or bound <= 1e-13:
            break
        for a in range(M):
            for b in range(a + 1):
                A[a, b] = 0.0
            A[a, a] = lam2
        for i in range(S.shape[0]):
            if lo[i] < y_z[i] < hi[i]:
                for a in range(M):
                    for b in range(a + 1):
                        A[a, b] += BT[i, a] * BT[i, b]
        if not cholesky(A, M):
            break
        cholesky_solve(A, M, rho)
        for k in range(M):
            z[k] += rho[k]
    return bound


@kernel_helper
def newton_bound(S, c, lam2, lb, ub, d, BT, r, lo, hi, y, delta, state, G, rho):
    """Return the error bound of d by the Newton step from it on its own active set; inf if that proves nothing.

    If the step stays within the bounds and every multiplier of the active set keeps its sign, it leads to the
    optimum. Rounding disturbs r by some units in the last place, which moves y by at most half of that over
    lambda, and a multiplier by that over lambda^2.
    """
    n = S.shape[0]
    size, snapped, free = 0.0, 0.0, 0
    for i in range(n):
        state[i] = 0
        if S[i] <= 0.0:
            y[i], state[i] = 0.0, 2
        elif d[i] <= lb[i] + _AT_BOUND:
            y[i], state[i] = lo[i], -1
        elif d[i] >= ub[i] - _AT_BOUND:
            y[i], state[i] = hi[i], 1
        else:
            y[i] = (d[i] - c[i]) / S[i]
            free += 1
        gap = c[i] + S[i] * y[i] - d[i]
        snapped += gap * gap
    for k in range(M):
        rho[k] = r[k]
        size += abs(r[k])
        for i in range(n):
            rho[k] -= BT[i, k] * y[i]
            size += abs(BT[i, k] * y[i])
    a = 0
    for i in range(n):
        if state[i] == 0:
            b = 0
            for j in range(i + 1):
                if state[j] == 0:
                    t = lam2 if i == j else 0.0
                    for k in range(M):
                        t += BT[i, k] * BT[j, k]
                    G[a, b] = t
                    b += 1
            delta[a] = dot_column(BT, i, rho) - lam2 * y[i]
            a += 1
    if not cholesky(G, free):
        return math.inf
    cholesky_solve(G, free, delta)
    moved, a = 0.0, 0
    for i in range(n):
        if state[i] == 0:
            moved += delta[a] * delta[a]
            if not lo[i] <= y[i] + delta[a] <= hi[i]:
                return math.inf
            for k in range(M):
                rho[k] -= BT[i, k] * delta[a]
            a += 1
    rounding = _ROUNDING * size
    for i in range(n):
        if (state[i] == -1 or state[i] == 1) and lo[i] < hi[i]:
            length = 0.0
            for k in range(M):
                length += abs(BT[i, k])
            gradient = y[i] - dot_column(BT, i, rho) / lam2
            if -state[i] * gradient < length * rounding / lam2:
                return math.inf
    return 1.01 * math.sqrt(moved) + math.sqrt(snapped) + rounding / math.sqrt(lam2)


@kernel_helper
def optimality(BT, r, S, c, lam2, lb, ub, lo, hi, d, z_solver, out):
    """Write bound violation, dual residual, task residual and error bound of a step d with multiplier z."""
    n = S.shape[0]
    A, z, rho, y_z = np.empty((M, M)), np.empty(M), np.empty(M), np.empty(n)
    out[0] = 0.0
    for i in range(n):
        for excess in (lb[i] - d[i], d[i] - ub[i]):
            if not excess <= out[0]:  # a NaN keeps no bound
                out[0] = excess if excess == excess else math.inf
    out[2] = clipped_primal(BT, r, lam2, lo, hi, z_solver, y_z, rho)
    distance = 0.0
    for i in range(n):
        gap = d[i] - c[i] - S[i] * y_z[i]
        distance += gap * gap
    out[1] = math.sqrt(distance)
    for k in range(M):
        z[k] = z_solver[k]
    out[3] = proved_bound(BT, r, lam2, lo, hi, S, c, d, z, A, y_z, rho)
    if lam2 > 0.0 and not out[3] <= STEP_TOLERANCE:
        # where the task cannot be met, z is huge and B^T z has lost the digits of y: prove it from d instead
        y, delta, state, G = np.empty(n), np.empty(n), np.empty(n, dtype=np.int64), np.empty((n, n))
        out[3] = min(out[3], newton_bound(S, c, lam2, lb, ub, d, BT, r, lo, hi, y, delta, state, G, rho))


@kernel(void(c2, c1, c1, c1, f8, c1, c1, c1, c1, o1))
def optimality_kernel(JT, S, c, e, lam2, lb, ub, d, z_solver, out):
    """Compiled :func:`check_optimality`: the four residuals in ``out``."""
    n = S.shape[0]
    BT, r, lo, hi = np.empty((n, M)), np.empty(M), np.empty(n), np.empty(n)
    weighted_task(JT, S, c, e, BT, r)
    y_bounds(S, c, lb, ub, lo, hi)
    optimality(BT, r, S, c, lam2, lb, ub, lo, hi, d, z_solver, out)


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
    d, z = np.ascontiguousarray(d, dtype=float), np.ascontiguousarray(z, dtype=float)
    if d.shape != (step.n,) or z.shape != (M,):
        raise InvalidInput(f"d must be ({step.n},) and z ({M},), not {d.shape} and {z.shape}")
    out = np.empty(4)
    optimality_kernel(step.JT, step.S, step.c, step.e, step.lam2, step.lb, step.ub, d, z, out)
    return Optimality(*out.tolist())
