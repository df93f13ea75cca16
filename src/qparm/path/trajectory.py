"""The trajectory: joint motion over time as polynomials that can be called. Data, no planning."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from numbers import Integral, Real
from typing import TYPE_CHECKING

import numpy as np

from qparm.errors import InvalidInput
from qparm.names import wrong_joint_names
from qparm.path.joint_path import SegmentKind

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray
    from scipy.interpolate import PPoly

    from qparm.path.joint_path import JointPath
    from qparm.path.tool_path import ToolPath
    from qparm.path.trajectory_report import RotationError, TrajectoryReport
    from qparm.robot import MotionLimits, SerialChain

__all__ = ["TimedSegment", "Trajectory"]

# Beyond this a table of samples would not fit into memory.
_MOST_SAMPLES = 3_000_000
# Seconds between two boundaries of which one is no knot.
_LEAST_DISTANCE = 2e-6
# Beyond this, slower or faster, the fifth powers of a scaled motion's times would lose its digits.
_MOST_SCALED = 1e6
# States meet to this (m, rad and their derivatives).
_JOINED = 1e-6


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

    def __post_init__(self) -> None:
        wrong = wrong_joint_names(self.joint_names)
        if wrong:
            raise InvalidInput(wrong)

    def __repr__(self) -> str:
        verdict = "executable" if self.executable else "NOT executable"
        joints, segments = len(self.joint_names), len(self.segments)
        return f"Trajectory({self.duration:.6g} s of {joints} joints, {segments} segments, {self.timing}, {verdict})"

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
            If a time is not a number, not finite or outside the trajectory, or there is no such order.
        """
        if not isinstance(order, Integral) or order not in (0, 1, 2, 3):
            raise InvalidInput(f"order must be 0, 1, 2 or 3, not {order!r}")
        t = _times(t)
        slack = 1e-9 * max(1.0, self.duration)
        if t.size and (t.min() < -slack or t.max() > self.duration + slack):
            raise InvalidInput(f"times must lie between 0 and {self.duration:.6f} s, not {t.min()} to {t.max()}")
        t = np.clip(t, 0.0, self.duration)
        values = [np.asarray(polynomial(t, nu=order), dtype=np.float64) for polynomial in self.polynomials]
        return np.asarray(np.stack(values, axis=-1), dtype=np.float64)

    def sample(self, period: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return samples every ``period`` seconds, the end included.

        Returns
        -------
        t : (T,) ndarray
            s.
        derivatives : (4, T, n) ndarray
            Position, velocity, acceleration, jerk (m, rad and their derivatives).
        """
        t = self.sample_times(period)
        return t, np.stack([self(t, order) for order in range(4)])

    def scaled(self, factor: float) -> Trajectory:
        """Return the same motion in ``factor`` times the time: above 1 slower.

        Velocities, accelerations and jerks become those given over the factor, its square and its cube. A faster motion
        is not executable: nobody has found that it keeps its limits.

        Raises
        ------
        InvalidInput
            If the factor is not between 1e-6 and 1e6: time does not run backwards.
        """
        from scipy.interpolate import PPoly

        if not isinstance(factor, Real):
            raise InvalidInput(f"the factor must be a number, not {factor!r}")
        factor = float(factor)
        if not (np.isfinite(factor) and factor > 0):
            raise InvalidInput(f"the factor must be finite and positive, not {factor}")
        if not 1 / _MOST_SCALED <= factor <= _MOST_SCALED:
            raise InvalidInput(f"the factor must be between {1 / _MOST_SCALED:g} and {_MOST_SCALED:g}, not {factor:g}")
        polynomials = []
        for polynomial in self.polynomials:
            powers = factor ** -np.arange(polynomial.c.shape[0] - 1.0, -1.0, -1.0)
            polynomials.append(PPoly(polynomial.c * powers[:, None], polynomial.x * factor))
        segments = tuple(replace(s, start=s.start * factor, end=s.end * factor) for s in self.segments)
        faster = (f"made {1 / factor:.6g} times as fast: its limits have not been verified anew",) * (factor < 1)
        return replace(
            self,
            polynomials=tuple(polynomials),
            knots=self.knots * factor,
            segments=segments,
            executable=self.executable and not faster,
            reasons=self.reasons + faster,
        )

    def then(self, other: Trajectory) -> Trajectory:
        """Return this trajectory followed by another that starts in the state in which this one ends.

        Raises
        ------
        InvalidInput
            If the joints differ, or positions, velocities or accelerations do not meet.
        """
        from scipy.interpolate import PPoly

        if self.joint_names != other.joint_names:
            raise InvalidInput("the two trajectories are of different joints")
        for order, name in enumerate(("positions", "velocities", "accelerations")):
            step = np.abs(self(self.duration, order) - other(0.0, order))
            if step.max() > _JOINED:
                joint = self.joint_names[int(step.argmax())]
                raise InvalidInput(f"the {name} do not meet: joint {joint!r} differs by {step.max():.3g}")
        polynomials = []
        for a, b in zip(self.polynomials, other.polynomials, strict=True):
            rows = max(a.c.shape[0], b.c.shape[0])
            parts = [np.pad(p.c, ((rows - p.c.shape[0], 0), (0, 0))) for p in (a, b)]
            polynomials.append(PPoly(np.concatenate(parts, axis=1), np.append(a.x, a.x[-1] + b.x[1:])))
        shift = self.duration
        later = tuple(replace(s, start=s.start + shift, end=s.end + shift) for s in other.segments)
        return replace(
            self,
            polynomials=tuple(polynomials),
            knots=np.append(self.knots, shift + other.knots[1:]),
            segments=self.segments + later,
            timing=self.timing if self.timing == other.timing else f"{self.timing}, {other.timing}",
            executable=self.executable and other.executable,
            reasons=self.reasons + other.reasons,
        )

    def verify(
        self,
        limits: MotionLimits,
        *,
        path: JointPath | None = None,
        chain: SerialChain | None = None,
        tool_path: ToolPath | None = None,
        feed: float | None = None,
        rotation_error: RotationError | None = None,
    ) -> TrajectoryReport:
        """Return quality figures of the motion, differentiated anew from its positions.

        Parameters
        ----------
        limits : MotionLimits
        path : JointPath, optional
            Whose waypoints are to be passed, at the knots.
        chain, tool_path : optional
            With the path: how far the tool is off the tool path on rows and transitions.
        feed : float, optional
            With these: the speed that the tool should keep on rows (m/s).
        rotation_error : callable, optional
            With these: by how much tool rotations (N, 3, 3) miss those of the path (N, 3, 3), (N,), rad; by default
            the angle between them. A tool that may spin or tilt is judged otherwise.
        """
        from qparm.path.trajectory_report import verify_trajectory

        return verify_trajectory(
            self, limits, path=path, chain=chain, tool_path=tool_path, feed=feed, rotation_error=rotation_error
        )

    @property
    def piece_count(self) -> int:
        """How many polynomials the joints have together."""
        return sum(polynomial.c.shape[1] for polynomial in self.polynomials)

    def sample_times(self, period: float) -> NDArray[np.float64]:
        """Return the times of samples every ``period`` seconds, the end included."""
        if not isinstance(period, Real):
            raise InvalidInput(f"period must be a number of seconds, not {period!r}")
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
        t = _times(t)
        starts = np.array([segment.start for segment in self.segments[1:]])
        return np.searchsorted(starts, t, side="right")


def _times(t: ArrayLike) -> NDArray[np.float64]:
    """Return times as an array, refused where they are no finite numbers."""
    try:
        times = np.asarray(t)
    except ValueError:
        raise InvalidInput("times must be a number of seconds or a list of such") from None
    if times.size and times.dtype.kind not in "iuf":
        raise InvalidInput(f"times must be a number of seconds or a list of such, not {t!r}")
    times = times.astype(np.float64)
    if not np.isfinite(times).all():
        raise InvalidInput("a time is not finite")
    return times
