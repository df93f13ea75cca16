"""The bounded step, exactly: a primal active-set method for box bounds, compiled.

    min  1/2 |B y - r|^2 + 1/2 lambda^2 |y|^2   s.t.  lo <= y <= hi,      B = J S,  r = e - J c

With the working set W of variables held at a bound, the free ones are a small least-norm problem.
Six or more free: through z of (B_F B_F^T + lambda^2 I) z = r - B_W y_W, y_F = B_F^T z. Fewer: the task
cannot be met, and y_F comes from its own normal equations. Either way refinement against the unsquared
residual brings back what squaring B lost.

Optimality reads off the multiplier z = (r - B y) / lambda^2: y = clip(B^T z, lo, hi), componentwise.
A variable at its bound whose B^T z lies inside is let go. The method is finite (strictly convex
objective, linearly independent bound gradients).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from qparm.compiled.kernels import c1, c2, f8, i8, kernel, kernel_helper, o1
from qparm.errors import KernelError
from qparm.ik.closed_form_step import M, cholesky, cholesky_solve, least_norm, weighted_task

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.ik.step import StepProblem

__all__ = ["active_set"]

# A multiplier's sign is trusted beyond this, in scaled units: keeping a bound whose multiplier is wrong
# by t moves the optimum by no more than t.
_SIGN_TOLERANCE = 1e-12
_INFINITY = 1e300
IMMOVABLE = 2
# A column counts towards the rank if it is not smaller than the largest by more than this.
_STRONG = 1e-6
_REFINEMENTS = 3


@kernel_helper
def y_bounds(S, c, lb, ub, lo, hi):
    """Write the bounds of y that stand for lb <= c + S y <= ub; a joint with S = 0 does not move by y."""
    for i in range(S.shape[0]):
        if S[i] > 1e-150:
            lo[i] = (lb[i] - c[i]) / S[i]
            hi[i] = (ub[i] - c[i]) / S[i]
            # a bound as far off as this is none, and must not read as the mark of a joint that does not move
            if lo[i] <= -_INFINITY:
                lo[i] = -math.inf
            if hi[i] >= _INFINITY:
                hi[i] = math.inf
        else:
            lo[i] = -_INFINITY
            hi[i] = _INFINITY


@kernel_helper
def dot_column(BT, i, z):
    """Return (B^T z)_i."""
    t = 0.0
    for k in range(M):
        t += BT[i, k] * z[k]
    return t


@kernel_helper
def free_step(BT, r, lam2, state, y, A, G, z, y_new, residual, g):
    """Write the optimum over the free variables into y_new and its multiplier z; return False if singular."""
    n = BT.shape[0]
    free, strong, largest = 0, 0, 0.0
    for k in range(M):
        residual[k] = r[k]
    for i in range(n):
        for k in range(M):
            largest = max(largest, abs(BT[i, k]))
    for i in range(n):
        if state[i] == 0:
            free += 1
            column = 0.0
            for k in range(M):
                column = max(column, abs(BT[i, k]))
            # a joint that is all but immovable (S of 1e-9 at a limit) does not make the 6 x 6 system regular
            if column > _STRONG * largest:
                strong += 1
        else:
            y_new[i] = y[i]
            for k in range(M):
                residual[k] -= BT[i, k] * y[i]
    if strong >= M:
        for a in range(M):
            for b in range(a + 1):
                A[a, b] = 0.0
            A[a, a] = lam2
        for i in range(n):
            if state[i] == 0:
                for a in range(M):
                    for b in range(a + 1):
                        A[a, b] += BT[i, a] * BT[i, b]
        if not cholesky(A, M):
            return False
        for k in range(M):
            z[k] = residual[k]
        cholesky_solve(A, M, z)
        # refine: g = residual - B_F B_F^T z - lambda^2 z, formed without squaring B
        for k in range(M):
            g[k] = residual[k] - lam2 * z[k]
        for i in range(n):
            if state[i] == 0:
                t = dot_column(BT, i, z)
                for k in range(M):
                    g[k] -= BT[i, k] * t
        cholesky_solve(A, M, g)
        for k in range(M):
            z[k] += g[k]
        for i in range(n):
            if state[i] == 0:
                y_new[i] = dot_column(BT, i, z)
        return True
    if lam2 <= 0.0:
        return False
    if free > 0:
        a = 0
        for i in range(n):
            if state[i] != 0:
                continue
            b = 0
            for j in range(i + 1):
                if state[j] != 0:
                    continue
                t = lam2 if i == j else 0.0
                for k in range(M):
                    t += BT[i, k] * BT[j, k]
                G[a, b] = t
                b += 1
            a += 1
        if not cholesky(G, free):
            return False
        for i in range(n):
            if state[i] == 0:
                y_new[i] = 0.0
        for _ in range(_REFINEMENTS):  # the solution, then its refinements
            for k in range(M):
                z[k] = residual[k]
            for i in range(n):
                if state[i] == 0:
                    for k in range(M):
                        z[k] -= BT[i, k] * y_new[i]
            a = 0
            for i in range(n):
                if state[i] == 0:
                    g[a] = dot_column(BT, i, z) - lam2 * y_new[i]
                    a += 1
            cholesky_solve(G, free, g)
            a = 0
            for i in range(n):
                if state[i] == 0:
                    y_new[i] += g[a]
                    a += 1
    for k in range(M):
        z[k] = residual[k]
    for i in range(n):
        if state[i] == 0:
            for k in range(M):
                z[k] -= BT[i, k] * y_new[i]
    for k in range(M):
        z[k] /= lam2
    return True


@kernel_helper
def bounded_least_norm(BT, r, lam2, lo, hi, y, z, state, A, G, y_new, residual, g):
    """Solve the bounded problem from the guess in y; return the iterations, negative on failure."""
    n = BT.shape[0]
    for i in range(n):
        state[i] = 0
        if lo[i] == -_INFINITY:
            # S_i = 0: not a variable, and counting it as free would make the 6 x 6 system look regular
            y[i] = 0.0
            state[i] = IMMOVABLE
        elif y[i] <= lo[i]:
            y[i] = lo[i]
            state[i] = -1
        elif y[i] >= hi[i]:
            y[i] = hi[i]
            state[i] = 1
    limit = 20 * (n + 1)
    for iteration in range(limit):
        if not free_step(BT, r, lam2, state, y, A, G, z, y_new, residual, g):
            return -iteration - 1
        # as far towards the face's optimum as the box allows
        alpha, blocking = 1.0, -1
        for i in range(n):
            if state[i] == 0:
                change = y_new[i] - y[i]
                if y_new[i] < lo[i]:
                    a = (lo[i] - y[i]) / change
                elif y_new[i] > hi[i]:
                    a = (hi[i] - y[i]) / change
                else:
                    continue
                if blocking < 0 or a < alpha:
                    alpha, blocking = max(a, 0.0), i
        if blocking >= 0:
            for i in range(n):
                if state[i] == 0:
                    y[i] = min(max(y[i] + alpha * (y_new[i] - y[i]), lo[i]), hi[i])
            if y_new[blocking] < lo[blocking]:
                y[blocking], state[blocking] = lo[blocking], -1
            else:
                y[blocking], state[blocking] = hi[blocking], 1
            continue
        for i in range(n):
            y[i] = y_new[i]
        worst, release = _SIGN_TOLERANCE, -1
        for i in range(n):
            if (state[i] == -1 or state[i] == 1) and lo[i] < hi[i]:
                t = dot_column(BT, i, z)
                excess = t - lo[i] if state[i] < 0 else hi[i] - t
                if excess > worst * (1.0 + abs(y[i])):
                    worst, release = excess, i
        if release < 0:
            return iteration + 1
        state[release] = 0
    return -limit


@kernel_helper
def write_step(S, c, y, state, lb, ub, d):
    """Write d = c + S y, with the joints of the working set at their bounds to the last bit."""
    for i in range(S.shape[0]):
        if state[i] == -1:
            d[i] = lb[i]
        elif state[i] == 1:
            d[i] = ub[i]
        else:
            d[i] = min(max(c[i] + S[i] * y[i], lb[i]), ub[i])


@kernel(i8(c2, c1, c1, c1, f8, c1, c1, o1, o1))
def active_set_kernel(JT, S, c, e, lam2, lb, ub, d, z):
    """Write the bounded step d and its multiplier z; return the iterations, negative on failure."""
    n = S.shape[0]
    BT, A, G, r, g, residual = (
        np.empty((n, M)),
        np.empty((M, M)),
        np.empty((n, n)),
        np.empty(M),
        np.empty(max(n, M)),
        np.empty(M),
    )
    y, y_new, lo, hi, state = np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n, dtype=np.int64)
    weighted_task(JT, S, c, e, BT, r)
    y_bounds(S, c, lb, ub, lo, hi)
    if not least_norm(BT, r, lam2, A, z, y):
        y[:] = 0.0
    iterations = bounded_least_norm(BT, r, lam2, lo, hi, y, z, state, A, G, y_new, residual, g)
    write_step(S, c, y, state, lb, ub, d)
    return iterations


def active_set(step: StepProblem) -> NDArray[np.float64]:
    """Return the bounded step by the compiled active set.

    Parameters
    ----------
    step : StepProblem

    Returns
    -------
    (n,) ndarray
        In scaled joints, within the bounds.

    Raises
    ------
    KernelError
        If the method does not end: with lambda^2 > 0 a defect; with lambda^2 = 0 the exact task does
        not fit into the bounds.
    """
    d, z = np.empty(step.n), np.empty(M)
    iterations = active_set_kernel(step.JT, step.S, step.c, step.e, step.lam2, step.lb, step.ub, d, z)
    if iterations < 0:
        raise KernelError(f"active set did not end after {-iterations} iterations (lambda^2 = {step.lam2:.1e})")
    return d
