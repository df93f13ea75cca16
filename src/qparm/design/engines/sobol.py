"""Sobol points: the whole range evenly, without learning anything."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import qmc

from qparm.design.engines.engine import Engine
from qparm.design.problem import Problem

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["SobolEngine", "sobol_points"]


def sobol_points(d: int, count: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return the first scrambled Sobol points, (count, d) in [0, 1)."""
    power = max(0, int(np.ceil(np.log2(max(count, 1)))))
    return qmc.Sobol(d, rng=rng).random_base2(power)[:count]


class SobolEngine(Engine):
    """Scrambled Sobol points over the range."""

    method = "sobol"

    def __init__(self, problem: Problem, *, seed: int, budget: int) -> None:
        super().__init__(problem, seed=seed, budget=budget)
        self._points = sobol_points(problem.d, budget, self.rng)
        self._next = 0

    def _propose(self, n: int) -> NDArray[np.float64]:
        self._next += n
        return self._points[self._next - n : self._next]
