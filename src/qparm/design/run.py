"""The loop of a study: engines ask, workers evaluate, the journal keeps, the engine is told."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from qparm.cell.design import MEASURES
from qparm.design.archive import Archive
from qparm.design.border import follow_border
from qparm.design.evaluate import ATTAINED, COUNTED, MEASURES_LEVEL, PLAN, REACH, Evaluation
from qparm.design.problem import Evaluations, Objective, Outcome, Problem
from qparm.design.space import shown
from qparm.design.stop import active_bounds, extended, stalled
from qparm.design.workers import Order, evaluate_all

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.design.engines import Engine
    from qparm.design.journal import Journal
    from qparm.design.space import DesignSpace

__all__ = ["Border", "Run", "total_violation", "validity"]

# Engines that stop by themselves, and whose ranges may be extended.
_SEARCHING = ("hybrid", "mopso")
# How often active bounds are looked for, in batches.
_EVERY = 5
# How far variables are moved to see whether a design lies on the border of reach.
_ASIDE: dict[str | None, float] = {"length": 1e-3, "angle": float(np.radians(0.1))}

Progress = Callable[[str, int, int, str], None]
Border = Literal["followed", "cut short", "not followed"]


def total_violation(space: DesignSpace, evaluation: Evaluation) -> float:
    """Return how far a design is from being valid: what it does not cover, and how far measures are beyond limits.

    A limit that is missed by as much as the limit itself counts as one.
    """
    violation = evaluation.violation
    if violation == 0:
        for name, limit in space.design.limit_values().items():
            value = evaluation.measures.get(name)
            if value is not None:
                beyond = MEASURES[name].sense * (value - limit)
                violation += max(beyond, 0.0) / (abs(limit) or 1.0)
    return violation


def validity(space: DesignSpace, evaluation: Evaluation) -> bool | None:
    """Return whether a design is valid; None where not all points, or not all limits, were looked at."""
    if total_violation(space, evaluation) > 0:
        return False
    looked_at = evaluation.level >= REACH and all(name in evaluation.measures for name in space.design.limits)
    return True if looked_at else None


class Run:
    """A study under way.

    Attributes
    ----------
    problem : Problem
        With the ranges as they are now.
    places : dict
        Every design that was asked for, and its place in the order.
    level_seconds : dict of int to (int, float)
        How often each level was run here, and for how long, over all workers.
    border : {"followed", "cut short", "not followed"}
        Whether the border of the valid designs was followed to its end, or to that of the budget.
    """

    def __init__(
        self,
        space: DesignSpace,
        problem: Problem,
        order: Order,
        journal: Journal,
        workers: int | None,
        progress: Progress | None,
    ) -> None:
        self.space, self.problem, self.order = space, problem, order
        self.places: dict[tuple[float, ...], int] = {}
        self.level_seconds: dict[int, tuple[int, float]] = {}
        self.border: Border = "not followed"
        self.engine: Engine
        self._journal, self._workers, self._progress = journal, workers, progress
        # the measures that the front gets
        self._all = tuple(name for name in (*ATTAINED, *COUNTED) if name not in space.unknown)
        self._names = [objective.name for objective in problem.objectives]
        self._best: tuple[float, str] = (np.inf, "")
        self._followed: tuple[NDArray[np.float64], list[Outcome]] = (np.empty((0, problem.d)), [])

    @property
    def archive(self) -> Archive:
        """The designs that no other of the engine's own search beats."""
        return Archive.of(self.engine.evaluations)

    @property
    def told(self) -> Evaluations:
        """What the engine was told, and the end of the border that was followed."""
        return self.engine.evaluations.and_also(self.problem, *self._followed)

    def search(self, engine: Engine, *, batch: int) -> str:
        """Ask and tell until the budget is spent or nothing more is gained; return why it ended."""
        self.engine = engine
        searching = engine.method in _SEARCHING
        rounds = 0
        while True:
            X = engine.ask(batch)
            if not len(X):
                return f"all {engine.evaluated} designs evaluated"
            self._tell(X, self.evaluate(X, self.order, "search", engine.evaluated, engine.budget))
            self.problem = engine.problem
            rounds += 1
            if not searching or not len(engine.archive):
                continue
            ended = stalled(engine.evaluations, batch=batch)
            if ended or rounds % _EVERY == 0:
                movable = tuple(b for b in active_bounds(engine.problem, engine.evaluations) if not b.hard)
                if movable:
                    engine.extend(extended(engine.problem, movable))
                    self.problem = engine.problem
                elif ended:
                    return f"nothing more gained after {engine.evaluated} designs"

    def least_length(self, most: int) -> None:
        """Follow the border of the valid designs to the shortest, with so many designs at most.

        Each is tested for reach; where there are limits on measures, those that reach are measured, and only one that
        keeps the limits is valid.
        """
        exact = next((one.exact for one in self.problem.objectives if one.name == "length"), None)
        if exact is None or not any(validity(self.space, one) for one in self.evaluations()):
            return
        problem = replace(self.problem, objectives=(Objective("length", exact),))
        looked_at = [one for one in self.evaluations() if validity(self.space, one) is not None]
        X = np.array([one.x for one in looked_at])
        outcomes = [
            Outcome(total_violation(self.space, one), (float(length),))
            for one, length in zip(looked_at, exact(X), strict=True)
        ]
        known = Evaluations.none(problem).and_also(problem, X, outcomes)
        order = Order(REACH, (), self.order.seed)
        limits = tuple(name for name in self.space.design.limits if MEASURES[name].level > REACH)
        limited = replace(self.order, names=limits) if limits else None

        def look(X: NDArray[np.float64]) -> NDArray[np.float64]:
            found = self.evaluate(X, order, "least length", 0, 0)
            if limited:
                self.evaluate(np.array([one.x for one in found if one.valid]), limited, "least length", 0, 0)
                found = self.evaluate(X, order, "least length", 0, 0)
            return np.array([total_violation(self.space, one) for one in found])

        x, ended = follow_border(problem, known, look, most=most, rng=np.random.default_rng([self.order.seed, 5]))
        self.border = "followed" if ended else "cut short"
        found = self.evaluate(x[None], self.order, "least length", 0, 0)
        if self.engine.method != "paper":
            self._tell(x[None], found)
        else:  # whose own front is to be the paper's
            self._followed = x[None], [self._outcome(one) for one in found]

    def promote(self, front: Iterable[int], planned: Iterable[int]) -> None:
        """Take all measures of the front, and plan some designs whole."""
        designs = list(self.places)
        chosen = [designs[k] for k in planned]
        told = list(dict.fromkeys([*(designs[k] for k in front), *chosen]))
        self.evaluate(told, Order(MEASURES_LEVEL, self._all, self.order.seed), "measures", 0, len(told))
        self.evaluate(chosen, Order(PLAN, self._all, self.order.seed), "plans", 0, len(chosen))

    def beyond_reach(self, x: Sequence[float]) -> str:
        """Return how a step of one variable from a design leads to points missed, or nothing where none does."""
        design = np.array(x)
        steps: list[float] = (0.005 * (self.problem.upper - self.problem.lower)).tolist()
        for k, dimension in enumerate(self.space.dimensions):
            steps[k] = _ASIDE.get(dimension, steps[k])
        moves = np.vstack([-np.diag(steps), np.diag(steps)])
        order = Order(REACH, (), self.order.seed)
        found = evaluate_all(
            self.space, (design + moves).tolist(), order, self._journal, workers=1, finished=self._count
        )
        for k, one in enumerate(found):
            if one.checked and not one.valid:
                place = k % len(steps)
                step = shown(abs(float(moves[k, place])), self.space.dimensions[place])
                return f"{step} {'less' if k < len(steps) else 'more'} of {self.space.names[place]} misses points"
        return ""

    def own(self) -> Evaluation:
        """Return the measures of the cell's own design; the engine is not told."""
        x = tuple(self.space.own.tolist())
        order = self.order if self.order.level < MEASURES_LEVEL else replace(self.order, names=self._all)
        return evaluate_all(self.space, [x], order, self._journal, workers=1, finished=self._count)[0]

    def evaluations(self) -> tuple[Evaluation, ...]:
        """Return all that was asked for, as far as it is known."""
        found = [self._journal.get(x) for x in self.places]
        return tuple(one for one in found if one is not None)

    def evaluate(
        self,
        X: NDArray[np.float64] | Sequence[Sequence[float]],
        order: Order,
        stage: str,
        before: int,
        total: int,
    ) -> list[Evaluation]:
        """Return the evaluations of designs (k, d), and keep account."""
        designs = [tuple(float(value) for value in x) for x in X]
        for x in designs:
            self.places.setdefault(x, len(self.places))
        done = before

        def finished(evaluation: Evaluation) -> None:
            nonlocal done
            done += 1
            self._count(evaluation)
            self._note(evaluation)
            if self._progress is not None:
                self._progress(stage, done, max(total, done), self._best[1])

        found = evaluate_all(self.space, designs, order, self._journal, workers=self._workers, finished=finished)
        for evaluation in found:
            self._note(evaluation)
        if self._progress is not None:
            self._progress(stage, before + len(designs), max(total, before + len(designs)), self._best[1])
        return found

    def _tell(self, X: NDArray[np.float64], found: Sequence[Evaluation]) -> None:
        self.engine.tell(X, [self._outcome(one) for one in found])

    def _outcome(self, evaluation: Evaluation) -> Outcome:
        violation = total_violation(self.space, evaluation)
        if violation > 0:
            return Outcome(violation)
        values = [MEASURES[name].sense * evaluation.measures[name] for name in self._names]
        return Outcome(0.0, tuple(values))

    def _count(self, evaluation: Evaluation) -> None:
        for level, seconds in evaluation.seconds.items():
            times, total = self.level_seconds.get(level, (0, 0.0))
            self.level_seconds[level] = times + 1, total + seconds

    def _note(self, evaluation: Evaluation) -> None:
        """Keep the best so far, for those who watch: the shortest valid design, else the least violating one."""
        violation = total_violation(self.space, evaluation)
        valid = validity(self.space, evaluation)
        if valid is None:
            return
        rank = evaluation.measures.get("length", 0.0) if valid else 1e6 + violation
        if rank < self._best[0]:
            words = self.space.shown(evaluation.x)
            most = "" if evaluation.level >= REACH else "at most "
            what = "shortest" if valid else f"nearest to valid ({most}{evaluation.coverage:.1%} covered)"
            self._best = rank, f"{what}: {words}"
