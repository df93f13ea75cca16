"""Objectives that are constant in steps: how wide these are, and where a design would be one that is known already.

Lengths out of a catalogue, or a table that answers for the nearest of its designs: two designs on one step have the
same outcome to the last bit, and the second of them tells nothing. If the steps along a variable are W wide and lie
anywhere, designs that are delta apart are on the same step with a probability of (1 - |delta| / W), for several
variables the product of these. The widths are those of largest likelihood, given which pairs turned out the same.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.design.problem import Evaluations

__all__ = ["same_step", "step_widths"]

# Widths that are tried, in fractions of the range; pairs farther apart than the widest tell nothing.
_WIDTHS = np.geomspace(0.004, 0.5, 29)
# The share of pairs that are the same, or not, for another reason: outcomes that agree by chance.
_BY_CHANCE = 0.01
# Most evaluations that are compared, the latest; sweeps over the variables.
_MOST, _SWEEPS = 250, 2


def step_widths(U: NDArray[np.float64], evaluations: Evaluations) -> NDArray[np.float64] | None:
    """Return how wide steps are along each variable, (d,) in fractions of the ranges; None where there are none.

    Parameters
    ----------
    U : ndarray, shape (n, d)
        The designs evaluated, in fractions of the ranges.
    evaluations : Evaluations
    """
    U, known = U[-_MOST:], evaluations.known[-_MOST:]
    outcomes = np.column_stack([evaluations.violation[-_MOST:], np.nan_to_num(evaluations.F[-_MOST:])])
    _, label = np.unique(outcomes, axis=0, return_inverse=True)
    i, j = np.triu_indices(len(U), 1)
    apart = np.abs(U[i] - U[j])
    # invalid designs may have one violation for other reasons than a step
    near = (known[i] | known[j]) & (apart <= _WIDTHS[-1]).all(axis=1)
    apart, same = apart[near], (label[i] == label[j])[near]
    if not same.any():
        return None
    widths = np.full(U.shape[1], np.median(apart[same]))
    factors = np.maximum(1.0 - apart / np.maximum(widths, _WIDTHS[0]), 0.0)
    for _ in range(_SWEEPS):
        for k in range(U.shape[1]):
            others = np.delete(factors, k, axis=1).prod(axis=1)
            likelihoods = []
            for width in _WIDTHS:
                chance = others * np.maximum(1.0 - apart[:, k] / width, 0.0)
                chance = _BY_CHANCE + (1.0 - 2.0 * _BY_CHANCE) * chance
                likelihoods.append(np.log(np.where(same, chance, 1.0 - chance)).sum())
            widths[k] = _WIDTHS[int(np.argmax(likelihoods))]
            factors[:, k] = np.maximum(1.0 - apart[:, k] / widths[k], 0.0)
    return widths


def same_step(C: NDArray[np.float64], seen: NDArray[np.float64], widths: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the probabilities that designs (k, d) are on the step of one that was seen (n, d), (k,)."""
    found = np.zeros(len(C))
    for u in seen:
        found = np.maximum(found, np.maximum(1.0 - np.abs(C - u) / widths, 0.0).prod(axis=1))
    return found
