"""How exact a joint path is between its waypoints on rows and transitions: on its curve, and interpolated linearly."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from qparm.verify.kinematics import joint_transforms, tool_rotation_error

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from qparm.cell import Cell
    from qparm.path import ToolPath
    from qparm.verify.files import WaypointTable

__all__ = ["BetweenFigures", "measure_between"]

# Places in each gap; not those at which the planner looked.
_PLACES = np.array([0.1, 0.3, 0.5, 0.7, 0.9])


@dataclass(frozen=True)
class BetweenFigures:
    """Largest deviations of the tool between waypoints of rows, and of transitions from row to row.

    Attributes
    ----------
    gaps : int
        Looked at: neighbouring waypoints of a row without a break between them.
    off_gaps : int
        Of them those in which the curve is off by more than the cell allows.
    position, rotation : float
        On the quintic spline through the waypoints (m, rad); NaN if there are no gaps.
    linear_position, linear_rotation : float
        With the joints interpolated linearly (m, rad).
    transition_gaps, transition_off_gaps : int
        The same of transitions that the tool follows.
    transition_position, transition_rotation : float
        On the quintic spline through their waypoints (m, rad); NaN if there are none.
    """

    gaps: int
    off_gaps: int
    position: float
    rotation: float
    linear_position: float
    linear_rotation: float
    transition_gaps: int
    transition_off_gaps: int
    transition_position: float
    transition_rotation: float

    def problems(self) -> tuple[str, ...]:
        """Return a sentence each for rows and transitions if the curve is off somewhere."""
        told = (
            ("between the points", self.position, self.rotation, self.off_gaps, self.gaps),
            ("on transitions", self.transition_position, self.transition_rotation, self.transition_off_gaps,
             self.transition_gaps),
        )  # fmt: skip
        return tuple(
            f"{where} the curve is off by up to {position * 1e6:.3g} um and {rotation * 1e6:.3g} urad, beyond the"
            f" tolerance in {off} of {gaps} gaps"
            for where, position, rotation, off, gaps in told
            if off
        )


def measure_between(cell: Cell, waypoints: WaypointTable, tool_path: ToolPath) -> BetweenFigures:
    """Return how far the tool leaves its path between the waypoints of rows and of transitions.

    Parameters
    ----------
    cell : Cell
    waypoints : WaypointTable
    tool_path : ToolPath
        The cell's.
    """
    process = cell.process
    rows = _gaps(cell, [_row_stretch(waypoints, tool_path, *ends) for ends in _row_ends(waypoints)])
    transitions = _gaps(
        cell, [_transition_stretch(waypoints, tool_path, *ends) for ends in _transition_ends(waypoints)]
    )
    beyond, beyond_on_transitions = (
        int(((table[:, 0] > process.position_between) | (table[:, 1] > process.rotation_between)).sum())
        for table in (rows, transitions)
    )
    position, rotation, linear_position, linear_rotation = _largest(rows)
    transition_position, transition_rotation, *_ = _largest(transitions)
    return BetweenFigures(
        gaps=len(rows),
        off_gaps=beyond,
        position=position,
        rotation=rotation,
        linear_position=linear_position,
        linear_rotation=linear_rotation,
        transition_gaps=len(transitions),
        transition_off_gaps=beyond_on_transitions,
        transition_position=transition_position,
        transition_rotation=transition_rotation,
    )


def _largest(table: NDArray[np.float64]) -> list[float]:
    return table.max(axis=0).tolist() if len(table) else [float("nan")] * table.shape[1]


@dataclass(frozen=True, eq=False)
class _Stretch:
    """Waypoints that one curve joins, (k,) and (k, n), and the tool's path along them."""

    s: NDArray[np.float64]
    q: NDArray[np.float64]
    pose: Callable[[NDArray[np.float64]], NDArray[np.float64]]


def _runs(joined: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return first and last waypoint of each run of joined gaps."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], joined, [False]]).astype(np.int8)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def _row_ends(waypoints: WaypointTable) -> list[tuple[int, int]]:
    on_row = waypoints.kind == "row"
    return _runs(on_row[1:] & on_row[:-1] & (np.diff(waypoints.row) == 0) & (waypoints.status[1:] == "reached"))


def _row_stretch(waypoints: WaypointTable, tool_path: ToolPath, first: int, last: int) -> _Stretch:
    row, part = int(waypoints.row[first]), slice(first, last + 1)
    return _Stretch(waypoints.s[part], waypoints.q[part], lambda s: tool_path.pose(row, s))


def _transition_ends(waypoints: WaypointTable) -> list[tuple[int, int]]:
    """Return the last waypoint of a row and the first of the next with via poses in between, and nothing but those."""
    on_row, via = waypoints.kind == "row", waypoints.kind == "transition"
    inner = _runs(via[1:] & via[:-1])
    alone = np.flatnonzero(via & ~np.append(False, via[:-1]) & ~np.append(via[1:], False)).tolist()
    ends = [(first - 1, last + 1) for first, last in sorted([*inner, *((k, k) for k in alone)])]
    return [
        (first, last)
        for first, last in ends
        if first >= 0 and last < len(via) and on_row[first] and on_row[last]
        and waypoints.row[last] == waypoints.row[first] + 1
        and (waypoints.status[first + 1 : last + 1] == "reached").all()
    ]  # fmt: skip


def _transition_stretch(waypoints: WaypointTable, tool_path: ToolPath, first: int, last: int) -> _Stretch:
    way, base = tool_path.transitions[int(waypoints.row[first])], tool_path.pose_base_workpiece
    # at its ends the waypoints have places on rows
    s = np.concatenate([[0.0], waypoints.s[first + 1 : last], [way.length]])
    return _Stretch(s, waypoints.q[first : last + 1], lambda at: base @ way.curve(at))


def _gaps(cell: Cell, stretches: list[_Stretch]) -> NDArray[np.float64]:
    """Return the largest deviations in each gap, (gaps, 4): on the curve and linear, position and rotation."""
    from scipy.interpolate import make_interp_spline

    off: list[NDArray[np.float64]] = [np.empty((0, 4))]
    for stretch in stretches:
        s, q = stretch.s, stretch.q
        at = (s[:-1, None] + np.diff(s)[:, None] * _PLACES).ravel()
        target = stretch.pose(at)
        curve = make_interp_spline(s, q, k=min(5, len(s) - 1))(at)
        linear = (q[:-1, None] + np.diff(q, axis=0)[:, None] * _PLACES[:, None]).reshape(len(at), -1)
        columns = []
        for joints in (curve, linear):
            poses, _ = joint_transforms(cell, joints)
            position = np.linalg.norm(poses[:, :3, 3] - target[:, :3, 3], axis=1)
            rotation = tool_rotation_error(cell, poses[:, :3, :3], target[:, :3, :3])
            columns += [position.reshape(-1, len(_PLACES)).max(axis=1), rotation.reshape(-1, len(_PLACES)).max(axis=1)]
        off.append(np.stack(columns, axis=1))
    return np.concatenate(off)
