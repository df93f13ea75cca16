"""The tool's path: rows over the surface and the self-motion areas between them. Data, no planning."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from qparm.errors import InvalidInput

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["Corner", "Row", "ToolPath", "Transition"]

PoseCurve = Callable[["NDArray[np.float64]"], "NDArray[np.float64]"]


@dataclass(frozen=True, eq=False)
class Row:
    """One row: a continuous curve of tool poses, and the points on it.

    Attributes
    ----------
    s : (c,) ndarray
        Arc length of the tool point from the row's start to each point (m), ascending.
    poses : (c, 4, 4) ndarray
        Tool poses at the points, workpiece frame.
    curve : callable
        ``curve(s)`` gives the (k, 4, 4) poses at arc lengths s, workpiece frame.
    turning_radius : float
        0 where the tool moves. Else it turns on the spot, s is the angle times this radius (m), and the feed is the
        speed at which s grows.
    """

    s: NDArray[np.float64]
    poses: NDArray[np.float64]
    curve: PoseCurve
    turning_radius: float = 0.0

    @property
    def length(self) -> float:
        """Length of the row (m)."""
        return float(self.s[-1])


@dataclass(frozen=True, eq=False)
class Transition:
    """The way from one row's last pose to the next row's first, through the self-motion area.

    Attributes
    ----------
    length : float
        Length of the tool's way, its lift included (m).
    s : (k,) ndarray
        Length of the way to each via pose, ends left out.
    poses : (k, 4, 4) ndarray
        Via poses, workpiece frame.
    curve : callable
        ``curve(s)`` gives the poses at arc lengths s.
    lifted : bool
        Whether the tool leaves the surface on the way.
    flows : bool
        Whether it leads on from the one row and into the other without a corner, four times continuously
        differentiable: then both row ends can be passed without a stop.
    """

    length: float
    s: NDArray[np.float64]
    poses: NDArray[np.float64]
    curve: PoseCurve
    lifted: bool
    flows: bool = False


@dataclass(frozen=True, eq=False)
class Corner:
    """Where the tool has to rest in the middle of what was given as one row.

    Attributes
    ----------
    row : int
        The row of the path that begins there; the one before ends in the same pose.
    line : int
        Of the pose in the list it comes from.
    pose : (4, 4) ndarray
        Workpiece frame.
    angle : float
        By which the direction changes (rad); 0 where the tool begins or ends to turn on the spot.
    what : str
        In words.
    """

    row: int
    line: int
    pose: NDArray[np.float64]
    angle: float
    what: str


@dataclass(frozen=True, eq=False)
class ToolPath:
    """Rows over the surface in the workpiece frame.

    The self-motion area (section 3.2.1 of the paper) is the edge from a row's last pose to the next row's
    first, plus the last and first ``self_motion_points`` poses: there the arm may reconfigure.

    Attributes
    ----------
    rows : tuple of Row
        In the order they are worked, each in its direction of travel.
    transitions : tuple of Transition
        One fewer than rows.
    pose_base_workpiece : (4, 4) ndarray
        Where the workpiece stands in the base frame.
    self_motion_points : int
        k >= 0.
    corners : tuple of Corner
        Row ends that are corners of a row as it was given.
    """

    rows: tuple[Row, ...]
    transitions: tuple[Transition, ...]
    pose_base_workpiece: NDArray[np.float64]
    self_motion_points: int = 0
    corners: tuple[Corner, ...] = field(default=(), kw_only=True)

    def __repr__(self) -> str:
        way = sum(row.length for row in self.rows)
        return f"ToolPath({len(self.rows)} rows, {self.point_count} points, {way:.4g} m)"

    @cached_property
    def row_of_point(self) -> NDArray[np.int64]:
        """The row of each point, (P,)."""
        return np.repeat(np.arange(len(self.rows)), [len(row.s) for row in self.rows])

    @cached_property
    def s(self) -> NDArray[np.float64]:
        """Arc length of each point within its row, (P,), m."""
        return np.concatenate([row.s for row in self.rows])

    @cached_property
    def poses(self) -> NDArray[np.float64]:
        """Tool poses of all points in the base frame, (P, 4, 4)."""
        return np.ascontiguousarray(self.pose_base_workpiece @ np.concatenate([row.poses for row in self.rows]))

    @cached_property
    def in_self_motion_area(self) -> NDArray[np.bool_]:
        """Which points belong to a self-motion area besides its edge, (P,); those beside a corner do not."""
        marks = []
        k, corners = self.self_motion_points, {corner.row for corner in self.corners}
        for i, row in enumerate(self.rows):
            mark = np.zeros(len(row.s), dtype=bool)
            if k and i > 0 and i not in corners:
                mark[:k] = True
            if k and i < len(self.rows) - 1 and i + 1 not in corners:
                mark[-k:] = True
            marks.append(mark)
        return np.concatenate(marks)

    @property
    def point_count(self) -> int:
        """P, the number of points."""
        return len(self.s)

    def pose(self, row: int, s: NDArray[np.float64] | float) -> NDArray[np.float64]:
        """Return tool poses anywhere on a row, base frame.

        Parameters
        ----------
        row : int
            From 0.
        s : float or (k,) ndarray
            Arc length from the row's start (m).

        Returns
        -------
        (4, 4) or (k, 4, 4) ndarray
        """
        if not 0 <= row < len(self.rows):
            raise InvalidInput(f"row must lie between 0 and {len(self.rows) - 1}, not {row}")
        length = self.rows[row].length
        if not (np.min(s, initial=0.0) >= -1e-9 and np.max(s, initial=0.0) <= length + 1e-9):
            raise InvalidInput(f"arc lengths of row {row} must lie between 0 and {length:.6f} m")
        poses = self.pose_base_workpiece @ self.rows[row].curve(np.atleast_1d(np.asarray(s, dtype=float)))
        return poses[0] if np.ndim(s) == 0 else poses

    def transition_poses(self, index: int) -> NDArray[np.float64]:
        """Return the via poses of a transition, base frame, (k, 4, 4)."""
        if not 0 <= index < len(self.transitions):
            raise InvalidInput(f"transition must lie between 0 and {len(self.transitions) - 1}, not {index}")
        return self.pose_base_workpiece @ self.transitions[index].poses
