"""Reasons for breaks inside rows: what stops the arm that goes on past the break, from either side.

The arm goes on in a bundle of ways. At every pose each is moved on, to the nearest configuration and to displaced ones
beside it, a tool that may spin or tilt turning with it; what is within a driven step of where it came from is kept, as
many as the bundle holds: those with the most reserve to limits, and others at random. The bundle ends where none of
them gets any farther. That is a search, no proof.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from qparm.ik.iterate import REACHED
from qparm.ik.reach import without_limits
from qparm.ik.relaxed import relaxed_iterate_kernel
from qparm.path.relaxation import EXACT, Relaxation
from qparm.planning.projection import project, velocity_scale

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.path import ToolPath
    from qparm.planning.solution import PathSolution
    from qparm.robot import SerialChain

__all__ = ["why_broken"]

_TOLERANCE = 1e-9
_ITERATIONS = 25
# A step is trusted this far (velocity-scaled rad), as in planning.projection.
_TRUST = 0.5
# The tool turns for nothing beside the joints: what is asked is how little they must move.
_EASE = 10.0
# So many ways are followed at once, each moved on to so many configurations displaced by so much (velocity-scaled rad,
# and rad of the tool); two that are nearer than this to each other are one.
_BUNDLE, _BESIDE, _WIDTH, _APART = 32, 4, 0.15, 0.05
# Points of a row at which the bundle is moved on, about, at most.
_MOST_POINTS = 100
# The tool leans as far as it may from this share of its cone on.
_AT_THE_RIM = 0.99


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

    From the point before the break a bundle of ways goes on along the row until none is left; from the point after it,
    backwards. What stops them is a position limit, if the next pose would be within a driven step without limits, else
    the pose itself: its solutions lie on another piece. Of a tool that may spin or tilt it is said what it may do, and
    whether it leans as far as it may.

    Parameters
    ----------
    chain : SerialChain
    tool_path : ToolPath
    solution : PathSolution
    first, last : int
        Neighbouring points of one row.
    jump : (P - 1, n) ndarray
        As for :func:`qparm.planning.graph`.
    relaxation : Relaxation
    """
    row = tool_path.row_of_point
    at = np.flatnonzero(row == row[first])
    forwards = _stopped(chain, tool_path, solution, range(first, int(at[-1]) + 1), jump, relaxation)
    backwards = _stopped(chain, tool_path, solution, range(last, int(at[0]) - 1, -1), jump, relaxation)
    free = f"; {relaxation.words}" if relaxation.free else ""
    return f"going on from point {first} {forwards}; coming back from point {last} {backwards}{free}"


