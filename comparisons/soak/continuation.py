"""Continuation of many solutions along a row, to see whether it can be driven from end to end in small steps."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from comparisons.soak.kinematics import Cell

__all__ = ["follow"]


def follow(
    cell: Cell, first: int, last: int, *, starts: int = 400, steps: int = 8, seed: int = 0, noise: float = 0.0
) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.float64]]:
    """Return how far (points) each of many solutions at ``first`` gets, which arrive at ``last``, their largest steps.

    Least-norm continuation, all at once; ``noise`` moves the starts of every step.
    """
    rng = np.random.default_rng(seed)
    (a0, e0), (a1, _) = cell.point(np.array(first)), cell.point(np.array(last))
    p0, r0 = cell.nominal(a0, e0)
    cost, q = cell.ik(p0, r0, rng, starts=starts, iterations=200, every=True)
    q = q[cost < 1e-8]
    n = abs(last - first) * steps
    alive, got = np.ones(len(q), bool), np.zeros(len(q))
    worst = np.zeros(len(q))
    for k in range(1, n + 1):
        p, r = cell.nominal(a0 + (a1 - a0) * k / n, e0)
        if not alive.any():
            break
        start = q[alive] + (noise * rng.standard_normal(q[alive].shape) if noise else 0)
        cost, new = cell.ik(p, r, rng, q=np.clip(start, *cell.limits.T), iterations=40, every=True)
        step = np.abs((new - q[alive]) / np.where(cell.prismatic, 0.4, 1)).max(1)
        ok = (cost < 1e-8) & (step < 0.15)
        i = np.flatnonzero(alive)
        q[i[ok]], worst[i[ok]] = new[ok], np.maximum(worst[i[ok]], step[ok])
        got[i[ok]] = k / steps
        alive[i[~ok]] = False
    return got, alive, worst
