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
        Of the grid (s); NaN if there is none: the samples are then the ends of polynomials.
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

    Where nine of ten intervals are alike, every one has to be.
    """
    t, rounding = table.t, np.full(len(table.t), table.time_rounding)
    dt = np.diff(t)
    if len(t) < 5:
        return Clock(t, rounding, float("nan"), ())
    period, allowed = float(np.median(dt)), 2 * table.time_rounding + _GRID
    off = np.abs(dt - period) > allowed
    off[-1] = dt[-1] > period + allowed
    if off.mean() > 1 - _MOST:
        return Clock(t, rounding, float("nan"), ())
    if off.any():
        at = np.flatnonzero(off)
        worst = at[np.abs(dt[at] - period).argmax()]
        wrong = Finding(
            "time-grid", "time", "interval between samples", "", float(t[at[0]]), float(dt[worst]), period, "s",
            int(off.sum()),
        )  # fmt: skip
        return Clock(t, rounding, period, (wrong,))
    # the mean of all is free of rounding
    period = float((t[-2] - t[0]) / (len(t) - 2))
    grid = t[0] + period * np.arange(len(t))
    exact = np.abs(grid - t) <= _SAME * max(1.0, float(t[-1]))
    return Clock(np.where(exact, grid, t), np.where(exact, 0.0, rounding), period, ())
