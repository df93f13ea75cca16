"""The one timing of a joint path: for every segment, how its curve is passed from rest to rest."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from qparm.errors import InvalidInput
from qparm.path import JointPath
from qparm.path.curve import piecewise
from qparm.robot.motion_limits import MotionLimits
from qparm.timing.path_speed import SpeedProfile, fastest_profile
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
        One a segment.
    waypoints : tuple of (k,) ndarray
        The path variable u of each segment's waypoints, its ends among them.
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
    """Time every segment of a joint path: rows at the feed where the joints allow it, all else as fast as can be.

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
    for index, segment in enumerate(path.segments):
        q, parameter = path.q[segment.first : segment.last + 1], path.parameters[index]
        cap = feed if segment.process_on else None
        if len(q) == 2 or not np.ptp(q, axis=0).max() > 0:
            speed = None if cap is None else cap / float(parameter[-1] - parameter[0])
            motion = straight_motion(q[0], q[-1], limits, speed=speed)
            motions.append(motion)
            waypoints.append(np.linspace(0.0, motion.duration, len(q)))
            continue
        profile = fastest_profile(piecewise(path.curve(index)), limits, feed=cap)
        motions.append(profile)
        at = profile.ends.inverse(parameter - parameter[0])
        at[0], at[-1] = 0.0, profile.ends.total
        waypoints.append(at)
    return PathTiming(path, limits, tuple(motions), tuple(waypoints))
