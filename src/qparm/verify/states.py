"""Limits from states: the least jerk that any motion needs which passes through two of them.

Between two states the jerk u, in units of the interval, has three known moments: m0 = ∫ u, m1 = ∫ x u, m2 = ∫ x² u
over x in [0, 1]. For every polynomial p of degree two |∫ p u| <= max |u| ∫ |p|, so max |u| is at least
|p0 m0 + p1 m1 + p2 m2| / ∫ |p|, and the best p gives the least possible largest jerk. A bound that is beyond the limit
proves that no motion within it passes through the states: a limit is exceeded, or they do not belong together.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.verify.clock import Clock

__all__ = ["LeastJerk", "least_jerk_shares"]

_CHUNK, _PAIRS = 65_536, 4096
# Places of the roots of p, and of the integrals of |p|.
_ROOTS, _FINE = np.linspace(0.0, 1.0, 21), 2000


@dataclass(frozen=True, eq=False)
class LeastJerk:
    """The least largest jerk over its limit.

    Attributes
    ----------
    share, time : (n,) ndarray
    first : (n,) ndarray
        Where it is first beyond the limit (s), NaN if nowhere.
    count : (n,) ndarray of int
    """

    share: NDArray[np.float64]
    time: NDArray[np.float64]
    first: NDArray[np.float64]
    count: NDArray[np.int64]


@cache
def _polynomials() -> NDArray[np.float64]:
    """Return coefficients (P, 3) of the polynomials p, lowest power first, each with ∫ |p| = 1."""
    found = [(1.0, 0.0, 0.0)]
    for k, a in enumerate(_ROOTS):
        found.append((-a, 1.0, 0.0))
        found += [(a * b, -a - b, 1.0) for b in _ROOTS[k:]]
    table = np.array(found)
    x = (np.arange(_FINE) + 0.5) / _FINE
    size = np.abs(table @ np.stack([np.ones(_FINE), x, x**2])).mean(axis=1)
    return table / size[:, None]


def least_jerk_shares(
    clock: Clock,
    states: NDArray[np.float64],
    rounding: NDArray[np.float64],
    velocity: NDArray[np.float64],
    jerk: NDArray[np.float64],
    *,
    slack: float,
) -> LeastJerk:
    """Return what jerk the states of a file need at least, over the limit.

    Parameters
    ----------
    clock : Clock
    states : (3, T, n) ndarray
        Position, velocity, acceleration.
    rounding : (3, n) ndarray
    velocity, jerk : (n,) ndarray
        Limits; the first tells what a rounded time may hide.
    slack : float
        Share over 1 that counts as kept.
    """
    n = states.shape[2]
    share, time, first = np.zeros(n), np.zeros(n), np.full(n, np.nan)
    count = np.zeros(n, dtype=np.int64)
    for start in range(0, len(clock.t) - 1, _CHUNK):
        part = slice(start, start + _CHUNK + 1)
        q, v, a = states[:, part]
        h = np.diff(clock.t[part])[:, None]
        late = clock.rounding[part]
        blur = velocity * (late[1:] + late[:-1])[:, None]
        parts = (
            h**2 * np.diff(a, axis=0),
            h * np.diff(v, axis=0) - h**2 * a[:-1],
            np.diff(q, axis=0) - h * v[:-1] - 0.5 * h**2 * a[:-1],
        )
        noise = (
            2 * h**2 * rounding[2],
            2 * h * rounding[1] + h**2 * rounding[2],
            2 * rounding[0] + blur + h * rounding[1] + 0.5 * h**2 * rounding[2],
        )
        bound = (np.abs(parts[0]) - noise[0]) / (h**3 * jerk)
        # the quintic between the states keeps the limit nearly everywhere: then there is such a motion
        rows, joints = np.nonzero(_quintic_jerk(*parts) > (h**3 * jerk) * (1 - slack))
        for k in range(0, len(rows), _PAIRS):
            row, joint = rows[k : k + _PAIRS], joints[k : k + _PAIRS]
            values = [x[row, joint] for x in parts]
            errors = [np.broadcast_to(x, parts[0].shape)[row, joint] for x in noise]
            bound[row, joint] = _least(values, errors) / (h[row, 0] ** 3 * jerk[joint])
        at = bound.argmax(axis=0)
        largest, middle = bound[at, np.arange(n)], 0.5 * (clock.t[part][1:] + clock.t[part][:-1])
        better = largest > share
        share[better], time[better] = largest[better], middle[at[better]]
        beyond = bound > 1 + slack
        count += beyond.sum(axis=0)
        first = np.fmin(first, np.where(beyond.any(axis=0), middle[beyond.argmax(axis=0)], np.nan))
    return LeastJerk(share, time, first, count)


def _quintic_jerk(A: NDArray[np.float64], B: NDArray[np.float64], C: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the largest jerk of the quintic, in units of the interval, of what the position, ... are short of."""
    c3, c4, c5 = 10 * C - 4 * B + 0.5 * A, -15 * C + 7 * B - A, 6 * C - 3 * B + 0.5 * A
    j0, j1, j2 = 6 * c3, 24 * c4, 60 * c5
    with np.errstate(divide="ignore", invalid="ignore"):
        x = np.where(j2 != 0, -0.5 * j1 / j2, 0.0)
    x = np.clip(np.nan_to_num(x), 0.0, 1.0)
    return np.maximum(np.maximum(np.abs(j0), np.abs(j0 + j1 + j2)), np.abs(j0 + x * (j1 + x * j2)))


def _least(values: list[NDArray[np.float64]], errors: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Return the best bound over all polynomials, (k,), of k triples."""
    p0, p1, p2 = _polynomials().T
    # the moments are m0 = A, m1 = A - B, m2 = 2 C + A - 2 B
    weights = np.stack([p0 + p1 + p2, -p1 - 2 * p2, 2 * p2])
    proved = np.abs(np.stack(values, axis=1) @ weights) - np.stack(errors, axis=1) @ np.abs(weights)
    return proved.max(axis=1)
