"""Planning: from the tool's path to a joint path.

A strategy chooses a configuration for every point: ``graph``, ``track`` (the general method), ``plan_by`` (one of
your own) or :func:`qparm.planning.paper.reverse.reverse` (the paper's). ``smooth_solution`` smooths what it chose, and
``assemble`` makes the joint path of it: exact between points, breaks planned as motions.
"""

from typing import TYPE_CHECKING

from qparm.lazy_names import on_demand
from qparm.path.relaxation import EXACT, Relaxation

if TYPE_CHECKING:
    from qparm.planning.assembly import BreakRecord, assemble, undriven
    from qparm.planning.interpolation.corners import rest_at_corners
    from qparm.planning.interpolation.exact import beyond_limits, inset
    from qparm.planning.moves.breaks import Motion, MotionFailure, plan_motion
    from qparm.planning.own import Planner, plan_by
    from qparm.planning.paper.general import PointRecord, TrackRecord, points_of, track
    from qparm.planning.paper.jump import jump_criteria
    from qparm.planning.paper.reverse_record import Repair, ReversePath, ReverseStatistics
    from qparm.planning.problem import Between, PathProblem, problem_of, row_end
    from qparm.planning.search.continuation import joined_rows
    from qparm.planning.search.continuity import driven_where_followed
    from qparm.planning.search.filling import FilledPath, filled
    from qparm.planning.search.graph_record import GraphRecord, SearchCount
    from qparm.planning.search.graph_search import graph, graph_relaxed
    from qparm.planning.search.sampling import Sampling
    from qparm.planning.smoothing.smooth_path import (
        SmoothRecord,
        largest_step,
        second_differences,
        smooth_found,
        smooth_solution,
        smoothest,
    )
    from qparm.planning.solution import PathSolution
    from qparm.planning.strategies import STRATEGIES, Found, Strategy
    from qparm.planning.tolerances import LIMIT_MARGIN
    from qparm.planning.windings import endless, wound, wound_graph

__all__ = [
    "EXACT",
    "LIMIT_MARGIN",
    "STRATEGIES",
    "Between",
    "BreakRecord",
    "FilledPath",
    "Found",
    "GraphRecord",
    "Motion",
    "MotionFailure",
    "PathProblem",
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
    "Strategy",
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
    "problem_of",
    "rest_at_corners",
    "row_end",
    "second_differences",
    "smooth_found",
    "smooth_solution",
    "smoothest",
    "track",
    "undriven",
    "wound",
    "wound_graph",
]

__getattr__, __dir__ = on_demand(
    __name__,
    {
        "Between": "problem",
        "BreakRecord": "assembly",
        "FilledPath": "search.filling",
        "Found": "strategies",
        "GraphRecord": "search.graph_record",
        "LIMIT_MARGIN": "tolerances",
        "Motion": "moves.breaks",
        "MotionFailure": "moves.breaks",
        "PathProblem": "problem",
        "PathSolution": "solution",
        "Planner": "own",
        "PointRecord": "paper.general",
        "Repair": "paper.reverse_record",
        "ReversePath": "paper.reverse_record",
        "ReverseStatistics": "paper.reverse_record",
        "STRATEGIES": "strategies",
        "Sampling": "search.sampling",
        "SearchCount": "search.graph_record",
        "SmoothRecord": "smoothing.smooth_path",
        "Strategy": "strategies",
        "TrackRecord": "paper.general",
        "assemble": "assembly",
        "beyond_limits": "interpolation.exact",
        "driven_where_followed": "search.continuity",
        "endless": "windings",
        "filled": "search.filling",
        "graph": "search.graph_search",
        "graph_relaxed": "search.graph_search",
        "inset": "interpolation.exact",
        "joined_rows": "search.continuation",
        "jump_criteria": "paper.jump",
        "largest_step": "smoothing.smooth_path",
        "plan_by": "own",
        "plan_motion": "moves.breaks",
        "points_of": "paper.general",
        "problem_of": "problem",
        "rest_at_corners": "interpolation.corners",
        "row_end": "problem",
        "second_differences": "smoothing.smooth_path",
        "smooth_found": "smoothing.smooth_path",
        "smooth_solution": "smoothing.smooth_path",
        "smoothest": "smoothing.smooth_path",
        "track": "paper.general",
        "undriven": "assembly",
        "wound": "windings",
        "wound_graph": "windings",
    },
    __all__,
)
