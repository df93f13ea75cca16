"""Timing of a list of joint waypoints from elsewhere: cleaned, fitted inside a band if one is given, timed."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np

from qparm.arrays import real_array
from qparm.errors import InvalidInput
from qparm.path import JointPath, Segment, SegmentKind
from qparm.timing.law import PathTiming, time_path
from qparm.timing.straight import straight_duration

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from qparm.robot.motion_limits import MotionLimits

__all__ = [
    "find_kinks",
    "find_reversals",
    "find_swings",
    "fit_band",
    "largest_bulge",
    "rounded_to",
    "same_distance",
    "time_waypoints",
]

Corners = Literal["smooth", "stop"]

# Waypoints are passed to this distance (m, rad): those closer to each other are one waypoint. On paths that are small
# or have their waypoints close, only those closer than this share of the mean distance.
_PASSED, _OF_MEAN = 1e-6, 1e-3
# No motion is shorter (m, rad), and none takes longer (s): later on whole nanoseconds are not told apart any more.
_LEAST_MOTION, _LONGEST = 1e-12, 4e6
# Beyond this (m, rad) numbers do not hold positions to the distance above.
_LARGEST = 1e9
# The ends of a fitted path stay where they are: this share of the band.
_ENDS = 1e-6
# A kink turns by more than this (rad), and so many times more than its neighbours.
_KINK, _SHARPER = np.radians(30.0), 10.0
# A way turns back where it turns by 180 degrees, to within so much (rad).
_BACK = np.radians(1.0)
# A curve swings wide where it leaves the straight line between two waypoints by so many times their distance.
_WIDE = 4.0
# Steps in which the nearest point of a line is found, each leaving two thirds of it.
_THIRDS = 40
# Rounding is looked for among so many waypoints at least, up to so many decimals, in joints that move by so many units
# of the last one; it is seen where third differences are so many units (1.3 of evenly spread errors).
_MANY, _DECIMALS, _FINE, _ROUGH = 20, 10, 1000.0, (0.5, 3.0)
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
        ``smooth``: a curve, four times continuously differentiable, through all waypoints; it stops where it turns back
        (:func:`find_reversals`), and at kinks (:func:`find_kinks`), where it would swing wide (:func:`find_swings`),
        or everywhere if that is quicker than a curve round them. ``stop``: straight lines in joint space, with a stop
        at every waypoint.
    names : tuple of str
        Of the joints.

    Returns
    -------
    PathTiming
        Its parameter is seconds at full speed along the chords.

    Raises
    ------
    InvalidInput
        If no joint moves by more than 1e-12, a value is not finite or beyond 1e9, the band is neither 0 nor between
        1e-12 and 1e9, the motion takes more than 4e6 s with a stop at every waypoint, or sizes do not agree.
    """
    q = _checked(q, limits.n, names)
    if corners not in get_args(Corners):
        raise InvalidInput(f"corners must be one of {', '.join(get_args(Corners))}, not {corners!r}")
    if not (np.isfinite(band) and band >= 0):
        raise InvalidInput(f"the band must be finite and not negative, not {band}")
    if band and not _LEAST_MOTION <= band <= _LARGEST:
        raise InvalidInput(f"the band must be 0 or lie between {_LEAST_MOTION:g} and {_LARGEST:g}, not {band:g}")
    if names and len(names) != limits.n:
        raise InvalidInput(f"{len(names)} joint names for {limits.n} joints")
    if not (np.ptp(q, axis=0) > _LEAST_MOTION).any():
        raise InvalidInput(
            f"all waypoints are the same: no joint moves by more than {_LEAST_MOTION:g}, and there is no motion to be"
            " timed"
        )
    same = same_distance(q, band)
    kept = _apart(q, same)
    if len(kept) < len(q):
        # those dropped are to be passed within the band too
        q, band = q[kept], max(band - same, 0.0)
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
    ends = np.array([0, N - 1])
    # what turns back within the band is taken out by the fit
    least = np.union1d(ends, find_reversals(_fitted(s, q, band, ends) / limits.velocity))
    kinks = find_kinks(q / limits.velocity)
    ways = [least, np.union1d(least, kinks), find_swings(_path(names, s, q, least))]
    # where a curve swings beyond all measure, its speed is rounding and its time no number; straight lines are left
    with np.errstate(invalid="ignore", divide="ignore"):
        timings = [
            time_path(_path(names, s, _fitted(s, q, band, stops), stops), limits)
            for k, stops in enumerate(ways)
            if not any(np.array_equal(stops, earlier) for earlier in ways[:k])
        ]
        usable = [timing for timing in timings if np.isfinite(timing.duration)]
    best = min(usable, key=lambda timing: timing.duration, default=None)
    if best is None or best.duration > straight_duration(np.diff(q, axis=0), limits):
        return time_path(_path(names, s, q, np.arange(N)), limits)
    return best


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


