"""Whether the rows of a plan are passed at the feed, judged as a trajectory file is (:mod:`qparm.verify.feed`)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from qparm.verify.clock import Clock
from qparm.verify.differences import shares_along
from qparm.verify.feed import measure_feed
from qparm.verify.following import nearest_on_curve
from qparm.verify.interpolate import positions_at
from qparm.verify.passing import look_at_tool, places

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.cell import Cell
    from qparm.path import ToolPath
    from qparm.verify.files import KnotTable, WaypointTable
    from qparm.verify.following import Curve

__all__ = ["FeedFault", "RowFeed", "measure_row_feed"]

# Seconds between the places looked at: the samples that are written if no other period is asked for.
_PERIOD = 0.02
# Rounding of a position (m, rad), and of a place of the tool (m).
_ROUNDING, _BLUR = 1e-12, 1e-11


@dataclass(frozen=True)
class FeedFault:
    """Where a row is not passed at the feed.

    Attributes
    ----------
    row : int
    time : float
        The first such place (s).
    speed : float
        The worst (m/s).
    count : int
        Places.
    """

    row: int
    time: float
    speed: float
    count: int

    def sentence(self, feed: float) -> str:
        """Return the fault in words."""
        what = "too fast" if self.speed > feed else "slow for no joint's sake"
        return (
            f"the tool is {what} on row {self.row} from {self.time:.3f} s: {self.speed * 1e3:.6g} mm/s"
            f" against a feed of {feed * 1e3:.6g} mm/s"
        )


@dataclass(frozen=True)
class RowFeed:
    """How well the feed is kept on rows, away from their ends and where no joint limits it.

    Attributes
    ----------
    deviation : float
        The largest share by which the speed is off; NaN if no row is long enough to tell.
    feed : float
        m/s.
    faults : tuple of FeedFault
    """

    deviation: float
    feed: float
    faults: tuple[FeedFault, ...]

    def problems(self) -> tuple[str, ...]:
        """Return a sentence for each fault."""
        return tuple(fault.sentence(self.feed) for fault in self.faults)


def measure_row_feed(
    cell: Cell,
    tool_path: ToolPath,
    waypoints: WaypointTable,
    knots: KnotTable,
    passed: NDArray[np.int64],
    limits: NDArray[np.float64],
) -> RowFeed:
    """Return how the rows are passed.

    Parameters
    ----------
    cell : Cell
    tool_path : ToolPath
        The cell's.
    waypoints, knots
        As :mod:`qparm.verify.files` reads them.
    passed : (N,) ndarray of int
        The knot that passes each waypoint.
    limits : (3, n) ndarray
        Of velocity, acceleration and jerk.
    """
    t = np.asarray(_PERIOD * np.arange(int(knots.t[-1] / _PERIOD) + 1), dtype=np.float64)
    if len(t) < 2:
        return RowFeed(float("nan"), cell.process.feed, ())
    q = positions_at(knots, t)
    shares = shares_along(Clock(t, np.zeros(len(t)), _PERIOD, ()), q, np.full(q.shape[1], _ROUNDING), limits)
    looks = look_at_tool(cell, t, np.ones(len(t), dtype=bool), lambda at: positions_at(knots, at))
    along = (waypoints.kind[1:] == "row") & (waypoints.kind[:-1] == "row") & (np.diff(waypoints.row) == 0)
    # what the planner calls a break is no process, though its ends are neighbours
    along &= waypoints.status[1:] == "reached"
    worst, faults = float("nan"), []
    edges = np.flatnonzero(np.diff(np.concatenate([[False], along, [False]])))
    for first, last in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        row, times = int(waypoints.row[first]), knots.t[passed[first : last + 1]]
        part = slice(*np.searchsorted(t, times[[0, -1]]))
        curve, length = tool_path.rows[row].curve, tool_path.rows[row].length
        if part.stop <= part.start or not length > 0:
            continue

        def place(x: NDArray[np.float64], curve: Curve = curve) -> NDArray[np.float64]:
            poses = tool_path.pose_base_workpiece @ curve(x)
            return places(cell, poses[:, :3, 3], poses[:, :3, :3])

        guess = np.interp(t[part], times, waypoints.s[first : last + 1])
        s = nearest_on_curve(place, places(cell, looks.position[part], looks.rotation[part]), length, guess)
        figures = measure_feed(t[part], s, cell.process.feed, _BLUR, shares)
        if figures is None:
            continue
        worst = float(np.fmax(worst, figures.deviation))
        faults += [
            FeedFault(row, found[0], found[1] * cell.process.feed, found[2])
            for found in (figures.too_fast, figures.too_slow)
            if found
        ]
    return RowFeed(worst, cell.process.feed, tuple(faults))
