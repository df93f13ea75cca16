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
    y = np.clip((guess.astype(L) - c) / np.where(movable, S, 1), lo, hi)
    y[~movable] = 0
    state = np.where(~movable, 2, np.where(y <= lo, -1, np.where(y >= hi, 1, 0)))
    for _ in range(200):
        wanted, z = _face_optimum(B, r, lam2, y, state == 0)
        blocked = (state == 0) & ((wanted < lo) | (wanted > hi))
        if blocked.any():
            # towards the optimum of the face until the first free joint meets a bound
            bound = np.where(wanted < lo, lo, hi)
            share = np.where(blocked, (bound - y) / np.where(blocked, wanted - y, 1), np.inf)
            k = int(share.argmin())
            y = np.where(state == 0, y + share[k] * (wanted - y), y)
            y[k], state[k] = bound[k], -1 if wanted[k] < lo[k] else 1
            continue
        y = wanted
        target = np.clip(B.T @ z, lo, hi)
        # z is a residual over lambda^2: its digits end where those of the residual's terms do
        rounding = L(1e-18) * (np.abs(r).max() + (np.abs(B) @ np.abs(y)).max()) / lam2
        off = np.where(state == 2, 0, np.abs(target - y))
        if (off <= 1e-13 + rounding).all():
            return np.asarray(c + S * y, dtype=L)
        state[int(np.where(np.abs(state) == 1, off, 0).argmax())] = 0
    return None


def _face_optimum(
    B: np.ndarray, r: np.ndarray, lam2: np.longdouble, y: np.ndarray, free: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the optimum over the free joints, the others held, and the multiplier of the task."""
    wanted = y.copy()
    rest = r - B[:, ~free] @ y[~free] if (~free).any() else r
    F = B[:, free]
    if free.sum() >= 6:
        z = _solve(F @ F.T + lam2 * np.eye(6, dtype=L), rest)
        wanted[free] = F.T @ z
        return wanted, z
    if free.any():
        normal = F.T @ F + lam2 * np.eye(int(free.sum()), dtype=L)
        wanted[free] = 0
        for _ in range(3):  # the solution, then refined against the residual before squaring
            wanted[free] += _solve(normal, F.T @ (rest - F @ wanted[free]) - lam2 * wanted[free])
    return wanted, (rest - F @ wanted[free]) / lam2
