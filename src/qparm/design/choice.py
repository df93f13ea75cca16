"""The choice of the recommended design from a front, and the grounds for it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

import numpy as np

from qparm.design.archive import Archive, knee

if TYPE_CHECKING:
    from qparm.design.evaluate import Evaluation
    from qparm.design.problem import Evaluations

__all__ = ["Grounds", "choice", "unmoved", "worth_planning"]

Grounds = Literal["only", "knee", "limit_margin", "singularity_margin", "nothing"]

# Objectives that differ by less than this share of themselves do not differ.
_SAME = 1e-9


def unmoved(told: Evaluations) -> tuple[int, ...]:
    """Return which objectives are the same for all valid designs, of two at least: no choice can go by them."""
    F = told.F[told.known]
    if len(F) < 2:
        return ()
    same = np.ptp(F, axis=0) <= _SAME * np.abs(F).max(axis=0)
    return tuple(int(k) for k in np.flatnonzero(same))


def choice(F: np.ndarray, front: Sequence[Evaluation]) -> tuple[int | None, Grounds]:
    """Return the place in a front of the design that is recommended, and why that one.

    The knee; where the front has none, the design with the most reserve to joint limits or, where that is not known,
    to singularities; of equal ones the first.

    Parameters
    ----------
    F : ndarray, shape (n, m)
        The front's objectives.
    front : sequence of n Evaluation
    """
    if len(front) == 1:
        return 0, "only"
    place = knee(F) if len(front) else None
    if place is not None:
        return place, "knee"
    for name in ("limit_margin", "singularity_margin"):
        if front and all(name in one.measures for one in front):
            return int(np.argmax([one.measures[name] for one in front])), name
    return None, "nothing"


def worth_planning(archive: Archive, chosen: int | None, count: int) -> list[int]:
    """Return places in a front: the recommended one and the ends, then others evenly between."""
    if not len(archive) or not count:
        return []
    last = len(archive) - 1
    evenly = [round(k * last / max(count - 2, 1)) for k in range(max(count - 1, 1))]
    first = [] if chosen is None else [chosen]
    return sorted(list(dict.fromkeys([*first, 0, last, *evenly]))[:count]) if last else [0]
