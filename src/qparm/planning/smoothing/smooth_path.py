"""Smoothing a solution: which waypoints take part, how far neighbours may step, and what is kept if it does not pay."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from qparm.planning.paper.jump import jumps_between
from qparm.planning.search.continuation import joined_rows
from qparm.planning.search.continuity import edge_is_continuous
from qparm.planning.search.projection import velocity_scale
from qparm.planning.smoothing.smooth import mean_spacing, roughness, smooth
from qparm.planning.smoothing.turns import Waypoints, with_turns
from qparm.planning.solution import PathSolution, driven_edges, fill, knots, runs

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.path import ToolPath
    from qparm.planning.problem import PathProblem
    from qparm.robot import SerialChain

__all__ = ["SmoothRecord", "largest_step", "second_differences", "smooth_found", "smooth_solution", "smoothest"]


@dataclass(frozen=True)
class SmoothRecord:
    """What smoothing changed.

    Attributes
    ----------
    iterations : int
        Convex subproblems solved.
    objective : tuple of float
        Before and after.
    largest_scaled_step : tuple of float
        Velocity-scaled, between neighbouring points of driven edges, row ends included (rad), before and after.
    second_differences : tuple of tuple of float
        Root mean square and peak inside rows, velocity-scaled (rad), before and after.
    """

    iterations: int
    objective: tuple[float, float]
    largest_scaled_step: tuple[float, float]
    second_differences: tuple[tuple[float, float], tuple[float, float]]


def largest_step(chain: SerialChain, solution: PathSolution) -> float:
    """Return the largest velocity-scaled step of a solution's driven edges (rad)."""
    step = np.abs(np.diff(solution.q, axis=0)) / velocity_scale(chain)
    return float(step[solution.driven].max(initial=0.0))


def second_differences(chain: SerialChain, tool_path: ToolPath, solution: PathSolution) -> tuple[float, float]:
    """Return root mean square and peak of the velocity-scaled second differences inside rows (rad); NaN if none."""
    values = _bends(chain, tool_path, solution)
    if not len(values):
        return float("nan"), float("nan")
    return float(np.sqrt((values**2).mean())), float(np.abs(values).max())


def _bends(chain: SerialChain, tool_path: ToolPath, solution: PathSolution) -> NDArray[np.float64]:
    """Return the velocity-scaled second differences inside rows, (T, n)."""
    row = tool_path.row_of_point
    inside = solution.driven[:-1] & solution.driven[1:] & (row[:-2] == row[2:])
    return np.diff(solution.q / velocity_scale(chain), 2, axis=0)[inside]


