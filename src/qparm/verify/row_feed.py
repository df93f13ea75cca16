"""The feed on the rows of a plan, judged as a trajectory file is (:mod:`qparm.verify.feed`)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from qparm.verify.feed import FeedFault, FeedFigures, judge_feed
from qparm.verify.row_speed import HighestFeed, highest_feeds
from qparm.verify.tool_speed import shares_of_knots, speeds_of_knots

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.cell import Cell
    from qparm.path import ToolPath
    from qparm.verify.files import KnotTable, WaypointTable

__all__ = ["GIVES_WAY", "OneRow", "RowFeed", "measure_row_feed"]

# A row slower than this share of the feed somewhere is told with the joint that makes it so: above, it may be no more
# than the end of a run-up.
GIVES_WAY = 0.99


@dataclass(frozen=True)
class OneRow:
    """How one row is passed.

    Attributes
    ----------
    row : int
    way : float
        How far the tool works (m).
    kept : float
        Share of it at the feed, within 0.1 %.
    slowest : float
        Least speed between the run-ups at the row's ends (m/s); NaN where there is no such place: the row is too short.
    time : float
        When (s).
    joint, limit : str
        What binds there: a joint's name, and its velocity, acceleration or jerk; empty at the feed.
    largest : float
        The largest speed (m/s).
    highest_feed : float
        Up to which feed the row, but for its run-ups, could be passed without slowing down (m/s); NaN if not known.
    highest_joint, highest_limit : str
        What bounds it.
    highest_place : float
        Where on the row (m).
    """

    row: int
    way: float
    kept: float
    slowest: float
    time: float
    joint: str
    limit: str
    largest: float
    highest_feed: float
    highest_joint: str
    highest_limit: str
    highest_place: float


@dataclass(frozen=True)
class RowFeed:
    """How well the feed is kept on rows.

    Attributes
    ----------
    deviation : float
        The largest share by which the speed is off away from the ends, where no joint limits it; NaN if no row is long
        enough to tell.
    feed : float
        m/s.
    kept : float
        Share of all rows' way at the feed, within 0.1 %; NaN if there is none.
    highest : float
        Up to which feed every row, but for its run-ups, could be passed without slowing down (m/s).
    rows : tuple of OneRow
    faults : tuple of (row, FeedFault)
    """

    deviation: float
    feed: float
    kept: float
    highest: float
    rows: tuple[OneRow, ...]
    faults: tuple[tuple[int, FeedFault], ...]


def measure_row_feed(
    cell: Cell,
    tool_path: ToolPath,
    waypoints: WaypointTable,
    knots: KnotTable,
    passed: NDArray[np.int64],
    limits: NDArray[np.float64],
    rests: NDArray[np.bool_],
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
    rests : (N,) ndarray of bool
        At which waypoints the arm rests.
    """
    feed = cell.process.feed
    shares = shares_of_knots(knots, limits) if len(knots.t) > 1 else None
    along = (waypoints.kind[1:] == "row") & (waypoints.kind[:-1] == "row") & (np.diff(waypoints.row) == 0)
    # what the planner calls a break is no process, though its ends are neighbours
    along &= waypoints.status[1:] == "reached"
    found: dict[int, list[FeedFigures]] = {}
    edges = np.flatnonzero(np.diff(np.concatenate([[False], along, [False]])))
    for first, last in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        row = int(waypoints.row[first])
        start, end = knots.t[passed[[first, last]]].tolist()
        one = tool_path.rows[row]
        if shares is None or not end > start:
            continue
        trace = speeds_of_knots(cell, knots, start, end, radius=one.turning_radius)
        figures = judge_feed(trace, feed, shares, float(np.diff(one.s).max()))
        if figures is not None:
            found.setdefault(row, []).append(figures)
    highest = highest_feeds(cell, tool_path, waypoints, limits, rests)
    rows = tuple(_one_row(cell, row, parts, highest.get(row)) for row, parts in sorted(found.items()))
    way = sum(one.way for one in rows)
    parts = [figures for row in sorted(found) for figures in found[row]]
    return RowFeed(
        deviation=float(np.fmax.reduce([one.deviation for one in parts], initial=float("nan"))),
        feed=feed,
        kept=sum(one.kept * one.way for one in rows) / way if way > 0 else float("nan"),
        highest=float(np.fmin.reduce([one.highest_feed for one in rows], initial=float("nan"))),
        rows=rows,
        faults=tuple(
            (row, fault)
            for row in sorted(found)
            for figures in found[row]
            for fault in (figures.too_fast, figures.too_slow)
            if fault is not None
        ),
    )


def _one_row(cell: Cell, row: int, parts: list[FeedFigures], highest: HighestFeed | None) -> OneRow:
    names = [joint.name for joint in cell.arm.joints]
    way = sum(part.way for part in parts)
    slowest = min((part.slowest for part in parts if part.slowest), key=lambda one: one.speed, default=None)
    bound = slowest is not None and slowest.joint >= 0 and slowest.speed < cell.process.feed * GIVES_WAY
    return OneRow(
        row=row,
        way=way,
        kept=sum(part.kept for part in parts) / max(way, 1e-12),
        slowest=slowest.speed if slowest else float("nan"),
        time=slowest.time if slowest else float("nan"),
        joint=names[slowest.joint] if slowest and bound else "",
        limit=slowest.limit if slowest and bound else "",
        largest=max(part.largest for part in parts),
        highest_feed=highest.speed if highest else float("nan"),
        highest_joint=names[highest.joint] if highest else "",
        highest_limit=highest.limit if highest else "",
        highest_place=highest.place if highest else float("nan"),
    )
