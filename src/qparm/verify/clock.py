"""The times of a file: whether they are a grid, and how exact they are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from qparm.verify.finding import Finding

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.verify.motion import MotionTable

__all__ = ["Clock", "read_clock"]

# How far a time may be off the grid (s), and the share of intervals that make one.
_GRID, _MOST = 1e-9, 0.9
_SAME = 1e-12


@dataclass(frozen=True, eq=False)
class Clock:
    """The times of a motion.

    Attributes
    ----------
    t : (T,) ndarray
        s, without the file's rounding where they are a grid.
    rounding : (T,) ndarray
        How far each may be off (s).
    period : float
        Of the grid (s); NaN if there is none: the samples are then points at times of their own.
    findings : tuple of Finding
    """

    t: NDArray[np.float64]
    rounding: NDArray[np.float64]
    period: float
    findings: tuple[Finding, ...]

    @property
    def sampled(self) -> bool:
        """Whether the times are a grid."""
        return not np.isnan(self.period)


def read_clock(table: MotionTable) -> Clock:
    """Return the times of a file; the last interval of a grid may be shorter than its period.

    Where nine of ten intervals are alike, every one has to be. The segments of a program may have steps of their own:
    there an interval has to be like the one before or after it, but next to a stop.
    """
    t, rounding = table.t, np.full(len(table.t), table.time_rounding)
    dt = np.diff(t)
    if len(t) < 5:
        return Clock(t, rounding, float("nan"), ())
    period, allowed = float(np.median(dt)), 2 * table.time_rounding + _GRID
    off = np.abs(dt - period) > allowed
    off[-1] = dt[-1] > period + allowed
    expected = np.full(len(dt), period)
    if table.stops is not None and off.any():
        odd, expected = _odd_steps(dt, table.stops, allowed)
        if not odd.any() or odd.mean() > 1 - _MOST:
            return Clock(t, rounding, float("nan"), ())
        off, period = odd, float("nan")
    elif off.mean() > 1 - _MOST:
        return Clock(t, rounding, float("nan"), ())
    if off.any():
        at = np.flatnonzero(off)
        worst = at[np.abs(dt - expected)[at].argmax()]
        wrong = Finding(
            "time-grid", "time", "interval between samples", "", float(t[at[0]]), float(dt[worst]),
            float(expected[worst]), "s",
            int(off.sum()),
        )  # fmt: skip
        return Clock(t, rounding, period, (wrong,))
    # the mean of all is free of rounding
    period = float((t[-2] - t[0]) / (len(t) - 2))
    grid = t[0] + period * np.arange(len(t))
    exact = np.abs(grid - t) <= _SAME * max(1.0, float(t[-1]))
    return Clock(np.where(exact, grid, t), np.where(exact, 0.0, rounding), period, ())


def _odd_steps(
    dt: NDArray[np.float64], stops: NDArray[np.int64], allowed: float
) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """Return which steps of a program are like neither neighbour, away from stops, and what each should be like."""
    # a stop is a sample: the steps before and after it
    near = np.zeros(len(dt), dtype=bool)
    near[np.clip(np.concatenate([stops - 1, stops]), 0, len(dt) - 1)] = True
    before, after = np.concatenate([dt[:1], dt[:-1]]), np.concatenate([dt[1:], dt[-1:]])
    # both have been rounded
    odd = (np.abs(dt - before) > 2 * allowed) & (np.abs(dt - after) > 2 * allowed) & ~near
    return odd, before
