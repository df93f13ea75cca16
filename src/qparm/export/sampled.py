"""A trajectory at the times that a format wants: its knots, a period, ticks of a servo, or steps of a program."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from qparm.errors import InvalidInput

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from qparm.path import Trajectory

__all__ = ["SampledTrajectory", "at_knots", "at_period", "at_steps", "at_ticks"]

# Share of a joint's largest velocity or acceleration below which it rests.
_REST = 1e-6
# A duration is a whole number of periods to this (s): times are kept in nanoseconds.
_NANOSECOND = 1e-9


@dataclass(frozen=True, eq=False)
class SampledTrajectory:
    """Samples of a trajectory, and what the formats say about them.

    Attributes
    ----------
    trajectory : Trajectory
    units : tuple of str
        ``"m"`` or ``"rad"`` for each joint.
    t : (T,) ndarray
        s, ascending.
    derivatives : (4, T, n) ndarray
        Position, velocity, acceleration, jerk (m, rad and their derivatives).
    segment : (T,) ndarray of int
        The segment of every sample; at a boundary the one that starts there.
    """

    trajectory: Trajectory
    units: tuple[str, ...]
    t: NDArray[np.float64]
    derivatives: NDArray[np.float64]
    segment: NDArray[np.int64]

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints, in the order of the columns."""
        return self.trajectory.joint_names

    @property
    def row(self) -> NDArray[np.int64]:
        """The row of every sample, -1 where none, (T,)."""
        return np.array([segment.row for segment in self.trajectory.segments], dtype=np.int64)[self.segment]

    @property
    def kind(self) -> NDArray[np.str_]:
        """The kind of segment of every sample, (T,)."""
        return np.array([segment.kind.value for segment in self.trajectory.segments])[self.segment]

    @property
    def process_on(self) -> NDArray[np.bool_]:
        """Whether the tool works on the surface at every sample, (T,)."""
        return np.array([segment.process_on for segment in self.trajectory.segments])[self.segment]

    @property
    def rests(self) -> NDArray[np.bool_]:
        """At which samples the arm rests, (T,): no velocity and no acceleration."""
        moving = np.abs(self.derivatives[1:3])
        largest = moving.max(axis=1, keepdims=True, initial=0.0)
        return (moving <= _REST * largest).all(axis=(0, 2))


def _sampled(trajectory: Trajectory, units: Sequence[str], t: NDArray[np.float64]) -> SampledTrajectory:
    derivatives = np.stack([trajectory(t, order) for order in range(4)])
    return SampledTrajectory(trajectory, tuple(units), t, derivatives, trajectory.segment_at(t))


def at_knots(trajectory: Trajectory, units: Sequence[str], period: float | None = None) -> SampledTrajectory:
    """Return the trajectory at its polynomials' boundaries, or every ``period`` seconds if one is given.

    A controller that interpolates quintically between the boundaries gives the trajectory back.
    """
    if period is not None:
        return at_period(trajectory, units, period)
    return _sampled(trajectory, units, trajectory.boundaries)


def at_period(trajectory: Trajectory, units: Sequence[str], period: float) -> SampledTrajectory:
    """Return the trajectory every ``period`` seconds, and at its end; at times in whole nanoseconds."""
    return _sampled(trajectory, units, np.round(trajectory.sample_times(period), 9))


def at_ticks(trajectory: Trajectory, units: Sequence[str], period: float) -> SampledTrajectory:
    """Return the trajectory at every tick of a servo interface; the last sample is held until the last tick.

    Raises
    ------
    InvalidInput
        If the trajectory does not end at rest: then nothing can be held.
    """
    t = trajectory.sample_times(period)
    end = _sampled(trajectory, units, t[-1:])
    peaks = np.abs(trajectory(trajectory.boundaries, 1)).max(axis=0, initial=0.0)
    moving = np.abs(end.derivatives[1, 0]) > _REST * np.maximum(peaks, 1e-9)
    if moving.any():
        joint = trajectory.joint_names[int(moving.argmax())]
        raise InvalidInput(f"the trajectory does not end at rest (joint {joint!r}): a stream could not hold its end")
    ticks = int(np.ceil((trajectory.duration - _NANOSECOND) / period))
    at = np.asarray(np.arange(ticks + 1) * period, dtype=np.float64)
    return replace(_sampled(trajectory, units, np.minimum(at, trajectory.duration)), t=at)


def at_steps(trajectory: Trajectory, units: Sequence[str], period: float) -> SampledTrajectory:
    """Return the trajectory in equal steps of at most ``period`` within every segment, whose ends are all sampled."""
    count = sum(1 for segment in trajectory.segments if segment.end > segment.start)
    if not count:
        raise InvalidInput("the trajectory has no motion that a program could do")
    trajectory.sample_times(period)  # refuses periods that are not usable
    times: list[NDArray[np.float64]] = []
    for segment in trajectory.segments:
        steps = max(1, int(np.ceil((segment.end - segment.start - _NANOSECOND) / period)))
        times.append(np.linspace(segment.start, segment.end, steps + 1))
    t = np.unique(np.round(np.concatenate(times), 9))
    return _sampled(trajectory, units, np.minimum(t, trajectory.duration))
