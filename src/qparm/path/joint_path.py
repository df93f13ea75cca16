"""The joint path: one configuration per waypoint, in segments by kind. Data, no planning."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from qparm.errors import InvalidInput
from qparm.names import wrong_joint_names
from qparm.path.curve import joint_curve

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from scipy.interpolate import BSpline

__all__ = ["NO_POINT", "Deviations", "JointPath", "Segment", "SegmentKind"]

# The point and row of a waypoint that is none of the raster, such as home.
NO_POINT = -1


class SegmentKind(StrEnum):
    """What the arm does on a segment, and what a waypoint belongs to."""

    APPROACH = "approach"
    ROW = "row"
    TRANSITION = "transition"
    BREAK = "break"
    RETRACT = "retract"


@dataclass(frozen=True)
class Segment:
    """A piece of the path that is moved through without a stop.

    Attributes
    ----------
    kind : SegmentKind
    row : int
        The row it belongs to (a transition: the row it leaves), -1 for approach and retract.
    first, last : int
        Its waypoints, both included; the next segment starts at ``last``.
    flows : bool
        Whether the next segment follows without a stop; else the arm is at rest there.
    """

    kind: SegmentKind
    row: int
    first: int
    last: int
    flows: bool = False

    @property
    def process_on(self) -> bool:
        """Whether the tool works on the surface."""
        return self.kind is SegmentKind.ROW


@dataclass(frozen=True, eq=False)
class Deviations:
    """How far the tool is off its path between neighbouring waypoints, by interpolation; NaN off rows and transitions.

    Attributes
    ----------
    curve_position, curve_rotation : (N - 1,) ndarray
        On the path's curve (m, rad).
    linear_position, linear_rotation : (N - 1,) ndarray
        Where the joints are interpolated linearly, as many controllers do.
    """

    curve_position: NDArray[np.float64]
    curve_rotation: NDArray[np.float64]
    linear_position: NDArray[np.float64]
    linear_rotation: NDArray[np.float64]

    def exact(self, position: float, rotation: float) -> NDArray[np.bool_]:
        """Return which gaps keep a tolerance on the curve, (N - 1,); those off rows and transitions do."""
        return ~((self.curve_position > position) | (self.curve_rotation > rotation))


@dataclass(frozen=True, eq=False)
class JointPath:
    """Waypoints in joint space, from home over the rows back to home, and the curve through them.

    Points that were not reached have no waypoint; the segments that bridge them are breaks. A row may have
    waypoints that are no points: they keep the curve on the surface.

    Attributes
    ----------
    joint_names : tuple of str
    q : (N, n) ndarray
        Configurations (m, rad).
    point : (N,) ndarray of int
        Index of the tool path's point, -1 for a waypoint that is none.
    row : (N,) ndarray of int
        Row from 0, -1 for home.
    kind : tuple of SegmentKind
        What each waypoint belongs to.
    status : tuple of str
        ``"reached"``, or what happened on the way to the waypoint: ``"after gap"``, ``"after jump"``.
    s : (N,) ndarray
        Arc length of the tool from the row's (or transition's) start (m).
    segments : tuple of Segment
        In order, each starting where the one before ends.
    parameters : tuple of (k,) ndarray
        For each segment the parameter of its waypoints, ascending: the tool's arc length on rows and transitions (m),
        a length in joint space elsewhere. By default the waypoints are counted.
    deviations : Deviations, optional
        How exact the path is between the waypoints.
    """

    joint_names: tuple[str, ...]
    q: NDArray[np.float64]
    point: NDArray[np.int64]
    row: NDArray[np.int64]
    kind: tuple[SegmentKind, ...]
    status: tuple[str, ...]
    s: NDArray[np.float64]
    segments: tuple[Segment, ...]
    parameters: tuple[NDArray[np.float64], ...] = ()
    deviations: Deviations | None = None

    def __post_init__(self) -> None:
        wrong = wrong_joint_names(self.joint_names)
        if wrong:
            raise InvalidInput(wrong)
        N = len(self.q)
        if self.q.shape != (N, len(self.joint_names)):
            raise InvalidInput(f"q must be (N, {len(self.joint_names)}), not {self.q.shape}")
        for name in ("point", "row", "kind", "status", "s"):
            if len(getattr(self, name)) != N:
                raise InvalidInput(f"{name} must have {N} entries, one per waypoint, not {len(getattr(self, name))}")
        if not np.isfinite(self.q).all():
            index = int(np.flatnonzero(~np.isfinite(self.q).all(axis=1))[0])
            raise InvalidInput(f"waypoint {index} has a joint value that is not finite")
        if self.segments:
            ends = [(segment.first, segment.last) for segment in self.segments]
            chained = all(a[1] == b[0] for a, b in pairwise(ends))
            ascending = all(first < last for first, last in ends)
            if not (chained and ascending and ends[0][0] == 0 and ends[-1][1] == N - 1):
                raise InvalidInput("segments must follow each other from the first waypoint to the last")
            if self.segments[-1].flows:
                raise InvalidInput("the last segment has none to flow on into")
        if not self.parameters:
            counted = tuple(np.arange(float(g.last - g.first + 1)) for g in self.segments)
            object.__setattr__(self, "parameters", counted)
        if [len(x) for x in self.parameters] != [g.last - g.first + 1 for g in self.segments]:
            raise InvalidInput("each segment needs one parameter for each of its waypoints")

    def __repr__(self) -> str:
        kinds = [segment.kind for segment in self.segments]
        parts = ", ".join(f"{kinds.count(kind)} {kind.value}" for kind in SegmentKind if kind in kinds)
        return f"JointPath({len(self.q)} waypoints of {self.n} joints; segments: {parts or 'none'})"

    @cached_property
    def runs(self) -> tuple[range, ...]:
        """The segments between two stops, as ranges of indices: one segment each unless it flows on into the next."""
        ends = [index + 1 for index, segment in enumerate(self.segments) if not segment.flows]
        return tuple(range(first, end) for first, end in pairwise([0, *ends]))

    def waypoints(self, run: range) -> NDArray[np.float64]:
        """Return the waypoints of a run, (k, n)."""
        return self.q[self.segments[run[0]].first : self.segments[run[-1]].last + 1]

    def run_parameter(self, run: range) -> NDArray[np.float64]:
        """Return the parameter of a run's waypoints, (k,): that of its first segment, and on from there."""
        parameter = [self.parameters[run[0]]]
        for index in run[1:]:
            own = self.parameters[index]
            parameter.append(parameter[-1][-1] + own[1:] - own[0])
        return np.concatenate(parameter)

    def run_curve(self, run: range) -> BSpline:
        """Return q(s) on a run of :attr:`runs`: the C4 quintic spline through its waypoints.

        Parameters
        ----------
        run : range

        Returns
        -------
        scipy.interpolate.BSpline
            Defined between the first and the last of :meth:`run_parameter`.
        """
        return joint_curve(self.run_parameter(run), self.waypoints(run))

    def curve(self, segment: int) -> BSpline:
        """Return q(s) on a segment: that of its run, with the segment's own parameter.

        Parameters
        ----------
        segment : int
            From 0. Two waypoints are joined by a straight line.

        Returns
        -------
        scipy.interpolate.BSpline
            Between the first and the last of ``parameters[segment]``.
        """
        from scipy.interpolate import BSpline

        if not 0 <= segment < len(self.segments):
            raise InvalidInput(f"segment must lie between 0 and {len(self.segments) - 1}, not {segment}")
        run = next(run for run in self.runs if segment in run)
        whole = self.run_curve(run)
        begins = self.segments[segment].first - self.segments[run[0]].first
        if not begins:
            return whole
        shift = self.parameters[segment][0] - self.run_parameter(run)[begins]
        return BSpline(whole.t + shift, whole.c, whole.k)

    @property
    def n(self) -> int:
        """The number of joints."""
        return len(self.joint_names)

    @property
    def breaks(self) -> tuple[Segment, ...]:
        """The segments on which the tool leaves its path because a point or a jump lies in between."""
        return tuple(segment for segment in self.segments if segment.kind is SegmentKind.BREAK)
