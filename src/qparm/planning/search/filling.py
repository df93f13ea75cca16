"""Poses put in between points that lie far apart, so that a path is searched and smoothed in small steps.

The tool path is continuous; how far its points lie apart is the user's matter. Where two points of a row are farther
apart than an arm can be followed from one to the next, poses of the row's own curve are put between them. They are
searched and smoothed like points, become waypoints that are no points, and are left out of every count of points.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from qparm.path import Row, ToolPath
from qparm.path.joint_path import NO_POINT
from qparm.planning.solution import PathSolution, at_knots

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.robot import SerialChain

__all__ = ["FilledPath", "filled"]

# Neighbours farther apart than this share of the characteristic length, or turned by more (rad), are filled in.
_GAP_LENGTH, _GAP_ANGLE = 0.2, np.radians(10.0)
# ... with no more poses than this between two points.
_MOST = 200


@dataclass(frozen=True, eq=False)
class FilledPath(ToolPath):
    """A tool path with poses put in between its points.

    Attributes
    ----------
    asked : ToolPath
        The path that was filled in.
    number : (K,) ndarray of int
        Of each point, which it is of ``asked``; -1 for those put in.
    """

    asked: ToolPath | None = None
    number: NDArray[np.int64] | None = None

    @property
    def given(self) -> ToolPath:
        """The path that was filled in."""
        return self if self.asked is None else self.asked

    @cached_property
    def points(self) -> NDArray[np.int64]:
        """Which are the points of the path that was filled in, (P,)."""
        if self.number is None:
            return np.arange(self.point_count)
        return np.flatnonzero(self.number != NO_POINT)

    @cached_property
    def in_self_motion_area(self) -> NDArray[np.bool_]:
        """Which points, and poses between two of them, belong to a self-motion area besides its edge, (K,)."""
        area = self.given.in_self_motion_area if self.asked is not None else super().in_self_motion_area
        if self.number is None:
            return area
        place = np.searchsorted(self.points, np.arange(self.point_count), side="right") - 1
        own = self.number != NO_POINT
        # a pose that was put in has a point of its row on either side
        return np.where(own, area[place], area[place] & area[np.minimum(place + 1, len(area) - 1)])

    def without(self, left_out: NDArray[np.bool_]) -> FilledPath:
        """Return the path without some of the poses that were put in, (K,)."""
        rows, offset = [], 0
        for row in self.rows:
            kept = ~left_out[offset : offset + len(row.s)]
            rows.append(Row(row.s[kept], np.ascontiguousarray(row.poses[kept]), row.curve))
            offset += len(row.s)
        number = np.arange(self.point_count) if self.number is None else self.number
        return FilledPath(
            tuple(rows), self.transitions, self.pose_base_workpiece, self.self_motion_points, self.given,
            number[~left_out],
        )  # fmt: skip

    def trimmed(self, solution: PathSolution) -> tuple[FilledPath, PathSolution]:
        """Return path and solution without the poses between two points that are not driven from one to the other."""
        if len(self.points) == self.point_count:
            return self, solution
        broken = np.concatenate([[0], np.cumsum(~solution.driven)])
        place = np.searchsorted(self.points, np.arange(self.point_count), side="right") - 1
        before = self.points[place]
        after = self.points[np.minimum(place + 1, len(self.points) - 1)]
        own = np.zeros(self.point_count, dtype=bool)
        own[self.points] = True
        left_out = ~own & (broken[after] > broken[before])
        kept = np.flatnonzero(~left_out)
        return self.without(left_out), at_knots(solution, kept)

    def of_points(self, solution: PathSolution) -> PathSolution:
        """Return the solution at the points of the path that was filled in."""
        return at_knots(solution, self.points)


def filled(chain: SerialChain, tool_path: ToolPath, *, fill: bool = True) -> FilledPath:
    """Return a tool path with poses put in between neighbouring points of a row that lie far apart.

    Parameters
    ----------
    chain : SerialChain
        Its characteristic length says what is far.
    tool_path : ToolPath
    fill : bool
        Without, the path keeps its points and no others.
    """
    rows, numbers, first = [], [], 0
    for row in tool_path.rows:
        c = len(row.s)
        number = np.arange(first, first + c)
        first += c
        gaps = np.minimum(_gaps(chain, row), _MOST) if fill else np.ones(c - 1, dtype=np.int64)
        if (gaps > 1).any():
            ways = zip(row.s[:-1], row.s[1:], gaps, strict=True)
            s = np.concatenate([*(np.linspace(a, b, n, endpoint=False) for a, b, n in ways), row.s[-1:]])
            own = np.concatenate([[0], np.cumsum(gaps)])
            # the points stay as they are given, to the last bit
            s[own] = row.s
            poses = np.array(row.curve(s))
            poses[own] = row.poses
            put_in = np.full(len(s), NO_POINT, dtype=np.int64)
            put_in[own] = number
            row, number = Row(s, poses, row.curve), put_in
        rows.append(row)
        numbers.append(number)
    if all(len(row.s) == len(own.s) for row, own in zip(rows, tool_path.rows, strict=True)):
        rows = list(tool_path.rows)
    return FilledPath(
        tuple(rows), tool_path.transitions, tool_path.pose_base_workpiece, tool_path.self_motion_points, tool_path,
        np.concatenate(numbers),
    )  # fmt: skip


def _gaps(chain: SerialChain, row: Row) -> NDArray[np.int64]:
    """Return into how many steps each gap between neighbouring points is cut, (c - 1,)."""
    R = row.poses[:, :3, :3]
    angle = np.arccos(np.clip(0.5 * (np.einsum("kij,kij->k", R[1:], R[:-1]) - 1.0), -1.0, 1.0))
    way = np.maximum(np.linalg.norm(np.diff(row.poses[:, :3, 3], axis=0), axis=1), np.diff(row.s))
    # a step hardly too long is none to be cut
    steps = np.maximum(way / (_GAP_LENGTH * chain.characteristic_length), angle / _GAP_ANGLE)
    return np.maximum(1, np.ceil(steps - 0.01)).astype(np.int64)
