"""A box in which most designs are valid (PRIM, Friedman and Fisher 1999): for people, and the paper's method."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from qparm.design.archive import Archive
from qparm.design.problem import Evaluations, Problem

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["ValidBox", "valid_box"]

# A design of more violation than this is not near a valid one.
_FAR = 0.05
_SLICE, _KEEP_OFF, _VALID, _SUPPORT = 0.05, 0.05, 0.9, 0.15


@dataclass(frozen=True, eq=False)
class ValidBox:
    """A box of designs.

    Attributes
    ----------
    lower, upper : ndarray, shape (d,)
        In the variables' units.
    valid_share : float
        Share of the evaluated designs inside that are valid; NaN where none was evaluated.
    support : float
        Share of all evaluated designs that lie inside; NaN where none was evaluated.
    """

    lower: NDArray[np.float64]
    upper: NDArray[np.float64]
    valid_share: float
    support: float


def valid_box(problem: Problem, evaluations: Evaluations) -> ValidBox:
    """Return a box of mostly valid designs.

    Slices of 5 % of the designs inside are peeled off where that raises the valid share most, never within 5 % of the
    range of an archived design, until 90 % are valid or 15 % of the designs would be left, or no slice helps.

    On the side towards which an objective that needs no evaluation improves, a slice is peeled off only where every
    design in it is far from valid (violation above 0.05): the best one lies on the border of the valid designs, in a
    corner as often as not, and there most of its neighbours are invalid.
    """
    U, valid = problem.to_unit(evaluations.X), evaluations.valid
    archived = problem.to_unit(Archive.of(evaluations).X)
    low, high = np.zeros(problem.d), np.ones(problem.d)
    keep_low, keep_high = np.ones(problem.d), np.zeros(problem.d)
    if len(archived):
        keep_low, keep_high = archived.min(axis=0) - _KEEP_OFF, archived.max(axis=0) + _KEEP_OFF
    near = evaluations.violation <= _FAR
    if near.any():
        better = _improving(problem)
        keep_low[better < 0] = np.minimum(keep_low, U[near].min(axis=0))[better < 0]
        keep_high[better > 0] = np.maximum(keep_high, U[near].max(axis=0))[better > 0]
    inside = ((low <= U) & (high >= U)).all(axis=1)
    total = max(int(inside.sum()), 1)
    while inside.any() and valid[inside].mean() < _VALID:
        best, cut = valid[inside].mean(), None
        for k in range(problem.d):
            for side in (0, 1):
                at = float(np.quantile(U[inside, k], (_SLICE, 1 - _SLICE)[side]))
                at = min(at, float(keep_low[k])) if side == 0 else max(at, float(keep_high[k]))
                left = inside & (U[:, k] >= at if side == 0 else U[:, k] <= at)
                if left.sum() < inside.sum() and left.sum() >= _SUPPORT * total and valid[left].mean() > best:
                    best, cut = valid[left].mean(), (k, side, at, left)
        if cut is None:
            break
        k, side, at, inside = cut
        (low, high)[side][k] = at
    lower, upper = problem.from_unit(np.array([low, high]))
    share = float(valid[inside].mean()) if inside.any() else float("nan")
    return ValidBox(lower, upper, share, float(inside.sum() / total) if len(U) else float("nan"))


def _improving(problem: Problem) -> NDArray[np.int64]:
    """Return towards which end of each variable exact objectives improve, (d,): -1, 1, or 0 for neither or both."""
    sides = np.zeros(problem.d)
    corner, ends = problem.from_unit(np.full((1, problem.d), 0.5)), np.eye(problem.d)
    for objective in problem.objectives:
        if objective.exact is not None:
            at = objective.exact(corner)
            sides -= np.sign(objective.exact(problem.from_unit(0.5 + 0.5 * ends)) - at)
    return np.sign(sides).astype(np.int64)
