"""The test whether an edge can be driven: the tool follows its path from one configuration to the other without a jump.

A small step is not enough: two pieces of a self-motion set may pass each other at any distance. So the edge is
bisected: the configurations' midpoint is moved onto the pose half way, and must come to lie between the two. Then
both halves are tested, until the steps are small.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from qparm.path.relaxation import EXACT, Relaxation
from qparm.planning.search.projection import project, search_scale
from qparm.planning.tolerances import FOLLOWED_POSE

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.path import ToolPath
    from qparm.planning.problem import PathProblem
    from qparm.planning.solution import PathSolution
    from qparm.robot import SerialChain

__all__ = [
    "LARGE_STEP",
    "driven_where_followed",
    "edge_is_continuous",
    "is_continuous",
    "nodes_of_edge",
    "poses_of_edge",
]

# Scaled steps (planning.projection.search_scale) below this are taken for continuous (rad).
LARGE_STEP = np.radians(10.0)
# A half must be shorter than the whole by this factor.
_HALF = 0.8
_DEPTH = 12


def poses_of_edge(tool_path: ToolPath, first: int, last: int) -> Callable[[NDArray[np.float64]], NDArray[np.float64]]:
    """Return the tool's poses between two points of a row, or of two rows that follow each other.

    Parameters
    ----------
    tool_path : ToolPath
    first, last : int
        Points, in order.

    Returns
    -------
    callable
        ``poses(x)`` for x from 0 (first) to 1 (last) gives (k, 4, 4), base frame.
    """
    row = tool_path.row_of_point
    if row[first] == row[last]:
        s0, s1 = tool_path.s[first], tool_path.s[last]
        return lambda x: tool_path.pose(int(row[first]), s0 + x * (s1 - s0))
    transition = tool_path.transitions[int(row[first])]
    return lambda x: np.ascontiguousarray(tool_path.pose_base_workpiece @ transition.curve(x * transition.length))


def nodes_of_edge(tool_path: ToolPath, first: int, last: int) -> NDArray[np.float64]:
    """Return where the halving begins: 0 and 1, and between them the via poses of a transition, which may lead far."""
    row = tool_path.row_of_point
    if row[first] != row[last]:
        transition = tool_path.transitions[int(row[first])]
        if transition.length > 0:
            return np.concatenate([[0.0], transition.s / transition.length, [1.0]])
    return np.array([0.0, 1.0])


def is_continuous(
    chain: SerialChain,
    poses: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    q0: NDArray[np.float64],
    q1: NDArray[np.float64],
    *,
    rho0: NDArray[np.float64] | None = None,
    rho1: NDArray[np.float64] | None = None,
    nodes: NDArray[np.float64] | None = None,
    relaxation: Relaxation = EXACT,
) -> bool:
    """Return whether the tool can follow its path from q0 to q1 without a jump.

    Parameters
    ----------
    chain : SerialChain
    poses : callable
        See :func:`poses_of_edge`.
    q0, q1 : (n,) ndarray
        Configurations at x = 0 and 1.
    rho0, rho1 : (3,) ndarray, optional
        Where a relaxed tool stands there.
    nodes : (k,) ndarray, optional
        See :func:`nodes_of_edge`.
    relaxation : Relaxation
    """
    D = search_scale(chain)
    x = np.array([0.0, 1.0]) if nodes is None else nodes
    ends = np.stack([np.zeros(3) if rho0 is None else rho0, np.zeros(3) if rho1 is None else rho1])
    rho = ends[0] + x[:, None] * (ends[1] - ends[0])
    q = q0 + x[:, None] * (q1 - q0)
    q[-1] = q1
    if len(x) > 2:
        targets = relaxation.targets(np.ascontiguousarray(poses(x[1:-1])), rho[1:-1])
        q[1:-1], there = project(
            chain, targets, q[1:-1], position_tolerance=FOLLOWED_POSE, rotation_tolerance=FOLLOWED_POSE, iterations=20
        )
        if not there.all():
            return False
    for _ in range(_DEPTH):
        step = (np.abs(np.diff(q, axis=0)) / D).max(axis=1)
        large = np.flatnonzero(step > LARGE_STEP)
        if not len(large):
            return True
        middle = 0.5 * (x[large] + x[large + 1])
        lean = 0.5 * (rho[large] + rho[large + 1])
        start = 0.5 * (q[large] + q[large + 1])
        targets = relaxation.targets(np.ascontiguousarray(poses(middle)), lean)
        added, there = project(
            chain, targets, start, position_tolerance=FOLLOWED_POSE, rotation_tolerance=FOLLOWED_POSE, iterations=20
        )
        halves = np.maximum((np.abs(added - q[large]) / D).max(axis=1), (np.abs(added - q[large + 1]) / D).max(axis=1))
        if not there.all() or (halves > _HALF * step[large]).any():
            return False
        x, q = np.insert(x, large + 1, middle), np.insert(q, large + 1, added, axis=0)
        rho = np.insert(rho, large + 1, lean, axis=0)
    return False


def edge_is_continuous(
    problem: PathProblem, solution: PathSolution, k: int, *, at: NDArray[np.int64] | None = None
) -> bool:
    """Return whether the tool can follow its path from entry k of a solution to the next.

    Parameters
    ----------
    problem : PathProblem
    solution : PathSolution
    k : int
    at : (K,) ndarray of int, optional
        The points that the solution is about; all by default.
    """
    edge = (k, k + 1) if at is None else (int(at[k]), int(at[k + 1]))
    tool_path = problem.tool_path
    return is_continuous(
        problem.chain, poses_of_edge(tool_path, *edge), solution.q[k], solution.q[k + 1], rho0=solution.rho[k],
        rho1=solution.rho[k + 1], nodes=nodes_of_edge(tool_path, *edge), relaxation=problem.relaxation,
    )  # fmt: skip


def driven_where_followed(problem: PathProblem, solution: PathSolution) -> PathSolution:
    """Return a solution of all points, driven wherever the tool can follow its path from one point to the next.

    By whatever criterion the configurations were chosen: a step that is too large for it is no reconfiguration if
    it can be followed, and one that cannot be followed is none to be driven.

    Parameters
    ----------
    problem : PathProblem
    solution : PathSolution
    """
    both = solution.reached[:-1] & solution.reached[1:]
    small = (np.abs(np.diff(solution.q, axis=0)) / search_scale(problem.chain)).max(axis=1) <= LARGE_STEP
    driven = both & (small | solution.driven)
    for k in np.flatnonzero(both & ~small):
        driven[k] = edge_is_continuous(problem, solution, int(k))
    return replace(solution, driven=driven)
