"""The highest speed at which a row could be passed from end to end: what its joints' curve asks at constant speed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from qparm.verify.between import joined_runs

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from scipy.interpolate import BSpline

    from qparm.cell import Cell
    from qparm.path import ToolPath
    from qparm.verify.files import WaypointTable

__all__ = ["HighestFeed", "highest_feeds"]

_LIMITS = ("velocity", "acceleration", "jerk")
# Places on each piece of the curve, from the largest of which on Newton's method finds the peak.
_PLACES = np.linspace(0.0, 1.0, 17)
_NEWTON = 4


@dataclass(frozen=True)
class HighestFeed:
    """The highest speed without a joint beyond a limit.

    Attributes
    ----------
    speed : float
        m/s.
    joint : int
    limit : str
        ``"velocity"``, ``"acceleration"`` or ``"jerk"``.
    place : float
        Where on the row (m).
    """

    speed: float
    joint: int
    limit: str
    place: float


def highest_feeds(
    cell: Cell, tool_path: ToolPath, waypoints: WaypointTable, limits: NDArray[np.float64], rests: NDArray[np.bool_]
) -> dict[int, HighestFeed]:
    """Return the highest speed of each row that is worked.

    At a constant speed v along q(s) the joints have v q', v^2 q'' and v^3 q''': the least of v_i / |q_i'|,
    sqrt(a_i / |q_i''|) and cbrt(j_i / |q_i'''|) over the row.

    Parameters
    ----------
    cell : Cell
    tool_path : ToolPath
        The cell's.
    waypoints : WaypointTable
    limits : (3, n) ndarray
        Of velocity, acceleration and jerk.
    rests : (N,) ndarray of bool
        At which waypoints the arm rests.
    """
    found: dict[int, HighestFeed] = {}
    for run in joined_runs(waypoints, tool_path, rests):
        rows = np.where(run.on_transition, -1, waypoints.row[run.edges])
        for row in np.unique(rows[rows >= 0]).tolist():
            own = np.flatnonzero(rows == row)
            begin, end = float(run.s[own[0]]), float(run.s[own[-1] + 1])
            best = _highest(run.curve, begin, end, limits, float(run.first[own[0]]) - begin)
            if row not in found or best.speed < found[row].speed:
                found[row] = best
    return found


def _highest(curve: BSpline, begin: float, end: float, limits: NDArray[np.float64], shift: float) -> HighestFeed:
    breaks = np.unique(curve.t)
    borders = np.concatenate([[begin], breaks[(breaks > begin) & (breaks < end)], [end]])
    width = np.diff(borders)
    best = HighestFeed(float("inf"), -1, _LIMITS[0], begin + shift)
    for order in (1, 2, 3):
        if order > curve.k:
            continue
        value = curve.derivative(order)
        slopes = [curve.derivative(k) for k in (order + 1, order + 2) if k <= curve.k]
        x = borders[:-1, None] + width[:, None] * _PLACES
        at = np.abs(value(x)).argmax(axis=1)  # (pieces, n)
        s = x[np.arange(len(width))[:, None], at]
        n, low, high = s.shape[1], borders[:-1, None], borders[1:, None]
        for _ in range(_NEWTON if len(slopes) == 2 else 0):
            slope, bend = (_own(one, s) for one in slopes)
            step = np.divide(slope, bend, out=np.zeros_like(slope), where=np.abs(bend) > 0)
            # to a peak near the largest place, not away from it
            s = np.clip(s - np.clip(step, -width[:, None] / 16, width[:, None] / 16), low, high)
        size = np.maximum(np.abs(_own(value, s)), np.abs(value(x)).max(axis=1))
        with np.errstate(divide="ignore"):
            speed = (limits[order - 1] / size) ** (1.0 / order)
        piece, joint = divmod(int(speed.argmin()), n)
        if speed[piece, joint] < best.speed:
            best = HighestFeed(float(speed[piece, joint]), joint, _LIMITS[order - 1], float(s[piece, joint]) + shift)
    return best


def _own(curve: BSpline, s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return each joint's value at places of its own (pieces, n)."""
    return np.stack([curve(s[:, j])[:, j] for j in range(s.shape[1])], axis=1)
