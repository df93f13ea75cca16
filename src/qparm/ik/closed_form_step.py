"""The step in closed form: eqs. 2, 3 and 4 of the paper as one formula.

    d = c + S y,   y = (J S)^T z,   (J S^2 J^T + lambda^2 I) z = e - J c

The 6 x 6 system is solved, never the n x n one: with lambda^2 = 1e-12 its answer is right to
1e-15 where the other's is right to 1e-5.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from qparm.compiled.kernels import c1, c2, f8, i8, kernel, kernel_helper, o1
from qparm.errors import InvalidInput

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.ik.step import StepProblem

__all__ = ["closed_form"]

M = 6  # task rows


@kernel_helper
def cholesky(A, size):
    """Factor the leading block of A in place (lower triangle); return False if it is not positive definite."""
    for j in range(size):
        s = A[j, j]
        for k in range(j):
            s -= A[j, k] * A[j, k]
        if not s > 0.0:
            return False
        s = math.sqrt(s)
        A[j, j] = s
        inverse = 1.0 / s
        for i in range(j + 1, size):
            t = A[i, j]
            for k in range(j):
                t -= A[i, k] * A[j, k]
            A[i, j] = t * inverse
    return True


@kernel_helper
def cholesky_solve(A, size, x):
    """Solve A A^T x = x in place for the factor in the lower triangle of A."""
    for i in range(size):
        t = x[i]
        for k in range(i):
            t -= A[i, k] * x[k]
        x[i] = t / A[i, i]
    for i in range(size - 1, -1, -1):
        t = x[i]
        for k in range(i + 1, size):
            t -= A[k, i] * x[k]
        x[i] = t / A[i, i]


@kernel_helper
def weighted_task(JT, S, c, e, BT, r):
    """Write B^T = (J S)^T and r = e - J c."""
    for k in range(M):
        r[k] = e[k]
    for i in range(S.shape[0]):
        s = S[i]
        for k in range(M):
            BT[i, k] = JT[i, k] * s
        if c[i] != 0.0:
            for k in range(M):
                r[k] -= JT[i, k] * c[i]


@kernel_helper
def least_norm(BT, r, lam2, A, z, y):
    """Write z and y = B^T z of the unbounded step; return False where B B^T + lambda^2 I is singular."""
    for a in range(M):
        for b in range(a + 1):
            A[a, b] = 0.0
        A[a, a] = lam2
    for i in range(BT.shape[0]):
        for a in range(M):
            t = BT[i, a]
            for b in range(a + 1):
                A[a, b] += t * BT[i, b]
    if not cholesky(A, M):
        return False
    for k in range(M):
        z[k] = r[k]
    cholesky_solve(A, M, z)
    for i in range(BT.shape[0]):
        t = 0.0
        for k in range(M):
            t += BT[i, k] * z[k]
        y[i] = t
    return True


@kernel(i8(c2, c1, c1, c1, f8, o1, o1))
def closed_form_kernel(JT, S, c, e, lam2, d, z):
    """Write the unbounded step d and its multiplier z; return 1, or 0 if the system is singular."""
    n = S.shape[0]
    BT, A, r, y = np.empty((n, M)), np.empty((M, M)), np.empty(M), np.empty(n)
    weighted_task(JT, S, c, e, BT, r)
    if not least_norm(BT, r, lam2, A, z, y):
        return 0
    for i in range(n):
        d[i] = c[i] + S[i] * y[i]
    return 1


def closed_form(step: StepProblem) -> NDArray[np.float64]:
    """Return the step without its bounds, d = c + S (J S)^T (J S^2 J^T + lambda^2 I)^-1 (e - J c).

    It is the bounded step too wherever it lies within the bounds, the problem being strictly convex.

    Parameters
    ----------
    step : StepProblem

    Returns
    -------
    (n,) ndarray
        In scaled joints.

    Raises
    ------
    InvalidInput
        If lambda^2 = 0 and the weighted Jacobian has not full row rank.

    References
    ----------
    Sun et al., Micromachines 2023, 14, 886, eqs. 2 to 4.
    """
    d, z = np.empty(step.n), np.empty(M)
    if not closed_form_kernel(step.JT, step.S, step.c, step.e, step.lam2, d, z):
        raise InvalidInput("the weighted Jacobian has not full row rank: an exact task needs lambda^2 > 0")
    return d
