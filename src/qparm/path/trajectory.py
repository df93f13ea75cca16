"""The trajectory: joint motion over time as polynomials that can be called. Data, no planning."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from qparm.errors import InvalidInput
from qparm.path.joint_path import SegmentKind

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray
    from scipy.interpolate import PPoly

__all__ = ["TimedSegment", "Trajectory"]

# Beyond this a table of samples would not fit into memory.
_MOST_SAMPLES = 10_000_000
# Seconds between two boundaries of which one is no knot.
_LEAST_DISTANCE = 2e-6


@dataclass(frozen=True)
class TimedSegment:
    """A segment of the joint path with its times (s)."""

    kind: SegmentKind
    row: int
    start: float
    end: float

    @property
    def process_on(self) -> bool:
        """Whether the tool works on the surface."""
        return self.kind is SegmentKind.ROW

    @property
    def name(self) -> str:
        """The kind, and for rows the row's number: ``"row 3"``."""
        return f"row {self.row}" if self.kind is SegmentKind.ROW else self.kind.value


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Joint motion over time: ``trajectory(t, order)`` is position, velocity, acceleration or jerk.

    Attributes
    ----------
    joint_names : tuple of str
    polynomials : tuple of scipy.interpolate.PPoly
        One for each joint, each with its own breaks, from 0 to the duration.
    knots : (K,) ndarray
        Times at which the waypoints are passed (s), K = N.
    segments : tuple of TimedSegment
    timing : str
        ``"quintic"`` or ``"ruckig"``.
    executable : bool
        False if something must not be run as it is; ``reasons`` say what.
    reasons : tuple of str
    """

    joint_names: tuple[str, ...]
    polynomials: tuple[PPoly, ...]
    knots: NDArray[np.float64]
    segments: tuple[TimedSegment, ...]
    timing: str
    executable: bool
    reasons: tuple[str, ...]

    @property
    def duration(self) -> float:
        """Seconds."""
        return float(self.knots[-1])

    @cached_property
    def boundaries(self) -> NDArray[np.float64]:
        """Times between which every joint is one polynomial, the knots among them (s), in whole nanoseconds.

        With position, velocity and acceleration at these times a quintic interpolation gives the trajectory back.
        Boundaries that are no knots keep a distance of 2 us: any closer, rounding would make jerk of it.
        """
        knots = np.round(self.knots * 1e9) / 1e9
        inner = np.unique(np.concatenate([polynomial.x for polynomial in self.polynomials]))
        inner = np.round(inner[(inner > 0) & (inner < self.duration)] * 1e9) / 1e9
        at = np.searchsorted(knots, inner)
        after, before = knots[np.minimum(at, len(knots) - 1)], knots[np.maximum(at - 1, 0)]
        inner = inner[(np.abs(after - inner) > _LEAST_DISTANCE) & (np.abs(inner - before) > _LEAST_DISTANCE)]
        kept, last = [], -np.inf
        for time in inner.tolist():
            if time - last > _LEAST_DISTANCE:
                kept.append(time)
                last = time
        return np.union1d(knots, kept)

    def __call__(self, t: ArrayLike, order: int = 0) -> NDArray[np.float64]:
        """Return positions (order 0), velocities (1), accelerations (2) or jerks (3).

        Parameters
        ----------
        t : float or (k,) array_like
            Seconds from 0 to the duration.
        order : {0, 1, 2, 3}

        Returns
        -------
        (n,) or (k, n) ndarray
            m, rad and their derivatives. Where a derivative steps, the value after the step.

        Raises
        ------
        InvalidInput
            If a time is not finite or lies outside the trajectory.
        """
        if order not in (0, 1, 2, 3):
            raise InvalidInput(f"order must be 0, 1, 2 or 3, not {order!r}")
        t = np.asarray(t, dtype=float)
        if not np.isfinite(t).all():
            raise InvalidInput("a time is not finite")
        slack = 1e-9 * max(1.0, self.duration)
        if t.size and (t.min() < -slack or t.max() > self.duration + slack):
            raise InvalidInput(f"times must lie between 0 and {self.duration:.6f} s, not {t.min()} to {t.max()}")
        t = np.clip(t, 0.0, self.duration)
        values = [np.asarray(polynomial(t, nu=order), dtype=np.float64) for polynomial in self.polynomials]
        return np.asarray(np.stack(values, axis=-1), dtype=np.float64)

    def sample_times(self, period: float) -> NDArray[np.float64]:
        """Return the times of samples every ``period`` seconds, the end included."""
        if not (np.isfinite(period) and period > 0):
            raise InvalidInput(f"period must be finite and positive, not {period}")
        if self.duration / period > _MOST_SAMPLES:
            raise InvalidInput(
                f"{self.duration:.0f} s every {period:g} s are more than {_MOST_SAMPLES:,} samples;"
                " take a longer period"
            )
        count = int(np.floor(self.duration / period * (1 + 1e-12)))
        times = np.asarray(np.arange(count + 1) * period, dtype=np.float64)
        if times[-1] < self.duration - 1e-9:
            times = np.append(times, self.duration)
        else:
            times[-1] = self.duration
        return times

    def segment_at(self, t: ArrayLike) -> NDArray[np.int64]:
        """Return the index of the segment at each time; at a boundary, the one that starts there."""
        t = np.asarray(t, dtype=float)
        if not np.isfinite(t).all():
            raise InvalidInput("a time is not finite")
        starts = np.array([segment.start for segment in self.segments[1:]])
        return np.searchsorted(starts, t, side="right")
