"""The one timing of a joint path: how its curve is passed from stop to stop."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from qparm.errors import InvalidInput
from qparm.path import JointPath
from qparm.path.curve import piecewise
from qparm.robot.motion_limits import MotionLimits
from qparm.timing.path_speed import ON_THE_SPOT, FeedSections, SpeedProfile, fastest_profile
from qparm.timing.straight import StraightMotion, straight_motion

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from scipy.interpolate import PPoly

    from qparm.robot import SerialChain

__all__ = ["Motion", "PathTiming", "ToolWay", "time_path", "tool_way"]

Motion = SpeedProfile | StraightMotion
# How far the tool moves, (k,), per unit in which the joints q (k, n) change by dq (k, n).
ToolWay = Callable[["NDArray[np.float64]", "NDArray[np.float64]"], "NDArray[np.float64]"]

# Places on a straight motion at which the tool's way is looked at, and by what share that may differ between them.
_PLACES, _EVEN = 33, 1e-4


@dataclass(frozen=True, eq=False)
class PathTiming:
    """A timed joint path, whatever form it is handed out in.

    Attributes
    ----------
    path : JointPath
    limits : MotionLimits
    motions : tuple of SpeedProfile or StraightMotion
        One for each of the path's runs.
    waypoints : tuple of (k,) ndarray
        The path variable u of each run's waypoints, its ends among them.
    """

    path: JointPath
    limits: MotionLimits
    motions: tuple[Motion, ...]
    waypoints: tuple[NDArray[np.float64], ...]

    @property
    def duration(self) -> float:
        """Seconds."""
        return sum(motion.duration for motion in self.motions)


def tool_way(chain: SerialChain) -> ToolWay:
    """Return how far an arm's tool point moves."""
    return lambda q, dq: np.linalg.norm((chain.jacobian(q)[:, :3] @ dq[:, :, None])[:, :, 0], axis=1)


def time_path(
    path: JointPath, limits: MotionLimits, *, feed: float | None = None, tool: ToolWay | None = None
) -> PathTiming:
    """Time a joint path from stop to stop: rows at the feed where the joints allow it, all else as fast as can be.

    Parameters
    ----------
    path : JointPath
        With at least two waypoints.
    limits : MotionLimits
    feed : float, optional
        Largest speed of the tool on rows (m/s); without it rows too are passed as fast as can be.
    tool : callable, optional
        How far the tool moves; without it the path parameter is taken for its way.

    Returns
    -------
    PathTiming

    Raises
    ------
    InvalidInput
        If the limits are of another number of joints, the feed is not positive, or there are no two waypoints.
    """
    if limits.n != path.n:
        raise InvalidInput(f"the limits are of {limits.n} joints, the path of {path.n}")
    if feed is not None and not (np.isfinite(feed) and feed > 0):
        raise InvalidInput(f"feed must be finite and positive, not {feed}")
    if not path.segments:
        raise InvalidInput("a path of less than two waypoints has no motion to be timed")
    motions: list[Motion] = []
    waypoints: list[NDArray[np.float64]] = []
    for run in path.runs:
        q, parameter = path.waypoints(run), path.run_parameter(run)
        speed = _straight_speed(path, run, feed, tool)
        if not np.ptp(q, axis=0).max() > 0 or (len(q) == 2 and not np.isnan(speed)):
            motion = straight_motion(q[0], q[-1], limits, speed=speed if np.isfinite(speed) else None)
            motions.append(motion)
            waypoints.append(np.linspace(0.0, motion.duration, len(q)))
            continue
        curve = piecewise(path.run_curve(run))
        profile = fastest_profile(curve, limits, feed=_sections(path, run, feed, curve, tool))
        motions.append(profile)
        at = profile.ends.inverse(parameter - parameter[0])
        at[0], at[-1] = 0.0, profile.ends.total
        waypoints.append(at)
    return PathTiming(path, limits, tuple(motions), tuple(waypoints))


def _speeds(path: JointPath, run: range, feed: float | None) -> NDArray[np.float64]:
    """Return the largest speed of the tool on each segment of a run, infinity where there is none (m/s)."""
    return np.array([feed if feed is not None and path.segments[index].process_on else np.inf for index in run])


def _sections(path: JointPath, run: range, feed: float | None, curve: PPoly, tool: ToolWay | None) -> FeedSections:
    """Return where along a run the feed is kept."""
    first = path.segments[run[0]].first
    parameter = path.run_parameter(run)
    at = [0, *(path.segments[index].last - first for index in run)]
    way = None if tool is None else lambda s: tool(np.asarray(curve(s)), np.asarray(curve(s, 1)))
    return FeedSections(parameter[at] - parameter[0], _speeds(path, run, feed), way)


def _straight_speed(path: JointPath, run: range, feed: float | None, tool: ToolWay | None) -> float:
    """Return the largest speed of a straight motion, as a share of it per second; NaN if that changes on the way."""
    largest, parameter = float(_speeds(path, run, feed).min()), path.run_parameter(run)
    length = float(parameter[-1] - parameter[0])
    if tool is not None and np.isfinite(largest):
        q = path.waypoints(run)
        step = q[-1] - q[0]
        way = tool(q[0] + np.linspace(0.0, 1.0, _PLACES)[:, None] * step, np.tile(step, (_PLACES, 1)))
        if way.max() > ON_THE_SPOT * length:
            length = float(way.max()) if np.ptp(way) <= _EVEN * way.max() else float("nan")
    return largest / length
