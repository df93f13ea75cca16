"""Corners: where a row begins in the pose in which the one before ends, the arm rests in one configuration."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from qparm.planning.interpolation.exact import Stretch, gap_deviations
from qparm.planning.interpolation.flow import Piece
from qparm.planning.search.projection import velocity_scale

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.path import Transition
    from qparm.planning.problem import PathProblem
    from qparm.planning.solution import PathSolution

__all__ = ["rest_at_corners", "resting", "rows_meet"]

# Rows no farther apart than this meet (m): a pose list has such poses for the same.
_SAME = 1e-9
# Configurations no farther apart than this are made one (velocity-scaled, rad): rows bend more from point to point, and
# a motion between them would take some milliseconds.
_NEAR = 1e-4
# The parameter of a rest, which must ascend (m).
_REST = 1e-10


def rows_meet(transition: Transition) -> bool:
    """Return whether the next row begins in the pose in which the one before ends."""
    return transition.length <= _SAME


def rest_at_corners(problem: PathProblem, solution: PathSolution) -> PathSolution:
    """Return the solution with one configuration for both points of a corner, where the two are nearly one.

    Parameters
    ----------
    problem : PathProblem
    solution : PathSolution
    """
    chain, tool_path, jump = problem.chain, problem.tool_path, problem.criteria
    row = tool_path.row_of_point
    q, rho = solution.q.copy(), solution.rho.copy()
    for k in np.flatnonzero(solution.driven & (row[1:] != row[:-1])).tolist():
        apart = (np.abs(q[k + 1] - q[k]) / velocity_scale(chain)).max()
        if not rows_meet(tool_path.transitions[int(row[k])]) or not 0.0 < apart <= _NEAR:
            continue
        for kept, moved, neighbour, edge in ((k, k + 1, k + 2, k + 1), (k + 1, k, k - 1, k - 1)):
            if solution.driven[edge] and (np.abs(q[neighbour] - q[kept]) > jump[edge]).any():
                continue
            turns = np.round((rho[moved, 2] - rho[kept, 2]) / (2 * np.pi))
            q[moved], rho[moved] = q[kept], rho[kept]
            # its row goes on with the spin that it had
            rho[moved, 2] += 2 * np.pi * turns
            break
    return replace(solution, q=q, rho=rho)


def resting(problem: PathProblem, index: int, q: NDArray[np.float64], rho: NDArray[np.float64]) -> Piece:
    """Return a transition on which neither tool nor arm moves.

    Parameters
    ----------
    problem : PathProblem
    index : int
        Of the transition.
    q : (n,) ndarray
    rho : (3,) ndarray
        Where a relaxed tool stands.
    """
    tool_path = problem.tool_path

    def pose_of(x: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.ascontiguousarray(
            tool_path.pose_base_workpiece @ tool_path.transitions[index].curve(np.zeros(len(x)))
        )

    s, Q, stands = np.array([0.0, _REST]), np.stack([q, q]), np.stack([rho, rho])
    gaps = gap_deviations(problem.chain, s, Q, stands, pose_of, problem.relaxation)
    return Piece(Stretch(s, Q, stands, np.ones(2, dtype=bool), *gaps), pose_of)
