"""Timing of a list of joint waypoints from elsewhere: cleaned, fitted inside a band if one is given, timed."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np

from qparm.arrays import real_array
from qparm.errors import InvalidInput
from qparm.path import JointPath, Segment, SegmentKind
from qparm.timing.law import PathTiming, time_path

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from qparm.robot.motion_limits import MotionLimits

__all__ = ["find_kinks", "find_swings", "fit_band", "largest_bulge", "same_distance", "time_waypoints"]

Corners = Literal["smooth", "stop"]

# Waypoints are passed to this distance (m, rad): those closer to each other are one waypoint. On paths that are small
# or have their waypoints close, only those closer than this share of the mean distance.
_PASSED, _OF_MEAN = 1e-6, 1e-3
# No motion is shorter (m, rad), and none takes longer (s).
_LEAST_MOTION, _LONGEST = 1e-12, 1e8
# Beyond this (m, rad) numbers do not hold positions to the distance above.
_LARGEST = 1e9
# The ends of a fitted path stay where they are: this share of the band.
_ENDS = 1e-6
# A kink turns by more than this (rad), and so many times more than its neighbours.
_KINK, _SHARPER = np.radians(30.0), 10.0
# A curve swings wide where it leaves the straight line between two waypoints by so many times their distance.
_WIDE = 4.0
_QP_TOLERANCE, _QP_ITERATIONS = 1e-7, 80


def time_waypoints(
    q: ArrayLike,
    limits: MotionLimits,
    *,
    band: float = 0.0,
    corners: Corners = "smooth",
    names: tuple[str, ...] = (),
) -> PathTiming:
    """Time a list of waypoints, at rest at both ends.

    Parameters
    ----------
    q : (N, n) array_like
        Waypoints (m, rad). One that is nearer than :func:`same_distance` to the one before is dropped, or, at the end,
        to the last: a curve through both would turn with them.
    limits : MotionLimits
    band : float
        How far the path may pass from the waypoints, those dropped too, each joint by itself (m, rad). The ends are
        always met.
    corners : {"smooth", "stop"}
        ``smooth``: a curve, four times continuously differentiable, through all waypoints; at kinks
        (:func:`find_kinks`), and where it would swing wide (:func:`find_swings`), it stops if that is quicker than
        a curve round them. ``stop``: straight lines in joint
        space, with a stop at every waypoint.
    names : tuple of str
        Of the joints.

    Returns
    -------
    PathTiming
        Its parameter is seconds at full speed along the chords.

    Raises
    ------
    InvalidInput
        If there are no two different waypoints, a value is not finite or beyond 1e9, or sizes do not agree.
    """
    q = _checked(q, limits.n, names)
    if corners not in get_args(Corners):
        raise InvalidInput(f"corners must be one of {', '.join(get_args(Corners))}, not {corners!r}")
    if not (np.isfinite(band) and band >= 0):
        raise InvalidInput(f"the band must be finite and not negative, not {band}")
    if names and len(names) != limits.n:
        raise InvalidInput(f"{len(names)} joint names for {limits.n} joints")
    same = same_distance(q, band)
    kept = _apart(q, same)
    if len(kept) < len(q):
        # those dropped are to be passed within the band too
        q, band = q[kept], max(band - same, 0.0)
    if len(q) == 2 and not (np.ptp(q, axis=0) > _LEAST_MOTION).any():
        raise InvalidInput("all waypoints are the same: there is no motion to be timed")
    longest = _longest(q, limits)
    if longest > _LONGEST:
        raise InvalidInput(
            f"with a stop at every waypoint the motion takes about {longest:.3g} s within these limits, more than"
            f" {_LONGEST:g} s: are the units of waypoints and limits right?"
        )
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(q, axis=0) / limits.velocity, axis=1))])
    names = names or tuple(f"joint_{k + 1}" for k in range(limits.n))
    N = len(q)
    if corners == "stop":
        return time_path(_path(names, s, q, np.arange(N)), limits)
    none, kinks = np.array([0, N - 1]), find_kinks(q / limits.velocity)
    ways = [none, np.union1d(none, kinks), find_swings(_path(names, s, q, none))]
    # where a curve swings beyond all measure, its speed is rounding and its time no number; straight lines are left
    with np.errstate(invalid="ignore", divide="ignore"):
        timings = [
            time_path(_path(names, s, _fitted(s, q, band, stops), stops), limits)
            for k, stops in enumerate(ways)
            if not any(np.array_equal(stops, earlier) for earlier in ways[:k])
        ]
        usable = [timing for timing in timings if np.isfinite(timing.duration)]
    return min(usable, key=lambda timing: timing.duration, default=None) or time_path(
        _path(names, s, q, np.arange(N)), limits
    )


def _longest(q: NDArray[np.float64], limits: MotionLimits) -> float:
    """Return about how long the motion takes with a stop at every waypoint (s), no less than it does."""
    step = np.abs(np.diff(q, axis=0))
    # each of the three limits alone; together they take no more than their sum
    times = step / limits.velocity + 2 * np.sqrt(step / limits.acceleration) + np.cbrt(32 * step / limits.jerk)
    return float(times.max(axis=1).sum())


def same_distance(q: NDArray[np.float64], band: float = 0.0) -> float:
    """Return the distance (m, rad; of the joint that differs most) below which waypoints are taken as one.

    It is that to which waypoints are passed, 1e-6, or less on paths that are small or have their waypoints close: a
    thousandth of the mean distance. It is at most half the band; more need not be dropped there, as the fit takes out
    what turns within the band.
    """
    chord = np.abs(np.diff(q, axis=0)).max(axis=1)
    same = min(_PASSED, _OF_MEAN * float(chord.mean()))
    return min(same, 0.5 * band) if band > 0 else same


def _apart(q: NDArray[np.float64], same: float) -> NDArray[np.int64]:
    """Return both ends and those waypoints between them that are farther than ``same`` from the one kept before."""
    chord = np.abs(np.diff(q, axis=0)).max(axis=1)
    if (chord > same).all():
        return np.arange(len(q))
    kept = [0]
    for k in range(1, len(q) - 1):
        # the next one is known; only after one that was dropped must it be looked at anew
        distance = chord[k - 1] if kept[-1] == k - 1 else np.abs(q[k] - q[kept[-1]]).max()
        if distance > same:
            kept.append(k)
    while len(kept) > 1 and np.abs(q[-1] - q[kept[-1]]).max() <= same:
        kept.pop()
    return np.array([*kept, len(q) - 1])


def _fitted(
    s: NDArray[np.float64], q: NDArray[np.float64], band: float, stops: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return waypoints fitted between the stops, which stay."""
    if band == 0:
        return q
    fitted = q.copy()
    for first, last in pairwise(stops.tolist()):
        fitted[first : last + 1] = fit_band(s[first : last + 1] - s[first], q[first : last + 1], band)
    return fitted


