"""Clearance of the tool point from the workpiece on a motion: checked densely, and bounded between the checks.

A distance changes by no more than the tool point moves, and the tool point moves by no more than the sum of the
joints' steps times their levers. So between two configurations nothing can be nearer than half the sum of their
distances less half that bound, which is what the checks rest on.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.robot import SerialChain

__all__ = ["Distance", "least_distance", "levers", "rises", "stays_clear", "tool_distance"]

Distance = Callable[["NDArray[np.float64]"], "NDArray[np.float64]"]
"""Points (k, 3) in the base frame to their signed distances (k,) from the workpiece (m), positive outside."""

# The tool point moves no farther than this between two places that are looked at (m).
_STEP = 2e-3
# Where the bound does not tell within so small a step (m), the motion counts as too near.
_FINEST = 1e-4
# A distance that falls by less than this between two checks is one that does not fall: rounding (m).
_ROUNDING = 1e-8
# How far below the height it starts from the tool point may be found while it leaves (m).
_DIP = 1e-6


def levers(chain: SerialChain) -> NDArray[np.float64]:
    """Return how far each joint can move the tool point per unit of its own, (n,): m/rad, and 1 for prismatic ones."""
    reach = np.linalg.norm(chain.fixed[:, :, 3], axis=1)
    reach[:-1] += np.where(chain.prismatic, np.maximum(np.abs(chain.lower), np.abs(chain.upper)), 0.0)
    # a joint carries the slides of those after it, not its own
    after = np.cumsum(reach[::-1])[::-1]
    carried = after[1:]
    return np.where(chain.prismatic, 1.0, carried)


def tool_distance(chain: SerialChain, Q: NDArray[np.float64], distance: Distance) -> NDArray[np.float64]:
    """Return the tool point's distance from the workpiece at configurations (k, n), (k,), m."""
    return np.asarray(distance(chain.forward(Q)[:, :3, 3]), dtype=float)


def stays_clear(
    chain: SerialChain, q0: NDArray[np.float64], q1: NDArray[np.float64], *, distance: Distance, least: float
) -> bool:
    """Return whether the tool point keeps a distance everywhere on a straight line in joint space.

    True only if it is proved: intervals for which the bound does not tell are halved until it does.

    Parameters
    ----------
    chain : SerialChain
    q0, q1 : (n,) ndarray
        Ends (m, rad).
    distance : callable
    least : float
        The distance to be kept (m).
    """
    way = float(levers(chain) @ np.abs(q1 - q0))
    u = np.linspace(0.0, 1.0, int(np.clip(np.ceil(way / 0.1), 4, 256)) + 1)
    d = tool_distance(chain, q0 + u[:, None] * (q1 - q0), distance)
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
        d = tool_distance(chain, q0 + middle[:, None] * (q1 - q0), distance)
        if not (d >= least).all():
            return False
        left, right = np.concatenate([left, middle]), np.concatenate([middle, right])
        d_left, d_right = np.concatenate([d_left, d]), np.concatenate([d, d_right])


def least_distance(
    chain: SerialChain, q0: NDArray[np.float64], q1: NDArray[np.float64], distance: Distance
) -> tuple[float, float]:
    """Return the least distance on a straight line in joint space (m), and where on it, from 0 to 1.

    The tool point moves no more than 2 mm between two places that are looked at.
    """
    way = float(levers(chain) @ np.abs(q1 - q0))
    u = np.linspace(0.0, 1.0, int(np.ceil(way / _STEP)) + 2)
    d = tool_distance(chain, q0 + u[:, None] * (q1 - q0), distance)
    k = int(d.argmin())
    return float(d[k]), float(u[k])


def rises(d: NDArray[np.float64]) -> bool:
    """Return whether distances (k,) taken densely while the tool leaves grow all the way and never dip."""
    return bool((np.diff(d) >= -_ROUNDING).all() and (d >= d[0] - _DIP).all())
