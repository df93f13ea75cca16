"""The strategies: how a configuration is chosen for every point of a tool path.

Each is an entry of :data:`STRATEGIES`: what it finds, and how the stages around it treat that. A planner of one's own
takes the place of one (:func:`own_strategy`).
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from qparm.planning.interpolation.exact import inset
from qparm.planning.own import Planner, plan_by
from qparm.planning.paper.general import TrackRecord, points_of, track
from qparm.planning.search.continuation import joined_rows
from qparm.planning.search.continuity import driven_where_followed
from qparm.planning.search.filling import FilledPath
from qparm.planning.tolerances import LIMIT_MARGIN
from qparm.planning.windings import wound, wound_graph

if TYPE_CHECKING:
    from qparm.ik import Method, StepRule, StepSolver
    from qparm.planning.paper.reverse_record import ReverseStatistics
    from qparm.planning.problem import PathProblem
    from qparm.planning.search.graph_record import GraphRecord
    from qparm.planning.solution import PathSolution

__all__ = ["STRATEGIES", "Found", "Progress", "Steps", "Strategy", "own_strategy"]

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Steps:
    """How the paper's strategies step, and whether every iterate is kept.

    Attributes
    ----------
    method : {"cwln", "wln", "gpm", "dls"} or callable
    solver : str or StepSolver
        See :class:`qparm.ik.PoseSolver`.
    keep_traces : bool
    """

    method: Method | StepRule = "cwln"
    solver: str | StepSolver = "auto"
    keep_traces: bool = False


@dataclass(frozen=True, eq=False)
class Found:
    """What a strategy found.

    Attributes
    ----------
    candidates : tuple of PathSolution
        Of all poses of the problem, the best first; what is smoothest of them in the end is taken.
    record : TrackRecord
        Of the points that were asked for.
    search : GraphRecord, ReverseStatistics or None
        What the strategy says of its work.
    """

    candidates: tuple[PathSolution, ...]
    record: TrackRecord
    search: GraphRecord | ReverseStatistics | None = None


@dataclass(frozen=True)
class Strategy:
    """How configurations are chosen.

    Attributes
    ----------
    find : callable
        ``find(problem, steps, progress)`` returns what is found.
    needs : tuple of str
        Modules that no other strategy loads, whose kernels a first run compiles.
    fills : bool
        Whether poses are put in between points that lie far apart.
    frees : bool
        Whether a tool may spin or tilt.
    follows : bool
        Whether rows that it leaves broken are followed from both sides before a break is accepted.
    smooths : bool
        Whether its path is smoothed unless one says otherwise.
    """

    find: Callable[[PathProblem, Steps, Progress | None], Found]
    needs: tuple[str, ...] = ()
    fills: bool = False
    frees: bool = False
    follows: bool = False
    smooths: bool = False

    def load(self) -> None:
        """Load what the strategy needs, and compile it on a first run."""
        for module in self.needs:
            importlib.import_module(module)


def _graph(problem: PathProblem, steps: Steps, progress: Progress | None) -> Found:
    path = problem.tool_path
    asked = path.given if isinstance(path, FilledPath) else path

    def told(done: int, total: int) -> None:
        # of the points that were asked for
        if progress is not None:
            progress(done * asked.point_count // total, total)

    candidates, search = wound_graph(problem.inside, progress=told)
    best = path.of_points(candidates[0]) if isinstance(path, FilledPath) else candidates[0]
    return Found(candidates, points_of(replace(problem, tool_path=asked), best), search)


def _reverse(problem: PathProblem, steps: Steps, progress: Progress | None) -> Found:
    # its kernels are loaded when it is asked for
    from qparm.planning.paper.reverse import reverse

    # where a joint rests on its limit the curve between the points swings beyond it
    inside = replace(problem, chain=inset(problem.chain, LIMIT_MARGIN))
    found = reverse(inside, method=steps.method, solver=steps.solver, progress=progress)
    solution = wound(problem, found.solution(problem.criteria_by_feed))
    solution = joined_rows(problem, driven_where_followed(problem, solution))
    return Found((solution,), found.record(), found.statistics)


def _general(problem: PathProblem, steps: Steps, progress: Progress | None) -> Found:
    solution, record = track(
        problem, method=steps.method, solver=steps.solver, keep_traces=steps.keep_traces, progress=progress
    )
    return Found((driven_where_followed(problem, wound(problem, solution)),), record)


def own_strategy(planner: Planner) -> Strategy:
    """Return a strategy that asks a planner of one's own; see :func:`qparm.planning.plan_by`."""

    def find(problem: PathProblem, steps: Steps, progress: Progress | None) -> Found:
        solution, record = plan_by(planner, problem)
        return Found((driven_where_followed(problem, solution),), record)

    return Strategy(find)


STRATEGIES = {
    "graph": Strategy(_graph, fills=True, frees=True, follows=True, smooths=True),
    "reverse": Strategy(_reverse, needs=("qparm.planning.paper.reverse",), follows=True, smooths=True),
    "general": Strategy(_general),
}


def strategy_of(strategy: str | Planner) -> Strategy:
    """Return the strategy of a name, or one that asks a planner of one's own."""
    return own_strategy(strategy) if callable(strategy) else STRATEGIES[strategy]
