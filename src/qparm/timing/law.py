"""The one timing of a joint path: how its curve is passed from stop to stop."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from qparm.errors import InvalidInput
from qparm.path import JointPath
from qparm.path.curve import piecewise
from qparm.robot.motion_limits import MotionLimits
from qparm.timing.path_speed import FeedSections, SpeedProfile, fastest_profile
from qparm.timing.straight import StraightMotion, straight_motion

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["Motion", "PathTiming", "time_path"]

Motion = SpeedProfile | StraightMotion


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


def time_path(path: JointPath, limits: MotionLimits, *, feed: float | None = None) -> PathTiming:
    """Time a joint path from stop to stop: rows at the feed where the joints allow it, all else as fast as can be.

    Parameters
    ----------
    path : JointPath
        With at least two waypoints.
    limits : MotionLimits
    feed : float, optional
        Largest speed of the path parameter on rows (m/s); without it rows too are passed as fast as can be.

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
        sections = _sections(path, run, feed)
        if len(q) == 2 or not np.ptp(q, axis=0).max() > 0:
            cap = sections.speeds.min()
            speed = float(cap / (parameter[-1] - parameter[0])) if np.isfinite(cap) else None
            motion = straight_motion(q[0], q[-1], limits, speed=speed)
            motions.append(motion)
            waypoints.append(np.linspace(0.0, motion.duration, len(q)))
            continue
        profile = fastest_profile(piecewise(path.run_curve(run)), limits, feed=sections)
        motions.append(profile)
        at = profile.ends.inverse(parameter - parameter[0])
        at[0], at[-1] = 0.0, profile.ends.total
        waypoints.append(at)
    return PathTiming(path, limits, tuple(motions), tuple(waypoints))


def _sections(path: JointPath, run: range, feed: float | None) -> FeedSections:
    """Return where along a run the feed is kept."""
    first = path.segments[run[0]].first
    parameter = path.run_parameter(run)
    at = [0, *(path.segments[index].last - first for index in run)]
    speeds = [feed if feed is not None and path.segments[index].process_on else np.inf for index in run]
    return FeedSections(parameter[at] - parameter[0], np.array(speeds))
