"""The paper's method (Sun et al. 2023, section 2.2): a swarm that keeps off invalid designs, in two steps."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from qparm.design.engines.potential_field import repulsion
from qparm.design.engines.swarm import SwarmEngine
from qparm.design.problem import Evaluations, Problem
from qparm.design.valid_region import ValidBox, valid_box

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["TwoStepEngine"]

# The paper gives no numbers; none of six pairs of strength and radius made a difference on problems like its own.
_STRENGTH, _RADIUS = 2e-4, 0.15
# Share of the budget that the first step has.
_FIRST = 0.3


class TwoStepEngine(SwarmEngine):
    """The swarm, an artificial potential field around every invalid design, and a smaller range for the second step.

    After 30 % of the budget the range is shrunk to the valid box of all designs evaluated so far, which a person read
    off a figure in the paper. Particles outside are drawn anew inside; archive and invalid designs are kept.

    Attributes
    ----------
    box : ValidBox or None
        The range of the second step, None before it.
    first_step : Evaluations
        What was known when the range was shrunk; empty before.
    """

    method = "paper"

    def __init__(self, problem: Problem, *, seed: int, budget: int) -> None:
        super().__init__(problem, seed=seed, budget=budget)
        self.box: ValidBox | None = None
        self.first_step = Evaluations.none(problem)

    def _propose(self, n: int) -> NDArray[np.float64]:
        if self.box is None and self.evaluated >= _FIRST * self.budget:
            self._shrink()
        return super()._propose(n)

    def _shrink(self) -> None:
        self.first_step = self.evaluations
        self.box = valid_box(self.problem, self.evaluations)
        self.low, self.high = self.problem.to_unit(np.array([self.box.lower, self.box.upper]))
        outside = ((self.position < self.low) | (self.position > self.high)).any(axis=1)
        anew = self.rng.uniform(self.low, self.high, self.position.shape)
        self.position = np.where(outside[:, None], anew, self.position)
        self.velocity[outside] = 0.0

    def _push(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        invalid = self.evaluations.X[~self.evaluations.valid]
        return repulsion(u, self.problem.to_unit(invalid), strength=_STRENGTH, radius=_RADIUS)

    def _mutated(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the position as it is: the paper's swarm has no mutation."""
        return u

    def _extended(self, previous: Problem) -> None:
        super()._extended(previous)
        if self.box is not None:
            self.low, self.high = self.problem.to_unit(np.array([self.box.lower, self.box.upper]))
