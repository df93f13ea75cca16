"""What of the surface an arm covers, cheapest first: what a bound proves, every fourth point, all points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from qparm.ik import PoseSolver
from qparm.robot.reach import excess_of_reach

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.path import ToolPath
    from qparm.robot import SerialChain

__all__ = ["COARSE", "Coverage", "point_weights", "reach_of_points", "screened"]

# Every so many points of the path are tried first.
COARSE = 4
# Random starts of a pose that its neighbour's configuration does not lead to.
_STARTS = 60
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


def screened(chain: SerialChain, tool_path: ToolPath) -> Coverage:
    """Return what the greatest reach of the links proves out of reach; all else counts as reached."""
    excess = np.array([excess_of_reach(chain, pose) for pose in tool_path.poses])
    reached = excess <= 0
    bound = chain.reach_bound
    beyond = 0.0 if bound is None else float(np.maximum(excess, 0.0).mean() / max(bound.reach, 1e-9))
    return _coverage(tool_path, np.arange(tool_path.point_count), reached, beyond)


def reach_of_points(
    chain: SerialChain,
    tool_path: ToolPath,
    points: NDArray[np.int64],
    *,
    rng: np.random.Generator,
    position_tolerance: float,
    rotation_tolerance: float,
) -> Coverage:
    """Return which points the arm reaches: from the neighbour's configuration, else from random starts.

    A point that is missed gets another try from the nearest ones that are reached, so that one unlucky draw does not
    make a design invalid.
    """
    solver = PoseSolver(
        chain, method="dls", position_tolerance=position_tolerance, rotation_tolerance=rotation_tolerance
    )
    q = 0.5 * (chain.lower + chain.upper)
    found = np.zeros((len(points), chain.n))
    reached = np.zeros(len(points), dtype=bool)
    for k, point in enumerate(points):
        pose = tool_path.poses[point]
        solution = solver.solve(pose, q)
        for _ in range(_STARTS):
            if solution.reached:
                break
            solution = solver.solve(pose, chain.random(rng, 1)[0])
        reached[k] = solution.reached
        if solution.reached:
            q = found[k] = solution.q
    there = np.flatnonzero(reached)
    positions = tool_path.poses[points][:, :3, 3]
    for k in np.flatnonzero(~reached) if len(there) else ():
        near = np.argsort(np.linalg.norm(positions[there] - positions[k], axis=1), kind="stable")[:8]
        for other in there[near]:
            if solver.solve(tool_path.poses[points[k]], found[other]).reached:
                reached[k] = True
                break
    return _coverage(tool_path, points, reached, 0.0)


def _coverage(tool_path: ToolPath, points: NDArray[np.int64], reached: NDArray[np.bool_], beyond: float) -> Coverage:
    weights = point_weights(tool_path)[points]
    share = 1.0 if reached.all() else float(weights[reached].sum() / weights.sum())
    missed = 0.0 if reached.all() else max(1.0 - share, 1.0 / tool_path.point_count)
    return Coverage(points, reached, share, missed + _DISTANCE_WEIGHT * beyond)
