"""Timing: from a joint path to a trajectory, in two output forms."""

from qparm.timing.forms import FORMS, TimingForm
from qparm.timing.jerk_limited import ruckig_form, ruckig_trajectory
from qparm.timing.law import PathTiming, time_path
from qparm.timing.path_speed import FeedSections, SpeedProfile, fastest_profile
from qparm.timing.quintic import quintic_form, quintic_trajectory
from qparm.timing.straight import StraightMotion, straight_duration, straight_motion
from qparm.timing.waypoints import (
    find_kinks,
    find_reversals,
    fit_band,
    largest_bulge,
    rounded_to,
    same_distance,
    time_waypoints,
)

__all__ = [
    "FORMS",
    "FeedSections",
    "PathTiming",
    "SpeedProfile",
    "StraightMotion",
    "TimingForm",
    "fastest_profile",
    "find_kinks",
    "find_reversals",
    "fit_band",
    "largest_bulge",
    "quintic_form",
    "quintic_trajectory",
    "rounded_to",
    "ruckig_form",
    "ruckig_trajectory",
    "same_distance",
    "straight_duration",
    "straight_motion",
    "time_path",
    "time_waypoints",
]


def __dir__() -> list[str]:
    return sorted(__all__)
