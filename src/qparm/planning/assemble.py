"""From configurations at the points to a joint path in segments: nothing is smoothed over, nothing is hidden."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from qparm.path import JointPath, Segment, SegmentKind, ToolPath
from qparm.path.joint_path import NO_POINT

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.ik import PoseSolution
    from qparm.robot import SerialChain

__all__ = ["assemble"]


class _Waypoints:
    """Collects waypoints and segments in order."""

    def __init__(self) -> None:
        self.q: list[NDArray[np.float64]] = []
        self.point: list[int] = []
        self.row: list[int] = []
        self.kind: list[SegmentKind] = []
        self.status: list[str] = []
        self.s: list[float] = []
        self.segments: list[Segment] = []

    def add(self, q: NDArray[np.float64], point: int, row: int, kind: SegmentKind, status: str, s: float) -> None:
        self.q.append(q)
        self.point.append(point)
        self.row.append(row)
        self.kind.append(kind)
        self.status.append(status)
        self.s.append(s)

    def segment(self, kind: SegmentKind, row: int) -> None:
        """Join the last two waypoints by a segment, prolonging the last one if it is of the same run."""
        last = len(self.q) - 1
        if self.segments and kind in (SegmentKind.ROW, SegmentKind.TRANSITION):
            previous = self.segments[-1]
            if previous.kind is kind and previous.row == row:
                self.segments[-1] = Segment(kind, row, previous.first, last)
                return
        self.segments.append(Segment(kind, row, last - 1, last))


def assemble(
    chain: SerialChain,
    tool_path: ToolPath,
    home: NDArray[np.float64],
    q_of_points: NDArray[np.float64],
    reached_points: NDArray[np.bool_],
    via_solutions: Sequence[Sequence[PoseSolution]],
    jump: NDArray[np.float64],
) -> JointPath:
    """Return the joint path of what was reached, with a break wherever the tool path could not be followed.

    Parameters
    ----------
    chain : SerialChain
    tool_path : ToolPath
    home : (n,) ndarray
        First and last waypoint.
    q_of_points : (P, n) ndarray
        A configuration for each point (m, rad); those of points that were not reached are not used.
    reached_points : (P,) ndarray of bool
    via_solutions : sequence of sequence of PoseSolution
        For each transition, its via poses.
    jump : (n,) ndarray
        A larger joint step between neighbours is a jump (m, rad).

    Returns
    -------
    JointPath
    """

    def jumps(a: NDArray[np.float64], b: NDArray[np.float64]) -> bool:
        return bool((np.abs(b - a) > jump).any())

    way = _Waypoints()
    way.add(home, NO_POINT, NO_POINT, SegmentKind.APPROACH, "reached", 0.0)
    reached: list[int] = np.flatnonzero(reached_points).tolist()
    row_of_point, s = tool_path.row_of_point, tool_path.s
    for previous, k in pairwise([None, *reached]):
        assert k is not None
        q, row = q_of_points[k], int(row_of_point[k])
        if previous is None:
            way.add(q, k, row, SegmentKind.ROW, "reached" if k == 0 else "after gap", s[k])
            way.segment(SegmentKind.APPROACH, NO_POINT)
            continue
        q_previous, row_previous = q_of_points[previous], int(row_of_point[previous])
        gap = k != previous + 1
        if row == row_previous:
            jumped = jumps(q_previous, q)
            status = "after gap" if gap else "after jump" if jumped else "reached"
            way.add(q, k, row, SegmentKind.ROW, status, s[k])
            way.segment(SegmentKind.ROW if status == "reached" else SegmentKind.BREAK, row)
            continue
        vias = via_solutions[row_previous] if not gap else []
        chainlink = [q_previous, *(via.q for via in vias), q]
        broken = not all(via.reached for via in vias)
        jumped = any(jumps(a, b) for a, b in pairwise(chainlink))
        if gap or broken or jumped:
            status = "after gap" if gap or (broken and not jumps(q_previous, q)) else "after jump"
            way.add(q, k, row, SegmentKind.ROW, status, s[k])
            way.segment(SegmentKind.BREAK, row_previous)
            continue
        transition = tool_path.transitions[row_previous]
        for via, via_s in zip(vias, transition.s, strict=True):
            way.add(via.q, NO_POINT, row_previous, SegmentKind.TRANSITION, "reached", float(via_s))
            way.segment(SegmentKind.TRANSITION, row_previous)
        way.add(q, k, row, SegmentKind.ROW, "reached", s[k])
        way.segment(SegmentKind.TRANSITION, row_previous)
    if reached:
        way.add(home, NO_POINT, NO_POINT, SegmentKind.RETRACT, "reached", 0.0)
        way.segment(SegmentKind.RETRACT, NO_POINT)
    return JointPath(
        joint_names=chain.names,
        q=np.array(way.q),
        point=np.array(way.point, dtype=np.int64),
        row=np.array(way.row, dtype=np.int64),
        kind=tuple(way.kind),
        status=tuple(way.status),
        s=np.array(way.s, dtype=float),
        segments=tuple(way.segments),
    )
