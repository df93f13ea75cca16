"""Single values that are wrong in a table whose other values are right.

Where a motion is one polynomial of degree five over three samples of a grid, the quintic through the states of the
outer two gives the state of the middle one exactly. A single wrong value there is off while the rest of its
sample is not; and with the value that the quintic gives in its place the samples at either side are exact again,
which they were not before. A motion whose pieces meet at a sample does not look like this: then more values are
off, or the samples at either side are exact as they are.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["single_values"]

# Of the orders 0 to 3: what a step of the jerk by 1 changes at least of a derivative, in units of h.
_SENSITIVE = np.array([0.02, 0.1, 0.3, 1.0])
# A value is as predicted if it is so within this many roundings, and wrong if by this many more than that may hide.
_EXACT, _OFF = 2.0, 1.0
# Candidates at a time that are looked at more closely.
_MOST = 2000


@cache
def _weights() -> NDArray[np.float64]:
    """Return weights (4, 6): derivatives in the middle from q0, q1, v0, v1, a0, a1 at -1 and 1."""
    table = []
    for x in (-1.0, 1.0):
        powers = np.arange(6)
        rows = [x**powers]
        for order in (1, 2):
            factor = np.array([np.prod(np.arange(p - order + 1, p + 1)) if p >= order else 0.0 for p in powers])
            rows.append(factor * x ** np.maximum(powers - order, 0))
        table.append(rows)
    system = np.array([table[end][order] for order in range(3) for end in range(2)])
    return (np.linalg.inv(system)[:4].T * np.array([1.0, 1.0, 2.0, 6.0])).T


def single_values(
    h: float, columns: list[NDArray[np.float64]], rounding: NDArray[np.float64]
) -> list[tuple[int, int, int, float]]:
    """Return sample, joint, order and the right value of each value that is wrong by itself.

    Parameters
    ----------
    h : float
        The grid's period (s).
    columns : list of (T, n) ndarray
        Position, velocity, acceleration and, if there is one, jerk. All on the grid.
    rounding : (4, n) ndarray
    """
    T, n = columns[0].shape
    if T < 5:
        return []
    scale = h ** np.arange(len(columns))
    found: list[tuple[int, int, int, float]] = []
    for joint in range(n):
        values = [column[:, joint] * s for column, s in zip(columns, scale, strict=True)]
        # double precision itself rounds, and so does the time: far more, after many samples
        size = [float(np.abs(value).max()) for value in values]
        late = [x * np.spacing(float(T)) for x in (*size[1:], size[-1])]
        own = [2e-16 * x for x in size]
        noise = rounding[: len(values), joint] * scale + np.array(own) + np.array(late)
        weights = np.abs(_weights()[: len(values)])
        allowed = _EXACT * (noise + weights @ np.repeat(noise[:3], 2))
        off = _residuals(values)
        exact = np.abs(off) <= allowed[:, None]
        # what a step of the jerk may be, hidden in what is exact
        hidden = np.where(exact, (allowed / _SENSITIVE[: len(values)])[:, None], 0.0).max(axis=0)
        alone = (~exact).sum(axis=0) == 1
        order = (~exact).argmax(axis=0)
        amount = np.take_along_axis(off, order[None], axis=0)[0]
        limit = np.maximum(allowed[order], _OFF * hidden)
        for k in np.flatnonzero(alone & (np.abs(amount) > limit))[:_MOST].tolist():
            which = int(order[k])
            if _mends(
                [value[max(k - 1, 0) : k + 4] for value in values], which, k + 1 - max(k - 1, 0), amount[k], allowed
            ):
                found.append((k + 1, joint, which, float((values[which][k + 1] - amount[k]) / scale[which])))
    return found


def _residuals(values: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Return by how much each inner sample is off what its neighbours say, (orders, T - 2), times powers of h."""
    ends = np.stack([part for value in values[:3] for part in (value[:-2], value[2:])])
    return np.stack([value[1:-1] for value in values]) - _weights()[: len(values)] @ ends


def _mends(
    values: list[NDArray[np.float64]], order: int, middle: int, amount: float, allowed: NDArray[np.float64]
) -> bool:
    """Return whether the samples at either side are exact with the predicted value, and were not as it was."""
    before = np.abs(_residuals(values)) <= allowed[:, None]
    if order < 3:
        beside = np.delete(before, middle - 1, axis=1)
        if beside.shape[1] < 2 or beside.all(axis=0).any():
            return False
    mended = [value.copy() for value in values]
    mended[order][middle] -= amount
    return bool((np.abs(_residuals(mended)) <= allowed[:, None]).all())
