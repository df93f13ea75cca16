"""Why a row breaks: what stops the arm that goes on past the break, from either side."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from qparm.ik.reach import without_limits
from qparm.path.relaxation import EXACT, Relaxation
from qparm.planning.projection import project

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from qparm.path import ToolPath
    from qparm.planning.solution import PathSolution
    from qparm.robot import SerialChain

__all__ = ["why_broken"]

_TOLERANCE = 1e-9


def why_broken(
    chain: SerialChain,
    tool_path: ToolPath,
    solution: PathSolution,
    first: int,
    last: int,
    *,
    jump: NDArray[np.float64],
    relaxation: Relaxation = EXACT,
) -> str:
    """Return in words what ends the way on from either side of a break inside a row.

    From the point before the break the arm goes on along the row, each time to the nearest configuration of the next
    pose, until it is stopped; from the point after it, backwards. What stops it is a position limit, if the next pose
    would be within a driven step without limits, else the pose itself: its solutions lie on another piece.

    Parameters
    ----------
    chain : SerialChain
    tool_path : ToolPath
    solution : PathSolution
    first, last : int
        Neighbouring points of one row.
    jump : (P - 1, n) ndarray
        As for :func:`qparm.planning.graph.graph`.
    relaxation : Relaxation
    """
    row = tool_path.row_of_point
    at = np.flatnonzero(row == row[first])
    forwards = _stopped(chain, tool_path, solution, range(first, int(at[-1]) + 1), jump, relaxation)
    backwards = _stopped(chain, tool_path, solution, range(last, int(at[0]) - 1, -1), jump, relaxation)
    return f"going on from point {first} {forwards}; coming back from point {last} {backwards}"


def _stopped(
    chain: SerialChain,
    tool_path: ToolPath,
    solution: PathSolution,
    points: Sequence[int],
    jump: NDArray[np.float64],
    relaxation: Relaxation,
) -> str:
    q, rho = solution.q[points[0]], solution.rho[points[0]]
    for before, k in pairwise(points):
        target = relaxation.targets(tool_path.poses[k : k + 1], rho[None])
        moved, limit = _step(chain, target, q), jump[min(before, k)]
        if moved is None or (np.abs(moved - q) > limit).any():
            free = _step(without_limits(chain), target, q)
            if free is None or (np.abs(free - q) > limit).any():
                return f"the arm is stopped at point {before}: point {k} has no solution near, limits apart"
            outside = np.maximum(chain.lower - free, free - chain.upper) / (chain.upper - chain.lower)
            names = [chain.names[i] for i in np.flatnonzero(outside > 0)]
            if not names:
                names = [chain.names[int(outside.argmax())]]
            return f"the arm is stopped at point {before} by the limits of {', '.join(names)}"
        q = moved
    return "the row can be followed to its end, but what lies on the other side of the break cannot be reached"


def _step(chain: SerialChain, target: NDArray[np.float64], q: NDArray[np.float64]) -> NDArray[np.float64] | None:
    moved, there = project(
        chain, target, q[None], position_tolerance=_TOLERANCE, rotation_tolerance=_TOLERANCE, iterations=25
    )
    return moved[0] if there[0] else None
