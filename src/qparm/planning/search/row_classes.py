"""Other ways through the rows: for each row a few paths of different kinds, of which the smoothest set is chosen.

Smoothing is local: it keeps the kind of path it is given, an arm that passes a wrist singularity in the middle of
a row goes on doing so. So each row is searched from solutions of its first and last pose that lie far apart
(:mod:`qparm.planning.search.row_ways`), and what is smooth in one row is tried in the rows beside it. Dynamic
programming over the rows picks one way for each: the smallest sum of their costs
(:func:`qparm.planning.smoothing.smooth.roughness`), row ends that can be drawn together and near each other.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from qparm.path.relaxation import Relaxation
from qparm.planning.search.projection import unwound_turns, velocity_scale
from qparm.planning.search.row_ways import ITERATIONS, TOLERANCE, RowWays, Way
from qparm.planning.smoothing.smooth import roughness, smooth
from qparm.planning.solution import PathSolution, driven_edges
from qparm.robot.flips import flips

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.path import ToolPath
    from qparm.robot import SerialChain

__all__ = ["other_ways", "rows_of"]

# What a squared radian between two rows' ends is taken to cost: too little, and smoothing may not hold the ways.
_LINKS = (2e-4, 2e-3)


def rows_of(tool_path: ToolPath, at: NDArray[np.int64]) -> list[slice]:
    """Return which of the knots ``at`` each row has."""
    row = tool_path.row_of_point[at]
    borders = [0, *(np.flatnonzero(np.diff(row)) + 1).tolist(), len(row)]
    return [slice(a, b) for a, b in pairwise(borders)]


def other_ways(
    chain: SerialChain,
    tool_path: ToolPath,
    at: NDArray[np.int64],
    spread: Sequence[Sequence[tuple[NDArray[np.float64], NDArray[np.float64]]]],
    base: PathSolution,
    *,
    jump: NDArray[np.float64],
    ends: NDArray[np.bool_],
    relaxation: Relaxation,
    threads: int | None = None,
) -> tuple[PathSolution, ...]:
    """Return paths of other ways through the rows, those that promise to be smoother.

    Parameters
    ----------
    chain : SerialChain
    tool_path : ToolPath
    at : (K,) ndarray of int
        Its knots.
    spread : sequence of sequence of (q, rho)
        For every row what :func:`qparm.planning.search.row_ways.spread_paths` found.
    base : PathSolution
        Of the knots. Rows that it does not drive in one piece are left as they are.
    jump : (K - 1, n) ndarray
        Of the edges between knots (m, rad).
    ends : (K - 1,) ndarray of bool
        Which edges are row ends.
    relaxation : Relaxation
    threads : int, optional
        All cores by default; the answer does not depend on it.

    Returns
    -------
    tuple of PathSolution
        Of the knots, on their poses; row ends are driven but may be far apart until the whole is smoothed.
    """
    scale = velocity_scale(chain)
    rows = rows_of(tool_path, at)
    base = _smoothed_whole(chain, tool_path, at, base, jump, ends, relaxation)
    turned = flips(chain)
    found_ways = [
        RowWays(
            chain, tool_path.poses[at[part]], tool_path.s[at[part]], jump[part.start : part.stop - 1], relaxation,
            base.q[part], base.rho[part], turned,
            searched=bool(base.reached[part].all() and base.driven[part.start : part.stop - 1].all()),
        )
        for part in rows
    ]  # fmt: skip
    workers = min(threads or os.cpu_count() or 1, len(rows))
    with ThreadPoolExecutor(workers) as pool:
        list(pool.map(RowWays.add_all, found_ways, spread))
        _carry_over(found_ways, pool)
    choices = [row_ways.flipped() for row_ways in found_ways]
    # what second differences are like on the base
    together = np.concatenate([np.diff(own[0].q / scale, 2, axis=0) for own in choices])
    if not len(together):
        return ()
    costs = [
        np.array([roughness(np.diff(way.q / scale, 2, axis=0), together) for way in row_ways]) for row_ways in choices
    ]
    found: dict[tuple[int, ...], PathSolution] = {}
    for link in _LINKS:
        chosen = _chosen(choices, costs, rows, base, jump, chain, link)
        if chosen is None or not any(chosen) or chosen in found:
            continue
        q = np.concatenate([row_ways[k].q for row_ways, k in zip(choices, chosen, strict=True)])
        rho = np.concatenate([row_ways[k].rho for row_ways, k in zip(choices, chosen, strict=True)])
        # the rows were found one by one: a continuous joint may be a turn off from one to the next
        whole = replace(base, q=unwound_turns(chain, q), rho=rho)
        path = _smoothed_whole(chain, tool_path, at, whole, jump, ends, relaxation)
        if (driven_edges(path.q, base.reached, jump) >= base.driven).all():
            found[chosen] = path
    return tuple(found.values())


def _carry_over(rows: Sequence[RowWays], pool: ThreadPoolExecutor) -> None:
    """Carry ways over to the rows beside theirs, and what becomes of them on, until no row has a new one."""
    told = [0] * len(rows)
    for _ in rows:
        new = [list(row.ways[count:]) for row, count in zip(rows, told, strict=True)]
        if not any(new):
            return
        told = [len(row.ways) for row in rows]
        least = [row.least for row in rows]

        def take(index: int, new: list[list[Way]] = new, least: list[float] = least) -> None:
            for beside in (index - 1, index + 1):
                if 0 <= beside < len(rows):
                    rows[index].take_over(rows[beside], new[beside], least=least[beside])

        list(pool.map(take, range(len(rows))))


def _smoothed_whole(
    chain: SerialChain,
    tool_path: ToolPath,
    at: NDArray[np.int64],
    base: PathSolution,
    jump: NDArray[np.float64],
    ends: NDArray[np.bool_],
    relaxation: Relaxation,
) -> PathSolution:
    """Return the base smoothed over all knots, as roughly as the ways that it is compared with."""
    there = np.flatnonzero(base.reached)
    if len(there) < 3:
        return base
    k = there[:-1]
    driven = base.driven[k] & (np.diff(there) == 1)
    linked = driven & ends[k]
    step = np.where(driven[:, None], np.maximum(jump[k], np.abs(np.diff(base.q[there], axis=0))), np.inf)
    found = smooth(
        chain, np.ascontiguousarray(tool_path.poses[at[there]]), base.q[there], s=tool_path.s[at[there]],
        run=np.concatenate([[0], np.cumsum(~driven | ends[k])]), linked=linked,
        step=step, relaxation=relaxation, parameters=relaxation.unwound(base.rho[there]), iterations=ITERATIONS,
        tolerance=TOLERANCE,
    )  # fmt: skip
    q, rho = base.q.copy(), base.rho.copy()
    q[there], rho[there] = found.q, found.parameters
    return replace(base, q=q, rho=rho)


def _chosen(
    choices: Sequence[Sequence[Way]],
    costs: Sequence[NDArray[np.float64]],
    rows: Sequence[slice],
    base: PathSolution,
    jump: NDArray[np.float64],
    chain: SerialChain,
    link: float,
) -> tuple[int, ...] | None:
    """Return which way to take through each row: least sum of costs, with row ends that can be driven."""
    scale, turning = velocity_scale(chain), chain.continuous
    cost = costs[0]
    back: list[NDArray[np.int64]] = []
    for index in range(1, len(rows)):
        edge = rows[index].start - 1
        first = np.array([way.q[0] for way in choices[index]])
        last = np.array([way.q[-1] for way in choices[index - 1]])
        d = first[None] - last[:, None]
        step = np.abs(np.where(turning, np.remainder(d + np.pi, 2 * np.pi) - np.pi, d))
        total = np.repeat(cost[:, None], len(first), axis=1)
        if base.driven[edge]:
            # ways that end apart are drawn together by smoothing, which costs both something
            far = (step > jump[edge]).any(axis=2)
            total = total + np.where(far, np.inf, link * ((step / scale) ** 2).sum(axis=2))
        back.append(total.argmin(axis=0))
        cost = total.min(axis=0) + costs[index]
    if not np.isfinite(cost).any():
        return None
    chosen = [int(cost.argmin())]
    for pointer in reversed(back):
        chosen.append(int(pointer[chosen[-1]]))
    return tuple(reversed(chosen))
