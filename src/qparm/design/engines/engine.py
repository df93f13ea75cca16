"""The base of all engines: propose designs, take in their measures, keep the archive."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from qparm.design.archive import Archive
from qparm.design.problem import Evaluations, Outcome, Problem
from qparm.errors import InvalidInput

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

__all__ = ["Engine"]


class Engine(ABC):
    """Ask for designs, tell their measures.

    The proposals depend on the problem, the seed, the budget, the numbers of designs asked for and the outcomes told,
    in their order, and on nothing else: told in the order of asking, a run is the same for any number of workers.

    Parameters
    ----------
    problem : Problem
    seed : int
    budget : int
        Evaluations in all. Schedules refer to it; nothing is proposed beyond it.
    """

    method = ""

    def __init__(self, problem: Problem, *, seed: int, budget: int) -> None:
        if budget < 1:
            raise InvalidInput(f"budget must be at least 1, not {budget}")
        self.problem = problem
        self.budget = budget
        self.rng = np.random.default_rng(seed)
        self.evaluations = Evaluations.none(problem)
        self.archive = Archive.of(self.evaluations)
        self._pending: list[NDArray[np.float64]] = []

    @property
    def evaluated(self) -> int:
        """Number of designs told so far."""
        return len(self.evaluations)

    def ask(self, n: int) -> NDArray[np.float64]:
        """Return the next designs, (k, d) in the variables' units, within the range.

        ``k`` is `n`, or fewer where the budget (told and pending together) ends or a grid is complete.

        Raises
        ------
        InvalidInput
            `n` below 1.
        """
        if n < 1:
            raise InvalidInput(f"ask for at least one design, not {n}")
        n = min(n, self.budget - self.evaluated - len(self._pending))
        if n <= 0:
            return np.empty((0, self.problem.d))
        X = self.problem.from_unit(self._propose(n))
        self._pending.extend(X)
        return X

    def tell(self, X: ArrayLike, outcomes: Sequence[Outcome]) -> None:
        """Take in the measures of designs, in the order of asking.

        Designs that were not asked for (a first guess, an older run) are welcome too.

        Raises
        ------
        InvalidInput
            Wrong shape, not finite, or not one outcome for each design; nothing is taken in then.
        """
        before = self.evaluated
        self.evaluations = self.evaluations.and_also(self.problem, X, outcomes)
        self.archive = Archive.of(self.evaluations)
        for row in self.evaluations.X[before:]:
            for k, pending in enumerate(self._pending):
                if np.array_equal(row, pending):
                    del self._pending[k]
                    break
        self._observe(before)

    def extend(self, problem: Problem) -> None:
        """Go on with other ranges of the same variables; nothing evaluated is lost.

        Raises
        ------
        InvalidInput
            Other variables or objectives.
        """
        for old, new in ((self.problem.variables, problem.variables), (self.problem.objectives, problem.objectives)):
            if [item.name for item in old] != [item.name for item in new]:
                raise InvalidInput("a search can only be extended in the ranges of the same variables and objectives")
        previous, self.problem = self.problem, problem
        self._extended(previous)

    @abstractmethod
    def _propose(self, n: int) -> NDArray[np.float64]:
        """Return n designs (or fewer) as fractions of their ranges."""

    def _observe(self, first: int) -> None:  # noqa: B027
        """Take in the evaluations from `first` on."""

    def _extended(self, previous: Problem) -> None:  # noqa: B027
        """Carry what is kept as fractions of the previous ranges over to the new ones."""
