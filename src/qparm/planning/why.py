"""Reasons for breaks inside rows: what stops the arm that goes on past the break, from either side.

A bundle of ways (:mod:`qparm.planning.search.bundle`) goes on along the row from the point before the break, and from
the point after it backwards, until none of them gets any farther; the last stretch once more in fine steps, to see
where and by what it is stopped. That is a search, no proof; but by the same ways it was tried to drive the row before
it was called broken.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from qparm.path.joint_path import NO_POINT
from qparm.planning.search.bundle import follow_bundle
from qparm.planning.search.continuation import followed_on
from qparm.planning.search.filling import FilledPath
from qparm.reach.verdict import ReachReason, check_reach, without_limits

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.path import ToolPath
    from qparm.path.relaxation import Relaxation
    from qparm.planning.problem import PathProblem
    from qparm.planning.search.sampling import Layer
    from qparm.planning.solution import PathSolution
    from qparm.robot import SerialChain

__all__ = ["why_broken"]

# The stretch on which the arm is stopped is followed again in so many steps.
_FINE = 16
# A smallest singular value of the scaled Jacobian below this is worth telling.
_SINGULAR = 0.05
# The tool leans as far as it may from this share of its cone on.
_AT_THE_RIM = 0.99


def why_broken(problem: PathProblem, solution: PathSolution, first: int, last: int) -> str:
    """Return in words what ends the way on from either side of a break inside a row.

    What stops the arm is a position limit, if without limits it would go on; else the path, if it leads out of reach;
    else a singularity, where the piece of the self-motion set that the arm is on comes to its end. Of a tool that may
    spin or tilt it is said what it may do, and whether it leans as far as it may.

    Parameters
    ----------
    problem : PathProblem
    solution : PathSolution
    first, last : int
        Neighbouring points of one row.
    """
    tool_path, relaxation = problem.tool_path, problem.relaxation
    row = tool_path.row_of_point
    own = solution.reached & (row == row[first])
    ahead = np.flatnonzero(~own[last:])
    behind = np.flatnonzero(~own[: first + 1])
    end = last + int(ahead[0]) if len(ahead) else len(own)
    begin = int(behind[-1]) if len(behind) else -1
    forwards = _stopped(problem, solution, range(first, end))
    backwards = _stopped(problem, solution, range(last, begin, -1))
    free = f"; {relaxation.words}" if relaxation.free else ""
    number = _number(tool_path)
    return f"going on from point {number[first]} {forwards}; coming back from point {number[last]} {backwards}{free}"


def _stopped(problem: PathProblem, solution: PathSolution, points: range) -> str:
    """Return where the arm is stopped on its way over some points, and by what."""
    chain, tool_path, relaxation = problem.chain, problem.tool_path, problem.relaxation
    coarse = followed_on(problem, solution, points)
    if coarse.arrived:
        return "the row can be followed to its end"
    at, following = points[len(coarse.layers) - 1], points[len(coarse.layers)]
    row = int(tool_path.row_of_point[at])
    s = np.linspace(tool_path.s[at], tool_path.s[following], _FINE + 1)

    def poses(x: NDArray[np.float64]) -> NDArray[np.float64]:
        return tool_path.pose(row, x)

    rng = np.random.default_rng(0)
    fine = follow_bundle(chain, poses, s, coarse.layers[-1], relaxation=relaxation, rng=rng)
    k = min(len(fine.layers) - 1, _FINE - 1)
    # points that were put in have no number: the last one that has is told, and how far beyond it the arm gets
    number = _number(tool_path)[np.array(points[: len(coarse.layers)])]
    told = int(np.flatnonzero(number != NO_POINT)[-1])
    beyond = abs(s[k] - tool_path.s[points[told]])
    where = f"the arm is stopped at point {number[told]}" + (f", {beyond * 1e3:.3g} mm on," if beyond > 0 else "")
    return where + _by_what(chain, poses, (float(s[k]), float(s[k + 1])), fine.layers[k], relaxation)


def _by_what(
    chain: SerialChain,
    poses: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    gap: tuple[float, float],
    ways: Layer,
    relaxation: Relaxation,
) -> str:
    """Return what stops a bundle on its way over a gap: limits, of the way that would be least outside; or the path."""
    unlimited = without_limits(chain)
    on = follow_bundle(
        unlimited, poses, np.array(gap), ways, relaxation=relaxation, rng=np.random.default_rng(0), width=256
    )  # fmt: skip
    q, rho = on.layers[-1].q, on.layers[-1].rho
    outside = np.maximum(chain.lower - q, q - chain.upper) / (chain.upper - chain.lower)
    least = int(outside.max(axis=1).argmin())
    beyond = np.flatnonzero(outside[least] > 0)
    if on.arrived and len(beyond):
        names = ", ".join(chain.names[i] for i in beyond)
        leans = relaxation.tilt > 0 and float(np.hypot(*rho[least, :2])) > _AT_THE_RIM * relaxation.tilt
        value = float(_smallest(chain, q[least : least + 1])[0])
        near = f", near a singularity (smallest singular value {value:.2g})" if value < _SINGULAR else ""
        return f" by the limits of {names}{', the tool leaning as far as it may' if leans else ''}{near}"
    (reach,) = check_reach(chain, poses(np.array(gap[1:])), rng=np.random.default_rng(0), relaxation=relaxation)
    if reach.reason is not ReachReason.WITHIN_REACH:
        return f": the path leads out of reach there ({reach})"
    return f" by a singularity (smallest singular value {_smallest(chain, ways.q).max():.2g})"


def _smallest(chain: SerialChain, q: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the smallest singular value of the scaled Jacobian at configurations (m, n), (m,)."""
    return np.asarray(np.linalg.svd(chain.scaled_jacobian(q), compute_uv=False)[:, -1], dtype=float)


def _number(tool_path: ToolPath) -> NDArray[np.int64]:
    """Return how each point is counted, (K,); -1 for poses that were put in between points."""
    number = tool_path.number if isinstance(tool_path, FilledPath) else None
    return np.arange(tool_path.point_count) if number is None else number