def _path(
    names: tuple[str, ...], s: NDArray[np.float64], q: NDArray[np.float64], stops: NDArray[np.int64]
) -> JointPath:
    """Return the path through waypoints with one segment between every two stops."""
    N = len(q)
    segments = tuple(Segment(SegmentKind.ROW, k, a, b) for k, (a, b) in enumerate(pairwise(stops.tolist())))
    return JointPath(
        joint_names=names,
        q=q,
        point=np.arange(N),
        row=np.zeros(N, dtype=np.int64),
        kind=(SegmentKind.ROW,) * N,
        status=("reached",) * N,
        s=s,
        segments=segments,
        parameters=tuple(s[segment.first : segment.last + 1] for segment in segments),
    )


def find_kinks(q: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the waypoints at which the direction turns sharply while it hardly turns at their neighbours.

    Through such a place a smooth curve needs bends of the waypoints' distance; where waypoints are sparse, as at the
    corners of a rectangle, every one of them turns, and none is a kink.

    Parameters
    ----------
    q : (N, n) ndarray
        Scaled, neighbours not the same.

    Returns
    -------
    (k,) ndarray of int
        Ascending; the first two and the last two waypoints are none.
    """
    chord = np.diff(q, axis=0)
    chord /= np.linalg.norm(chord, axis=1)[:, None]
    turn = np.arccos(np.clip((chord[1:] * chord[:-1]).sum(axis=1), -1.0, 1.0))
    beside = np.maximum(turn[:-2], turn[2:])
    return 2 + np.flatnonzero((turn[1:-1] > _KINK) & (turn[1:-1] > _SHARPER * beside))


def fit_band(s: NDArray[np.float64], q: NDArray[np.float64], band: float) -> NDArray[np.float64]:
    """Return waypoints within a band around those given, with the least third derivative along s.

    Parameters
    ----------
    s : (N,) ndarray
        Ascending.
    q : (N, n) ndarray
    band : float
        Largest change of a value (m, rad); the ends stay.

    Returns
    -------
    (N, n) ndarray
    """
    from qparm.banded_qp import REACH, banded_qp_kernel

    N = len(q)
    if N < 5:
        return q
    x = s / s[-1] * (N - 1)
    at = np.arange(N - 3)[:, None] + np.arange(4)
    # the third divided differences, weighted by the width that each stands for
    nodes = x[at]
    apart = nodes[:, :, None] - nodes[:, None, :]
    apart[:, range(4), range(4)] = 1.0
    rows = np.sqrt((nodes[:, 3] - nodes[:, 0]) / 3.0)[:, None] / apart.prod(axis=2)
    rows /= np.abs(rows).mean()
    H = np.zeros((N, REACH + 1, 1, 1))
    for a in range(4):
        for b in range(a, 4):
            H[a : a + N - 3, b - a, 0, 0] += rows[:, a] * rows[:, b]
    bound = np.ones((N, 1))
    bound[[0, -1]] = _ENDS
    free = np.full((N - 1, 1), np.inf)
    fitted = np.empty_like(q)
    for joint in range(q.shape[1]):
        third = (rows * q[at, joint]).sum(axis=1) / band
        g = np.zeros((N, 1))
        for a in range(4):
            g[a : a + N - 3, 0] += rows[:, a] * third
        z = np.zeros(N)
        banded_qp_kernel(
            H, g, np.ones((N, 1, 1)), -bound, bound, -free, free, _QP_TOLERANCE, _QP_ITERATIONS, z, np.empty(3)
        )
        # an interior point may end a little outside
        fitted[:, joint] = q[:, joint] + band * np.clip(z, -1.0, 1.0)
    fitted[[0, -1]] = q[[0, -1]]
    return fitted


def find_swings(path: JointPath) -> NDArray[np.int64]:
    """Return the waypoints at which a curve must stop so that none of it leaves its chord by a few times its length.

    Waypoints that lie close beside others far apart make it swing: the more, the more their distances differ.

    Parameters
    ----------
    path : JointPath
        Through the waypoints.

    Returns
    -------
    (k,) ndarray of int
        Ascending, both ends among them.
    """
    chord = np.abs(np.diff(path.q, axis=0)).max(axis=1)
    stops = np.array([0, len(path.q) - 1])
    while True:
        wide = np.flatnonzero(_bulges(path) > _WIDE * chord)
        added = np.union1d(stops, np.concatenate([wide, wide + 1]))
        if len(added) == len(stops):
            return stops
        stops = added
        path = _path(path.joint_names, path.s, path.q, stops)


def _bulges(path: JointPath) -> NDArray[np.float64]:
    """Return how far the curve leaves the straight line after each waypoint but the last, (N - 1,), of one joint."""
    bulges = np.zeros(len(path.q) - 1)
    x = np.arange(1, 8) / 8.0
    for run in path.runs:
        q, s = path.waypoints(run), path.run_parameter(run)
        if len(q) == 2:
            continue
        on_curve = path.run_curve(run)((s[:-1, None] + np.diff(s)[:, None] * x).ravel())
        chord = q[:-1, None] + np.diff(q, axis=0)[:, None] * x[:, None]
        first = path.segments[run[0]].first
        bulges[first : first + len(q) - 1] = np.abs(on_curve.reshape(chord.shape) - chord).max(axis=(1, 2))
    return bulges


def largest_bulge(path: JointPath) -> tuple[float, int]:
    """Return how far a path's curve leaves the straight lines between its waypoints, and after which waypoint.

    Returns
    -------
    distance : float
        Of one joint (m, rad).
    waypoint : int
    """
    bulges = _bulges(path)
    after = int(bulges.argmax())
    return float(bulges[after]), after if bulges[after] > 0 else 0


def _checked(q: ArrayLike, n: int, names: tuple[str, ...]) -> NDArray[np.float64]:
    table = real_array(q, what="the waypoints").copy()
    if table.ndim != 2 or table.shape[1] != n:
        columns = f"of shape {table.shape}" if table.ndim != 2 else f"of {table.shape[1]}"
        named = f" ({', '.join(names[:20])})" if table.ndim == 2 and len(names) == table.shape[1] else ""
        raise InvalidInput(f"the waypoints must be of {n} joints as the limits are, not {columns}{named}")
    if len(table) < 2:
        raise InvalidInput(f"at least two waypoints are needed, not {len(table)}")
    bad = np.argwhere(~(np.abs(table) <= _LARGEST))
    if len(bad):
        waypoint, joint = bad[0].tolist()
        value, name = table[waypoint, joint], repr(names[joint]) if len(names) == n else joint
        if not np.isfinite(value):
            raise InvalidInput(f"waypoint {waypoint} has a value of joint {name} that is not finite")
        raise InvalidInput(
            f"waypoint {waypoint} has {value:g} for joint {name}: numbers beyond {_LARGEST:g} do not hold positions"
            f" to {_PASSED:g}"
        )
    return table
