"""Coverage of the surface by an arm, cheapest test first: a proved bound, every fourth point, all points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from qparm.reach.many_arms import reach_of_designs
from qparm.reach.relaxed_bound import relaxed_excess

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.path import ToolPath
    from qparm.path.relaxation import Relaxation
    from qparm.robot import SerialChain

__all__ = ["COARSE", "Coverage", "point_weights", "reach_of_points", "screened", "share_reached"]

# Every so many points of the path are tried first.
COARSE = 4
# Starts of a pose that its neighbours' configurations do not lead to.
_RESTARTS = 30
_DISTANCE_WEIGHT = 0.1


@dataclass(frozen=True, eq=False)
class Coverage:
    """Which of some points are within reach.

    Attributes
    ----------
    points : (k,) ndarray of int
        Those that were looked at.
    reached : (k,) ndarray of bool
    share : float
        Share of the path that they stand for, of those looked at.
    violation : float
        ``1 - share + 0.1 mean(excess / reach)``: graded by what is missed and by how far it lies beyond reach.
    """

    points: NDArray[np.int64]
    reached: NDArray[np.bool_]
    share: float
    violation: float


def point_weights(tool_path: ToolPath) -> NDArray[np.float64]:
    """Return the length of path that each point stands for, (P,) m: half way to its neighbours in the row."""
    weights = np.zeros(tool_path.point_count)
    for row in range(len(tool_path.rows)):
        at = np.flatnonzero(tool_path.row_of_point == row)
        gaps = np.abs(np.diff(tool_path.s[at]))
        weights[at[:-1]] += 0.5 * gaps
        weights[at[1:]] += 0.5 * gaps
    return weights if weights.sum() > 0 else np.ones_like(weights)


def screened(chain: SerialChain, tool_path: ToolPath, relaxation: Relaxation) -> Coverage:
    """Return what the reach of the links proves out of reach, too far or too near; all else counts as reached.

    A tool that may spin or tilt is out of reach only if it is however it is turned.
    """
    beyond = np.maximum(np.maximum(*relaxed_excess(chain, tool_path.poses, relaxation)), 0.0)
    bound = chain.reach_bound
    share = 0.0 if bound is None else float(beyond.mean() / max(bound.reach, 1e-9))
    return _coverage(tool_path, np.arange(tool_path.point_count), beyond == 0, share)


def reach_of_points(
    chain: SerialChain,
    tool_path: ToolPath,
    points: NDArray[np.int64],
    *,
    relaxation: Relaxation,
    seed: int,
    position_tolerance: float,
    rotation_tolerance: float,
) -> Coverage:
    """Return which points the arm reaches (:func:`qparm.reach.many_arms.reach_of_designs`): a search, no proof."""
    found = reach_of_designs(
        [chain],
        np.ascontiguousarray(tool_path.poses[points]),
        relaxation=relaxation,
        position_tolerance=position_tolerance,
        rotation_tolerance=rotation_tolerance,
        restarts=_RESTARTS,
        seed=seed,
        threads=1,
    )
    return _coverage(tool_path, points, found.reached[0], 0.0)


def share_reached(tool_path: ToolPath, reached: NDArray[np.bool_]) -> float:
    """Return the share of the path that the points reached, (P,), stand for."""
    weights = point_weights(tool_path)
    return 1.0 if reached.all() else float(weights[reached].sum() / weights.sum())


def _coverage(tool_path: ToolPath, points: NDArray[np.int64], reached: NDArray[np.bool_], beyond: float) -> Coverage:
    weights = point_weights(tool_path)[points]
    share = 1.0 if reached.all() else float(weights[reached].sum() / weights.sum())
    missed = 0.0 if reached.all() else max(1.0 - share, 1.0 / tool_path.point_count)
    return Coverage(points, reached, share, missed + _DISTANCE_WEIGHT * beyond)
