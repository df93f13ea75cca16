"""How exact a joint path is between its waypoints on rows: on the curve through them, and interpolated linearly."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from qparm.verify.kinematics import joint_transforms, tool_rotation_error

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.cell import Cell
    from qparm.path import ToolPath
    from qparm.verify.files import WaypointTable

__all__ = ["BetweenFigures", "measure_between"]

# Places in each gap; not those at which the planner looked.
_PLACES = np.array([0.1, 0.3, 0.5, 0.7, 0.9])


@dataclass(frozen=True)
class BetweenFigures:
    """Largest deviations of the tool between waypoints of rows.

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
    """

    gaps: int
    off_gaps: int
    position: float
    rotation: float
    linear_position: float
    linear_rotation: float

    def problems(self) -> tuple[str, ...]:
        """Return a sentence if the curve is off somewhere."""
        if not self.off_gaps:
            return ()
        return (
            f"between the points the curve is off by up to {self.position * 1e6:.3g} um and"
            f" {self.rotation * 1e6:.3g} urad, beyond the tolerance in {self.off_gaps} of {self.gaps} gaps",
        )


def measure_between(cell: Cell, waypoints: WaypointTable, tool_path: ToolPath) -> BetweenFigures:
    """Return how far the tool leaves its path between the waypoints of rows.

    Parameters
    ----------
    cell : Cell
    waypoints : WaypointTable
    tool_path : ToolPath
        The cell's.
    """
    from scipy.interpolate import make_interp_spline

    on_row = waypoints.kind == "row"
    joined = on_row[1:] & on_row[:-1] & (np.diff(waypoints.row) == 0) & (waypoints.status[1:] == "reached")
    off: list[NDArray[np.float64]] = []
    start = 0
    while start < len(joined):
        if not joined[start]:
            start += 1
            continue
        end = start
        while end < len(joined) and joined[end]:
            end += 1
        s, q = waypoints.s[start : end + 1], waypoints.q[start : end + 1]
        at = (s[:-1, None] + np.diff(s)[:, None] * _PLACES).ravel()
        target = tool_path.pose(int(waypoints.row[start]), at)
        curve = make_interp_spline(s, q, k=min(5, len(s) - 1))(at)
        linear = (q[:-1, None] + np.diff(q, axis=0)[:, None] * _PLACES[:, None]).reshape(len(at), -1)
        columns = []
        for joints in (curve, linear):
            poses, _ = joint_transforms(cell, joints)
            position = np.linalg.norm(poses[:, :3, 3] - target[:, :3, 3], axis=1)
            rotation = tool_rotation_error(cell, poses[:, :3, :3], target[:, :3, :3])
            columns += [position.reshape(-1, len(_PLACES)).max(axis=1), rotation.reshape(-1, len(_PLACES)).max(axis=1)]
        off.append(np.stack(columns, axis=1))
        start = end
    if not off:
        return BetweenFigures(0, 0, *(float("nan"),) * 4)
    table = np.concatenate(off)
    beyond = (table[:, 0] > cell.process.position_between) | (table[:, 1] > cell.process.rotation_between)
    return BetweenFigures(len(table), int(beyond.sum()), *(float(x) for x in table.max(axis=0)))
