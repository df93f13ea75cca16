"""The whole map: a regular grid over the range, its ends included."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from qparm.design.engines.engine import Engine
from qparm.design.problem import Problem
from qparm.errors import InvalidInput

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["GridEngine", "grid_side"]


def grid_side(d: int, budget: int) -> int:
    """Return how many points along each of d variables a budget pays for."""
    side = max(1, round(budget ** (1 / d)))
    return side - 1 if side**d > budget else side


class GridEngine(Engine):
    """A grid of equal numbers along all variables, the last variable fastest; its end is the end of the search.

    Raises
    ------
    InvalidInput
        A budget below two points along each variable.
    """

    method = "grid"

    def __init__(self, problem: Problem, *, seed: int, budget: int) -> None:
        super().__init__(problem, seed=seed, budget=budget)
        self.side = grid_side(problem.d, budget)
        if self.side < 2:
            raise InvalidInput(f"a grid over {problem.d} variables needs a budget of at least {2**problem.d}")
        self._next = 0

    def _propose(self, n: int) -> NDArray[np.float64]:
        d, side = self.problem.d, self.side
        places = np.arange(self._next, min(self._next + n, side**d))
        self._next += len(places)
        return np.column_stack(np.unravel_index(places, (side,) * d)) / (side - 1)
