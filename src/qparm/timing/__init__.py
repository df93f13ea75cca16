"""Timing: from a joint path to a trajectory."""

from qparm.timing.quintic import QuinticTiming, quintic_timing, quintic_trajectory

__all__ = ["QuinticTiming", "quintic_timing", "quintic_trajectory"]
