"""Interpolation as a controller does it: quintics between them, and the peaks they reach."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.verify.files import KnotTable

__all__ = ["derivative_peaks", "interval_peaks", "position_extremes", "positions_at"]

# Intervals at a time: what they take in memory stays in the cache.
_CHUNK = 2048
_VELOCITY_SAMPLES = 33
_SHORT = 1e-4  # s


def _coefficients(knots: KnotTable, which: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return coefficients (6, k, n), lowest power first, and durations (k, 1) of the quintics after given knots.

    In x = (t - t_k) / h and relative to the position at the knot, which keeps the digits of small steps.
    """
    q, v, a = knots.derivatives
    h = (knots.t[which + 1] - knots.t[which])[:, None]
    v0, v1, a0, a1 = v[which] * h, v[which + 1] * h, a[which] * h**2, a[which + 1] * h**2
    D = q[which + 1] - q[which] - v0 - 0.5 * a0
    E, F = v1 - v0 - a0, a1 - a0
    high = (10 * D - 4 * E + 0.5 * F, -15 * D + 7 * E - F, 6 * D - 3 * E + 0.5 * F)
    return np.stack([np.zeros_like(D), v0, 0.5 * a0, *high]), h


def _chunks(count: int) -> Iterator[NDArray[np.int64]]:
    for first in range(0, count, _CHUNK):
        yield np.arange(first, min(first + _CHUNK, count))


def derivative_peaks(knots: KnotTable) -> NDArray[np.float64]:
    """Return the largest absolute velocity, acceleration and jerk of each joint between the knots, (3, n)."""
    n = knots.derivatives.shape[2]
    return interval_peaks(knots).max(axis=1, initial=0.0) if len(knots.t) > 1 else np.zeros((3, n))


def interval_peaks(knots: KnotTable) -> NDArray[np.float64]:
    """Return the largest absolute velocity, acceleration and jerk of each joint on each interval, (3, K - 1, n).

    Jerk and acceleration at their extremes, in closed form; velocity at 33 points of every interval. On intervals
    shorter than 0.1 ms the jerk is the mean, from the accelerations at their ends: of the last digit of a position
    a third derivative over so short a time makes whole limits.
    """
    n = knots.derivatives.shape[2]
    peaks = np.zeros((3, max(len(knots.t) - 1, 0), n))
    x = np.linspace(0.0, 1.0, _VELOCITY_SAMPLES)
    for which in _chunks(len(knots.t) - 1):
        c, h = _coefficients(knots, which)
        velocity = np.einsum("pi,ikn->pkn", np.stack([m * x ** (m - 1) for m in range(1, 6)], axis=1), c[1:])
        j0, j1, j2 = 6 * c[3], 24 * c[4], 60 * c[5]
        with np.errstate(divide="ignore", invalid="ignore"):
            vertex = np.where(j2 != 0, -0.5 * j1 / j2, 0.0)
            root = np.sqrt(j1**2 - 4 * j2 * j0)
            at_extreme = [
                np.zeros_like(j0),
                np.ones_like(j0),
                (-j1 + root) / (2 * j2),
                (-j1 - root) / (2 * j2),
                -j0 / j1,
            ]
        jerk = np.maximum(np.abs(j0), np.abs(j0 + j1 + j2))
        inner = (vertex > 0) & (vertex < 1)
        jerk = np.where(inner, np.maximum(jerk, np.abs(j0 + j1 * vertex + j2 * vertex**2)), jerk)
        jerk = np.where(h < _SHORT, np.abs(j0 + j1 / 2 + j2 / 3), jerk)
        acceleration = np.zeros_like(j0)
        for point in at_extreme:
            point = np.where((point >= 0) & (point <= 1), point, 0.0)
            value = 2 * c[2] + point * (j0 + point * (j1 / 2 + point * j2 / 3))
            acceleration = np.maximum(acceleration, np.abs(value))
        for order, values in enumerate((np.abs(velocity).max(axis=0) / h, acceleration / h**2, jerk / h**3)):
            peaks[order, which] = values
    return peaks


def position_extremes(knots: KnotTable) -> NDArray[np.float64]:
    """Return the least and the largest position of each joint, between the knots too, (2, n).

    At 33 points of every interval, and from the outermost one on by a step of Newton's method on the velocity.
    """
    n = knots.derivatives.shape[2]
    least, largest = np.full(n, np.inf), np.full(n, -np.inf)
    x = np.linspace(0.0, 1.0, _VELOCITY_SAMPLES)
    powers = np.stack([x**m for m in range(6)], axis=1)
    for which in _chunks(max(len(knots.t) - 1, 0)):
        c, _ = _coefficients(knots, which)
        values = np.einsum("pi,ikn->pkn", powers, c)
        for side in (-1.0, 1.0):
            at = x[(side * values).argmax(axis=0)]
            v = c[1] + at * (2 * c[2] + at * (3 * c[3] + at * (4 * c[4] + at * 5 * c[5])))
            a = 2 * c[2] + at * (6 * c[3] + at * (12 * c[4] + at * 20 * c[5]))
            with np.errstate(divide="ignore", invalid="ignore"):
                step = np.where(side * a < 0, -v / a, 0.0)
            near = np.clip(at + np.clip(np.nan_to_num(step), -1 / 32, 1 / 32), 0.0, 1.0)
            beside = near * (c[1] + near * (c[2] + near * (c[3] + near * (c[4] + near * c[5]))))
            outermost = np.maximum(side * beside, (side * values).max(axis=0)) * side + knots.derivatives[0][which]
            least, largest = np.minimum(least, outermost.min(axis=0)), np.maximum(largest, outermost.max(axis=0))
    return np.stack(
        [np.minimum(least, knots.derivatives[0].min(axis=0)), np.maximum(largest, knots.derivatives[0].max(axis=0))]
    )


def positions_at(knots: KnotTable, t: NDArray[np.float64], *, order: int = 0) -> NDArray[np.float64]:
    """Return the interpolated positions, or with order 1 the velocities, at times within the knots, (T, n)."""
    if len(knots.t) < 2:
        return np.repeat(knots.derivatives[order], len(t), axis=0)
    values = np.empty((len(t), knots.derivatives.shape[2]))
    for part in _chunks(len(t)):
        which = np.clip(np.searchsorted(knots.t, t[part], side="right") - 1, 0, len(knots.t) - 2)
        c, h = _coefficients(knots, which)
        x = (t[part] - knots.t[which])[:, None] / h
        if order:
            values[part] = (c[1] + x * (2 * c[2] + x * (3 * c[3] + x * (4 * c[4] + x * 5 * c[5])))) / h
            continue
        value = c[5]
        for m in range(4, 0, -1):
            value = value * x + c[m]
        values[part] = knots.derivatives[0][which] + x * value
    return values
