"""The forms in which a timed path is handed out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from qparm.timing.jerk_limited import ruckig_form, ruckig_trajectory
from qparm.timing.quintic import quintic_form, quintic_trajectory

if TYPE_CHECKING:
    from qparm.path import Trajectory

__all__ = ["FORMS", "TimingForm"]


@dataclass(frozen=True)
class TimingForm:
    """A form.

    Attributes
    ----------
    of_path : callable
        ``of_path(chain, joint_path, feed=, position=, rotation=)`` times an arm's joint path and returns a trajectory.
    of_timing : callable
        ``of_timing(timing)`` returns the trajectory of a :class:`qparm.timing.PathTiming`.
    """

    of_path: Callable[..., Trajectory]
    of_timing: Callable[..., Trajectory]


FORMS = {
    "quintic": TimingForm(quintic_trajectory, quintic_form),
    "ruckig": TimingForm(ruckig_trajectory, ruckig_form),
}