def smooth_solution(problem: PathProblem, solution: PathSolution) -> tuple[PathSolution, SmoothRecord]:
    """Return a solution smoothed as a whole; the one given where that does not keep all that was reached.

    Parameters
    ----------
    problem : PathProblem
        No driven step is made larger than its criteria, or than it is.
    solution : PathSolution
    """
    chain, tool_path, relaxation, jump = problem.chain, problem.tool_path, problem.relaxation, problem.criteria
    run = runs(tool_path, solution.reached, solution.driven)
    at = _waypoints(knots(chain, tool_path), run)
    before = largest_step(chain, solution), second_differences(chain, tool_path, solution)
    if len(at) < 3:
        return solution, _unchanged(0, 0.0, *before)
    s, run_at = tool_path.s[at], run[at]
    linked = (run_at[:-1] != run_at[1:]) & (np.diff(at) == 1) & solution.driven[at[:-1]]
    inside = run_at[:-1] == run_at[1:]
    apart = np.abs(np.diff(solution.q[at], axis=0))
    step = np.where((inside | linked)[:, None], np.maximum(jumps_between(jump, at), apart), np.inf)
    given = Waypoints(
        np.ascontiguousarray(tool_path.poses[at]), solution.q[at], relaxation.unwound(solution.rho[at]), s, run_at,
        linked, mean_spacing(s, run_at), step, np.full(len(at), -1),
    )  # fmt: skip
    ways = with_turns(problem, given, tool_path.row_of_point[at])
    smoothed = smooth(
        chain, ways.poses, ways.q, s=ways.s, run=ways.run, linked=ways.linked, spacing=ways.spacing,
        turn=ways.turn >= 0, step=ways.step, relaxation=relaxation, parameters=ways.rho,
    )  # fmt: skip
    driven_at = inside | linked
    reached_at = np.ones(len(at), dtype=bool)
    points = ways.turn < 0
    turns = {
        int(turn): (smoothed.q[ways.turn == turn], smoothed.parameters[ways.turn == turn])
        for turn in np.unique(ways.turn[~points])
    }
    after = PathSolution(smoothed.q[points], smoothed.parameters[points], reached_at, driven_at)
    if len(at) < int(solution.reached.sum()):
        after = fill(problem, at, after)
    else:
        q, rho = solution.q.copy(), solution.rho.copy()
        q[at], rho[at] = after.q, after.rho
        after = PathSolution(q, rho, solution.reached, solution.driven)
    after = replace(after, turns=turns)
    kept = bool((after.reached >= solution.reached).all() and (after.driven >= solution.driven).all())
    over = np.flatnonzero(after.driven & ~driven_edges(after.q, after.reached, jump)) if kept else ()
    kept = kept and all(edge_is_continuous(problem, after, int(k)) for k in over)
    if not kept or smoothed.after >= smoothed.before:
        return solution, _unchanged(smoothed.iterations, smoothed.before, *before)
    return after, SmoothRecord(
        smoothed.iterations,
        (smoothed.before, smoothed.after),
        (before[0], largest_step(chain, after)),
        (before[1], second_differences(chain, tool_path, after)),
    )


def smoothest(
    problem: PathProblem, candidates: Sequence[tuple[PathSolution, SmoothRecord]]
) -> tuple[PathSolution, SmoothRecord]:
    """Return of several smoothed paths the one to take.

    The fewest reconfigurations come first, then the least :func:`qparm.planning.smoothing.smooth.roughness`.

    Parameters
    ----------
    problem : PathProblem
    candidates : sequence of (PathSolution, SmoothRecord)
        Of equal ones the first is taken. What the record says of the path before smoothing is about the first.
    """
    chain, tool_path = problem.chain, problem.tool_path
    first = _bends(chain, tool_path, candidates[0][0])

    def rank(candidate: tuple[PathSolution, SmoothRecord]) -> tuple[float, ...]:
        solution = candidate[0]
        rough = roughness(_bends(chain, tool_path, solution), first)
        return (-int(solution.reached.sum()), *solution.reconfigurations(tool_path), rough)

    solution, record = min(candidates, key=rank)
    given = candidates[0][1]
    return solution, SmoothRecord(
        record.iterations,
        (given.objective[0], record.objective[1]),
        (given.largest_scaled_step[0], record.largest_scaled_step[1]),
        (given.second_differences[0], record.second_differences[1]),
    )


def smooth_found(
    problem: PathProblem, candidates: Sequence[PathSolution], *, follows: bool = False
) -> tuple[PathSolution, SmoothRecord]:
    """Return the smoothest of several paths, smoothed.

    Parameters
    ----------
    problem : PathProblem
    candidates : sequence of PathSolution
    follows : bool
        Whether what is smoothed is followed once more from both sides of what is still broken.
    """
    solution, record = smoothest(problem, [smooth_solution(problem.inside, one) for one in candidates])
    if follows and solution.reconfigurations(problem.tool_path)[0]:
        again = smooth_solution(problem.inside, joined_rows(problem, solution))
        solution, record = smoothest(problem, [(solution, record), again])
    return solution, record


def _unchanged(iterations: int, value: float, step: float, differences: tuple[float, float]) -> SmoothRecord:
    return SmoothRecord(iterations, (value, value), (step, step), (differences, differences))


def _waypoints(at: NDArray[np.int64], run: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the knots that are reached, and the ends of every run."""
    taken = np.zeros(len(run), dtype=bool)
    taken[at] = True
    borders = np.flatnonzero(np.diff(run))
    taken[borders] = taken[borders + 1] = True
    return np.flatnonzero(taken & (run >= 0))
