"""Other ways through the rows: for each row a few paths of different kinds, of which the smoothest set is chosen.

Smoothing is local: it keeps the kind of path it is given, an arm that passes a wrist singularity in the middle of
a row goes on doing so. So each row is searched from solutions of its first and last pose that lie far apart, each
path is smoothed by itself, and dynamic programming over the rows picks one for each: the smallest sum of
their costs (:func:`qparm.planning.smooth.roughness`), row ends within the jump criterion and near each other.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from qparm.planning.continuity import LARGE_STEP
from qparm.planning.layered import INSIDE, LayeredSearch
from qparm.planning.projection import project, velocity_scale
from qparm.planning.relaxation import Relaxation
from qparm.planning.sampling import Layer
from qparm.planning.smooth import roughness, smooth
from qparm.planning.solution import PathSolution, driven_edges

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.path import ToolPath
    from qparm.robot import SerialChain

__all__ = ["other_ways"]

# Solutions tried at either end of a row, and how finely their paths are smoothed to be compared.
_ENDS = 16
_FEW, _ITERATIONS, _TOLERANCE = 3, 6, 2e-2
# A way that is this much rougher than the row's own after a few iterations is given up.
_HOPELESS = 2.0
# Two smoothed paths of a row are one if no velocity-scaled joint differs by more (rad).
_SAME = np.radians(5.0)
# ... and after a few iterations they are on their way to one another.
_LIKE = np.radians(15.0)
# A path that is found lies no farther than this from the smoothed one of its kind, as a rule.
_NEAR = np.radians(30.0)
_SOLVED = 1e-11
# What a squared radian between two rows' ends is taken to cost: too little, and smoothing may not hold the ways.
_LINKS = (2e-4, 2e-3)
# Smoothing the whole draws row ends together that lie this many times the jump criterion apart.
_DRAWN = 2.0


def other_ways(
    chain: SerialChain,
    tool_path: ToolPath,
    at: NDArray[np.int64],
    layers: Sequence[Layer],
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
    layers : sequence of Layer
        Samples of every knot.
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
    row = tool_path.row_of_point[at]
    borders = [0, *(np.flatnonzero(np.diff(row)) + 1).tolist(), len(row)]
    rows = [slice(a, b) for a, b in pairwise(borders)]

    base = _smoothed_whole(chain, tool_path, at, base, jump, ends, relaxation)

    def ways(part: slice) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
        return _ways(chain, tool_path, at, layers, base, jump, relaxation, part)

    workers = min(threads or os.cpu_count() or 1, len(rows))
    with ThreadPoolExecutor(workers) as pool:
        choices = list(pool.map(ways, rows))
    # what second differences are like on the base
    together = np.concatenate([np.diff(own[0][0] / scale, 2, axis=0) for own in choices])
    if not len(together):
        return ()
    costs = [
        np.array([roughness(np.diff(q / scale, 2, axis=0), together) for q, _ in row_ways]) for row_ways in choices
    ]
    found: dict[tuple[int, ...], PathSolution] = {}
    for link in _LINKS:
        chosen = _chosen(choices, costs, rows, base, jump, scale, link)
        if chosen is None or not any(chosen) or chosen in found:
            continue
        q = np.concatenate([row_ways[k][0] for row_ways, k in zip(choices, chosen, strict=True)])
        rho = np.concatenate([row_ways[k][1] for row_ways, k in zip(choices, chosen, strict=True)])
        path = _smoothed_whole(chain, tool_path, at, replace(base, q=q, rho=rho), jump, ends, relaxation)
        if (driven_edges(path.q, base.reached, jump) >= base.driven).all():
            found[chosen] = path
    return tuple(found.values())


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
    found = smooth(
        chain, np.ascontiguousarray(tool_path.poses[at[there]]), base.q[there], s=tool_path.s[at[there]],
        run=np.concatenate([[0], np.cumsum(~driven | ends[k])]), linked=linked,
        step=np.where(driven[:, None], np.maximum(jump[k], np.abs(np.diff(base.q[there], axis=0))), np.inf), relaxation=relaxation,
        parameters=relaxation.unwound(base.rho[there]), iterations=_ITERATIONS, tolerance=_TOLERANCE,
    )  # fmt: skip
    q, rho = base.q.copy(), base.rho.copy()
    q[there], rho[there] = found.q, found.parameters
    return replace(base, q=q, rho=rho)


def _chosen(
    choices: Sequence[Sequence[tuple[NDArray[np.float64], NDArray[np.float64]]]],
    costs: Sequence[NDArray[np.float64]],
    rows: Sequence[slice],
    base: PathSolution,
    jump: NDArray[np.float64],
    scale: NDArray[np.float64],
    link: float,
) -> tuple[int, ...] | None:
    """Return which way to take through each row: least sum of costs, with row ends that can be driven."""
    cost = costs[0]
    back: list[NDArray[np.int64]] = []
    for index in range(1, len(rows)):
        edge = rows[index].start - 1
        first = np.array([q[0] for q, _ in choices[index]])
        last = np.array([q[-1] for q, _ in choices[index - 1]])
        step = np.abs(first[None] - last[:, None])
        total = np.repeat(cost[:, None], len(first), axis=1)
        if base.driven[edge]:
            # ways that end far apart are drawn together by smoothing, which costs both something
            far = (step > _DRAWN * jump[edge]).any(axis=2)
            total = total + np.where(far, np.inf, link * ((step / scale) ** 2).sum(axis=2))
        back.append(total.argmin(axis=0))
        cost = total.min(axis=0) + costs[index]
    if not np.isfinite(cost).any():
        return None
    chosen = [int(cost.argmin())]
    for pointer in reversed(back):
        chosen.append(int(pointer[chosen[-1]]))
    return tuple(reversed(chosen))


def _ways(
    chain: SerialChain,
    tool_path: ToolPath,
    at: NDArray[np.int64],
    layers: Sequence[Layer],
    base: PathSolution,
    jump: NDArray[np.float64],
    relaxation: Relaxation,
    part: slice,
) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Return configurations and tool parameters of the ways through one row, the base's own first."""
    scale = velocity_scale(chain)
    count = part.stop - part.start
    inner = jump[part.start : part.stop - 1]
    poses, s = np.ascontiguousarray(tool_path.poses[at[part]]), tool_path.s[at[part]]

    def smoothed(
        q: NDArray[np.float64], rho: NDArray[np.float64], iterations: int = _ITERATIONS
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        found = smooth(
            chain, poses, q, s=s, run=np.zeros(count, dtype=np.int64), linked=np.zeros(count - 1, dtype=bool),
            step=inner, relaxation=relaxation, parameters=rho, iterations=iterations, tolerance=_TOLERANCE, threads=1,
        )  # fmt: skip
        return found.q, found.parameters

    def bend(q: NDArray[np.float64]) -> float:
        return float((np.diff(q / scale, 2, axis=0) ** 2).sum())

    whole = base.reached[part].all() and base.driven[part.start : part.stop - 1].all() and count > 2
    ways = [(base.q[part], base.rho[part])]
    if not whole or any(not len(layer.q) for layer in layers[part]):
        return ways
    met, least = [ways[0][0]], bend(ways[0][0])
    for backwards in (False, True):
        line = list(layers[part])[::-1] if backwards else list(layers[part])
        limits = inner[::-1] if backwards else inner
        search = LayeredSearch(chain, scale)
        for k, layer in enumerate(line):
            search.add(layer, INSIDE, limits[max(k - 1, 0)])
        for end in _ends(search, line[-1].q / scale):
            q, rho, _ = search.path(end)
            if backwards:
                q, rho = q[::-1], rho[::-1]
            # smoothing would lead it to where it has led another
            if any((np.abs(q - other) / scale).max() < _NEAR for other in met):
                continue
            met.append(q)
            rho = relaxation.unwound(rho)
            q, there = project(
                chain, relaxation.targets(poses, rho), q, position_tolerance=_SOLVED, rotation_tolerance=_SOLVED,
                threads=1,
            )  # fmt: skip
            if not there.all():
                continue
            way = smoothed(q, rho, _FEW)
            known = any((np.abs(way[0] - other[0]) / scale).max() < _LIKE for other in ways)
            if known or bend(way[0]) > _HOPELESS * least:
                continue
            way = smoothed(*way)
            largest = (np.abs(np.diff(way[0], axis=0)) / scale).max()
            known = any((np.abs(way[0] - other[0]) / scale).max() < _SAME for other in ways)
            if largest <= LARGE_STEP and not known:
                ways.append(way)
                met.append(way[0])
                least = min(least, bend(way[0]))
    return ways


def _ends(search: LayeredSearch, u: NDArray[np.float64]) -> list[int]:
    """Return solutions (m, n) of the last layer that paths lead to, far from each other; the best path's first."""
    through = np.flatnonzero(search.cost[:, 0] == 0)
    if not len(through):
        return []
    chosen = [int(search.cost[through, 2].argmin())]
    distance = np.full(len(through), np.inf)
    while len(chosen) < min(_ENDS, len(through)):
        distance = np.minimum(distance, np.abs(u[through] - u[through[chosen[-1]]]).max(axis=1))
        chosen.append(int(distance.argmax()))
    return through[chosen].tolist()
