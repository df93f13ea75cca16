"""The graph strategy: the whole path at once, over samples of every pose's self-motion set.

1. Solutions of all knots are sampled, block by block (:mod:`qparm.planning.sampling`).
2. Dynamic programming finds the path with the fewest reconfigurations inside rows, then the least time spent
   in reconfigurations, then the smallest largest step (:mod:`qparm.planning.layered`).
3. The search is run again among paths beside the one that was found, until nothing improves
   (:mod:`qparm.planning.refine`).
4. Rows that are still broken are followed from both sides (:mod:`qparm.planning.continuation`).
5. Other ways through the rows are looked for, in case they are smoother (:mod:`qparm.planning.row_classes`).

Where reconfigurations remain, the sampling is made twice as dense, and if that gains something, four times; the counts
are reported. Zero is proven to be the least; more than that is what was found.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from qparm.ik.relaxed_bound import relaxed_excess
from qparm.path.relaxation import EXACT, Relaxation
from qparm.planning.continuation import joined_rows
from qparm.planning.continuity import LARGE_STEP, edge_is_continuous
from qparm.planning.jump import jumps_between
from qparm.planning.knot_samples import KnotSamples
from qparm.planning.layered import FORCED, INSIDE, ROW_END, LayeredSearch
from qparm.planning.projection import project, search_scale, velocity_scale
from qparm.planning.refine import refine
from qparm.planning.row_classes import other_ways, rows_of
from qparm.planning.row_ways import spread_paths
from qparm.planning.sampling import Layer, Sampling
from qparm.planning.solution import PathSolution, at_knots, driven_edges, fill, knots, reconfigurations, row_end
from qparm.robot.limits import QUINTIC_PEAKS
from qparm.robot.reach import reach_excess

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.path import ToolPath
    from qparm.robot import SerialChain

__all__ = ["GraphRecord", "SearchCount", "graph", "graph_relaxed"]

_TOLERANCE = 1e-7
# After a step that is no motion, steps are held to this share of it.
_SHORTER = 0.9
# Denser samples gain something if they save a reconfiguration, or this share of the seconds of all remains at most.
_GAIN = 0.9
# So often at most: what cannot be driven then is a break, until a way along the row is found.
_SHORTENINGS = 8


@dataclass(frozen=True)
class SearchCount:
    """What one density of sampling led to.

    Attributes
    ----------
    density : int
        Times the first sampling's.
    samples : int
        Solutions kept, over all knots.
    inside, row_ends : int
        Reconfigurations of the best path among them, as it would be driven.
    seconds : float
        Spent in reconfigurations and over points not reached, from rest to rest.
    """

    density: int
    samples: int
    inside: int
    row_ends: int
    seconds: float


@dataclass(frozen=True, eq=False)
class GraphRecord:
    """How the graph search went.

    Attributes
    ----------
    knots : int
        Poses searched.
    counts : tuple of SearchCount
        One for each density that was tried.
    inside, row_ends : int
        Reconfigurations that remain.
    proven : bool
        Whether no path has fewer reconfigurations, inside rows and at row ends: every point is reached and there are
        none.
    largest_steps : tuple of float
        Largest velocity-scaled step after the search and after each round of refinement (rad).
    """

    knots: int
    counts: tuple[SearchCount, ...]
    inside: int
    row_ends: int
    proven: bool
    largest_steps: tuple[float, ...]


def graph(
    chain: SerialChain,
    tool_path: ToolPath,
    *,
    jump: NDArray[np.float64],
    position_tolerance: float,
    rotation_tolerance: float,
    seed: int = 0,
    relaxation: Relaxation = EXACT,
    sampling: Sampling | None = None,
    beside: PathSolution | None = None,
    threads: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[tuple[PathSolution, ...], GraphRecord]:
    """Choose a configuration for every point of a tool path.

    With a tool that is free to spin or tilt, see :func:`graph_relaxed`.

    Parameters
    ----------
    chain : SerialChain
    tool_path : ToolPath
    jump : (P - 1, n) ndarray
        A larger step between neighbouring points is a reconfiguration (m, rad): the criteria of
        :func:`qparm.planning.jump.jump_criteria`, without its first line.
    position_tolerance, rotation_tolerance : float
        To which the points are solved (m, rad).
    seed : int
        Of every random draw; the answer does not depend on the number of threads.
    relaxation : Relaxation
        Which rotations of the tool are free.
    sampling : Sampling, optional
    beside : PathSolution, optional
        Of all points: a path that is known. No path with more reconfigurations is found among the samples.
    threads : int, optional
        All cores by default.
    progress : callable, optional
        ``progress(done, total)`` in points.

    Returns
    -------
    solutions : tuple of PathSolution
        The path with the least cost; and, where there may be a smoother one, another to be smoothed beside it.
    record : GraphRecord
    """
    at = knots(chain, tool_path)
    jump_at, ends = jumps_between(jump, at), _knot_row_ends(tool_path, at)
    first = sampling or Sampling.of_dimension(chain.n + relaxation.freedom - 6)
    best: tuple[PathSolution, NDArray[np.float64], KnotSamples] | None = None
    least = (np.inf, np.inf)
    counts: list[SearchCount] = []
    for density in (1, 2, 4):
        samples = KnotSamples(
            chain, tool_path.poses[at], tool_path.row_of_point[at], seed, relaxation, first.finer(density),
            None if beside is None else at_knots(beside, at),
        )  # fmt: skip
        found, limit = _driven_path(
            chain, tool_path, at, samples, jump_at, ends, relaxation, threads, progress if density == 1 else None
        )
        inside, at_ends = reconfigurations(found, ends)
        seconds = _seconds(chain, found)
        counts.append(SearchCount(density, samples.count, inside, at_ends, seconds))
        gained = inside < least[0] or (inside == least[0] and seconds < _GAIN * least[1])
        if best is None or (inside, seconds) < least:
            least, best = (inside, seconds), (found, limit, samples)
        # where twice as many gain nothing, four times as many hardly will
        if inside + at_ends == 0 or not gained:
            break
        if not at_ends and not _open(chain, tool_path, at, found, ends, relaxation):
            break
    assert best is not None
    sampled, limit, samples = best
    layers, rows = samples.layers, rows_of(tool_path, at)
    # the bundle is searched on one core: meanwhile the rows are, for other ways through them, on the others
    with ThreadPoolExecutor(max(1, (threads or os.cpu_count() or 1) - 1)) as pool:
        spread = []
        if layers is not None:
            limits = [jump_at[part.start : part.stop - 1] for part in rows]
            spread = [pool.submit(spread_paths, chain, layers[p], j) for p, j in zip(rows, limits, strict=True)]
        refined, largest = _refined(chain, tool_path, at, sampled, limit, ends, relaxation, seed, threads)
    refined = _mended(chain, tool_path, at, refined, relaxation)
    refined = joined_rows(chain, tool_path, refined, ends, relaxation=relaxation, at=at)
    if _rank(chain, sampled, ends) < _rank(chain, refined, ends):
        refined = sampled
    found = [refined]
    if layers is not None:
        others = other_ways(
            chain, tool_path, at, [one.result() for one in spread], refined, jump=jump_at, ends=ends,
            relaxation=relaxation, threads=threads,
        )  # fmt: skip
        # the row ends between ways of another kind must be followable too
        found += [other for other in others if not len(_torn(chain, tool_path, at, other, relaxation))]
    whole = tuple(
        fill(
            chain, tool_path, at, solution, jump=jump, relaxation=relaxation,
            position_tolerance=position_tolerance, rotation_tolerance=rotation_tolerance,
        )
        for solution in found
    )  # fmt: skip
    inside, at_ends = whole[0].reconfigurations(tool_path)
    proven = bool(whole[0].reached.all()) and inside + at_ends == 0
    return whole, GraphRecord(len(at), tuple(counts), inside, at_ends, proven, tuple(largest))


def _driven_path(
    chain: SerialChain,
    tool_path: ToolPath,
    at: NDArray[np.int64],
    samples: KnotSamples,
    jump: NDArray[np.float64],
    ends: NDArray[np.bool_],
    relaxation: Relaxation,
    threads: int | None,
    progress: Callable[[int, int], None] | None,
) -> tuple[PathSolution, NDArray[np.float64]]:
    """Return the best path through the samples that can be driven, and the limits of its steps."""
    limit = jump
    found = _search(chain, tool_path, at, samples, limit, ends, relaxation, threads, progress)
    for _ in range(_SHORTENINGS):
        torn = _torn(chain, tool_path, at, found, relaxation)
        if not torn:
            break
        limit = _shortened(limit, torn, ends, search_scale(chain))
        found = _search(chain, tool_path, at, samples, limit, ends, relaxation, threads, progress)
    found = _mended(chain, tool_path, at, found, relaxation)
    return joined_rows(chain, tool_path, found, ends, relaxation=relaxation, at=at, layers=samples.layers), limit


def _rank(chain: SerialChain, solution: PathSolution, ends: NDArray[np.bool_]) -> tuple[float, ...]:
    return reconfigurations(solution, ends)[0], _seconds(chain, solution)


def _seconds(chain: SerialChain, solution: PathSolution) -> float:
    """Return the time from rest to rest of all motions from one piece that is driven to the next (s)."""
    there = np.flatnonzero(solution.reached)
    driven = (np.diff(there) == 1) & solution.driven[there[:-1]]
    step = np.abs(np.diff(solution.q[there], axis=0))[~driven]
    turning = chain.continuous
    step[:, turning] = np.abs(np.remainder(step[:, turning] + np.pi, 2 * np.pi) - np.pi)
    v, a, j = QUINTIC_PEAKS
    times = [v * step / chain.velocity, np.sqrt(a * step / chain.acceleration), np.cbrt(j * step / chain.jerk)]
    return float(np.max(times, axis=(0, 2), initial=0.0).sum())


def _open(
    chain: SerialChain,
    tool_path: ToolPath,
    at: NDArray[np.int64],
    solution: PathSolution,
    ends: NDArray[np.bool_],
    relaxation: Relaxation,
) -> bool:
    """Return whether a row is broken that is within reach, for all that can be proved, from end to end."""
    lost = np.flatnonzero(~solution.reached)
    poses = tool_path.poses[at[lost]]
    too_far, too_near = relaxed_excess(chain, poses, relaxation) if relaxation.free else reach_excess(chain, poses)
    row = tool_path.row_of_point[at]
    hopeless = row[lost[(too_far > 0) | (too_near > 0)]]
    broken = row[:-1][solution.reached[:-1] & solution.reached[1:] & ~solution.driven & ~ends]
    return bool(np.setdiff1d(broken, hopeless).size)


def graph_relaxed(
    chain: SerialChain, tool_path: ToolPath, *, relaxation: Relaxation, **options: Any
) -> tuple[tuple[PathSolution, ...], GraphRecord]:
    """Choose a configuration for every point of a tool path whose tool may be free to spin or tilt.

    Freedom must not make a path worse, and a search among samples of a larger set may miss what a smaller one has.
    So the path with the tool fixed is found first, takes part in the search of the larger set, and is one of the
    paths returned.

    Parameters
    ----------
    chain, tool_path, relaxation, options
        See :func:`graph`.

    Returns
    -------
    solutions : tuple of PathSolution
        The one with the fewest points unreached and the fewest reconfigurations first.
    record : GraphRecord
    """
    if not relaxation.free:
        return graph(chain, tool_path, **options)
    quiet: dict[str, Any] = options | {"progress": None}
    fixed, fixed_record = graph(chain, tool_path, **quiet)
    found, record = graph(chain, tool_path, relaxation=relaxation, beside=fixed[0], **options)

    def rank(solution: PathSolution) -> tuple[int, ...]:
        return (-int(solution.reached.sum()), *solution.reconfigurations(tool_path))

    if rank(fixed[0]) < rank(found[0]):
        return (*fixed, *found), fixed_record
    return (*found, fixed[0]), record


def _search(
    chain: SerialChain,
    tool_path: ToolPath,
    at: NDArray[np.int64],
    samples: KnotSamples,
    jump: NDArray[np.float64],
    ends: NDArray[np.bool_],
    relaxation: Relaxation,
    threads: int | None,
    progress: Callable[[int, int], None] | None,
) -> PathSolution:
    """Return the best path through the samples."""
    poses = tool_path.poses[at]
    search = LayeredSearch(chain, velocity_scale(chain))
    there: list[int] = []
    blocks = samples.blocks
    workers = min(threads or os.cpu_count() or 1, len(blocks))
    with ThreadPoolExecutor(workers) as pool:
        # a few blocks ahead of the search, so that layers do not pile up
        ahead = 2 * workers
        waiting = {index: pool.submit(samples.draw, index) for index in range(min(ahead, len(blocks)))}
        for index, (first, last) in enumerate(blocks):
            layers = waiting.pop(index).result()
            samples.keep(index, layers)
            if index + ahead < len(blocks):
                waiting[index + ahead] = pool.submit(samples.draw, index + ahead)
            for k, layer in zip(range(first, last), layers, strict=True):
                if not len(layer.q):
                    continue
                if k == first and there and there[-1] == k - 1:
                    layer = _with_neighbours(chain, poses[k], layer, search.last, relaxation)
                gap = bool(there) and there[-1] != k - 1
                kind = FORCED if gap else ROW_END if k > 0 and ends[k - 1] else INSIDE
                search.add(layer, kind, jump[max(k - 1, 0)])
                there.append(k)
            search.prune()
            if progress is not None:
                progress(int(at[last - 1]) + 1, tool_path.point_count)
    K, n = len(at), chain.n
    q, rho, reached = np.zeros((K, n)), np.zeros((K, 3)), np.zeros(K, dtype=bool)
    if there:
        q[there], found, _ = search.path()
        rho[there] = relaxation.unwound(found)
        reached[there] = True
    return PathSolution(q, rho, reached, driven_edges(q, reached, jump))


def _torn(
    chain: SerialChain, tool_path: ToolPath, at: NDArray[np.int64], solution: PathSolution, relaxation: Relaxation
) -> list[tuple[int, float]]:
    """Return the driven edges that cannot be followed, with their scaled steps."""
    step = (np.abs(np.diff(solution.q, axis=0)) / search_scale(chain)).max(axis=1)
    large = np.flatnonzero(solution.driven & (step > LARGE_STEP))
    return [
        (int(k), float(step[k]))
        for k in large
        if not edge_is_continuous(chain, tool_path, solution, int(k), relaxation, at=at)
    ]


def _shortened(
    limit: NDArray[np.float64],
    torn: list[tuple[int, float]],
    ends: NDArray[np.bool_],
    scale: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return limits (K - 1, n) by which no torn edge is driven again.

    A step between two pieces of a self-motion set is no motion, however short: inside the rows none as long is taken.
    Every row end has a length of its own, and a limit.
    """
    limit = limit.copy()
    inside = min((step for k, step in torn if not ends[k]), default=np.inf)
    limit[~ends] = np.minimum(limit[~ends], _SHORTER * inside * scale)
    for k, step in torn:
        if ends[k]:
            limit[k] = np.minimum(limit[k], _SHORTER * step * scale)
    return limit


