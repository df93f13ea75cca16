"""A study: which of a cell's designs are valid, which no other beats, and what limits them."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from qparm.cell.design import MEASURES
from qparm.design.allotment import allotted
from qparm.design.archive import Archive
from qparm.design.choice import Grounds, choice, unmoved, worth_planning
from qparm.design.engines import METHODS, Engine, make_engine
from qparm.design.evaluate import LEVELS, MEASURES_LEVEL, REACH, Evaluation
from qparm.design.journal import Journal, problem_hash
from qparm.design.problem import Problem
from qparm.design.run import Border, Run, total_violation, validity
from qparm.design.space import DesignSpace
from qparm.design.stop import ActiveBound, active_bounds
from qparm.design.workers import Order
from qparm.errors import InvalidInput

if TYPE_CHECKING:
    from qparm.cell import Cell

__all__ = ["DesignStudy", "SecondStep", "design"]

# The paper's two: total length, and singularities met by the planner.
_PAPER_OBJECTIVES = ("length", "singularities")


@dataclass(frozen=True, eq=False)
class SecondStep:
    """The range to which the paper's method shrinks after its first step.

    Attributes
    ----------
    first : int
        Designs of the first step.
    lower, upper : tuple of float
        The ends of the new range (SI).
    valid_share : float
        Of the first step's designs inside it.
    """

    first: int
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    valid_share: float


@dataclass(frozen=True, eq=False)
class DesignStudy:
    """What a study found.

    Attributes
    ----------
    space : DesignSpace
    method, level : str
    seed, budget : int
    objectives : tuple of str
        What the search went by.
    problem : Problem
        With the ranges as they were at the end.
    evaluations : tuple of Evaluation
        All, in the order in which they were asked for, each as far as it is known now.
    front : tuple of int
        Places of the designs that no other beats, in the order of the first objective; of ``paper``, none of its own
        search.
    best : tuple of int
        The same of all designs, those of the border that was followed too: ``front`` but for ``paper``.
    chosen : int or None
        Place of the design of ``best`` that is recommended; None if none is valid, or nothing tells them apart.
    grounds : {"only", "knee", "limit_margin", "singularity_margin", "nothing"}
        Why that one, see :func:`qparm.design.choice.choice`.
    unmoved : tuple of str
        Objectives that are the same for all valid designs.
    beyond_reach : str or None
        Where the recommended design lies on the border of reach, the step that misses points; else empty. None where
        the budget left nothing to look for one, or nothing is recommended.
    least : int or None
        Place of the shortest valid design.
    least_of_search : int or None
        The same, of what the search alone found, before its border was followed.
    second_step : SecondStep or None
        Of the paper's method.
    own : Evaluation
        Of the cell as it stands, as far as the search went with the others.
    nearest : Evaluation or None
        Where no design is valid: the one that comes nearest, with all of its points looked at.
    misses : tuple of str
        What it misses, and why.
    active : tuple of ActiveBound
        The bounds that limit the front.
    border : {"followed", "cut short", "not followed"}
        Whether the border of the valid designs was followed to its end, or to that of the budget.
    stages : tuple of (str, int)
        Designs evaluated in turn, none of them counted twice: ``("search", 145), ("least length", 40)``,
        ``("beside the recommended", 4), ("own", 1)``. Their sum is at most the budget.
    stopped : str
        Why the search ended.
    level_seconds : dict of int to (int, float)
        Of each level, how often it was run here and the seconds it took, over all workers.
    seconds : float
        Of the whole study.
    rank_consistency : dict of str to float
        Kendall's tau between what the levels tell of the front.
    """

    space: DesignSpace
    method: str
    level: str
    seed: int
    budget: int
    objectives: tuple[str, ...]
    problem: Problem
    evaluations: tuple[Evaluation, ...]
    front: tuple[int, ...]
    best: tuple[int, ...]
    chosen: int | None
    grounds: Grounds
    unmoved: tuple[str, ...]
    beyond_reach: str | None
    least: int | None
    least_of_search: int | None
    second_step: SecondStep | None
    own: Evaluation
    nearest: Evaluation | None
    misses: tuple[str, ...]
    active: tuple[ActiveBound, ...]
    border: Border
    stages: tuple[tuple[str, int], ...]
    stopped: str
    level_seconds: dict[int, tuple[int, float]]
    seconds: float
    journal_hash: str
    rank_consistency: dict[str, float]

    def violation(self, evaluation: Evaluation) -> float:
        """Return how far a design is from being valid, limits on measures included."""
        return total_violation(self.space, evaluation)

    def valid(self, evaluation: Evaluation) -> bool | None:
        """Return whether a design is valid; None where not everything that is asked was looked at."""
        return validity(self.space, evaluation)

    def cell(self) -> Cell | None:
        """Return the chosen design as a cell, or None if none is valid."""
        return None if self.chosen is None else self.space.cell_at(self.evaluations[self.chosen].x)


def design(
    cell: Cell | Mapping[str, Any] | str | Path | DesignSpace,
    *,
    method: str = "hybrid",
    budget: int = 200,
    border: int | None = None,
    seed: int = 0,
    level: str | None = None,
    ranges: Mapping[str, Sequence[str]] | None = None,
    workers: int | None = None,
    journal: Path | Journal | None = None,
    plans: int = 8,
    progress: Callable[[str, int, int, str], None] | None = None,
) -> DesignStudy:
    """Search a cell's designs.

    Parameters
    ----------
    cell : Cell, mapping, str, Path or DesignSpace
    method : str
        ``hybrid``, ``mopso``, ``paper`` (the paper's, with its two objectives), ``grid`` (the whole map) or ``sobol``.
    budget : int
        Designs to evaluate, in all: those of the search, those along the border of the valid ones to the shortest,
        a few beside the recommended one, and the cell's own.
    border : int, optional
        How many of these are kept to follow the border, 0 for none; a quarter by default.
    seed : int
        Of every draw; the same seed gives the same study, for any number of workers.
    level : {"reach", "measures", "plan"}, optional
        How far every design is evaluated; ``reach`` for a grid, else ``measures``, or as far as limits need.
        Objectives that the level does not tell are left out of the search; limits that it does not tell are refused.
    ranges : mapping, optional
        See :meth:`DesignSpace.of`.
    workers : int, optional
        See :func:`qparm.design.workers.evaluate_all`.
    journal : Path or Journal, optional
        Where finished evaluations are kept; those that are there already are not done again.
    plans : int
        How many designs of the front are planned whole.
    progress : callable, optional
        ``progress(stage, done, total, best)``.

    Raises
    ------
    CellError, InvalidInput
        If the cell or an option is not usable.
    """
    start = time.perf_counter()
    space = cell if isinstance(cell, DesignSpace) else DesignSpace.of(cell, ranges=ranges)
    if method not in METHODS:
        raise InvalidInput(f"method must be one of {', '.join(METHODS)}, not {method!r}")
    if level not in (None, "reach", "measures", "plan"):
        raise InvalidInput(f"level must be 'reach', 'measures' or 'plan', not {level!r}")
    whole = (("plans", plans, 0), ("budget", budget, 1), ("border", border, 0), ("seed", seed, 0))
    for name, value, least in whole:
        if name == "border" and value is None:
            continue
        if isinstance(value, bool) or not isinstance(value, int) or value < least:
            raise InvalidInput(f"{name} must be a whole number from {least}, not {value!r}")
    depth = _depth(space, method, level)
    objectives = _objectives(space, method, depth)
    kept = journal if isinstance(journal, Journal) else Journal(problem_hash(space, seed), journal)
    order = Order(depth, _wanted(space, objectives, depth), seed)
    run = Run(space, space.problem(objectives), order, kept, workers, progress)
    followed = any(one.name == "length" and one.exact is not None for one in run.problem.objectives)
    shares = allotted(budget, run.problem.d, border=border, followed=followed)
    stopped = run.search(make_engine(method, run.problem, seed=seed, budget=shares.search), batch=_batch(method))
    stages = [("search", len(run.places))]
    if shares.border:
        run.least_length(budget - shares.own - shares.beside - len(run.places))
    stages.append(("least length", len(run.places) - stages[0][1]))
    told = run.told
    everything = Archive.of(told)
    front, best = ([run.places[tuple(x)] for x in archive.X.tolist()] for archive in (run.archive, everything))
    run.promote(dict.fromkeys([*front, *best]) if depth >= MEASURES_LEVEL else (), ())
    still = unmoved(told)
    place, grounds = choice(everything.F, [run.evaluations()[k] for k in best])
    if len(still) == len(objectives):
        place, grounds = None, "nothing"
    run.promote((), [best[k] for k in worth_planning(everything, place, plans)])
    chosen = None if place is None else best[place]
    evaluations = run.evaluations()
    reserve = chosen is not None and budget - shares.own - len(run.places) >= 2 * run.problem.d
    stages.append(("beside the recommended", 2 * run.problem.d if reserve else 0))
    beyond_reach = run.beyond_reach(evaluations[chosen].x) if chosen is not None and reserve else None
    own = run.own()
    stages.append(("own", shares.own))
    nearest, misses = (None, ()) if front else _nearest(space, evaluations, seed)
    return DesignStudy(
        space=space,
        method=method,
        seed=seed,
        budget=budget,
        level=LEVELS[depth],
        objectives=objectives,
        problem=run.problem,
        evaluations=evaluations,
        front=tuple(front),
        best=tuple(best),
        chosen=chosen,
        grounds=grounds,
        unmoved=tuple(objectives[k] for k in still),
        beyond_reach=beyond_reach,
        least=_least(space, evaluations),
        least_of_search=_least(space, evaluations[: stages[0][1]]),
        second_step=_second_step(run.engine),
        own=own,
        nearest=nearest,
        misses=misses,
        active=active_bounds(run.problem, told) if front else (),
        border=run.border,
        stages=tuple(stages),
        stopped=stopped,
        level_seconds=run.level_seconds,
        seconds=time.perf_counter() - start,
        journal_hash=kept.digest(),
        rank_consistency=_consistency([evaluations[k] for k in best]),
    )


def _depth(space: DesignSpace, method: str, level: str | None) -> int:
    """Return how far every design is evaluated: at least as far as limits, and the paper's objectives, are told."""
    asked = LEVELS.index(level or ("reach" if method == "grid" else "measures"))
    needed = {f"a limit on {name}": MEASURES[name].level for name in space.design.limits}
    if method == "paper":
        needed |= {f"method paper's objective {name}": MEASURES[name].level for name in _PAPER_OBJECTIVES}
    for what, least in needed.items():
        if least > asked:
            if level is not None:
                raise InvalidInput(
                    f"{what} is not known at level {level}: take level {LEVELS[least]}, or leave level out"
                )
            asked = least
    return asked


def _objectives(space: DesignSpace, method: str, depth: int) -> tuple[str, ...]:
    if method == "paper":
        return _PAPER_OBJECTIVES
    told = tuple(name for name in space.design.objectives if MEASURES[name].level <= depth)
    return told or ("length",)


def _wanted(space: DesignSpace, objectives: Sequence[str], depth: int) -> tuple[str, ...]:
    """Return the measures that the search needs of every valid design; the front gets the others when it stands."""
    return () if depth < MEASURES_LEVEL else tuple(dict.fromkeys([*objectives, *space.design.limits]))


def _batch(method: str) -> int:
    """Return how many designs are asked for at a time: few where the next ones depend on them."""
    return 200 if method in ("grid", "sobol") else 10


def _second_step(engine: Engine) -> SecondStep | None:
    from qparm.design.engines.two_steps import TwoStepEngine

    if not isinstance(engine, TwoStepEngine) or engine.box is None:
        return None
    box = engine.box
    return SecondStep(
        len(engine.first_step), tuple(box.lower.tolist()), tuple(box.upper.tolist()), float(box.valid_share)
    )


def _least(space: DesignSpace, evaluations: Sequence[Evaluation]) -> int | None:
    valid = [k for k, one in enumerate(evaluations) if validity(space, one)]
    return min(valid, key=lambda k: (evaluations[k].measures["length"], evaluations[k].x)) if valid else None


def _nearest(space: DesignSpace, evaluations: Sequence[Evaluation], seed: int) -> tuple[Evaluation, tuple[str, ...]]:
    """Return the design that comes nearest to being valid, all of its points looked at, and what it misses and why."""
    from qparm.design.coverage import share_reached
    from qparm.reach import ReachReason
    from qparm.reports.check import check_cell, missed_lines

    nearest = min(evaluations, key=lambda one: (total_violation(space, one), one.x))
    if nearest.valid or not nearest.checked:
        return nearest, ()
    cell = space.cell_at(nearest.x)
    tool_path = cell.tool_path()
    reach = check_cell(cell, seed=seed).reach
    reached = np.array([verdict.reason is ReachReason.WITHIN_REACH for verdict in reach])
    missed = int((~reached).sum())
    whole = replace(
        nearest,
        level=REACH,
        coverage=share_reached(tool_path, reached),
        missed=missed,
        checked=len(reach),
        reason=f"{missed} of {len(reach)} points are not reached" if missed else nearest.reason,
    )
    return whole, tuple(missed_lines(tool_path, reach))


def _consistency(front: Sequence[Evaluation]) -> dict[str, float]:
    """Return Kendall's tau between what the samples and a whole plan tell of the same designs."""
    from scipy.stats import kendalltau

    pairs = (
        ("largest_step", "planned_largest_step"),
        ("singularity_margin", "planned_margin"),
        ("motion_time", "cycle_time"),
    )
    found = {}
    for cheap, dear in pairs:
        both = [one.measures for one in front if cheap in one.measures and dear in one.measures]
        if len(both) > 2:
            tau: Any = kendalltau([one[cheap] for one in both], [one[dear] for one in both])[0]
            if math.isfinite(tau):
                found[f"{cheap} / {dear}"] = float(tau)
    return found
