"""Division of a form into pieces: at the waypoints, and in between until the form keeps to the timing."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from qparm.errors import InvalidInput
from qparm.path import JointPath, SegmentKind, TimedSegment, Trajectory

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.robot import SerialChain
    from qparm.timing.law import Motion

__all__ = [
    "Deviation",
    "deviation_on",
    "joint_deviation",
    "looks",
    "resting_trajectory",
    "spaced",
    "split",
    "timed_segments",
    "tool_deviation",
]

# deviation(form, path) tells for each of k states, positions and velocities (2, k, n), how far the form is off, 1 being
# as far as it may be
Deviation = Callable[["NDArray[np.float64]", "NDArray[np.float64]"], "NDArray[np.float64]"]

# How much of what is allowed the form may use: the curve itself uses the rest.
_TOOL = 0.6
# The same of its speed, as a share: half of the 0.1 % within which the feed is kept.
_SPEED = 5e-4
# The timing keeps the feed where it is this near to it; what is slower begins, ends or turns.
_AT_FEED = 0.01
# A tool that goes less than this per radian turns on the spot (m): no place of its path is nearest then.
_ON_THE_SPOT = 5e-5
# How far joints may be off where there is no tool (m, rad).
_JOINT = 1e-6
_STILL = 1e-3


def tool_deviation(chain: SerialChain, *, position: float, rotation: float, feed: float | None = None) -> Deviation:
    """Return the measure by which the tool is compared: the worst of its place, its rotation and its speed.

    The place is that of the same time. The rotation is compared with the path's own where the path is nearest: a tool
    that is on its path, but a micrometre ahead, is turned off it by what the path turns on that micrometre, unless it
    is turned ahead as far.

    Parameters
    ----------
    chain : SerialChain
    position, rotation : float
        How far the tool may be off its path (m, rad).
    feed : float, optional
        Its speed on rows (m/s), to be kept where the timing keeps it.

    Raises
    ------
    InvalidInput
        If a tolerance is not finite and positive.
    """
    for what, value in (("position", position), ("rotation", rotation)):
        if not (np.isfinite(value) and value > 0):
            raise InvalidInput(f"the tolerance in {what} must be finite and positive, not {value}")

    def twist(states: NDArray[np.float64]) -> NDArray[np.float64]:
        return (chain.jacobian(states[0]) @ states[1][:, :, None])[:, :, 0]

    def deviation(form: NDArray[np.float64], path: NDArray[np.float64]) -> NDArray[np.float64]:
        E, moving = chain.pose_error(chain.forward(form[0]), chain.forward(path[0])), twist(path)
        off, turned = np.linalg.norm(E[:, :3], axis=1), np.linalg.norm(_turned_at_nearest(E, moving), axis=1)
        worst = np.maximum(off / position, turned / rotation) / _TOOL
        if feed is None:
            return worst
        asked, found = (np.linalg.norm(one[:, :3], axis=1) for one in (moving, twist(form)))
        missed = np.where(np.abs(asked / feed - 1) <= _AT_FEED, np.abs(found - asked) / (_SPEED * feed), 0.0)
        return np.maximum(worst, missed)

    return deviation


def _turned_at_nearest(E: NDArray[np.float64], moving: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what is missing from the form's rotation to that of the path where it is nearest, (k, 3).

    Parameters
    ----------
    E : (k, 6) ndarray
        What is missing from the form's pose to the path's at the same time (m, rad).
    moving : (k, 6) ndarray
        The path's velocity and angular velocity there.
    """
    v, turning = moving[:, :3], moving[:, 3:]
    square = (v**2).sum(axis=1)
    goes = square > _ON_THE_SPOT**2 * (turning**2).sum(axis=1)
    late = np.divide((E[:, :3] * v).sum(axis=1), square, out=np.zeros(len(E)), where=goes)
    return E[:, 3:] - late[:, None] * turning


def deviation_on(path: JointPath, run: range, tool: Deviation | None) -> Deviation:
    """Return how a run's deviation is measured: at the tool where it follows the tool path, else at the joints."""
    on_path = all(path.segments[index].kind in (SegmentKind.ROW, SegmentKind.TRANSITION) for index in run)
    return tool if on_path and tool is not None else joint_deviation


def joint_deviation(form: NDArray[np.float64], path: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the largest difference of a joint over what it may be."""
    return np.abs(form[0] - path[0]).max(axis=1) / _JOINT


def looks(u: NDArray[np.float64], shares: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return places inside pieces with the given borders, at shares of each piece, (pieces * shares,)."""
    return (u[:-1, None] + np.diff(u)[:, None] * shares).ravel()


def spaced(motion: Motion, waypoints: NDArray[np.float64], least: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return borders in u: both ends and those waypoints between them that are far enough apart in time.

    On shorter pieces rounding is jerk. The waypoints left out are passed inside a piece, on the path as all of it is.

    Parameters
    ----------
    motion : SpeedProfile or StraightMotion
    waypoints : (k,) ndarray
        Ascending.
    least : (k,) ndarray
        How far each must be from the one kept before it (s).
    """
    u, first = np.unique(waypoints, return_index=True)
    t, least = motion.times(u), least[first]
    if not (np.diff(t) < np.maximum(least[:-1], least[1:])).any():
        return u
    kept, times, apart = [0], t.tolist(), least.tolist()
    for k in range(1, len(u) - 1):
        if times[k] - times[kept[-1]] >= max(apart[k], apart[kept[-1]]):
            kept.append(k)
    while len(kept) > 1 and times[-1] - times[kept[-1]] < max(apart[-1], apart[kept[-1]]):
        kept.pop()
    kept.append(len(u) - 1)
    # those left out lie in short pieces: a long one would be compared with the path far from them
    t, at = t[kept], np.array(kept)
    gap = np.maximum(least[at[:-1]], least[at[1:]])
    dropped = (np.diff(at) > 1) & (np.diff(t) > 3 * gap)
    after, before = t[:-1][dropped] + gap[dropped], t[1:][dropped] - gap[dropped]
    return np.union1d(u[at], motion.places(np.concatenate([after, before])))


def split(u: NDArray[np.float64], bad: NDArray[np.bool_], knots: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return borders with bad pieces halved: at the knot nearest to the middle, where there is one inside."""
    first, last = u[:-1][bad], u[1:][bad]
    middle = 0.5 * (first + last)
    at = np.clip(np.searchsorted(knots, middle), 1, len(knots) - 1)
    nearest = np.where(knots[at] - middle < middle - knots[at - 1], knots[at], knots[at - 1])
    margin = 0.05 * (last - first)
    inside = (nearest > first + margin) & (nearest < last - margin)
    return np.union1d(u, np.where(inside, nearest, middle))


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
        polynomials=tuple(PPoly(np.array([[value]]), np.array([0.0, _STILL])) for value in path.q[0]),
        knots=np.zeros(1),
        segments=(TimedSegment(SegmentKind.APPROACH, -1, 0.0, 0.0),),
        timing=timing,
        executable=not reasons,
        reasons=reasons,
    )
