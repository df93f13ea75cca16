"""The check that each column of a file is the derivative of the one before it, and not that times something.

Where a derivative hardly changes from one sample to the next, its mean over the interval is known from its ends; the
column before must have grown by just that. The ratio of the two, over all such intervals, is 1; a column (or the time)
that is off by a per cent makes it 1.01 or 0.99. The most common ratio counts, so that intervals in which the motion
does what samples do not show (a jerk that switches twice) have no say.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["NAMES", "column_ratios", "silent_columns"]

NAMES = ("position", "velocity", "acceleration", "jerk")
# A derivative hardly changes if its ends differ by less than this share of it; at least so many such intervals tell.
_STEADY, _FEWEST = 0.05, 8
# Ratios this near to each other are alike; so much of all weight must be alike.
_WIDTH, _FEW = 1e-3, 0.1
# Growth of a column that is at least so many times its rounding tells.
_OVER_ROUNDING = 2e3
# A column is silent on another where it is zero at both ends of intervals with more than this share of its growth.
# Of jerks that switch between samples it is 0.006 at 20 ms.
_SILENT = 0.25


def column_ratios(
    t: NDArray[np.float64], columns: list[NDArray[np.float64] | None], rounding: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return by how much each column grows over what the next one says, (3, n); NaN where that cannot be told.

    Parameters
    ----------
    t : (T,) ndarray
        s.
    columns : list of (T, n) ndarray or None
        Position, velocity, acceleration, jerk.
    rounding : (4, n) ndarray
    """
    assert columns[0] is not None
    n = columns[0].shape[1]
    ratios, h = np.full((3, n), np.nan), np.diff(t)
    for order in range(3):
        values, slopes = columns[order], columns[order + 1]
        if values is None or slopes is None:
            continue
        bends = columns[order + 2] if order < 2 else None
        for joint in range(n):
            slope = slopes[:, joint]
            told = 0.5 * h * (slope[1:] + slope[:-1])
            if bends is not None:
                told -= h**2 / 12 * np.diff(bends[:, joint])
            tells = np.abs(np.diff(slope)) <= _STEADY * np.abs(slope[1:] + slope[:-1])
            tells &= np.abs(told) > _OVER_ROUNDING * (rounding[order, joint] + h * rounding[order + 1, joint])
            at = np.flatnonzero(tells)
            if len(at) >= _FEWEST:
                grown = np.diff(values[:, joint])[at]
                ratios[order, joint] = _most_common(grown / told[at], np.abs(told[at]))
    return ratios


def silent_columns(
    columns: list[NDArray[np.float64] | None], rounding: NDArray[np.float64]
) -> list[tuple[int, int, int, float]]:
    """Return the columns that are zero though the one before them changes: a ratio of growth to zero tells nothing.

    Parameters
    ----------
    columns, rounding
        As for :func:`column_ratios`.

    Returns
    -------
    list of (int, int, int, float)
        Order of the one that changes, joint, interval of its largest change, that change.
    """
    found: list[tuple[int, int, int, float]] = []
    for order in range(3):
        values, slopes = columns[order], columns[order + 1]
        if values is None or slopes is None:
            continue
        grown = np.abs(np.diff(values, axis=0))
        grown[grown <= _OVER_ROUNDING * rounding[order]] = 0.0
        zero = np.abs(slopes) <= rounding[order + 1]
        silent = np.where(zero[1:] & zero[:-1], grown, 0.0)
        for joint in np.flatnonzero(silent.sum(axis=0) > _SILENT * grown.sum(axis=0)).tolist():
            at = int(silent[:, joint].argmax())
            found.append((order, joint, at, float(silent[at, joint])))
    return found


def _most_common(values: NDArray[np.float64], weights: NDArray[np.float64]) -> float:
    """Return the middle of the narrow range of values with the most weight; NaN if it is no more than a few of them."""
    order = np.argsort(values)
    values, weights = values[order], weights[order]
    summed = np.append(0.0, np.cumsum(weights))
    last = np.searchsorted(values, values + _WIDTH, side="right")
    inside = summed[last] - summed[:-1]
    best = int(inside.argmax())
    if inside[best] < _FEW * summed[-1] or last[best] - best < _FEWEST:
        return float("nan")
    return float(values[best + np.searchsorted(summed[best + 1 : last[best] + 1] - summed[best], 0.5 * inside[best])])
