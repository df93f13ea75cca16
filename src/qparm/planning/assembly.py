"""From configurations at the points to a joint path in segments: exact between points, breaks planned as motions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from qparm.path import Deviations, JointPath, Segment, SegmentKind
from qparm.path.joint_path import NO_POINT
from qparm.path.relaxation import Relaxation
from qparm.planning.interpolation.corners import resting, rows_meet
from qparm.planning.interpolation.exact import PoseOf, Stretch, exact_stretch, inset, is_exact
from qparm.planning.interpolation.flow import Piece, flowing
from qparm.planning.moves.breaks import Motion, MotionFailure, plan_motion
from qparm.planning.search.bundle import nearest_way
from qparm.planning.search.continuity import is_continuous
from qparm.planning.search.filling import FilledPath
from qparm.planning.search.projection import velocity_scale
from qparm.planning.smoothing.turns import between as between_ends
from qparm.planning.tolerances import TRANSITION_MARGIN
from qparm.planning.why import why_broken

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.planning.problem import PathProblem
    from qparm.planning.solution import PathSolution
    from qparm.robot import SerialChain

__all__ = ["BreakRecord", "assemble", "undriven"]

# So many breaks inside rows are explained: who makes more has a path of another kind, and no use for all reasons.
_EXPLAINED = 40


@dataclass(frozen=True)
class BreakRecord:
    """One motion off the path: approach, retract, or a break.

    Attributes
    ----------
    kind : SegmentKind
    first, last : int
        Points before and after it, -1 for home.
    row : int
        Of the first point, or of the last after home.
    place : str
        ``"home"``, ``"row"``, ``"row end"`` (a self-motion area) or ``"gap"`` (points between the two are not reached).
    escape : str
        How the surface is left; empty if no motion was found.
    clearance : float
        Least distance from the workpiece on the way (m); NaN if no surface is known.
    time : float
        From its first to its last waypoint (s): in a plan, that of the trajectory; before, an estimate.
    failure : str
        Why no motion was found; the arm would go straight, through whatever is there. Empty if one was.
    why : str
        Of a break inside a row, what stops the arm on either side; of the first forty.
    """

    kind: SegmentKind
    first: int
    last: int
    row: int
    place: str
    escape: str
    clearance: float
    time: float
    failure: str = ""
    why: str = ""

    @property
    def name(self) -> str:
        """What it is, in words."""
        if self.kind is not SegmentKind.BREAK:
            return "approach from home" if self.kind is SegmentKind.APPROACH else "retract to home"
        where = {"row": f"inside row {self.row}", "row end": f"at an end of row {self.row}"}.get(self.place, "")
        where = where or f"over the points not reached in row {self.row}"
        return f"break {where}, from point {self.first} to {self.last}"


@dataclass(frozen=True)
class _Followed:
    """A run of a row from a point, or a transition to one."""

    kind: SegmentKind
    row: int
    point: int
    piece: Piece


@dataclass
class _Waypoints:
    """Collects waypoints and segments in order."""

    q: list[NDArray[np.float64]] = field(default_factory=list)
    point: list[int] = field(default_factory=list)
    row: list[int] = field(default_factory=list)
    kind: list[SegmentKind] = field(default_factory=list)
    status: list[str] = field(default_factory=list)
    s: list[float] = field(default_factory=list)
    segments: list[Segment] = field(default_factory=list)
    parameters: list[NDArray[np.float64]] = field(default_factory=list)
    deviations: list[NDArray[np.float64]] = field(default_factory=list)

    def add(self, q: NDArray[np.float64], point: int, row: int, kind: SegmentKind, status: str, s: float) -> None:
        self.q.append(q)
        self.point.append(point)
        self.row.append(row)
        self.kind.append(kind)
        self.status.append(status)
        self.s.append(float(s))

    def segment(
        self, kind: SegmentKind, row: int, parameter: NDArray[np.float64], gaps: NDArray[np.float64] | None = None,
        flows: bool = False,
    ) -> None:  # fmt: skip
        """Close a segment of the last ``len(parameter)`` waypoints."""
        last = len(self.q) - 1
        edges = len(parameter) - 1
        self.segments.append(Segment(kind, row, last - edges, last, flows))
        self.parameters.append(parameter)
        self.deviations.append(np.full((edges, 4), np.nan) if gaps is None else gaps)


def assemble(problem: PathProblem, solution: PathSolution) -> tuple[JointPath, tuple[BreakRecord, ...]]:
    """Return the joint path of what was reached, with a motion wherever the tool path could not be followed.

    Parameters
    ----------
    problem : PathProblem
        Of a :class:`qparm.planning.search.filling.FilledPath` the points are counted as in the path that was filled in.
    solution : PathSolution

    Returns
    -------
    joint_path : JointPath
    records : tuple of BreakRecord
        One for each motion off the path, in order.
    """
    chain, tool_path, home, between = problem.chain, problem.tool_path, problem.home, problem.between
    rng = problem.rng(2)
    way, records = _Waypoints(), []
    row_of_point, s, row_ends = tool_path.row_of_point, tool_path.s, problem.row_ends

    def move(kind: SegmentKind, first: int, last: int, place: str) -> None:
        q0 = home if first < 0 else solution.q[first]
        q1 = home if last < 0 else solution.q[last]
        row = int(row_of_point[last if first < 0 else first])
        motion = plan_motion(
            chain, q0, q1, distance=problem.distance, clearance=between.clearance,
            from_surface=first >= 0, to_surface=last >= 0, rng=rng,
        )  # fmt: skip
        segment_row = row if kind is SegmentKind.BREAK else NO_POINT
        status = "reached" if place == "home" else "after gap" if place == "gap" else "after jump"
        end = (home, NO_POINT, NO_POINT, SegmentKind.RETRACT, "reached", 0.0)
        if last >= 0:
            end = (solution.q[last], last, int(row_of_point[last]), SegmentKind.ROW, status, float(s[last]))
        if isinstance(motion, MotionFailure):
            way.add(*end)
            way.segment(kind, segment_row, np.array([0.0, 1.0]))
        else:
            _add_pieces(way, motion, kind, segment_row, end)
        record = _record(motion, kind, first, last, row, place)
        if place == "row" and sum(bool(one.why) for one in records) < _EXPLAINED:
            why = why_broken(problem, solution, first, last)
            record = replace(record, why=why)
        records.append(record)

    followed: list[_Followed] = []

    def close() -> None:
        """Add what was followed without a break."""
        pieces = [one.piece for one in followed]
        if all(transition.flows for transition in tool_path.transitions):
            pieces = flowing(
                chain, pieces, relaxation=problem.relaxation, position=between.position, rotation=between.rotation,
                for_linear=between.for_linear,
            )  # fmt: skip
        for one, piece in zip(followed, pieces, strict=True):
            if one.kind is SegmentKind.ROW:
                _add_row(way, piece, one.point, one.row)
            else:
                _add_transition(way, piece, one.point, one.row, float(s[one.point]))
        followed.clear()

    reached: list[int] = np.flatnonzero(solution.reached).tolist()
    way.add(home, NO_POINT, NO_POINT, SegmentKind.APPROACH, "reached", 0.0)
    at = 0
    while at < len(reached):
        first = reached[at]
        row = int(row_of_point[first])
        if at == 0:
            move(SegmentKind.APPROACH, -1, first, "home")
        last = first
        while at + 1 < len(reached) and reached[at + 1] == last + 1 and _along(solution, row_of_point, last):
            at, last = at + 1, last + 1
        if last > first:
            run = np.arange(first, last + 1)

            def pose_of(x: NDArray[np.float64], row: int = row) -> NDArray[np.float64]:
                return tool_path.pose(row, x)

            stretch = exact_stretch(
                chain, s[run], solution.q[run], solution.rho[run], pose_of, relaxation=problem.relaxation,
                position=between.position, rotation=between.rotation, for_linear=between.for_linear,
            )  # fmt: skip
            followed.append(_Followed(SegmentKind.ROW, row, first, Piece(stretch, pose_of)))
        at += 1
        if at == len(reached):
            close()
            break
        following = reached[at]
        if following == last + 1 and solution.driven[last]:
            transition = _transition(problem, solution, last)
            if transition is not None:
                followed.append(_Followed(SegmentKind.TRANSITION, row, following, transition))
                continue
        close()
        at_end = bool(row_ends[last])
        move(SegmentKind.BREAK, last, following,
             "gap" if following != last + 1 else "row end" if at_end else "row")  # fmt: skip
    if reached:
        move(SegmentKind.RETRACT, reached[-1], -1, "home")
    deviations = np.concatenate(way.deviations) if way.deviations else np.empty((0, 4))
    point = np.array(way.point, dtype=np.int64)
    if isinstance(tool_path, FilledPath) and tool_path.number is not None:
        number = np.append(tool_path.number, NO_POINT)
        point = number[point]
        records = [replace(one, first=int(number[one.first]), last=int(number[one.last])) for one in records]
    path = JointPath(
        joint_names=chain.names,
        q=np.array(way.q),
        point=point,
        row=np.array(way.row, dtype=np.int64),
        kind=tuple(way.kind),
        status=tuple(way.status),
        s=np.array(way.s, dtype=float),
        segments=tuple(way.segments),
        parameters=tuple(way.parameters),
        deviations=Deviations(*(np.ascontiguousarray(column) for column in deviations.T)),
    )
    return path, tuple(records)


def undriven(solution: PathSolution, records: Sequence[BreakRecord]) -> PathSolution:
    """Return the solution without the edges that turned out as breaks: what is found to be near may not be followed."""
    driven = solution.driven.copy()
    driven[[one.first for one in records if one.kind is SegmentKind.BREAK and one.last == one.first + 1]] = False
    return replace(solution, driven=driven)


def _along(solution: PathSolution, row_of_point: NDArray[np.int64], k: int) -> bool:
    """Return whether the arm is driven from point k to the next in the same row."""
    return bool(solution.driven[k]) and row_of_point[k] == row_of_point[k + 1]


def _gaps(stretch: Stretch) -> NDArray[np.float64]:
    columns = (stretch.curve_position, stretch.curve_rotation, stretch.linear_position, stretch.linear_rotation)
    return np.stack(columns, axis=1)


def _add_row(way: _Waypoints, piece: Piece, first: int, row: int) -> None:
    """Add a run of a row whose first waypoint is there already."""
    point, stretch = first, piece.stretch
    for k in range(1, len(stretch.s)):
        point += int(stretch.given[k])
        index = point if stretch.given[k] else NO_POINT
        way.add(stretch.q[k], index, row, SegmentKind.ROW, "reached", stretch.s[k])
    way.segment(SegmentKind.ROW, row, stretch.s, _gaps(stretch), piece.flows)


def _add_transition(way: _Waypoints, piece: Piece, following: int, row: int, s: float) -> None:
    """Add a transition whose first waypoint is there already."""
    stretch = piece.stretch
    for k in range(1, len(stretch.s) - 1):
        way.add(stretch.q[k], NO_POINT, row, SegmentKind.TRANSITION, "reached", stretch.s[k])
    way.add(stretch.q[-1], following, row + 1, SegmentKind.ROW, "reached", s)
    way.segment(SegmentKind.TRANSITION, row, stretch.s, _gaps(stretch), piece.flows)


def _add_pieces(
    way: _Waypoints,
    motion: Motion,
    kind: SegmentKind,
    row: int,
    end: tuple[NDArray[np.float64], int, int, SegmentKind, str, float],
) -> None:
    """Add the pieces of a motion whose first waypoint is there already."""
    for number, (piece, parameter) in enumerate(zip(motion.pieces, motion.parameters, strict=True)):
        final = number == len(motion.pieces) - 1
        for k in range(1, len(piece)):
            if final and k == len(piece) - 1:
                way.add(*end)
            else:
                way.add(piece[k], NO_POINT, row, kind, "reached", parameter[k])
        way.segment(kind, row, parameter)


def _transition(problem: PathProblem, solution: PathSolution, last: int) -> Piece | None:
    """Return the way from a row's last point to the next row's first, or None if the arm cannot follow it."""
    chain, tool_path, relaxation, between = problem.chain, problem.tool_path, problem.relaxation, problem.between
    index = int(tool_path.row_of_point[last])
    transition = tool_path.transitions[index]
    q0, q1, rho0, rho1 = solution.q[last], solution.q[last + 1], solution.rho[last], solution.rho[last + 1]
    length = transition.length
    if rows_meet(transition):
        if np.array_equal(q0, q1):
            return resting(problem, index, q0, rho0)
        # the tool stands while the arm moves from one row's configuration to the next's
        length = float((np.abs(q1 - q0) / velocity_scale(chain)).max()) * chain.characteristic_length
    # a transition without length has its via poses evenly
    even = np.linspace(0.0, 1.0, len(transition.s) + 2)[1:-1]
    share = (transition.s / transition.length if transition.length > 0 else even)[:, None]
    rho = relaxation.clipped((1 - share) * rho0 + share * rho1)
    smoothed = solution.turns.get(index)
    targets = relaxation.targets(np.ascontiguousarray(tool_path.transition_poses(index)), rho)

    def pose_of(x: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.ascontiguousarray(tool_path.pose_base_workpiece @ transition.curve(x * (transition.length / length)))

    def ways() -> Iterator[tuple[NDArray[np.float64], NDArray[np.float64]]]:
        """Yield configurations of the via poses: the smoothed ones; else, or where their curve will not do, others."""
        if smoothed is not None:
            yield smoothed
        # first a little inside the limits: where a joint comes to rest at one, the curve swings beyond it
        for arm in (inset(chain, TRANSITION_MARGIN), chain):
            q, there = between_ends(arm, targets, q0, q1, share)
            if there.all():
                yield q, rho
        # where a joint has no room to turn with the tool, a tool that may turn gives way
        if relaxation.free:
            poses, blend = tool_path.transition_poses(index), (1 - share) * q0 + share * q1
            arm = inset(chain, TRANSITION_MARGIN)
            turned = [nearest_way(arm, *one, relaxation) for one in zip(poses, blend, rho, strict=True)]
            found = [one for one in turned if one is not None]
            if len(found) == len(turned):
                yield np.array([q for q, _ in found]), np.array([lean for _, lean in found])

    for via, lean in ways():
        q = np.concatenate([q0[None], via, q1[None]])
        stretch = exact_stretch(
            chain, length * np.concatenate([[0.0], share[:, 0], [1.0]]), q,
            np.concatenate([rho0[None], lean, rho1[None]]), pose_of, relaxation=relaxation, position=between.position,
            rotation=between.rotation, for_linear=between.for_linear,
        )  # fmt: skip
        # near a singularity the arm turns far from one via pose to the next, but on the path; the criterion of the row
        # end is that of all its steps together
        over = np.flatnonzero((np.abs(np.diff(stretch.q, axis=0)) > problem.criteria[last] / (len(q) - 1)).any(axis=1))
        followed = all(_is_followed(chain, stretch, int(k), pose_of, relaxation) for k in over)
        if followed and is_exact(chain, stretch, position=between.position, rotation=between.rotation):
            return Piece(stretch, pose_of)
    return None


def _is_followed(chain: SerialChain, stretch: Stretch, k: int, pose_of: PoseOf, relaxation: Relaxation) -> bool:
    """Return whether the tool can follow its path over gap k of a stretch."""
    s0, s1 = stretch.s[k], stretch.s[k + 1]
    return is_continuous(
        chain, lambda x: pose_of(s0 + x * (s1 - s0)), stretch.q[k], stretch.q[k + 1], rho0=stretch.rho[k],
        rho1=stretch.rho[k + 1], relaxation=relaxation,
    )  # fmt: skip


def _record(
    motion: Motion | MotionFailure, kind: SegmentKind, first: int, last: int, row: int, place: str
) -> BreakRecord:
    if isinstance(motion, MotionFailure):
        return BreakRecord(kind, first, last, row, place, "", float("nan"), float("nan"), motion.reason)
    return BreakRecord(kind, first, last, row, place, motion.escape, motion.least_clearance, motion.time)
