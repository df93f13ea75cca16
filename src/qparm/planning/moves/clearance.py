"""Clearance of the tool point from the workpiece on a motion: checked densely, and bounded between the checks.

A distance changes by no more than the tool point moves, and the tool point moves by no more than the sum of the
joints' steps times their levers. So between two configurations nothing can be nearer than half the sum of their
distances less half that bound, which is what the checks rest on.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.robot import SerialChain

__all__ = ["Distance", "ToolDistance", "least_distance", "rises", "stays_clear"]


class Distance(Protocol):
    """How far configurations are from the workpiece: what motions off the path ask.

    Asked are configurations, not points, so that what is watched may be more than the tool's point.
    """

    @property
    def levers(self) -> NDArray[np.float64]:
        """How far each joint can move what is watched per unit of its own, (n,): m/rad, 1 for prismatic ones."""
        ...

    def __call__(self, Q: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return signed distances (k,) of configurations (k, n) from the workpiece (m), positive outside."""
        ...


@dataclass(frozen=True, eq=False)
class ToolDistance:
    """The distance of the tool's point, and of nothing else.

    Attributes
    ----------
    chain : SerialChain
    of_points : callable
        Points (k, 3) in the base frame to their signed distances (k,) from the workpiece (m), positive outside.
    """

    chain: SerialChain
    of_points: Callable[[NDArray[np.float64]], NDArray[np.float64]]

    @property
    def levers(self) -> NDArray[np.float64]:
        """How far each joint can move the tool point per unit of its own, (n,): m/rad, and 1 for prismatic ones."""
        return self._levers

    @cached_property
    def _levers(self) -> NDArray[np.float64]:
        chain = self.chain
        reach = np.linalg.norm(chain.fixed[:, :, 3], axis=1)
        reach[:-1] += np.where(chain.prismatic, np.maximum(np.abs(chain.lower), np.abs(chain.upper)), 0.0)
        # a joint carries the slides of those after it, not its own
        after = np.cumsum(reach[::-1])[::-1]
        return np.where(chain.prismatic, 1.0, after[1:])

    def __call__(self, Q: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the tool point's signed distances from the workpiece at configurations (k, n), (k,), m."""
        return np.asarray(self.of_points(self.chain.forward(Q)[:, :3, 3]), dtype=float)


# The tool point moves no farther than this between two places that are looked at (m).
_STEP = 2e-3
# Where the bound does not tell within so small a step (m), the motion counts as too near.
_FINEST = 1e-4
# A distance that falls by less than this between two checks is one that does not fall: rounding (m).
_ROUNDING = 1e-8
# How far below the height it starts from the tool point may be found while it leaves (m).
_DIP = 1e-6


def stays_clear(q0: NDArray[np.float64], q1: NDArray[np.float64], *, distance: Distance, least: float) -> bool:
    """Return whether the tool point keeps a distance everywhere on a straight line in joint space.

    True only if it is proved: intervals for which the bound does not tell are halved until it does.

    Parameters
    ----------
    q0, q1 : (n,) ndarray
        Ends (m, rad).
    distance : Distance
    least : float
        The distance to be kept (m).
    """
    way = float(distance.levers @ np.abs(q1 - q0))
    u = np.linspace(0.0, 1.0, int(np.clip(np.ceil(way / 0.1), 4, 256)) + 1)
    d = distance(q0 + u[:, None] * (q1 - q0))
    if not (d >= least).all():
        return False
    left, right, d_left, d_right = u[:-1], u[1:], d[:-1], d[1:]
    while True:
        untold = 0.5 * (d_left + d_right - way * (right - left)) < least
        if not untold.any():
            return True
        left, right, d_left, d_right = left[untold], right[untold], d_left[untold], d_right[untold]
        if way * (right[0] - left[0]) < _FINEST:
            return False
        middle = 0.5 * (left + right)
        d = distance(q0 + middle[:, None] * (q1 - q0))
        if not (d >= least).all():
            return False
        left, right = np.concatenate([left, middle]), np.concatenate([middle, right])
        d_left, d_right = np.concatenate([d_left, d]), np.concatenate([d, d_right])


def least_distance(q0: NDArray[np.float64], q1: NDArray[np.float64], distance: Distance) -> tuple[float, float]:
    """Return the least distance on a straight line in joint space (m), and where on it, from 0 to 1.

    The tool point moves no more than 2 mm between two places that are looked at.
    """
    way = float(distance.levers @ np.abs(q1 - q0))
    u = np.linspace(0.0, 1.0, int(np.ceil(way / _STEP)) + 2)
    d = distance(q0 + u[:, None] * (q1 - q0))
    k = int(d.argmin())
    return float(d[k]), float(u[k])


def rises(d: NDArray[np.float64]) -> bool:
    """Return whether distances (k,) taken densely while the tool leaves grow all the way and never dip."""
    return bool((np.diff(d) >= -_ROUNDING).all() and (d >= d[0] - _DIP).all())
