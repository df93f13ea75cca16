"""The graph strategy: the whole path at once, over samples of every pose's self-motion set.

1. Solutions of all knots are sampled, block by block (:mod:`qparm.planning.search.sampling`).
2. Dynamic programming finds the path with the fewest reconfigurations inside rows, then the least time spent
   in reconfigurations, then the smallest largest step (:mod:`qparm.planning.search.layered`).
3. The search is run again among paths beside the one that was found, until nothing improves
   (:mod:`qparm.planning.search.refine`).
4. Rows that are still broken are followed from both sides (:mod:`qparm.planning.search.continuation`).
5. Other ways through the rows are looked for, in case they are smoother (:mod:`qparm.planning.search.row_classes`).

Where reconfigurations remain, the sampling is made twice as dense, and if that gains something, four times; the counts
are reported. Zero is proven to be the least; more than that is what was found.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from qparm.path import joint_curve
from qparm.path.relaxation import EXACT, Relaxation
from qparm.planning.paper.jump import jumps_between
from qparm.planning.search.continuation import joined_rows
from qparm.planning.search.continuity import LARGE_STEP, edge_is_continuous
from qparm.planning.search.graph_record import GraphRecord, SearchCount
from qparm.planning.search.knot_samples import KnotSamples
from qparm.planning.search.layered import FORCED, INSIDE, ROW_END, LayeredSearch
from qparm.planning.search.projection import project, search_scale, velocity_scale
from qparm.planning.search.refine import refine
from qparm.planning.search.row_classes import other_ways, rows_of
from qparm.planning.search.row_ways import spread_paths
from qparm.planning.search.sampling import Layer, Sampling
from qparm.planning.solution import PathSolution, at_knots, driven_edges, fill, knots, reconfigurations
from qparm.planning.tolerances import SEARCH_POSE
from qparm.reach.relaxed_bound import relaxed_excess
from qparm.robot.limits import QUINTIC_PEAKS
from qparm.robot.reach import reach_excess

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.planning.problem import PathProblem
    from qparm.robot import SerialChain

__all__ = ["graph", "graph_relaxed"]

# Configurations and the tool's parameters at the knots of a row.
Found = tuple[Any, Any]

# The first search is among knots so many times farther apart than those that are smoothed, and among so many fewer
# samples of each: what it finds unbroken is unbroken.
_APART, _FEWER = 3.0, 0.6
# After a step that is no motion, steps are held to this share of it.
_SHORTER = 0.9
# Denser samples gain something if they save a reconfiguration, or this share of the seconds of all remains at most.
_GAIN = 0.9
# So often at most: what cannot be driven then is a break, until a way along the row is found.
_SHORTENINGS = 8


@dataclass(frozen=True, eq=False)
class _Knots:
    """The poses that are searched, and how they follow each other.

    Attributes
    ----------
    problem : PathProblem
    at : (K,) ndarray of int
        Which points they are.
    ends : (K - 1,) ndarray of bool
        Which edges between them are row ends.
    jump : (K - 1, n) ndarray
        The criteria of these edges (m, rad).
    """

    problem: PathProblem
    at: NDArray[np.int64]
    ends: NDArray[np.bool_]
    jump: NDArray[np.float64]

    @classmethod
    def of(cls, problem: PathProblem, at: NDArray[np.int64]) -> _Knots:
        """Return some points of a problem as knots."""
        return cls(problem, at, _knot_row_ends(problem, at), jumps_between(problem.criteria, at))

    @property
    def poses(self) -> NDArray[np.float64]:
        return self.problem.tool_path.poses[self.at]

    @property
    def row(self) -> NDArray[np.int64]:
        return self.problem.tool_path.row_of_point[self.at]

    def is_continuous(self, solution: PathSolution, k: int) -> bool:
        """Return whether the tool can follow its path from one knot to the next."""
        return edge_is_continuous(self.problem, solution, k, at=self.at)

    def joined(self, solution: PathSolution, layers: Sequence[Layer] | None = None) -> PathSolution:
        """Return a solution without the breaks that some way along a row does without."""
        return joined_rows(self.problem, solution, at=self.at, ends=self.ends, layers=layers)


def graph(
    problem: PathProblem,
    *,
    sampling: Sampling | None = None,
    beside: PathSolution | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[tuple[PathSolution, ...], GraphRecord]:
    """Choose a configuration for every point of a tool path.

    With a tool that is free to spin or tilt, see :func:`graph_relaxed`.

    Parameters
    ----------
    problem : PathProblem
    sampling : Sampling, optional
    beside : PathSolution, optional
        Of all points: a path that is known. No path with more reconfigurations is found among the samples.
    progress : callable, optional
        ``progress(done, total)`` in points.

    Returns
    -------
    solutions : tuple of PathSolution
        The path with the least cost; and, where there may be a smoother one, another to be smoothed beside it.
    record : GraphRecord
    """
    chain, tool_path = problem.chain, problem.tool_path
    sampling = sampling or Sampling.of_dimension(chain.n + problem.relaxation.freedom - 6)
    close, apart = knots(chain, tool_path), knots(chain, tool_path, apart=_APART)
    if len(apart) < len(close):
        searched = _Knots.of(problem, apart)
        sampled = _sampled(searched, [sampling.finer(_FEWER)], beside, progress)
        if sampled.unbroken:
            found, record = _made_smoother(searched, sampled)
            if record.proven:
                return found, record
    searched = _Knots.of(problem, close)
    densities = [sampling.finer(density) for density in (1, 2, 4)]
    return _made_smoother(searched, _sampled(searched, densities, beside, progress))


@dataclass(frozen=True, eq=False)
class _Sampled:
    """The best path that was found among samples.

    Attributes
    ----------
    solution : PathSolution
        Of the knots.
    limit : (K - 1, n) ndarray
        Of its steps (m, rad).
    layers : list of Layer or None
        The samples that it was found among.
    counts : tuple of SearchCount
        One for each sampling.
    """

    solution: PathSolution
    limit: NDArray[np.float64]
    layers: list[Layer] | None
    counts: tuple[SearchCount, ...]

    @property
    def unbroken(self) -> bool:
        """Whether every knot is reached, and every edge driven."""
        return bool(self.solution.reached.all() and self.solution.driven.all())


def _sampled(
    searched: _Knots,
    samplings: Sequence[Sampling],
    beside: PathSolution | None,
    progress: Callable[[int, int], None] | None,
) -> _Sampled:
    """Return the best path among samples, which are made denser as long as that gains something."""
    problem, at, ends = searched.problem, searched.at, searched.ends
    best: _Sampled | None = None
    least = (np.inf, np.inf)
    counts: list[SearchCount] = []
    for sampling in samplings:
        samples = KnotSamples(
            problem.chain, searched.poses, searched.row, problem.seed, problem.relaxation, sampling,
            None if beside is None else at_knots(beside, at),
        )  # fmt: skip
        found, limit = _driven_path(searched, samples, progress if not counts else None)
        inside, at_ends = reconfigurations(found, ends)
        seconds = _seconds(problem.chain, found)
        counts.append(SearchCount(2 ** len(counts), samples.count, inside, at_ends, seconds))
        gained = inside < least[0] or (inside == least[0] and seconds < _GAIN * least[1])
        if best is None or (inside, seconds) < least:
            least, best = (inside, seconds), _Sampled(found, limit, samples.layers, ())
        # where twice as many gain nothing, four times as many hardly will
        if inside + at_ends == 0 or not gained:
            break
        if not at_ends and not _open(searched, found):
            break
    assert best is not None
    return replace(best, counts=tuple(counts))


def _made_smoother(searched: _Knots, sampled: _Sampled) -> tuple[tuple[PathSolution, ...], GraphRecord]:
    """Return a path refined, and others that may become smoother, at all points."""
    problem, at, layers = searched.problem, searched.at, sampled.layers
    chain, rows = problem.chain, rows_of(problem.tool_path, at)
    # the bundle is searched on one core: meanwhile the rows are, for other ways through them, on the others
    with ThreadPoolExecutor(max(1, (problem.threads or os.cpu_count() or 1) - 1)) as pool:
        spread = []
        if layers is not None:
            limits = [searched.jump[part.start : part.stop - 1] for part in rows]
            spread = [pool.submit(spread_paths, chain, layers[p], j) for p, j in zip(rows, limits, strict=True)]
        refined, largest = _refined(searched, sampled.solution, sampled.limit)
    refined = searched.joined(_mended(searched, refined))
    if _rank(searched, sampled.solution) < _rank(searched, refined):
        refined = sampled.solution
    whole = [fill(problem, at, refined)]
    if layers is not None:
        whole += _other_ways(problem, whole[0], at, [one.result() for one in spread])
    inside, at_ends = whole[0].reconfigurations(problem.tool_path)
    proven = bool(whole[0].reached.all()) and inside + at_ends == 0
    return tuple(whole), GraphRecord(len(at), sampled.counts, inside, at_ends, proven, tuple(largest))


def _other_ways(
    problem: PathProblem, solution: PathSolution, at: NDArray[np.int64], spread: Sequence[Sequence[Found]]
) -> list[PathSolution]:
    """Return solutions of all points that go other ways through the rows, and promise to be smoother.

    The ways are compared where they are going to be smoothed, which is at more points than they were searched at.
    """
    chain, tool_path = problem.chain, problem.tool_path
    close = knots(chain, tool_path)
    compared = _Knots.of(problem, close)
    s, scale = tool_path.s, velocity_scale(chain)
    paths = []
    for part, own, found in zip(rows_of(tool_path, at), rows_of(tool_path, close), spread, strict=True):
        paths.append([_between(s[at[part]], s[close[own]], scale, *one) for one in found])
    others = other_ways(
        chain, tool_path, close, paths, at_knots(solution, close), jump=compared.jump, ends=compared.ends,
        relaxation=problem.relaxation, threads=problem.threads,
    )  # fmt: skip
    # the row ends between ways of another kind must be followable too
    return [fill(problem, close, other) for other in others if not len(_torn(compared, other))]


def _between(
    s: NDArray[np.float64], at: NDArray[np.float64], scale: NDArray[np.float64], q: NDArray[np.float64],
    rho: NDArray[np.float64],
) -> Found:  # fmt: skip
    """Return a path through knots at s (K,) as its spline is at other places of the row."""
    if len(s) == len(at):
        return q, rho
    value = joint_curve(s, np.concatenate([q / scale, rho], axis=1))(at)
    return value[:, : q.shape[1]] * scale, value[:, q.shape[1] :]


def _driven_path(
    searched: _Knots,
    samples: KnotSamples,
    progress: Callable[[int, int], None] | None,
) -> tuple[PathSolution, NDArray[np.float64]]:
    """Return the best path through the samples that can be driven, and the limits of its steps."""
    limit = searched.jump
    found = _search(searched, samples, limit, progress)
    for _ in range(_SHORTENINGS):
        torn = _torn(searched, found)
        if not torn:
            break
        limit = _shortened(limit, torn, searched.ends, search_scale(searched.problem.chain))
        found = _search(searched, samples, limit, progress)
    return searched.joined(_mended(searched, found), samples.layers), limit


def _rank(searched: _Knots, solution: PathSolution) -> tuple[float, ...]:
    return reconfigurations(solution, searched.ends)[0], _seconds(searched.problem.chain, solution)


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


def _open(searched: _Knots, solution: PathSolution) -> bool:
    """Return whether a row is broken that is within reach, for all that can be proved, from end to end."""
    chain, relaxation = searched.problem.chain, searched.problem.relaxation
    lost = np.flatnonzero(~solution.reached)
    poses = searched.poses[lost]
    too_far, too_near = relaxed_excess(chain, poses, relaxation) if relaxation.free else reach_excess(chain, poses)
    row = searched.row
    hopeless = row[lost[(too_far > 0) | (too_near > 0)]]
    broken = row[:-1][solution.reached[:-1] & solution.reached[1:] & ~solution.driven & ~searched.ends]
    return bool(np.setdiff1d(broken, hopeless).size)


def graph_relaxed(
    problem: PathProblem, *, progress: Callable[[int, int], None] | None = None
) -> tuple[tuple[PathSolution, ...], GraphRecord]:
    """Choose a configuration for every point of a tool path whose tool may be free to spin or tilt.

    Freedom must not make a path worse, and a search among samples of a larger set may miss what a smaller one has.
    So the path with the tool fixed is found first, takes part in the search of the larger set, and is one of the
    paths returned.

    Parameters
    ----------
    problem : PathProblem
    progress : callable, optional
        ``progress(done, total)`` in points.

    Returns
    -------
    solutions : tuple of PathSolution
        The one with the fewest points unreached and the fewest reconfigurations first.
    record : GraphRecord
    """
    if not problem.relaxation.free:
        return graph(problem, progress=progress)
    fixed, fixed_record = graph(replace(problem, relaxation=EXACT))
    found, record = graph(problem, beside=fixed[0], progress=progress)

    def rank(solution: PathSolution) -> tuple[int, ...]:
        return (-int(solution.reached.sum()), *solution.reconfigurations(problem.tool_path))

    if rank(fixed[0]) < rank(found[0]):
        return (*fixed, *found), fixed_record
    return (*found, fixed[0]), record


def _search(
    searched: _Knots,
    samples: KnotSamples,
    jump: NDArray[np.float64],
    progress: Callable[[int, int], None] | None,
) -> PathSolution:
    """Return the best path through the samples."""
    problem, at, ends, poses = searched.problem, searched.at, searched.ends, searched.poses
    chain, relaxation = problem.chain, problem.relaxation
    search = LayeredSearch(chain, velocity_scale(chain))
    there: list[int] = []
    blocks = samples.blocks
    workers = min(problem.threads or os.cpu_count() or 1, len(blocks))
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
                progress(int(at[last - 1]) + 1, problem.tool_path.point_count)
    K, n = len(at), chain.n
    q, rho, reached = np.zeros((K, n)), np.zeros((K, 3)), np.zeros(K, dtype=bool)
    if there:
        q[there], found, _ = search.path()
        rho[there] = relaxation.unwound(found)
        reached[there] = True
    return PathSolution(q, rho, reached, driven_edges(q, reached, jump))


def _torn(searched: _Knots, solution: PathSolution) -> list[tuple[int, float]]:
    """Return the driven edges that cannot be followed, with their scaled steps."""
    step = (np.abs(np.diff(solution.q, axis=0)) / search_scale(searched.problem.chain)).max(axis=1)
    large = np.flatnonzero(solution.driven & (step > LARGE_STEP))
    return [(int(k), float(step[k])) for k in large if not searched.is_continuous(solution, int(k))]


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


def _refined(searched: _Knots, found: PathSolution, limit: NDArray[np.float64]) -> tuple[PathSolution, list[float]]:
    """Return the path refined, all of its driven edges such that they can be followed; else as it was found."""
    problem, ends = searched.problem, searched.ends
    driven = np.flatnonzero(found.driven)
    while (np.abs(np.diff(found.q, axis=0))[driven] <= limit[driven]).all():
        refined, largest = refine(
            problem.chain, searched.poses, found, limit, ends, problem.relaxation, problem.rng(1),
            threads=problem.threads,
        )  # fmt: skip
        torn = _torn(searched, refined)
        if not torn:
            return refined, largest
        limit = _shortened(limit, torn, ends, search_scale(problem.chain))
    return found, []


def _mended(searched: _Knots, solution: PathSolution) -> PathSolution:
    """Return the solution with every edge driven that can be, and none that cannot."""
    driven = solution.driven.copy()
    driven[[k for k, _ in _torn(searched, solution)]] = False
    for k in np.flatnonzero(solution.reached[:-1] & solution.reached[1:] & ~driven):
        driven[k] = searched.is_continuous(solution, int(k))
    return PathSolution(solution.q, solution.rho, solution.reached, driven)


def _knot_row_ends(problem: PathProblem, at: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return which edges between knots lie in self-motion areas."""
    edges = problem.row_ends
    inside = np.concatenate([[0], np.cumsum(~edges)])
    return inside[at[1:]] == inside[at[:-1]]


def _with_neighbours(
    chain: SerialChain, pose: NDArray[np.float64], layer: Layer, previous: Layer | None, relaxation: Relaxation
) -> Layer:
    """Return a layer with the previous one's solutions moved onto its pose, so that a block joins the one before."""
    assert previous is not None
    targets = np.broadcast_to(pose, (1, 4, 4))
    moved, there = project(
        chain, targets, previous.q[None], position_tolerance=SEARCH_POSE, rotation_tolerance=SEARCH_POSE,
        offsets=relaxation.rotations(previous.rho), iterations=20,
    )  # fmt: skip
    there = there[0]
    return Layer(np.concatenate([moved[0][there], layer.q]), np.concatenate([previous.rho[there], layer.rho]))
