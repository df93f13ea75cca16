"""Windings: which of the angles whole turns apart each joint takes, chosen for the whole path at once.

A joint whose limits are wider than a turn reaches the same poses at several angles. The search looks at one turn only,
where it can; which turn is chosen here, joint by joint: for the parts of the path between two reconfigurations, that
which takes the least motion from home, from part to part and back. A part in which a joint turns farther than its
limits are apart is cut: there it unwinds, off the surface.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from qparm.planning.search.graph_search import graph_relaxed
from qparm.planning.solution import PathSolution, reconfigurations
from qparm.robot import CONTINUOUS_RANGE

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.planning.problem import PathProblem
    from qparm.planning.search.graph_record import GraphRecord
    from qparm.robot import SerialChain

__all__ = ["endless", "wound", "wound_graph"]

_TURN = 2 * np.pi
# Turns beside those that reach home that a part may take.
_BESIDE = 1
# Of two ways of the same length the one that begins nearer home is taken: a way before the first row costs more.
_APPROACH = 1.001


def endless(chain: SerialChain) -> SerialChain:
    """Return the arm with each joint whose limits are two turns apart, or more, as one that turns without end.

    Whatever it does within one turn, one of its windings lies within the limits.
    """
    wide = ~chain.continuous & ~chain.prismatic & (chain.upper - chain.lower >= 2 * _TURN * (1 - 1e-6))
    if not wide.any():
        return chain
    joints = tuple(
        replace(joint, position=CONTINUOUS_RANGE, continuous=True) if turns else joint
        for joint, turns in zip(chain.joints, wide.tolist(), strict=True)
    )
    return replace(chain, joints=joints)


def wound_graph(
    problem: PathProblem, *, progress: Callable[[int, int], None] | None = None
) -> tuple[tuple[PathSolution, ...], GraphRecord]:
    """Return what :func:`qparm.planning.graph_relaxed` finds, with windings chosen.

    Parameters
    ----------
    problem : PathProblem
    progress : callable, optional
        ``progress(done, total)`` in points.
    """

    def found(arm: SerialChain) -> tuple[tuple[PathSolution, ...], GraphRecord]:
        candidates, record = graph_relaxed(replace(problem, chain=arm), progress=progress)
        return tuple(wound(problem, one) for one in candidates), record

    chain, ends = problem.chain, problem.row_ends
    arm = endless(chain)
    candidates, record = found(arm)
    if arm is chain or reconfigurations(candidates[0], ends) == (0, 0):
        return candidates, record
    # where a joint's turns do not suffice, another way may need none
    others, other_record = found(chain)

    def worth(one: PathSolution) -> tuple[int, int, int]:
        return (-int(one.reached.sum()), *reconfigurations(one, ends))

    if worth(others[0]) < worth(candidates[0]):
        return others, other_record
    return candidates, record


def wound(problem: PathProblem, solution: PathSolution) -> PathSolution:
    """Return a solution with each joint's windings within its limits, and with the least motion between parts.

    Parameters
    ----------
    problem : PathProblem
        Whose limits are kept.
    solution : PathSolution
        Not smoothed; within the limits but for whole turns.
    """
    chain, home = problem.chain, problem.home
    reached = np.flatnonzero(solution.reached)
    turning = np.flatnonzero(~chain.prismatic & (chain.continuous | (chain.upper - chain.lower > _TURN)))
    if not len(turning) or not len(reached):
        return solution
    q, driven, ends = solution.q.copy(), solution.driven.copy(), problem.row_ends
    for joint in turning:
        limits = float(chain.lower[joint]), float(chain.upper[joint])
        _cut(q[:, joint], driven, ends, limits)
    parts = np.split(reached, np.flatnonzero(~driven[reached[:-1]] | (np.diff(reached) > 1)) + 1)
    for joint in turning:
        limits = float(chain.lower[joint]), float(chain.upper[joint])
        shifts = _shifts([q[part, joint] for part in parts], float(home[joint]), limits)
        for part, shift in zip(parts, shifts, strict=True):
            q[part, joint] += _TURN * shift
    return replace(solution, q=q, driven=driven)


def _cut(
    q: NDArray[np.float64], driven: NDArray[np.bool_], ends: NDArray[np.bool_], limits: tuple[float, float]
) -> None:
    """Undo driven edges where no winding of a joint (P,) fits its limits any more: at a row's end if there is one."""
    low = high = q[0]
    end, k = -1, 0
    while k < len(driven):
        if not driven[k]:
            low = high = q[k + 1]
            end = -1
            k += 1
            continue
        low, high = min(low, q[k + 1]), max(high, q[k + 1])
        least, most = _fitting(low, high, limits)
        if most < least:
            k = end if end >= 0 else k
            driven[k] = False
            continue
        if ends[k]:
            end = k
        k += 1


def _fitting(low: float, high: float, limits: tuple[float, float]) -> tuple[int, int]:
    """Return the least and the most turns by which a range may be moved within limits; the least is more if none."""
    # rounding: a joint may rest on its limit
    least, most = np.ceil((limits[0] - low) / _TURN - 1e-9), np.floor((limits[1] - high) / _TURN + 1e-9)
    return int(least), int(most)


def _shifts(
    parts: list[NDArray[np.float64]], home: float, limits: tuple[float, float]
) -> list[int]:  # fmt: skip
    """Return by how many turns each part of one joint's way is moved: the least way in all, by dynamic programming."""
    options = [_options(part, home, limits) for part in parts]
    cost = _APPROACH * np.abs(parts[0][0] + _TURN * options[0] - home)
    back = []
    for k in range(1, len(parts)):
        left, right = parts[k - 1][-1] + _TURN * options[k - 1], parts[k][0] + _TURN * options[k]
        total = cost[:, None] + np.abs(right - left[:, None])
        back.append(total.argmin(axis=0))
        cost = total.min(axis=0)
    at = int((cost + np.abs(parts[-1][-1] + _TURN * options[-1] - home)).argmin())
    chosen = [int(options[-1][at])]
    for k in range(len(parts) - 2, -1, -1):
        at = int(back[k][at])
        chosen.append(int(options[k][at]))
    return chosen[::-1]


def _options(
    part: NDArray[np.float64], home: float, limits: tuple[float, float]
) -> NDArray[np.int64]:  # fmt: skip
    """Return the turns by which a part may be moved: within the limits, and so that it comes near home if it can."""
    low, high = float(part.min()), float(part.max())
    least, most = _fitting(low, high, limits)
    near = np.round((home - high) / _TURN) - _BESIDE, np.round((home - low) / _TURN) + _BESIDE
    if most < least:
        return np.zeros(1, dtype=np.int64)
    first, last = np.clip(near, least, most)
    return np.arange(int(first), int(last) + 1)
