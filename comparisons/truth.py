"""The true bounded step: an active set solved in extended precision, its KKT conditions checked.

Independent of the package's solvers but for the first guess of the active set, which does not matter: the
answer is accepted only if it satisfies the KKT conditions of the problem to 1e-13 in 80-bit arithmetic.
"""

from __future__ import annotations

import numpy as np

from qparm.ik import StepProblem

__all__ = ["true_step"]

L = np.longdouble


def _solve(A: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Solve A x = b in extended precision by Gaussian elimination with partial pivoting."""
    A, b = A.copy(), b.copy()
    n = len(b)
    for k in range(n):
        p = k + int(np.abs(A[k:, k]).argmax())
        if p != k:
            A[[k, p]], b[[k, p]] = A[[p, k]], b[[p, k]]
        factors = A[k + 1 :, k] / A[k, k]
        A[k + 1 :] -= factors[:, None] * A[k]
        b[k + 1 :] -= factors * b[k]
    x = np.empty(n, dtype=L)
    for k in range(n - 1, -1, -1):
        x[k] = (b[k] - A[k, k + 1 :] @ x[k + 1 :]) / A[k, k]
    return x


def true_step(step: StepProblem, guess: np.ndarray) -> np.ndarray | None:
    """Return the bounded step to extended precision, None if no active set satisfied the KKT conditions.

    Parameters
    ----------
    step : StepProblem
    guess : (n,) ndarray
        A step whose joints at their bounds are the first guess of the active set.
    """
    J, S, c, e = (np.asarray(x, dtype=L) for x in (step.J, step.S, step.c, step.e))
    lam2 = L(step.lam2)
    B, r = J * S, e - J @ c
    movable = step.S > 0
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        lo = np.where(movable, (step.lb.astype(L) - c) / np.where(movable, S, 1), -np.inf)
        hi = np.where(movable, (step.ub.astype(L) - c) / np.where(movable, S, 1), np.inf)
    states = [np.where(guess <= step.lb, -1, np.where(guess >= step.ub, 1, 0))]
    rng = np.random.default_rng(0)  # the flips below may cycle; then they start from another set
    states += [rng.integers(-1, 2, step.n) for _ in range(20)]
    for state in states:
        y = _from_active_set(B, r, lam2, lo, hi, np.where(movable, state, 2))
        if y is not None:
            return np.asarray(c + S * y, dtype=L)
    return None


def _from_active_set(
    B: np.ndarray, r: np.ndarray, lam2: np.longdouble, lo: np.ndarray, hi: np.ndarray, state: np.ndarray
) -> np.ndarray | None:
    """Return the optimum y, changing the working set one joint at a time; None if that does not end."""
    y, z = np.zeros(B.shape[1], dtype=L), np.zeros(6, dtype=L)
    for _ in range(60):
        free = state == 0
        y[:] = np.where(state == -1, lo, np.where(state == 1, hi, 0))
        rest = r - B[:, ~free] @ y[~free] if (~free).any() else r
        F = B[:, free]
        if free.sum() >= 6:
            z = _solve(F @ F.T + lam2 * np.eye(6, dtype=L), rest)
            y[free] = F.T @ z
        else:
            if free.any():
                normal = F.T @ F + lam2 * np.eye(int(free.sum()), dtype=L)
                for _ in range(3):  # the solution, then refined against the residual before squaring
                    y[free] += _solve(normal, F.T @ (rest - F @ y[free]) - lam2 * y[free])
            z = (rest - F @ y[free]) / lam2
        wanted = np.clip(B.T @ z, lo, hi)
        rounding = L(1e-18) * np.abs(z).max()  # B^T z cancels from the size of z
        if (np.abs(wanted - y) <= 1e-13 + rounding).all():
            return y
        # let go the worst bound that is not wanted, or bind the worst free joint outside
        off = np.where(free, np.maximum(lo - y, y - hi), np.abs(wanted - y))
        off = np.where(state == 2, 0, off)
        k = int(off.argmax())
        state[k] = 0 if not free[k] else (-1 if y[k] < lo[k] else 1)
    return None
