"""Designs that no other beats: dominance, the archive, hypervolume, crowding and the knee. All is minimised."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from qparm.errors import InvalidInput

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from qparm.design.problem import Evaluations

__all__ = ["Archive", "crowding", "free_boxes", "hypervolume", "knee", "non_dominated", "reference_point"]

# How far below the line through a front's ends a knee lies at least, of its extent.
_KNEE = 0.01


@dataclass(frozen=True, eq=False)
class Archive:
    """The non-dominated designs of all that was evaluated, in ascending order of the first objective.

    Attributes
    ----------
    X : ndarray, shape (k, d)
        Designs.
    F : ndarray, shape (k, m)
        Their objectives.
    index : ndarray of int, shape (k,)
        Their places in the evaluations.
    """

    X: NDArray[np.float64]
    F: NDArray[np.float64]
    index: NDArray[np.intp]

    def __len__(self) -> int:
        return len(self.X)

    @classmethod
    def of(cls, evaluations: Evaluations) -> Archive:
        """Return the archive of evaluations; of equal objectives the first design stays."""
        index = np.flatnonzero(evaluations.known)
        index = index[non_dominated(evaluations.F[index])]
        F = evaluations.F[index]
        index = index[np.lexsort([index, *F.T[::-1]])]
        return cls(evaluations.X[index], evaluations.F[index], index)

    def hypervolume(self, reference: ArrayLike) -> float:
        """Return the volume dominated up to a reference point (m,)."""
        return hypervolume(self.F, reference)


def _checked(F: ArrayLike) -> NDArray[np.float64]:
    F = np.asarray(F, dtype=float)
    if F.ndim != 2:
        raise InvalidInput(f"objectives must have shape (n, m), not {F.shape}")
    if not np.isfinite(F).all():
        i, k = np.argwhere(~np.isfinite(F))[0]
        raise InvalidInput(f"objective {k} of design {i} is {F[i, k]}; it must be finite")
    return F


def non_dominated(F: ArrayLike) -> NDArray[np.bool_]:
    """Return which rows no other row dominates (Sun et al. 2023, eq. 1); of equal rows the first.

    Parameters
    ----------
    F : array_like, shape (n, m)

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    F = _checked(F)
    keep = np.zeros(len(F), dtype=bool)
    if not len(F):
        return keep
    # In lexicographic order a row can only be dominated by an earlier one.
    order = np.lexsort([np.arange(len(F)), *F.T[::-1]])
    if F.shape[1] <= 2:
        last = F[order, -1]
        keep[order] = last < np.concatenate([[np.inf], np.minimum.accumulate(last)[:-1]])
        return keep
    front = np.empty((0, F.shape[1]))
    for i in order:
        if not (front <= F[i]).all(axis=1).any():
            keep[i] = True
            front = np.vstack([front, F[i]])
    return keep


def free_boxes(F: ArrayLike, reference: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return disjoint boxes (lower, upper], (b, m) each, that fill what no row of F dominates below a reference.

    Lower ends are -inf where a box is open. The boxes come from slicing at the values of the last objective, then of
    the one before, and so on: about n boxes for two objectives, n² for three.

    Parameters
    ----------
    F : array_like, shape (n, m)
    reference : array_like, shape (m,)
    """
    return _slices(*_front_below(F, reference))


def _slices(F: NDArray[np.float64], reference: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    m = len(reference)
    if m == 1:
        top = min(float(F.min()), float(reference[0])) if len(F) else float(reference[0])
        return np.array([[-np.inf]]), np.array([[top]])
    levels = np.concatenate([[-np.inf], np.unique(F[:, -1]), [reference[-1]]])
    lowers, uppers = [], []
    for low, high in pairwise(levels):
        below = F[F[:, -1] <= low, :-1]
        lower, upper = _slices(below[non_dominated(below)], reference[:-1])
        lowers.append(np.column_stack([lower, np.full(len(lower), low)]))
        uppers.append(np.column_stack([upper, np.full(len(upper), high)]))
    return np.vstack(lowers), np.vstack(uppers)


def hypervolume(F: ArrayLike, reference: ArrayLike) -> float:
    """Return the volume that the rows of F dominate up to a reference point; exact.

    For two objectives the sum over the staircase, for three and more the sum over slices of the last one.

    Parameters
    ----------
    F : array_like, shape (n, m)
    reference : array_like, shape (m,)
    """
    return _volume(*_front_below(F, reference))


def _front_below(F: ArrayLike, reference: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the non-dominated rows of F below a reference, and the reference, both checked."""
    F, reference = _checked(F), np.asarray(reference, dtype=float)
    if reference.shape != (F.shape[1],):
        raise InvalidInput(f"the reference must have shape ({F.shape[1]},), not {reference.shape}")
    F = F[(reference > F).all(axis=1)]
    return F[non_dominated(F)], reference


def _volume(F: NDArray[np.float64], reference: NDArray[np.float64]) -> float:
    if not len(F):
        return 0.0
    if len(reference) == 1:
        return float(reference[0] - F.min())
    if len(reference) == 2:
        F = F[np.argsort(F[:, 0])]
        right = np.append(F[1:, 0], reference[0])
        return float(((right - F[:, 0]) * (reference[1] - F[:, 1])).sum())
    F = F[np.argsort(F[:, -1], kind="stable")]
    high = np.append(F[1:, -1], reference[-1])
    volume = 0.0
    for k in range(len(F)):
        if high[k] > F[k, -1]:
            below = F[: k + 1, :-1]
            volume += (high[k] - F[k, -1]) * _volume(below[non_dominated(below)], reference[:-1])
    return float(volume)


def crowding(F: ArrayLike) -> NDArray[np.float64]:
    """Return the crowding distance of each row (Deb et al. 2002): infinite at the ends, larger is lonelier.

    Parameters
    ----------
    F : array_like, shape (n, m)

    Returns
    -------
    ndarray, shape (n,)
    """
    F = _checked(F)
    distance = np.zeros(len(F))
    for values in F.T:
        order = np.argsort(values, kind="stable")
        span = values[order[-1]] - values[order[0]] if len(F) else 0.0
        if len(F):
            distance[order[[0, -1]]] = np.inf
        if len(F) > 2 and span > 0:
            distance[order[1:-1]] += (values[order[2:]] - values[order[:-2]]) / span
    return distance


def reference_point(F: ArrayLike) -> NDArray[np.float64]:
    """Return a reference for a front (n, m): its worst values and a tenth of its extent beyond them."""
    F = _checked(F)
    if not len(F):
        raise InvalidInput("an empty front has no reference point")
    worst, extent = F.max(axis=0), np.ptp(F, axis=0)
    return worst + 0.1 * np.where(extent > 0, extent, np.maximum(np.abs(worst), 1e-9))


def knee(F: ArrayLike) -> int | None:
    """Return the row of a front (n, m) that lies farthest below the line through its extreme designs.

    After scaling every objective to [0, 1]; for more than two objectives below the plane through the points where one
    is worst and the others best. None where no row lies below it by a hundredth: the front is straight or bulges the
    other way, and what is farthest along it is one of its ends.
    """
    F = _checked(F)
    if not len(F):
        raise InvalidInput("an empty front has no knee")
    extent = np.ptp(F, axis=0)
    scaled = (F - F.min(axis=0)) / np.where(extent > 0, extent, 1.0)
    below = 1.0 - scaled.sum(axis=1)
    place = int(np.argmax(below))
    return place if len(F) == 1 or below[place] > _KNEE else None
