"""The result of every strategy: a configuration for each point, and which edges between points are driven."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from qparm.path import joint_curve
from qparm.planning.problem import row_end
from qparm.planning.search.continuity import edge_is_continuous
from qparm.planning.search.projection import project, velocity_scale

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.path import ToolPath
    from qparm.planning.problem import PathProblem
    from qparm.robot import SerialChain

__all__ = ["PathSolution", "at_knots", "driven_edges", "fill", "knots", "reconfigurations", "runs"]

# Poses nearer to each other than this share of the characteristic length, and than this angle, need not be searched
# one by one: what lies between follows from its neighbours.
_KNOT_LENGTH = 0.05
_KNOT_ANGLE = np.radians(3.0)


@dataclass(frozen=True, eq=False)
class PathSolution:
    """Configurations at the points of a tool path.

    Attributes
    ----------
    q : (P, n) ndarray
        m, rad; those of points that are not reached are not used.
    rho : (P, 3) ndarray
        Where a relaxed tool stands: tilt about x and y, spin (rad); zero without relaxation.
    reached : (P,) ndarray of bool
    driven : (P - 1,) ndarray of bool
        Whether the arm goes from a point to the next along the surface (or the transition); False where it has
        to reconfigure, or where one of the two is not reached.
    turns : dict of int to (q, rho)
        Configurations (k, n) at the via poses of transitions, and where a relaxed tool stands there, (k, 3), as far
        as they were smoothed with the rows.
    """

    q: NDArray[np.float64]
    rho: NDArray[np.float64]
    reached: NDArray[np.bool_]
    driven: NDArray[np.bool_]
    turns: dict[int, tuple[NDArray[np.float64], NDArray[np.float64]]] = field(default_factory=dict)

    def reconfigurations(self, tool_path: ToolPath) -> tuple[int, int]:
        """Return the numbers inside rows and at row ends; gaps of unreached points are not counted."""
        return reconfigurations(self, row_end(tool_path))


def reconfigurations(solution: PathSolution, ends: NDArray[np.bool_]) -> tuple[int, int]:
    """Return the numbers inside rows and at row ends of a solution of some points; ``ends`` (K - 1,) tells which."""
    broken = solution.reached[:-1] & solution.reached[1:] & ~solution.driven
    return int((broken & ~ends).sum()), int((broken & ends).sum())


def driven_edges(q: NDArray[np.float64], reached: NDArray[np.bool_], jump: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which edges join two reached points by a step within the criterion ((n,) or (P - 1, n)), (P - 1,)."""
    return reached[:-1] & reached[1:] & (np.abs(np.diff(q, axis=0)) <= jump).all(axis=1)


def at_knots(solution: PathSolution, at: NDArray[np.int64]) -> PathSolution:
    """Return a solution at some of its points (K,); from one to the next is driven where all edges between them are."""
    broken = np.concatenate([[0], np.cumsum(~solution.driven)])[at]
    return PathSolution(
        solution.q[at], solution.rho[at], solution.reached[at], broken[1:] == broken[:-1], solution.turns
    )


