"""A motion as a file holds it: times, positions, and what else the format carries."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from qparm.path import Trajectory
    from qparm.verify.files import KnotTable

__all__ = [
    "TIME_ROUNDING",
    "MotionTable",
    "motion_of_knots",
    "motion_of_trajectory",
    "same_motion",
    "unusable_numbers",
]

# The points of a JointTrajectory have their times in whole nanoseconds (s).
TIME_ROUNDING = 0.5e-9
ORDERS = ("position", "velocity", "acceleration", "jerk")
# No joint is beyond this (m, rad), nor any derivative (SI), nor a time (s); samples are no nearer to each other (s):
# what is derived from such numbers stays within what floating point can hold.
LARGEST_POSITION, LARGEST_DERIVATIVE, LATEST, SHORTEST_STEP = 1e5, 1e12, 1e12, 0.5e-9


@dataclass(frozen=True, eq=False)
class MotionTable:
    """What a trajectory file holds, in SI, whatever its format.

    Attributes
    ----------
    format : str
        As ``qparm export`` names it.
    joints : tuple of str
        Names, in the file's order.
    t : (T,) ndarray
        s, from the start of the motion.
    q : (T, n) ndarray
        Positions (m, rad).
    velocity, acceleration, jerk : (T, n) ndarray or None
        None where the format has none.
    position_rounding : (n,) ndarray
        How far a position in the file may be from the one that was written (m, rad).
    time_rounding : float
        The same of a time (s).
    row : (T,) ndarray of int or None
    segment : (T,) ndarray of str or None
        Row and kind of segment of every sample, where the format tells them.
    executable : bool
        False if the file is marked not executable.
    stops : (S,) ndarray of int or None
        Samples at which a program stops; None for a file that is no program. Each segment of a program may have
        steps of its own.
    not_told : tuple of str
        What nobody can know from the file, such as how near a controller passes the points of a program.
    """

    format: str
    joints: tuple[str, ...]
    t: NDArray[np.float64]
    q: NDArray[np.float64]
    velocity: NDArray[np.float64] | None
    acceleration: NDArray[np.float64] | None
    jerk: NDArray[np.float64] | None
    position_rounding: NDArray[np.float64]
    time_rounding: float
    row: NDArray[np.int64] | None = None
    segment: NDArray[np.str_] | None = None
    executable: bool = True
    stops: NDArray[np.int64] | None = None
    not_told: tuple[str, ...] = ()


def motion_of_knots(knots: KnotTable) -> MotionTable:
    """Return the motion that a ``trajectory.json`` holds, whatever it is marked."""
    q, velocity, acceleration = knots.derivatives
    return MotionTable(
        "json", knots.joints, knots.t, q, velocity, acceleration, None, np.zeros(len(knots.joints)), TIME_ROUNDING
    )


def motion_of_trajectory(trajectory: Trajectory) -> MotionTable:
    """Return the motion that the ``trajectory.json`` of a trajectory would hold, whatever it would say of itself."""
    t = trajectory.boundaries
    q, velocity, acceleration = (trajectory(t, order) for order in range(3))
    names = trajectory.joint_names
    # as they are read: whole seconds, and nanoseconds
    seconds, nanoseconds = np.divmod(np.round(t * 1e9), 1e9)
    t = seconds + 1e-9 * nanoseconds
    return MotionTable("json", names, t, q, velocity, acceleration, None, np.zeros(len(names)), TIME_ROUNDING)


def same_motion(a: MotionTable, b: MotionTable) -> bool:
    """Return whether two motions are equal to the last bit."""
    columns = ("t", "q", "velocity", "acceleration")
    return a.joints == b.joints and all(np.array_equal(getattr(a, key), getattr(b, key)) for key in columns)


def unusable_numbers(
    t: NDArray[np.float64],
    derivatives: Sequence[NDArray[np.float64] | None],
    joints: Sequence[str],
    place: Callable[[int], str],
) -> str:
    """Return what is wrong with the numbers of a motion, where first, as a sentence; empty if nothing is.

    Parameters
    ----------
    t : (T,) ndarray
        s.
    derivatives : sequence of (T, n) ndarray or None
        Position, velocity, acceleration, jerk.
    joints : sequence of str
    place : callable
        Where sample k is, such as ``"line 7"``.
    """
    bad = np.flatnonzero(~np.isfinite(t))
    if len(bad):
        return f"{place(int(bad[0]))}: the time is not finite"
    for order, (name, values) in enumerate(zip(ORDERS, derivatives, strict=False)):
        if values is None:
            continue
        largest = LARGEST_DERIVATIVE if order else LARGEST_POSITION
        bad = np.argwhere(~(np.abs(values) <= largest))
        if len(bad):
            k, joint = (int(x) for x in bad[0])
            value = values[k, joint]
            beyond = f"beyond {largest:g} (SI)" if np.isfinite(value) else "not finite"
            return f"{place(k)}: the {name} of joint {joints[joint]!r} is {value:g}, {beyond}"
    if t[0] < 0:
        return f"{place(0)}: the time {t[0]:.9g} s is negative"
    if not np.abs(t).max() <= LATEST:
        return f"{place(len(t) - 1)}: the time {t[-1]:.9g} s is beyond {LATEST:g} s"
    bad = np.flatnonzero(np.diff(t) < SHORTEST_STEP)
    if len(bad):
        k = int(bad[0]) + 1
        return f"{place(k)}: the time {t[k]:.9g} s does not come after the {t[k - 1]:.9g} s before it"
    return ""
