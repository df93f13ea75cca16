"""When a search has found what it will find, and whether a bound that someone chose limits it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from qparm.design.archive import Archive, hypervolume, reference_point
from qparm.design.problem import Evaluations, Problem

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["ActiveBound", "active_bounds", "extended", "stalled"]

# Least relative gain of hypervolume that counts.
_GAIN = 1e-3
# How near to a bound is on it, and how far across it is looked, of the range.
_NEAR = 0.02
# How much a range grows at an active bound.
_EXTENSION = 0.2


@dataclass(frozen=True)
class ActiveBound:
    """A bound that limits the design.

    Attributes
    ----------
    variable : str
    side : str
        ``"lower"`` or ``"upper"``.
    bound : float
        The end of the range as it is (SI).
    extended : float
        Where it would go; the bound itself where that is hard.
    objectives : tuple of str
        What improves across it.
    index : int
        Place of an archived design on it in the evaluations.
    """

    variable: str
    side: Literal["lower", "upper"]
    bound: float
    extended: float
    objectives: tuple[str, ...]
    index: int

    @property
    def hard(self) -> bool:
        """Whether the range cannot be extended there."""
        return self.extended == self.bound

    def __str__(self) -> str:
        sign = ">=" if self.side == "lower" else "<="
        return f"design limited by bound {self.variable} {sign} {self.bound:g}: {', '.join(self.objectives)}"


def stalled(evaluations: Evaluations, *, batch: int) -> bool:
    """Return whether the last max(5 batch, 50) evaluations gained less than 1e-3 of the hypervolume.

    False as long as nothing valid is known. The reference point is that of the archive now and then, together.
    """
    raise NotImplementedError


def active_bounds(problem: Problem, evaluations: Evaluations) -> tuple[ActiveBound, ...]:
    """Return the ends of ranges that limit the archive.

    An end is active where an archived design lies within 2 % of it (of the range) and a step of as much across it
    would gain more than 1e-3 of the hypervolume: exact objectives are evaluated there, the others follow the gradient
    of a plane through the nearest evaluations. Whether the step stays valid is not asked: other variables may make up
    for it.
    """
    raise NotImplementedError


def extended(problem: Problem, bounds: tuple[ActiveBound, ...]) -> Problem:
    """Return a problem whose ranges are extended at active bounds by 20 %, up to the hard bounds."""
    for bound in bounds:
        variable = next(item for item in problem.variables if item.name == bound.variable)
        lower, upper = variable.lower, variable.upper
        if bound.side == "lower":
            lower = bound.extended
        else:
            upper = bound.extended
        problem = problem.with_range(variable.name, lower, upper)
    return problem
