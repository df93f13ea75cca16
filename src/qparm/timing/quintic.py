"""Quintic timing of joint waypoints: C2, at rest at the ends of every segment, within all limits.

Along rows the time between two waypoints is arc length over feed. The path's own speed and acceleration at a
waypoint are those of the parabola through its time and its neighbours', and the joints follow its curve q(s):

    dq/dt = q'(s) v,    d2q/dt2 = q''(s) v^2 + q'(s) a

Between two waypoints these states determine one quintic per joint, which keeps to the curve. Where a limit is
exceeded, the time of that interval is stretched; what is left over after some rounds is taken out by stretching
the whole segment, which scales velocity by 1/k, acceleration by 1/k^2 and jerk by 1/k^3 and leaves the path as it is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from qparm.path import JointPath, SegmentKind, TimedSegment, Trajectory
from qparm.robot import SerialChain, rest_to_rest_time

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["QuinticTiming", "quintic_timing", "quintic_trajectory"]

_ROUNDS = 40
# Peaks are brought to this share of a limit: the rest is left for rounding.
_TARGET = 1.0 - 1e-6
# Leaving rest, or coming to it, takes twice the time of an interval at full feed.
_END_FACTOR = 2.0
_SHORTEST = 1e-3
# A joint's mean speed over an interval stays below its limit by this factor, since its peak is higher.
_MARGIN_OF_SPEED = 1.25


@dataclass(frozen=True, eq=False)
class QuinticTiming:
    """Times of the intervals and states at the waypoints.

    Attributes
    ----------
    dt : (N - 1,) ndarray
        Seconds between neighbouring waypoints.
    velocity, acceleration : (N, n) ndarray
        At the waypoints; zero at the ends of segments.
    """

    dt: NDArray[np.float64]
    velocity: NDArray[np.float64]
    acceleration: NDArray[np.float64]


def quintic_timing(chain: SerialChain, path: JointPath, *, feed: float) -> QuinticTiming:
    """Return times and states such that every quintic keeps every limit.

    Parameters
    ----------
    chain : SerialChain
        Gives the limits.
    path : JointPath
        At least two waypoints.
    feed : float
        Speed of the tool on rows and transitions (m/s), kept where the limits allow.

    Returns
    -------
    QuinticTiming
    """
    from qparm.timing.kernels import quintic_peaks

    q = np.ascontiguousarray(path.q)
    edge_segment = np.empty(len(q) - 1, dtype=np.int64)
    at_rest = np.zeros(len(q), dtype=bool)
    dt = np.empty(len(q) - 1)
    for index, segment in enumerate(path.segments):
        edges = slice(segment.first, segment.last)
        edge_segment[edges] = index
        at_rest[[segment.first, segment.last]] = True
        if segment.last - segment.first > 1 or segment.process_on:
            steps = np.abs(np.diff(q[segment.first : segment.last + 1], axis=0))
            # no faster than the feed, and no faster than the joints: the rounds below then have little to stretch
            dt[edges] = _MARGIN_OF_SPEED * (steps / chain.velocity).max(axis=1)
            if segment.kind in (SegmentKind.ROW, SegmentKind.TRANSITION):
                dt[edges] = np.maximum(_feed_times(path.parameters[index]) / feed, dt[edges])
        else:
            dt[edges] = rest_to_rest_time(
                chain, q[segment.first : segment.last], q[segment.first + 1 : segment.last + 1]
            )
    dt = np.maximum(dt, _SHORTEST)
    limits = np.stack([chain.velocity, chain.acceleration, chain.jerk])
    flat = np.repeat(at_rest[:, None], q.shape[1], axis=1)
    geometry = _geometry(path)
    peaks = np.empty((len(dt), q.shape[1], 5))
    for _ in range(_ROUNDS):
        v, a = _states(q, dt, flat, geometry)
        quintic_peaks(q, v, a, dt, limits, chain.lower, chain.upper, peaks)
        outside = (peaks[:, :, 3] < chain.lower - 1e-12) | (peaks[:, :, 4] > chain.upper + 1e-12)
        if outside.any():
            # between two values within the limits, a joint that rests at both cannot leave them
            flat[:-1][outside] = True
            flat[1:][outside] = True
            continue
        factor = _stretch(peaks, limits).max(axis=1)
        if (factor <= 1.0).all():
            return QuinticTiming(dt, v, a)
        # the neighbours give way as well, or their states would fight the stretched interval's
        spread = np.sqrt(np.maximum(factor, 1.0))
        spread = np.maximum(factor, np.maximum(np.append(spread[1:], 1.0), np.append(1.0, spread[:-1])))
        dt = dt * np.where(factor > 1.0, np.maximum(spread, 1.001), np.minimum(spread, 1.5))
    return _within_limits(chain, q, dt, flat, edge_segment, limits, peaks, geometry)


def _within_limits(
    chain: SerialChain,
    q: NDArray[np.float64],
    dt: NDArray[np.float64],
    flat: NDArray[np.bool_],
    edge_segment: NDArray[np.int64],
    limits: NDArray[np.float64],
    peaks: NDArray[np.float64],
    geometry: _Geometry,
) -> QuinticTiming:
    """Return the timing with whole segments stretched so that what is still over a limit comes within."""
    from qparm.timing.kernels import quintic_peaks

    while True:
        v, a = _states(q, dt, flat, geometry)
        quintic_peaks(q, v, a, dt, limits, chain.lower, chain.upper, peaks)
        outside = (peaks[:, :, 3] < chain.lower - 1e-12) | (peaks[:, :, 4] > chain.upper + 1e-12)
        if not outside.any():
            break
        flat[:-1][outside] = True
        flat[1:][outside] = True
    factor = np.ones(edge_segment[-1] + 1)
    np.maximum.at(factor, edge_segment, _stretch(peaks, limits).max(axis=1))
    dt = dt * factor[edge_segment]
    v, a = _states(q, dt, flat, geometry)
    return QuinticTiming(dt, v, a)


def _stretch(peaks: NDArray[np.float64], limits: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return by how much the time of each interval must grow for each joint, (N - 1, n)."""
    ratio = peaks[:, :, :3] / (_TARGET * limits.T)
    return np.maximum(np.maximum(ratio[:, :, 0], np.sqrt(ratio[:, :, 1])), np.cbrt(ratio[:, :, 2]))