def _refined(
    chain: SerialChain,
    tool_path: ToolPath,
    at: NDArray[np.int64],
    found: PathSolution,
    limit: NDArray[np.float64],
    ends: NDArray[np.bool_],
    relaxation: Relaxation,
    seed: int,
    threads: int | None,
) -> tuple[PathSolution, list[float]]:
    """Return the path refined, all of its driven edges such that they can be followed; else as it was found."""
    scale = search_scale(chain)
    driven = np.flatnonzero(found.driven)
    while (np.abs(np.diff(found.q, axis=0))[driven] <= limit[driven]).all():
        rng = np.random.default_rng([seed, 1])
        refined, largest = refine(chain, tool_path.poses[at], found, limit, ends, relaxation, rng, threads=threads)
        torn = _torn(chain, tool_path, at, refined, relaxation)
        if not torn:
            return refined, largest
        limit = _shortened(limit, torn, ends, scale)
    return found, []


def _mended(
    chain: SerialChain,
    tool_path: ToolPath,
    at: NDArray[np.int64],
    solution: PathSolution,
    relaxation: Relaxation,
) -> PathSolution:
    """Return the solution with every edge driven that can be, and none that cannot."""
    driven = solution.driven.copy()
    driven[[k for k, _ in _torn(chain, tool_path, at, solution, relaxation)]] = False
    for k in np.flatnonzero(solution.reached[:-1] & solution.reached[1:] & ~driven):
        driven[k] = edge_is_continuous(chain, tool_path, solution, int(k), relaxation, at=at)
    return PathSolution(solution.q, solution.rho, solution.reached, driven)


def _knot_row_ends(tool_path: ToolPath, at: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return which edges between knots lie in self-motion areas."""
    edges = row_end(tool_path)
    inside = np.concatenate([[0], np.cumsum(~edges)])
    return inside[at[1:]] == inside[at[:-1]]


def _with_neighbours(
    chain: SerialChain, pose: NDArray[np.float64], layer: Layer, previous: Layer | None, relaxation: Relaxation
) -> Layer:
    """Return a layer with the previous one's solutions moved onto its pose, so that a block joins the one before."""
    assert previous is not None
    targets = np.broadcast_to(pose, (1, 4, 4))
    moved, there = project(
        chain, targets, previous.q[None], position_tolerance=_TOLERANCE, rotation_tolerance=_TOLERANCE,
        offsets=relaxation.rotations(previous.rho), iterations=20,
    )  # fmt: skip
    there = there[0]
    return Layer(np.concatenate([moved[0][there], layer.q]), np.concatenate([previous.rho[there], layer.rho]))
