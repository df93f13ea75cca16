"""Quality figures of a plan, as data, and what in them speaks against its files."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from qparm.verify.finding import AT_LIMIT, LIMIT_SLACK, Finding

if TYPE_CHECKING:
    from qparm.cell.work import Process
    from qparm.verify.between import BetweenFigures
    from qparm.verify.clearance import ClearanceFigures
    from qparm.verify.motion_report import MotionReport
    from qparm.verify.row_feed import RowFeed

__all__ = ["Figures", "JointFigures", "Jump", "Unreached"]

# What the files of a plan say of one place is the same to this (m, rad).
_SAME = 1e-6


@dataclass(frozen=True)
class Unreached:
    """A point without a configuration within tolerance: where it is."""

    index: int
    row: int
    reason: str


@dataclass(frozen=True)
class Jump:
    """A step over the jump criterion between two points of a row, or across a row's end.

    Attributes
    ----------
    first, last : int
        Points of the raster; more than one apart if points between them are missing.
    row, row_last : int
    joint : str
        The joint that exceeds the criterion most.
    step : float
        Its step (m or rad).
    ratio : float
        Step over criterion.
    place : str
        ``"row"``, ``"row end"`` (a self-motion area) or ``"gap"`` (points between the two are missing).
    """

    first: int
    last: int
    row: int
    row_last: int
    joint: str
    step: float
    ratio: float
    place: str


@dataclass(frozen=True)
class JointFigures:
    """One joint: steps, distances to limits, shares of limits.

    Attributes
    ----------
    name, unit : str
    largest_step : float
        Between neighbouring points of a row.
    limit_distance_waypoints, limit_distance_trajectory : float
        Least distance to a position limit; negative outside.
    velocity_share, acceleration_share, jerk_share : float
        Largest absolute value over the limit: between the knots, where they are interpolated quintically, and at the
        samples.
    """

    name: str
    unit: str
    largest_step: float
    limit_distance_waypoints: float
    limit_distance_trajectory: float
    velocity_share: float
    acceleration_share: float
    jerk_share: float


@dataclass(frozen=True)
class Figures:
    """All that was measured; SI units.

    Attributes
    ----------
    points, reached : int
        Points of the raster, and those with a waypoint within tolerance.
    unreached : tuple of Unreached
    position_error_max, position_error_mean, rotation_error_max, rotation_error_mean : float
        At the points that have a waypoint (m, rad); NaN if there is none.
    jumps : tuple of Jump
        Where the arm would go from one point to the next without a motion of its own.
    reconfigurations : tuple of Jump
        Where a motion off the surface joins two points, whatever their step.
    faster_than_feed : int
        Neighbouring points whose step no joint limit of velocity allows in the time of the feed.
    largest_step_revolute, largest_step_prismatic : float
        Between neighbouring points of a row (rad, m).
    singular_value_min : float
        Of the scaled Jacobian over the points that have a waypoint; NaN if there is none.
    singular_value_index : int
        The point at which it is found, -1 if there is none.
    joints : tuple of JointFigures
    duration : float
        s.
    waypoint_deviation : float
        Largest difference between a waypoint and the knot that is to pass it (m, rad).
    sample_deviation : float
        Largest difference between a sample's position and the interpolated knots (m, rad).
    surface_deviation : float
        Largest distance of the tool from the stand-off surface on rows, at 32 places between every two points (m); NaN
        where no surface is known.
    tool_speed_max, tool_speed_mean : float
        Speed of the tool along rows, over the same places (m/s).
    columns_consistent : bool
        Whether every column is the integral of the next within what the limits on jerk allow.
    between : BetweenFigures
        How exact the path is between its waypoints.
    clearance : ClearanceFigures
        How near the tool comes to the workpiece off the rows.
    feed : RowFeed
        How well rows keep the feed.
    """

    points: int
    reached: int
    unreached: tuple[Unreached, ...]
    position_error_max: float
    position_error_mean: float
    rotation_error_max: float
    rotation_error_mean: float
    jumps: tuple[Jump, ...]
    reconfigurations: tuple[Jump, ...]
    faster_than_feed: int
    largest_step_revolute: float
    largest_step_prismatic: float
    singular_value_min: float
    singular_value_index: int
    joints: tuple[JointFigures, ...]
    duration: float
    waypoint_deviation: float
    sample_deviation: float
    surface_deviation: float
    tool_speed_max: float
    tool_speed_mean: float
    columns_consistent: bool
    between: BetweenFigures
    clearance: ClearanceFigures
    feed: RowFeed

    def findings(self, motion: MotionReport | None, process: Process) -> tuple[Finding, ...]:
        """Return what else speaks against the files of a plan, besides what is found of the motion itself.

        Parameters
        ----------
        motion : MotionReport or None
            What was found of the motion; what it says already is not said again.
        process : Process
            The cell's: a trajectory keeps to the joint path within its tolerances between points, and may pass a
            waypoint as far off. How far the tool is off the points is found of the motion.
        """
        told = {(one.code, one.subject) for one in motion.findings} if motion is not None else set()
        found = []
        for joint in self.joints:
            subject, outside = (
                f"joint {joint.name!r}",
                -min(joint.limit_distance_waypoints, joint.limit_distance_trajectory),
            )
            if outside > AT_LIMIT:
                found.append(Finding("position", subject, "is outside its limits in the files by", amount=outside,
                                     limit=0.0, unit=joint.unit))  # fmt: skip
            for order in ("velocity", "acceleration", "jerk"):
                share = getattr(joint, f"{order}_share")
                if share > 1 + LIMIT_SLACK:
                    found.append(
                        Finding(order, subject, f"{order} in the files", amount=share, limit=1.0, unit="share")
                    )
        found = [one for one in found if (one.code, one.subject) not in told]
        missed = sum(one.code == "point" for one in motion.findings) if motion is not None else self.points
        if self.points - self.reached > missed:
            found.append(
                Finding("files-differ", "joint path", "points without a waypoint within tolerance, of those passed:",
                        amount=self.points - self.reached - missed, limit=0.0)
            )  # fmt: skip
        allowed = max(_SAME, process.position_between, process.rotation_between)
        if self.waypoint_deviation > allowed:
            found.append(
                Finding("files-differ", "trajectory", "misses a waypoint of the joint path by (m or rad)",
                        amount=self.waypoint_deviation, limit=allowed)
            )  # fmt: skip
        if self.sample_deviation > _SAME:
            found.append(
                Finding("files-differ", "samples", "differ from the trajectory between its points by (m or rad)",
                        amount=self.sample_deviation, limit=_SAME)
            )  # fmt: skip
        if not self.columns_consistent:
            found.append(Finding("files-differ", "samples", "their columns are not derivatives of each other"))
        return tuple(found)
