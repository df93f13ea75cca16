"""Planning: from the tool's path to a joint path.

A strategy chooses a configuration for every point: ``graph``, ``track`` (the general method), ``plan_by`` (one of
your own) or :func:`qparm.planning.reverse.reverse` (the paper's). ``smooth_solution`` smooths what it chose, and
``assemble`` makes the joint path of it: exact between points, breaks planned as motions.
"""

from qparm.path.relaxation import EXACT, Relaxation
from qparm.planning.assembly import Between, BreakRecord, assemble, undriven
from qparm.planning.breaks import Motion, MotionFailure, plan_motion
from qparm.planning.continuation import joined_rows
from qparm.planning.continuity import driven_where_followed
from qparm.planning.corners import rest_at_corners
from qparm.planning.exact import beyond_limits, inset
from qparm.planning.filling import FilledPath, filled
from qparm.planning.general import PointRecord, TrackRecord, points_of, track
from qparm.planning.graph_search import GraphRecord, SearchCount, graph, graph_relaxed
from qparm.planning.jump import jump_criteria
from qparm.planning.own import Planner, plan_by
from qparm.planning.reverse_record import Repair, ReversePath, ReverseStatistics
from qparm.planning.sampling import Sampling
from qparm.planning.smooth import LIMIT_MARGIN
from qparm.planning.smooth_path import SmoothRecord, largest_step, second_differences, smooth_solution, smoothest
from qparm.planning.solution import PathSolution, row_end
from qparm.planning.windings import endless, wound, wound_graph

__all__ = [
    "EXACT",
    "LIMIT_MARGIN",
    "Between",
    "BreakRecord",
    "FilledPath",
    "GraphRecord",
    "Motion",
    "MotionFailure",
    "PathSolution",
    "Planner",
    "PointRecord",
    "Relaxation",
    "Repair",
    "ReversePath",
    "ReverseStatistics",
    "Sampling",
    "SearchCount",
    "SmoothRecord",
    "TrackRecord",
    "assemble",
    "beyond_limits",
    "driven_where_followed",
    "endless",
    "filled",
    "graph",
    "graph_relaxed",
    "inset",
    "joined_rows",
    "jump_criteria",
    "largest_step",
    "plan_by",
    "plan_motion",
    "points_of",
    "rest_at_corners",
    "row_end",
    "second_differences",
    "smooth_solution",
    "smoothest",
    "track",
    "undriven",
    "wound",
    "wound_graph",
]


def __dir__() -> list[str]:
    return sorted(__all__)
