"""Turns between rows, smoothed with the rows: their via poses join two runs of waypoints into one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from qparm.planning.search.projection import project
from qparm.planning.tolerances import EXACT_POSE

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.planning.problem import PathProblem
    from qparm.robot import SerialChain

__all__ = ["Waypoints", "between", "with_turns"]


@dataclass(frozen=True, eq=False)
class Waypoints:
    """What :func:`qparm.planning.smoothing.smooth.smooth` works on.

    Attributes
    ----------
    poses : (N, 4, 4) ndarray
    q : (N, n) ndarray
    rho : (N, 3) ndarray
    s, run, linked, spacing
        See :func:`qparm.planning.smoothing.smooth.stencils`.
    step : (N - 1, n) ndarray
    turn : (N,) ndarray of int
        The transition that a waypoint is a via pose of, -1 for points.
    """

    poses: NDArray[np.float64]
    q: NDArray[np.float64]
    rho: NDArray[np.float64]
    s: NDArray[np.float64]
    run: NDArray[np.int64]
    linked: NDArray[np.bool_]
    spacing: NDArray[np.float64]
    step: NDArray[np.float64]
    turn: NDArray[np.int64]


def between(
    chain: SerialChain,
    targets: NDArray[np.float64],
    q0: NDArray[np.float64],
    q1: NDArray[np.float64],
    share: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return configurations at poses between two given ones, (k, n), by the least change from the straight line.

    ``share`` (k, 1) is where on it each begins. Also returns which poses are reached, (k,).
    """
    start = np.clip((1 - share) * q0 + share * q1, chain.lower, chain.upper)
    return project(chain, targets, start, position_tolerance=EXACT_POSE, rotation_tolerance=EXACT_POSE, iterations=25)


def with_turns(problem: PathProblem, given: Waypoints, row: NDArray[np.int64]) -> Waypoints:
    """Return waypoints with the via poses of turns put in wherever a linked edge passes one that the arm can follow.

    Parameters
    ----------
    problem : PathProblem
    given : Waypoints
        Points of rows.
    row : (N,) ndarray of int
        Of each.
    """
    chain, tool_path, relaxation = problem.chain, problem.tool_path, problem.relaxation
    names = ("poses", "q", "rho", "s", "run", "spacing", "turn")
    columns = {name: np.split(getattr(given, name), np.arange(1, len(row))) for name in names}
    linked, steps = given.linked.tolist(), list(given.step)
    inserted: list[tuple[int, dict[str, NDArray[np.float64]]]] = []
    for k in np.flatnonzero(given.linked):
        transition = tool_path.transitions[int(row[k])]
        if not transition.flows:
            continue
        share = (transition.s / transition.length)[:, None]
        rho = relaxation.clipped((1 - share) * given.rho[k] + share * given.rho[k + 1])
        targets = relaxation.targets(np.ascontiguousarray(tool_path.transition_poses(int(row[k]))), rho)
        q, there = between(chain, targets, given.q[k], given.q[k + 1], share)
        if not there.all():
            continue
        gap = transition.length / (len(q) + 1)
        inserted.append((int(k), {
            "poses": tool_path.transition_poses(int(row[k])), "q": q, "rho": rho, "s": given.s[k] + transition.s,
            "run": np.full(len(q), given.run[k]), "spacing": np.full(len(q), gap),
            "turn": np.full(len(q), row[k]),
        }))  # fmt: skip
    if not inserted:
        return given
    # what follows a turn belongs to the run before it, and its way goes on from there
    run, s = given.run.copy(), given.s.copy()
    for k, values in inserted:
        length = tool_path.transitions[int(row[k])].length
        later = given.run == given.run[k + 1]
        s[later] += s[k] + length - s[k + 1]
        values["s"] += s[k] - given.s[k]
        values["run"][:] = run[k]
        run[later] = run[k]
    columns["run"], columns["s"] = np.split(run, np.arange(1, len(row))), np.split(s, np.arange(1, len(row)))
    for k, values in reversed(inserted):
        count = len(values["q"])
        for name in names:
            columns[name].insert(k + 1, values[name])
        linked[k : k + 1] = [False] * (count + 1)
        way = np.concatenate([given.q[k : k + 1], values["q"], given.q[k + 1 : k + 2]])
        # the criterion of the row end is that of all steps together
        steps[k : k + 1] = list(np.maximum(given.step[k] / (count + 1), np.abs(np.diff(way, axis=0))))
    merged = {name: np.ascontiguousarray(np.concatenate(columns[name])) for name in names}
    return Waypoints(linked=np.array(linked), step=np.array(steps), **merged)
