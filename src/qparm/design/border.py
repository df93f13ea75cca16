"""From a valid design along the border of the valid ones to the shortest, in few evaluations.

The length is affine in the variables and needs no evaluation; whether a design is valid does. So designs are looked at
that are shorter than the best one by a step. A model of the graded violations, fitted to all that is known, says where
on that plane validity is likeliest. One that is valid is the best from then on; where none of a round is, the step is
halved, and after two good rounds it is doubled.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from qparm.design.archive import Archive
from qparm.design.engines.belief import Models
from qparm.design.problem import Evaluations, Outcome, Problem

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.design.engines.belief import Belief

__all__ = ["follow_border"]

# Steps (m), the first and the last, and how many designs are looked at before one is halved.
_FIRST_STEP, _LAST_STEP = 0.016, 0.00025
_ROUND = 4
# Candidates on a plane, half of them near the best (by 10^-2.5 to 10^-0.5 of the ranges), and how they are brought
# onto it: into the range and onto the plane by turns.
_CANDIDATES, _NEAR, _TURNS = 400, (-2.5, -0.5), 20
# Of one round no two are nearer to each other than this, in fractions of the ranges.
_APART = 1e-4


def follow_border(
    problem: Problem,
    known: Evaluations,
    look: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    *,
    most: int,
    rng: np.random.Generator,
) -> tuple[NDArray[np.float64], bool]:
    """Return the shortest valid design found, (d,), and whether the last step was tried: not all designs were needed.

    Parameters
    ----------
    problem : Problem
        With one objective, known exactly and affine: the length (m).
    known : Evaluations
        At least one of them valid.
    look : callable
        Designs (k, d) to their violations (k,), 0 where valid.
    most : int
        Designs that may be looked at.
    rng : numpy.random.Generator
    """
    exact = problem.objectives[0].exact
    assert exact is not None
    fitted: dict[str, NDArray[np.float64]] = {}
    step, before = _FIRST_STEP, False
    while step >= _LAST_STEP and most > 0:
        archive = Archive.of(known)
        U = _shorter(problem, archive.X[0], step, rng)
        found = False
        if len(U):
            belief = Models(problem, known, archive, fitted).at(U)
            X = problem.from_unit(U[_likeliest(belief, U, min(_ROUND, most), rng)])
            violation = look(X)
            most -= len(X)
            outcomes = [Outcome(float(v), (float(f),)) for v, f in zip(violation, exact(X), strict=True)]
            known = known.and_also(problem, X, outcomes)
            found = bool((violation == 0).any())
        if not found:
            step *= 0.5
        elif before:
            step *= 2.0
        before = found
    return Archive.of(known).X[0], step < _LAST_STEP


def _shorter(problem: Problem, best: NDArray[np.float64], step: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return designs as fractions of their ranges (k, d), whose length is less than the best one's by a step (m)."""
    exact, d = problem.objectives[0].exact, problem.d
    assert exact is not None
    at = problem.to_unit(best[None])
    length = float(exact(best[None])[0])
    # the length is affine: its gradient in fractions of the range
    corner = exact(problem.from_unit(np.zeros((1, d))))[0]
    gradient = exact(problem.from_unit(np.eye(d))) - corner
    if not gradient.any():
        return np.empty((0, d))
    half = _CANDIDATES // 2
    near = at + 10.0 ** rng.uniform(*_NEAR, (half, 1)) * rng.standard_normal((half, d))
    u = np.concatenate([rng.random((_CANDIDATES - half, d)), near])
    for _ in range(_TURNS):
        u = np.clip(u, 0.0, 1.0)
        beyond = corner + u @ gradient - (length - step)
        u = u - np.outer(beyond, gradient) / (gradient @ gradient)
    u = np.clip(u, 0.0, 1.0)
    return u[np.abs(exact(problem.from_unit(u)) - (length - step)) < 0.1 * step]


def _likeliest(belief: Belief, U: NDArray[np.float64], count: int, rng: np.random.Generator) -> list[int]:
    """Return the places of the candidates likeliest to be valid, each picked as if those before had been seen."""
    picks: list[int] = []
    free, drawn = np.ones(len(U), dtype=bool), rng.random(len(U))
    while len(picks) < count and free.any():
        worth = drawn  # where no invalid design is known
        if belief.violation is not None:
            worth = -belief.violation.mean / np.sqrt(belief.violation.variance)
        pick = int(np.argmax(np.where(free, worth, -np.inf)))
        picks.append(pick)
        free &= np.abs(U - U[pick]).max(axis=1) > _APART
        belief.expect(pick)
    return picks
