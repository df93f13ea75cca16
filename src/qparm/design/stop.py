"""Stopping rules: whether a search has stalled, and whether a chosen bound limits it."""

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

    False as long as fewer were evaluated or nothing valid was known before them. The reference point is that of the
    archive now and then, together.
    """
    window = max(5 * batch, 50)
    before = Archive.of(evaluations.first(max(len(evaluations) - window, 0))).F
    if not len(before):
        return False
    now = Archive.of(evaluations).F
    reference = reference_point(np.vstack([before, now]))
    volume = hypervolume(now, reference)
    return volume - hypervolume(before, reference) < _GAIN * volume


def active_bounds(problem: Problem, evaluations: Evaluations) -> tuple[ActiveBound, ...]:
    """Return the ends of ranges that limit the archive.

    An end is active where an archived design lies within 2 % of it (of the range) and a step of as much across it
    would gain more than 1e-3: of the hypervolume, or of the archive's extent beyond the best value of an objective.
    Exact objectives are evaluated there, the others follow the slopes of a plane through the nearest evaluations.
    Whether the step stays valid is not asked: other variables may make up for it.
    """
    archive = Archive.of(evaluations)
    if not len(archive):
        return ()
    reference = reference_point(archive.F)
    volume = hypervolume(archive.F, reference)
    ideal, extent = archive.F.min(axis=0), reference - archive.F.min(axis=0)
    U = problem.to_unit(archive.X)
    known = evaluations.known
    U_known, F_known = problem.to_unit(evaluations.X[known]), evaluations.F[known]
    found = []
    for k, variable in enumerate(problem.variables):
        sides: tuple[tuple[Literal["lower", "upper"], float, float], ...] = (
            ("lower", variable.lower, variable.hard_lower),
            ("upper", variable.upper, variable.hard_upper),
        )
        for side, end, hard in sides:
            outward = -1.0 if side == "lower" else 1.0
            on_bound = np.flatnonzero((U[:, k] <= _NEAR) if side == "lower" else (1 - U[:, k] <= _NEAR))
            best, gain = None, _GAIN
            for i in on_bound:
                F = _across(problem, archive.X[i], archive.F[i], k, outward * _NEAR, U_known, F_known)
                more = hypervolume(np.vstack([archive.F, F]), reference) / volume - 1.0
                more = max(more, float(((ideal - F) / extent).max()))
                if more > gain:
                    best, gain = (int(archive.index[i]), archive.F[i] > F), more
            if best is not None:
                at = end + outward * _EXTENSION * (variable.upper - variable.lower)
                at = max(at, hard) if side == "lower" else min(at, hard)
                names = tuple(o.name for o, improves in zip(problem.objectives, best[1], strict=True) if improves)
                found.append(ActiveBound(variable.name, side, end, float(at), names, best[0]))
    return tuple(found)


def _across(
    problem: Problem,
    x: NDArray[np.float64],
    F: NDArray[np.float64],
    k: int,
    step: float,
    U_known: NDArray[np.float64],
    F_known: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the objectives expected of a design after a step (of the range) along one variable."""
    moved = x.copy()
    moved[k] += step * (problem.upper - problem.lower)[k]
    u = problem.to_unit(x)
    distance = np.sqrt(((U_known - u) ** 2).sum(axis=1))
    near = np.argsort(distance, kind="stable")[: 4 * (problem.d + 1)]
    # A little ridge keeps slopes along unseen directions at zero.
    A, b = U_known[near] - u, F_known[near] - F
    ridge = 1e-6 + 1e-3 * (A**2).sum() / problem.d
    slopes = np.linalg.solve(A.T @ A + ridge * np.eye(problem.d), A.T @ b)
    out = F + step * slopes[k]
    for j, objective in enumerate(problem.objectives):
        if objective.exact is not None:
            out[j] = float(np.asarray(objective.exact(moved[None])).reshape(-1)[0])
    return out


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