def runs(tool_path: ToolPath, reached: NDArray[np.bool_], driven: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return for each point the run it belongs to, (P,), -1 where it is not reached.

    A run is a piece of one row that is driven without a break.
    """
    row = tool_path.row_of_point
    starts = np.ones(len(row), dtype=bool)
    starts[1:] = ~(driven & (row[:-1] == row[1:]))
    return np.where(reached, np.cumsum(starts) - 1, -1)


def knots(chain: SerialChain, tool_path: ToolPath, *, apart: float = 1.0) -> NDArray[np.int64]:
    """Return the points that a path is chosen at: all, or every so many where they lie dense.

    Parameters
    ----------
    chain : SerialChain
    tool_path : ToolPath
    apart : float
        How many times farther from each other they may lie than what is smoothed.
    """
    chosen, offset = [], 0
    largest, widest = apart * _KNOT_LENGTH * chain.characteristic_length, apart * _KNOT_ANGLE
    for row in tool_path.rows:
        c = len(row.s)
        R = row.poses[:, :3, :3]
        cosine = 0.5 * (np.einsum("kij,kij->k", R[1:], R[:-1]) - 1.0)
        angle = np.arccos(np.clip(cosine, -1.0, 1.0)).max(initial=0.0)
        step = np.linalg.norm(np.diff(row.poses[:, :3, 3], axis=0), axis=1).max(initial=0.0)
        stride = max(1, int(min(largest / max(step, 1e-12), widest / max(angle, 1e-12), c)))
        pieces = max(1, -(-(c - 1) // stride))
        chosen.append(offset + np.unique(np.round(np.linspace(0, c - 1, pieces + 1)).astype(np.int64)))
        offset += c
    return np.concatenate(chosen)


def fill(problem: PathProblem, at: NDArray[np.int64], solution: PathSolution) -> PathSolution:
    """Return the solution of all points from that of some of them.

    Between two knots joined by a driven edge the start is the spline of their run; where the arm reconfigures
    between two knots, the points between follow one side as far as they can, the rest the other.

    Parameters
    ----------
    problem : PathProblem
    at : (K,) ndarray of int
        The points that ``solution`` is about, in order, the first and last of each row among them.
    solution : PathSolution
        Of the K knots.
    """
    chain, tool_path, relaxation, jump = problem.chain, problem.tool_path, problem.relaxation, problem.criteria
    P = tool_path.point_count
    D = velocity_scale(chain)
    poses, s, row = tool_path.poses, tool_path.s, tool_path.row_of_point
    q, rho = np.empty((P, chain.n)), np.zeros((P, 3))
    guessed = np.zeros(P, dtype=bool)
    q[at], rho[at], guessed[at] = solution.q, solution.rho, solution.reached
    is_knot = np.zeros(P, dtype=bool)
    is_knot[at] = True
    # what is driven without a break belongs together; a point between two knots belongs to the one it was found from
    together = np.full(P, -1, dtype=np.int64)
    together[at] = np.concatenate([[0], np.cumsum(~solution.driven)])
    start = 0
    knot_row = row[at]
    while start < len(at):
        end = start
        while end + 1 < len(at) and knot_row[end + 1] == knot_row[start] and solution.driven[end]:
            end += 1
        if end > start and solution.reached[start]:
            inside = np.arange(at[start], at[end] + 1)
            new = inside[~is_knot[inside]]
            if len(new):
                both = np.concatenate([solution.q[start : end + 1] / D, solution.rho[start : end + 1]], axis=1)
                value = joint_curve(s[at[start : end + 1]], both)(s[new])
                q[new] = np.clip(value[:, : chain.n] * D, chain.lower, chain.upper)
                rho[new] = relaxation.clipped(value[:, chain.n :])
                guessed[new] = True
                together[new] = together[at[start]]
        start = end + 1
    rest = np.flatnonzero(~guessed & ~is_knot)
    reached = np.zeros(P, dtype=bool)
    some = np.flatnonzero(guessed)

    def onto(
        targets: NDArray[np.float64], starts: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        return project(
            chain, targets, starts, position_tolerance=problem.position_tolerance,
            rotation_tolerance=problem.rotation_tolerance, iterations=25,
        )  # fmt: skip

    if len(some):
        targets = relaxation.targets(poses[some], rho[some])
        q[some], reached[some] = onto(targets, q[some])
    # what no run covers is followed from its neighbours, forwards and then backwards
    for order, neighbour in ((rest, -1), (rest[::-1], 1)):
        for k in order:
            other = k + neighbour
            if reached[k] or not (0 <= other < P) or not reached[other] or row[other] != row[k]:
                continue
            target = relaxation.targets(poses[k : k + 1], rho[other : other + 1])
            moved, there = onto(target, q[other : other + 1])
            if there[0] and (np.abs(moved[0] - q[other]) <= jump[min(k, other)]).all():
                q[k], rho[k], reached[k], together[k] = moved[0], rho[other], True, together[other]
    q[~reached] = 0.0
    driven = reached[:-1] & reached[1:] & (together[:-1] == together[1:])
    filled = PathSolution(q, rho, reached, driven)
    # a larger step is none to be driven, unless its knots were found to be joined or it can be followed
    joined = np.zeros(P - 1, dtype=bool)
    joined[at[:-1][(np.diff(at) == 1) & solution.driven]] = True
    for k in np.flatnonzero(driven & ~joined & ~driven_edges(q, reached, jump)):
        driven[k] = edge_is_continuous(problem, filled, int(k))
    return filled