def _feed_times(parameter: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the lengths of a segment's intervals, lengthened where it starts from and comes to rest."""
    ds = np.diff(parameter)
    ds[0] *= _END_FACTOR
    ds[-1] *= _END_FACTOR
    return ds


@dataclass(frozen=True, eq=False)
class _Geometry:
    """The path's curve at the waypoints of each segment with more than two: slices, parameters, derivatives."""

    spans: tuple[slice, ...]
    s: tuple[NDArray[np.float64], ...]
    first: tuple[NDArray[np.float64], ...]
    second: tuple[NDArray[np.float64], ...]


def _geometry(path: JointPath) -> _Geometry:
    spans, s, first, second = [], [], [], []
    for index, segment in enumerate(path.segments):
        if segment.last - segment.first < 2:
            continue
        curve, parameter = path.curve(index), path.parameters[index]
        spans.append(slice(segment.first, segment.last + 1))
        s.append(parameter)
        first.append(curve(parameter, 1))
        second.append(curve(parameter, 2))
    return _Geometry(tuple(spans), tuple(s), tuple(first), tuple(second))


def _states(
    q: NDArray[np.float64], dt: NDArray[np.float64], flat: NDArray[np.bool_], geometry: _Geometry
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return velocity and acceleration at the waypoints: the curve's at the path's speed, zero where flat."""
    v, a = np.zeros_like(q), np.zeros_like(q)
    for span, s, first, second in zip(geometry.spans, geometry.s, geometry.first, geometry.second, strict=True):
        h = dt[span.start : span.stop - 1]
        slope = np.diff(s) / h
        width = h[:-1] + h[1:]
        speed = ((slope[:-1] * h[1:] + slope[1:] * h[:-1]) / width)[:, None]
        acceleration = (2.0 * np.diff(slope) / width)[:, None]
        inner = slice(span.start + 1, span.stop - 1)
        v[inner] = first[1:-1] * speed
        a[inner] = second[1:-1] * speed**2 + first[1:-1] * acceleration
    v[flat] = 0.0
    a[flat] = 0.0
    return v, a


def quintic_coefficients(
    q0: NDArray[np.float64], v0: NDArray[np.float64], a0: NDArray[np.float64],
    q1: NDArray[np.float64], v1: NDArray[np.float64], a1: NDArray[np.float64], dt: NDArray[np.float64],
) -> NDArray[np.float64]:  # fmt: skip
    """Return the coefficients (6, ...) of the quintics between two states, highest power of time first."""
    D = q1 - q0 - v0 * dt - 0.5 * a0 * dt**2
    E = (v1 - v0 - a0 * dt) * dt
    F = (a1 - a0) * dt**2
    return np.stack(
        [
            (6 * D - 3 * E + 0.5 * F) / dt**5,
            (-15 * D + 7 * E - F) / dt**4,
            (10 * D - 4 * E + 0.5 * F) / dt**3,
            0.5 * a0,
            v0,
            q0,
        ]
    )


def quintic_trajectory(
    chain: SerialChain, path: JointPath, *, feed: float, reasons: tuple[str, ...] = ()
) -> Trajectory:
    """Return the quintic trajectory through all waypoints of a joint path.

    Parameters
    ----------
    chain, path, feed
        See :func:`quintic_timing`.
    reasons : tuple of str
        Why the trajectory must not be executed as it is; empty if it may.

    Returns
    -------
    Trajectory
    """
    from scipy.interpolate import PPoly

    if len(path.q) < 2:
        return resting_trajectory(path, "quintic", reasons)
    timing = quintic_timing(chain, path, feed=feed)
    q, v, a, h = path.q, timing.velocity, timing.acceleration, timing.dt[:, None]
    coefficients = quintic_coefficients(q[:-1], v[:-1], a[:-1], q[1:], v[1:], a[1:], h)
    knots = np.concatenate([[0.0], np.cumsum(timing.dt)])
    polynomials = tuple(PPoly(np.ascontiguousarray(coefficients[:, :, i]), knots) for i in range(path.n))
    return Trajectory(
        joint_names=path.joint_names,
        polynomials=polynomials,
        knots=knots,
        segments=timed_segments(path, knots),
        timing="quintic",
        executable=not reasons,
        reasons=reasons,
    )


def timed_segments(path: JointPath, knots: NDArray[np.float64]) -> tuple[TimedSegment, ...]:
    """Return the path's segments with the times at which they begin and end."""
    return tuple(
        TimedSegment(segment.kind, segment.row, float(knots[segment.first]), float(knots[segment.last]))
        for segment in path.segments
    )


def resting_trajectory(path: JointPath, timing: str, reasons: tuple[str, ...]) -> Trajectory:
    """Return the trajectory of a path of one waypoint: no motion, no duration."""
    from scipy.interpolate import PPoly

    return Trajectory(
        joint_names=path.joint_names,
        polynomials=tuple(PPoly(np.array([[value]]), np.array([0.0, _SHORTEST])) for value in path.q[0]),
        knots=np.zeros(1),
        segments=(TimedSegment(SegmentKind.APPROACH, -1, 0.0, 0.0),),
        timing=timing,
        executable=not reasons,
        reasons=reasons,
    )
