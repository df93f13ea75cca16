"""Phases of constant jerk moved onto a grid of times that all joints share, ending exactly where they are to end.

A profile's phases change at times of their own in every joint. A file holds one list of times for all joints: phases
closer together than its digits tell would be lost, and what is read from it would not be what was planned. On a grid
nothing is lost. Moving a phase's end changes where the profile arrives; its jerks are changed by the least that takes
it back.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["GridPhases", "grid_phases"]

# Phases are also cut at these shares of a piece: with fewer than three there is no way to arrive.
_CUTS = (0.25, 0.5, 0.75)
_NANO = 1e-9


@dataclass(frozen=True, eq=False)
class GridPhases:
    """Phases of P pieces and n joints.

    Attributes
    ----------
    ends : (P, n, K) ndarray
        When each phase ends, since its piece began (s), in whole nanoseconds; the last is the piece's duration.
    jerks : (P, n, K) ndarray
    starts : (3, P, n, K) ndarray
        Position, velocity and acceleration where each phase begins.
    """

    ends: NDArray[np.float64]
    jerks: NDArray[np.float64]
    starts: NDArray[np.float64]

    @property
    def duration(self) -> NDArray[np.float64]:
        """Of each piece (s), (P,)."""
        return self.ends[:, 0, -1]

    def states(self, t: NDArray[np.float64], which: slice | NDArray[np.int64] = slice(None)) -> NDArray[np.float64]:
        """Return position, velocity and acceleration at times (P, L) since each piece began, (3, P, L, n)."""
        ends, jerks, starts = self.ends[which], self.jerks[which], self.starts[:, which]
        phase = np.minimum((t[:, :, None, None] >= ends[:, None]).sum(axis=3), ends.shape[2] - 1).swapaxes(1, 2)
        begins = np.concatenate([np.zeros_like(ends[:, :, :1]), ends[:, :, :-1]], axis=2)
        x = t[:, None, :] - np.take_along_axis(begins, phase, 2)
        j = np.take_along_axis(jerks, phase, 2)
        q, v, a = (np.take_along_axis(start, phase, 2) for start in starts)
        table = np.stack([q + x * (v + x * (a / 2 + x * j / 6)), v + x * (a + x * j / 2), a + x * j])
        return table.swapaxes(2, 3)

    def times(self, piece: int) -> NDArray[np.float64]:
        """Return when a phase of any joint ends, and the piece's start, ascending (s)."""
        return np.unique(np.append(self.ends[piece].ravel(), 0.0))


def grid_phases(
    ends: NDArray[np.float64],
    jerks: NDArray[np.float64],
    states: tuple[NDArray[np.float64], NDArray[np.float64]],
    duration: NDArray[np.float64],
    cells: NDArray[np.int64],
) -> GridPhases:
    """Return phases moved to the nearest of a piece's ``cells`` equal steps, with jerks that lead to the state asked.

    Parameters
    ----------
    ends, jerks : (P, n, K) ndarray
        When phases end since their piece began (s), not descending; their jerks.
    states : two (3, P, n) ndarrays
        Position, velocity and acceleration where pieces begin and where they are to end.
    duration : (P,) ndarray
        In whole nanoseconds (s).
    cells : (P,) ndarray of int
        At least four.
    """
    first, last = states
    h = duration[:, None, None]
    cuts = np.broadcast_to(np.array(_CUTS), (*ends.shape[:2], len(_CUTS)))
    share = np.clip(ends / h, 0.0, 1.0)
    share[:, :, -1] = 1.0
    at = np.sort(np.concatenate([share, cuts], axis=2), axis=2)
    # the jerk of the phase in which each part lies
    phase = np.minimum((share[:, :, None] < at[:, :, :, None]).sum(axis=3), ends.shape[2] - 1)
    jerk = np.take_along_axis(jerks, phase, 2)
    nano = np.round(duration / _NANO)[:, None, None]
    step = np.round(at * cells[:, None, None]) / cells[:, None, None]
    tick = np.round(step * nano)
    tau = np.diff(tick, axis=2, prepend=0.0) / nano
    rest = 1.0 - tick / nano
    # what a unit of jerk over each phase makes of acceleration, velocity and position at the end, over its duration
    effect = np.stack([np.ones_like(tau), tau / 2 + rest, tau**2 / 6 + tau * rest / 2 + rest**2 / 2], axis=2)
    weighted = effect * tau[:, :, None]
    asked = np.stack(
        [
            (last[2] - first[2]) * h[:, :, 0] ** 2,
            (last[1] - first[1] - first[2] * h[:, :, 0]) * h[:, :, 0],
            last[0] - first[0] - first[1] * h[:, :, 0] - 0.5 * first[2] * h[:, :, 0] ** 2,
        ],
        axis=2,
    )
    scaled = jerk * h**3
    missing = asked - (weighted @ scaled[:, :, :, None])[:, :, :, 0]
    gram = weighted @ effect.swapaxes(2, 3)
    scaled = scaled + (effect.swapaxes(2, 3) @ np.linalg.solve(gram, missing[:, :, :, None]))[:, :, :, 0]
    jerk = scaled / h**3
    t = tick * _NANO
    length = np.diff(t, axis=2, prepend=0.0)
    starts = np.empty((3, *jerk.shape))
    q, v, a = (order.copy() for order in first)
    for k in range(jerk.shape[2]):
        starts[0, :, :, k], starts[1, :, :, k], starts[2, :, :, k] = q, v, a
        x, j = length[:, :, k], jerk[:, :, k]
        q, v, a = q + x * (v + x * (a / 2 + x * j / 6)), v + x * (a + x * j / 2), a + x * j
    return GridPhases(t, jerk, starts)
