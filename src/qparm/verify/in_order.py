"""When points are passed one after the other, where each may be passed at several times."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

__all__ = ["passed_in_order"]

# A point that is not passed weighs more than any time (s).
_MISSED = 1e7
# Ways that miss so many points more than the best are given up.
_MORE_MISSED = 3


@dataclass(frozen=True, eq=False)
class _Ways:
    """The best ways to pass the points so far, one for each time at which the last point may be passed.

    Attributes
    ----------
    t : (S,) ndarray
        Ascending; -inf where no point is passed yet (s).
    cost : (S,) ndarray
        The time that the rows take (s), and what missed points weigh.
    row : (S,) ndarray of int
        Of the last point passed.
    number : (S,) ndarray of int
        Of each way, among all.
    """

    t: NDArray[np.float64]
    cost: NDArray[np.float64]
    row: NDArray[np.int64]
    number: NDArray[np.int64]

    def before(self, t: NDArray[np.float64], row: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return the best way to pass a point of a row at each of some times, -1 if there is none, and its cost."""
        same = self.row == row
        key = self.cost - np.where(same, self.t, 0.0)
        # where the least of all up to each is, the last of equals
        least = np.minimum.accumulate(key)
        at = np.maximum.accumulate(np.where(key == least, np.arange(len(key)), -1))
        last = np.searchsorted(self.t, t, side="right") - 1
        which = np.where(last >= 0, at[last], -1)
        return which, key[which] + np.where(same[which], t, 0.0)

    def kept(self) -> _Ways:
        """Return the ways without those that miss many more points than the best."""
        few = self.cost < self.cost.min() + (_MORE_MISSED + 0.5) * _MISSED
        return _Ways(self.t[few], self.cost[few], self.row[few], self.number[few])


def passed_in_order(
    candidates: Sequence[NDArray[np.int64]], t: NDArray[np.float64], row: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Return at which candidate each point is passed, (P,), -1 where at none.

    No point is passed before the one before it, as many as possible are, and then the rows take the least time from
    their first point to their last: what lies before and after belongs to the ways between rows.

    Parameters
    ----------
    candidates : sequence of (c,) ndarray of int
        For each point those of ``t`` at which it may be passed, ascending in time.
    t : (n,) ndarray
        s.
    row : (P,) ndarray of int
        The row of each point.
    """
    single = np.array([own[0] if len(own) == 1 else -1 for own in candidates], dtype=np.int64)
    if (single >= 0).all() and (np.diff(t[single]) >= 0).all():
        return single
    parents, points, chosen = [-1], [-1], [-1]
    none = np.zeros(1, dtype=np.int64)
    ways = _Ways(np.array([-np.inf]), np.zeros(1), none - 1, none)
    for k, own in enumerate(candidates):
        which, cost = ways.before(t[own], int(row[k]))
        possible = which >= 0
        own, which, cost = own[possible], which[possible], cost[possible]
        number = len(parents) + np.arange(len(own))
        parents += ways.number[which].tolist()
        points += [k] * len(own)
        chosen += own.tolist()
        # every way may miss the point too
        times = np.concatenate([ways.t, t[own]])
        order = np.argsort(times, kind="stable")
        ways = _Ways(
            times[order],
            np.concatenate([ways.cost + _MISSED, cost])[order],
            np.concatenate([ways.row, np.full(len(own), row[k])])[order],
            np.concatenate([ways.number, number])[order],
        ).kept()
    found = np.full(len(candidates), -1, dtype=np.int64)
    way = int(ways.number[int(ways.cost.argmin())])
    while way > 0:
        found[points[way]] = chosen[way]
        way = parents[way]
    return found