def find_reversals(q: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the waypoints at which the way turns back by 180 degrees: whatever passes them comes to rest.

    Parameters
    ----------
    q : (N, n) ndarray
        Scaled, neighbours not the same.

    Returns
    -------
    (k,) ndarray of int
        Ascending.
    """
    chord = np.diff(q, axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        chord /= np.linalg.norm(chord, axis=1)[:, None]
    return 1 + np.flatnonzero((chord[1:] * chord[:-1]).sum(axis=1) < -np.cos(_BACK))


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
    from qparm.banded.qp import REACH, banded_qp_kernel

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
        Ascending, both ends and where the path stops already among them.
    """
    chord = np.abs(np.diff(path.q, axis=0)).max(axis=1)
    stops = np.array([0, *(segment.last for segment in path.segments)])
    while True:
        wide = np.flatnonzero(_bulges(path) > _WIDE * chord)
        added = np.union1d(stops, np.concatenate([wide, wide + 1]))
        if len(added) == len(stops):
            return stops
        stops = added
        path = _path(path.joint_names, path.s, path.q, stops)


def _bulges(path: JointPath) -> NDArray[np.float64]:
    """Return how far the curve is from where even motion along the straight lines would be, (N - 1,), of one joint."""
    x = np.arange(1, 8) / 8.0
    bulges = np.zeros(len(path.q) - 1)
    for gaps, start, step, on_curve in _on_curve(path, x):
        bulges[gaps] = np.abs(on_curve - start - step * x[:, None]).max(axis=(1, 2))
    return bulges


def largest_bulge(path: JointPath) -> tuple[float, int]:
    """Return how far a path's curve leaves the straight lines between its waypoints, and after which waypoint.

    Returns
    -------
    distance : float
        Of a point of the curve from the nearest point of the line between its two waypoints: of the joint that differs
        most (m, rad).
    waypoint : int
    """
    distances = np.zeros(len(path.q) - 1)
    for gaps, start, step, on_curve in _on_curve(path, np.arange(1, 16) / 16.0):
        distances[gaps] = _from_lines(on_curve - start, step).max(axis=1)
    after = int(distances.argmax())
    return float(distances[after]), after if distances[after] > 0 else 0


def _on_curve(
    path: JointPath, x: NDArray[np.float64]
) -> Iterator[tuple[slice, NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]]:
    """Yield of each run of three waypoints or more its gaps (k), their starts and steps, and where the curve is.

    Starts and steps are (k, 1, n); the curve is given at the shares x (P,) of every gap, (k, P, n).
    """
    for run in path.runs:
        q, s = path.waypoints(run), path.run_parameter(run)
        if len(q) == 2:
            continue
        on_curve = path.run_curve(run)((s[:-1, None] + np.diff(s)[:, None] * x).ravel())
        first, gaps = path.segments[run[0]].first, len(q) - 1
        yield slice(first, first + gaps), q[:-1, None], np.diff(q, axis=0)[:, None], on_curve.reshape(gaps, len(x), -1)


def _from_lines(points: NDArray[np.float64], step: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the distances of points (k, P, n) from the lines from 0 to a step each (k, 1, n), of one joint, (k, P)."""
    low, high = np.zeros(points.shape[:2]), np.ones(points.shape[:2])

    def distance(x: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.abs(points - x[..., None] * step).max(axis=2)

    for _ in range(_THIRDS):  # it is convex in x
        a, b = low + (high - low) / 3, high - (high - low) / 3
        left = distance(a) <= distance(b)
        low, high = np.where(left, low, a), np.where(left, b, high)
    return distance(0.5 * (low + high))


def rounded_to(q: NDArray[np.float64]) -> int | None:
    """Return how many decimals waypoints (N, n) are rounded to if that, more than the way, bends a curve through them.

    Rounding is seen in the third differences of neighbouring values: they are a few units of the last decimal, while
    those of a way that is sampled finely are far less. None where there is no such thing.
    """
    if len(q) < _MANY:
        return None
    for digits in range(_DECIMALS):
        unit = 10.0**-digits
        if (np.abs(q - np.round(q, digits)) <= 1e-6 * unit).all():
            break
    else:
        return None
    moving = np.ptp(q, axis=0) > _FINE * unit
    bent = np.sqrt((np.diff(q[:, moving], 3, axis=0) ** 2).mean(axis=0)) / unit
    return digits if moving.any() and (bent < _ROUGH[1]).all() and (bent > _ROUGH[0]).any() else None


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
