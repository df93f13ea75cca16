"""The default engine: a swarm's moves, chosen by what models expect of them.

Gaussian processes predict the objectives that need an evaluation; those known exactly are taken as they are. Another
process follows the graded violation and tells how likely a design is to be valid. A batch is picked one design at a
time: the largest expected gain of hypervolume times the probability of being valid, each pick counted as evaluated
with what is expected of it. As long as nothing valid is known the picks go where most is expected to be won inside.
Where outcomes are constant in steps, all is weighted with the probability of being on a step that is not known yet.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from qparm.design.archive import crowding, free_boxes, reference_point
from qparm.design.engines.belief import Belief, Models
from qparm.design.engines.engine import Engine
from qparm.design.engines.improvement import expected_gain, expected_shortfall
from qparm.design.engines.moves import candidates, steps_around
from qparm.design.engines.sobol import sobol_points
from qparm.design.engines.steps import same_step, step_widths
from qparm.design.problem import Problem

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["HybridEngine"]

# Sobol points to start with, for each variable and one more.
_START, _LEAST_START = 3, 8
_CANDIDATES, _KEPT = 1500, 1000
# Twice the best candidates are refined, by steps of 10^-2.5 to 10^-1.
_ROUNDS, _REFINED, _STEPS = 2, 12, 250
# Least distances (largest of the coordinates) to what was evaluated and to what was picked.
_FROM_EVALUATED, _FROM_PICKED = 2e-3, 5e-3
# Most archived designs that boxes are made of, by the number of objectives.
_FRONT = {1: 1, 2: 200, 3: 40}
_FRONT_MANY = 12


class HybridEngine(Engine):
    """Swarm moves, chosen by Gaussian processes and expected gain of hypervolume."""

    method = "hybrid"

    def __init__(self, problem: Problem, *, seed: int, budget: int) -> None:
        super().__init__(problem, seed=seed, budget=budget)
        self._points = sobol_points(problem.d, budget, self.rng)
        self._begun = 0
        self._fitted: dict[str, NDArray[np.float64]] = {}

    def _propose(self, n: int) -> NDArray[np.float64]:
        if self._begun < max(_START * (self.problem.d + 1), _LEAST_START) or not self.evaluated:
            self._begun += n
            return self._points[self._begun - n : self._begun]
        return self._chosen(n)

    def _chosen(self, n: int) -> NDArray[np.float64]:
        models = Models(self.problem, self.evaluations, self.archive, self._fitted)
        seen = self.problem.to_unit(np.vstack([self.evaluations.X, *self._pending]))
        front = self._front()
        reference = reference_point(front) if len(front) else None
        widths = step_widths(self.problem.to_unit(self.evaluations.X), self.evaluations)
        C = candidates(self._best(), _CANDIDATES, self.rng)
        for _ in range(_ROUNDS):
            new = 1.0 if widths is None else 1.0 - same_step(C, seen, widths)
            order = np.argsort(-_worth(models.at(C), front, reference) * new, kind="stable")
            steps = steps_around(C[order[:_REFINED]], _STEPS, self.rng, least=-2.5, most=-1.0)
            C = np.vstack([C[order[:_KEPT]], steps])
        free = np.ones(len(C), dtype=bool)
        for u in seen:
            free &= np.abs(C - u).max(axis=1) > _FROM_EVALUATED
        new = np.ones(len(C)) if widths is None else 1.0 - same_step(C, seen, widths)
        belief, picks = models.at(C), []
        for _ in range(n):
            pick = int(np.argmax(np.where(free, _worth(belief, front, reference) * new, -1.0)))
            picks.append(pick)
            free &= np.abs(C - C[pick]).max(axis=1) > _FROM_PICKED
            if widths is not None:
                new = np.minimum(new, 1.0 - same_step(C, C[pick : pick + 1], widths))
            belief.expect(pick)
            if len(front):
                front = np.vstack([front, belief.mean[pick]])
        return C[picks]

    def _front(self) -> NDArray[np.float64]:
        F = self.archive.F
        most = _FRONT.get(self.problem.m, _FRONT_MANY)
        return F if len(F) <= most else F[np.sort(np.argsort(-crowding(F), kind="stable")[:most])]

    def _best(self) -> NDArray[np.float64]:
        if len(self.archive):
            return self.problem.to_unit(self.archive.X)
        return self.problem.to_unit(self.evaluations.X[np.argsort(self.evaluations.violation, kind="stable")[:5]])


def _worth(belief: Belief, front: NDArray[np.float64], reference: NDArray[np.float64] | None) -> NDArray[np.float64]:
    """Return what designs are worth evaluating, (k,)."""
    if reference is not None:
        return expected_gain(*free_boxes(front, reference), belief.mean, belief.deviation) * belief.valid
    if belief.violation is None:
        return belief.valid
    return expected_shortfall(np.zeros(1), belief.violation.mean, np.sqrt(belief.violation.variance))
