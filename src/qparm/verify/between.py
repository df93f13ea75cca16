"""The exactness of a joint path between its waypoints: on its curve and by linear joint interpolation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from qparm.verify.kinematics import joint_transforms, tool_rotation_error

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray
    from scipy.interpolate import BSpline

    from qparm.cell import Cell
    from qparm.path import ToolPath
    from qparm.verify.files import WaypointTable

__all__ = ["BetweenFigures", "JoinedRun", "joined_runs", "measure_between"]

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


def measure_between(
    cell: Cell, waypoints: WaypointTable, tool_path: ToolPath, *, rests: NDArray[np.bool_] | None = None
) -> BetweenFigures:
    """Return how far the tool leaves its path between the waypoints of rows and of transitions.

    Parameters
    ----------
    cell : Cell
    waypoints : WaypointTable
    tool_path : ToolPath
        The cell's.
    rests : (N,) ndarray of bool, optional
        At which waypoints the arm rests: between a row and a transition, the curve begins anew there. By default at
        all of them.
    """
    process = cell.process
    table, on_transition = _gaps(cell, waypoints, tool_path, rests)
    rows, transitions = table[~on_transition], table[on_transition]
    beyond, beyond_on_transitions = (
        int(((part[:, 0] > process.position_between) | (part[:, 1] > process.rotation_between)).sum())
        for part in (rows, transitions)
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
class JoinedRun:
    """Gaps between waypoints of rows and transitions that lie on one curve.

    Attributes
    ----------
    edges : (m,) ndarray of int
        The waypoints at which the gaps begin, one after the other.
    on_transition : (m,) ndarray of bool
    first, last : (m,) ndarray
        Where each gap begins and ends on its row or transition (m).
    s : (m + 1,) ndarray
        The curve's parameter at the waypoints, from 0 (m).
    curve : scipy.interpolate.BSpline
        The quintic spline through them.
    """

    edges: NDArray[np.int64]
    on_transition: NDArray[np.bool_]
    first: NDArray[np.float64]
    last: NDArray[np.float64]
    s: NDArray[np.float64]
    curve: BSpline


def joined_runs(
    waypoints: WaypointTable, tool_path: ToolPath, rests: NDArray[np.bool_] | None = None
) -> Iterator[JoinedRun]:
    """Yield the curves of rows and transitions, from rest to rest; see :func:`measure_between`."""
    from scipy.interpolate import make_interp_spline

    on_row, via = waypoints.kind == "row", waypoints.kind == "transition"
    reached = waypoints.status[1:] == "reached"
    in_row = on_row[1:] & on_row[:-1] & (np.diff(waypoints.row) == 0) & reached
    on_transition = ((via[1:] & (via | on_row)[:-1]) | (via[:-1] & on_row[1:])) & reached
    joined, stops = in_row | on_transition, np.ones(len(on_row), dtype=bool) if rests is None else rests
    start = 0
    while start < len(joined):
        if not joined[start]:
            start += 1
            continue
        end = start + 1
        while end < len(joined) and joined[end] and (in_row[end] == in_row[end - 1] or not stops[end]):
            end += 1
        edges = np.arange(start, end)
        start = end
        first, last = _places_of_edges(waypoints, tool_path, edges, on_transition)
        # a transition without length joins two rows that meet
        if (last <= first).any():
            continue
        s = np.concatenate([[0.0], np.cumsum(last - first)])
        curve = make_interp_spline(s, waypoints.q[edges[0] : edges[-1] + 2], k=min(5, len(s) - 1))
        yield JoinedRun(edges, on_transition[edges], first, last, s, curve)


def _gaps(
    cell: Cell, waypoints: WaypointTable, tool_path: ToolPath, rests: NDArray[np.bool_] | None
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return the largest deviations in each gap, (gaps, 4): on the curve and linear; and which are on transitions."""
    off, kinds = [np.empty((0, 4))], [np.empty(0, dtype=bool)]
    for run in joined_runs(waypoints, tool_path, rests):
        edges, s = run.edges, run.s
        q = waypoints.q[edges[0] : edges[-1] + 2]
        at = (run.first[:, None] + (run.last - run.first)[:, None] * _PLACES).ravel()
        driven = np.repeat(run.on_transition, len(_PLACES))
        target = _nominal(tool_path, waypoints.row[np.repeat(edges, len(_PLACES))], at, driven)
        on_curve = run.curve((s[:-1, None] + np.diff(s)[:, None] * _PLACES).ravel())
        linear = (q[:-1, None] + np.diff(q, axis=0)[:, None] * _PLACES[:, None]).reshape(len(at), -1)
        columns = []
        for joints in (on_curve, linear):
            poses, _ = joint_transforms(cell, joints)
            position = np.linalg.norm(poses[:, :3, 3] - target[:, :3, 3], axis=1)
            rotation = tool_rotation_error(cell, poses[:, :3, :3], target[:, :3, :3])
            columns += [position.reshape(-1, len(_PLACES)).max(axis=1), rotation.reshape(-1, len(_PLACES)).max(axis=1)]
        off.append(np.stack(columns, axis=1))
        kinds.append(run.on_transition)
    return np.concatenate(off), np.concatenate(kinds)


def _places_of_edges(
    waypoints: WaypointTable, tool_path: ToolPath, edges: NDArray[np.int64], on_transition: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return where edges begin and end, as arc lengths of their row or transition (m)."""
    first, last = waypoints.s[edges].copy(), waypoints.s[edges + 1].copy()
    driven, row = on_transition[edges], waypoints.kind == "row"
    first[driven & row[edges]] = 0.0
    for k in np.flatnonzero(driven & row[edges + 1]):
        last[k] = tool_path.transitions[int(waypoints.row[edges[k]])].length
    return first, last


def _nominal(
    tool_path: ToolPath, rows: NDArray[np.int64], at: NDArray[np.float64], driven: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """Return the nominal poses at arc lengths of rows, or of the transitions after them, base frame."""
    poses = np.empty((len(at), 4, 4))
    keys = 2 * rows + driven
    for key in np.unique(keys):
        own, (row, on_transition) = keys == key, divmod(int(key), 2)
        if on_transition:
            poses[own] = tool_path.pose_base_workpiece @ tool_path.transitions[row].curve(at[own])
        else:
            poses[own] = tool_path.pose(row, at[own])
    return poses