def _stopped(
    chain: SerialChain,
    tool_path: ToolPath,
    solution: PathSolution,
    points: range,
    jump: NDArray[np.float64],
    relaxation: Relaxation,
) -> str:
    thinned = list(points[:: max(1, len(points) // _MOST_POINTS)])
    # the same draws whatever else was drawn before: the sentence is no part of the plan
    rng = np.random.default_rng(0)
    q, rho = solution.q[points[:1]], solution.rho[points[:1]]
    for before, k in pairwise(thinned):
        pose, limit = tool_path.poses[k], jump[min(before, k) : max(before, k)].sum(axis=0)
        moved = _moved_on(chain, pose, q, rho, limit, relaxation, rng)
        if not len(moved[0]):
            return f"the arm is stopped at point {before}{_by_what(chain, pose, k, q, rho, limit, relaxation)}"
        q, rho = moved
    return "the row can be followed to its end, but what lies on the other side of the break cannot be reached"


def _moved_on(
    chain: SerialChain,
    pose: NDArray[np.float64],
    q: NDArray[np.float64],
    rho: NDArray[np.float64],
    limit: NDArray[np.float64],
    relaxation: Relaxation,
    rng: np.random.Generator,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return a bundle (m, n), and how its tools stand, moved on to the next pose; empty where none gets there."""
    scale, (m, n) = velocity_scale(chain), q.shape
    tries = np.repeat(q[:, None], 1 + _BESIDE, axis=1)
    tries[:, 1:] += rng.standard_normal((m, _BESIDE, n)) * scale * _WIDTH
    leans = np.repeat(rho[:, None], 1 + _BESIDE, axis=1)
    leans[:, 1:] += rng.standard_normal((m, _BESIDE, 3)) * _WIDTH
    leans = relaxation.clipped(leans)
    moved, there = project(
        chain, np.broadcast_to(pose, (m, 4, 4)), np.clip(tries, chain.lower, chain.upper), iterations=_ITERATIONS,
        position_tolerance=_TOLERANCE, rotation_tolerance=_TOLERANCE, threads=1,
        offsets=relaxation.rotations(leans.reshape(-1, 3)) if relaxation.free else None,
    )  # fmt: skip
    there &= (np.abs(moved - q[:, None]) <= limit).all(axis=2)
    found_q, found_rho = [moved[there]], [leans[there]]
    for one, lean in zip(q, rho, strict=True) if relaxation.free else ():
        turned = _turned(chain, pose, one, lean, relaxation)
        if turned is not None and (np.abs(turned[0] - one) <= limit).all():
            found_q.append(turned[0][None])
            found_rho.append(turned[1][None])
    found, leaning = np.concatenate(found_q), np.concatenate(found_rho)
    kept: list[int] = []
    reserve = np.argsort(-chain.distance_to_limits(found), kind="stable")
    for order, most in ((reserve, _BUNDLE // 2), (rng.permutation(len(found)), _BUNDLE)):
        for k in order:
            if len(kept) == most:
                break
            if (np.abs(found[kept] - found[k]) > scale * _APART).any(axis=1).all():
                kept.append(int(k))
    return found[kept], leaning[kept]


def _by_what(
    chain: SerialChain,
    pose: NDArray[np.float64],
    k: int,
    q: NDArray[np.float64],
    rho: NDArray[np.float64],
    limit: NDArray[np.float64],
    relaxation: Relaxation,
) -> str:
    """Return what stops a bundle before point k: limits, of the way that would be least outside, or the pose."""
    unlimited = without_limits(chain)
    least, names, leaning = np.inf, "", False
    for one, lean in zip(q, rho, strict=True):
        free = _nearest(unlimited, pose, one, lean, relaxation)
        if free is None or (np.abs(free[0] - one) > limit).any():
            continue
        outside = np.maximum(chain.lower - free[0], free[0] - chain.upper) / (chain.upper - chain.lower)
        if outside.max() < least:
            least = float(outside.max())
            which = np.flatnonzero(outside > 0) if least > 0 else [int(outside.argmax())]
            names, leaning = ", ".join(chain.names[i] for i in which), _leans(free[1], relaxation)
    far = ", the tool leaning as far as it may" if leaning else ""
    return f" by the limits of {names}{far}" if names else f": point {k} has no solution near, limits apart"


def _leans(rho: NDArray[np.float64], relaxation: Relaxation) -> bool:
    return relaxation.tilt > 0 and float(np.hypot(rho[0], rho[1])) > _AT_THE_RIM * relaxation.tilt


def _nearest(
    chain: SerialChain,
    pose: NDArray[np.float64],
    q: NDArray[np.float64],
    rho: NDArray[np.float64],
    relaxation: Relaxation,
) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Return the nearest configuration of a pose and how the tool stands there, None if there is none."""
    if relaxation.free:
        return _turned(chain, pose, q, rho, relaxation)
    moved, there = project(
        chain, pose[None], q[None], position_tolerance=_TOLERANCE, rotation_tolerance=_TOLERANCE, iterations=_ITERATIONS
    )
    return (moved[0], rho) if there[0] else None


def _turned(
    chain: SerialChain,
    pose: NDArray[np.float64],
    q: NDArray[np.float64],
    rho: NDArray[np.float64],
    relaxation: Relaxation,
) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Return the nearest configuration of a pose whose tool turns as it likes, None if there is none."""
    q, rho, cone = q.copy(), rho.copy(), np.array([relaxation.tilt, float(relaxation.spin)])
    end = relaxed_iterate_kernel(
        chain.fixed, chain.prismatic, chain.lower, chain.upper, velocity_scale(chain), chain.characteristic_length,
        np.full(chain.n, _TRUST), pose, cone, _EASE, _TOLERANCE, _TOLERANCE, _ITERATIONS, q, rho, np.empty(2),
    )  # fmt: skip
    return (q, rho) if end == REACHED else None
