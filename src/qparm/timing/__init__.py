"""Timing: from a joint path to a trajectory, in two output forms."""

from qparm.timing.jerk_limited import ruckig_trajectory
from qparm.timing.quintic import QuinticTiming, quintic_timing, quintic_trajectory

__all__ = ["QuinticTiming", "quintic_timing", "quintic_trajectory", "ruckig_trajectory"]
