"""The step without slack rows, and the step proved from the active set that a solver found for it.

    min  1/2 |J S y - r|^2 + 1/2 lambda^2 |y|^2     s.t.  lb - c <= S y <= ub - c,      r = e - J c

in the units of the slack form. Its Hessian is as flat as lambda^2 in the null space, so a first-order solver's y is
off there whatever it claims. Its active set mostly is not, and that is all that is kept: the optimum with these
joints at their bounds is one linear solve, and the KKT check proves it or refuses it.
"""

from __future__ import annotations

import math

import numpy as np

from qparm.compiled.kernels import c1, c2, f8, i8, kernel, o1, o2
from qparm.ik.active_set_step import IMMOVABLE, free_step, write_step, y_bounds
from qparm.ik.closed_form_step import M, weighted_task
from qparm.ik.kkt import optimality
from qparm.ik.solvers.slack_form import unit_of_task

__all__ = ["face_step_kernel", "normal_form_kernel"]


@kernel(f8(c2, c1, c1, c1, f8, c1, c1, f8, o2, o1, o1, o1))
def normal_form_kernel(JT, S, c, e, lam2, lb, ub, infinity, H, g, lo, hi):
    """Write the Hessian, the gradient at zero and the bounds of y; return the unit they are in."""
    n = S.shape[0]
    BT, r = np.empty((n, M)), np.empty(M)
    weighted_task(JT, S, c, e, BT, r)
    unit = unit_of_task(r)
    y_bounds(S, c, lb, ub, lo, hi)
    for i in range(n):
        t = 0.0
        for k in range(M):
            t -= BT[i, k] * r[k]
        g[i] = t / unit
        for j in range(i + 1):
            t = lam2 if i == j else 0.0
            for k in range(M):
                t += BT[i, k] * BT[j, k]
            H[i, j] = H[j, i] = t
        lo[i] = min(max(lo[i] / unit, -infinity), infinity)
        hi[i] = min(max(hi[i] / unit, -infinity), infinity)
    return unit


@kernel(i8(c2, c1, c1, c1, f8, c1, c1, c1, c1, f8, o1, o1, o1))
def face_step_kernel(JT, S, c, e, lam2, lb, ub, x, multipliers, unit, d, z, out):
    """Write the optimum d on the face that a solver's x and bound multipliers name, its z and its KKT residuals.

    A joint is at a bound where x + multiplier lies beyond it. Return 0 where the face has no optimum of its own.
    """
    n = S.shape[0]
    BT, A, G, r, g = np.empty((n, M)), np.empty((M, M)), np.empty((n, n)), np.empty(M), np.empty(max(n, M))
    y, y_new, lo, hi, residual = np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(M)
    state = np.empty(n, dtype=np.int64)
    weighted_task(JT, S, c, e, BT, r)
    y_bounds(S, c, lb, ub, lo, hi)
    for i in range(n):
        reach = (x[i] + multipliers[i]) * unit
        state[i], y[i] = 0, 0.0
        if not S[i] > 1e-150:
            state[i] = IMMOVABLE
        elif reach <= lo[i] or lo[i] == hi[i]:
            state[i], y[i] = -1, lo[i]
        elif reach >= hi[i]:
            state[i], y[i] = 1, hi[i]
    if not free_step(BT, r, lam2, state, y, A, G, z, y_new, residual, g):
        out[:] = math.inf
        return 0
    write_step(S, c, y_new, state, lb, ub, d)
    optimality(BT, r, S, c, lam2, lb, ub, lo, hi, d, z, out)
    return 1
