"""A path becomes a bundle of paths beside it, and the search is run again among them, until nothing improves.

Each path of a bundle is displaced by the same amount all along, so that a whole path can be taken as it is; between
them the search may change wherever that is shorter.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from qparm.path.relaxation import Relaxation
from qparm.planning.search.layered import FORCED, INSIDE, ROW_END, LayeredSearch
from qparm.planning.search.projection import project, velocity_scale
from qparm.planning.search.sampling import Layer
from qparm.planning.solution import PathSolution, driven_edges
from qparm.planning.tolerances import SEARCH_POSE

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.robot import SerialChain

__all__ = ["refine"]

_COPIES = 40
_WIDEST, _NARROWEST = np.radians(32.0), np.radians(4.0)
_ROUNDS = 40
# A round that lowers the largest step by less than this share counts as no gain, and the bundle gets narrower.
_GAIN, _NARROWER = 0.03, 0.5


def refine(
    chain: SerialChain,
    poses: NDArray[np.float64],
    solution: PathSolution,
    jump: NDArray[np.float64],
    ends: NDArray[np.bool_],
    relaxation: Relaxation,
    rng: np.random.Generator,
    *,
    copies: int = _COPIES,
    rounds: int = _ROUNDS,
    threads: int | None = None,
) -> tuple[PathSolution, list[float]]:
    """Search again among displaced copies of a path until nothing improves.

    Parameters
    ----------
    chain : SerialChain
    poses : (K, 4, 4) ndarray
        Of the knots, base frame.
    solution : PathSolution
        Of the knots.
    jump : (K - 1, n) ndarray
        Of the edges between knots (m, rad).
    ends : (K - 1,) ndarray of bool
        Which edges are row ends.
    relaxation : Relaxation
    rng : numpy.random.Generator
    copies, rounds : int
        Paths in a bundle, and bundles at most.
    threads : int, optional
        All cores by default; the answer does not depend on it.

    Returns
    -------
    solution : PathSolution
    largest_steps : list of float
        The largest velocity-scaled step before, and after each round (rad).
    """
    there = np.flatnonzero(solution.reached)
    if len(there) < 2:
        return solution, []
    poses = poses[there]
    kinds = [FORCED if b != a + 1 else ROW_END if ends[a] else INSIDE for a, b in pairwise(there.tolist())]
    scale, limits = velocity_scale(chain), jump[there[:-1]]
    q, rho = solution.q[there], solution.rho[there]
    widths = np.geomspace(1.0, 0.05, copies)[:, None]
    width = _WIDEST
    _, _, cost = _best(chain, [Layer(q[k : k + 1], rho[k : k + 1]) for k in range(len(q))], kinds, limits)
    largest = [cost[2]]
    for _ in range(rounds):
        shift = rng.standard_normal((copies, chain.n)) * scale * width * widths
        lean = rng.standard_normal((copies, 3)) * width * widths
        beside = np.concatenate([q[:, None], q[:, None] + shift], axis=1)
        leaning = relaxation.clipped(np.concatenate([rho[:, None], rho[:, None] + lean], axis=1), inner=True)
        beside, arrived = project(
            chain, poses, np.clip(beside, chain.lower, chain.upper),
            position_tolerance=SEARCH_POSE, rotation_tolerance=SEARCH_POSE, threads=threads,
            offsets=relaxation.rotations(leaning.reshape(-1, 3)) if relaxation.free else None,
        )  # fmt: skip
        arrived[:, 0] = True
        beside[:, 0] = q
        layers = [Layer(beside[k][arrived[k]], leaning[k][arrived[k]]) for k in range(len(q))]
        # first the least largest step, then the shortest way that keeps it
        _, _, least = _best(chain, layers, kinds, limits)
        q, rho, _ = _best(chain, layers, kinds, limits, cap=least[2] * (1 + 1e-9))
        gain, fewer = cost[2] - least[2], least[:2] < cost[:2]
        cost = least
        largest.append(cost[2])
        if not fewer and gain <= _GAIN * cost[2]:
            if width < _NARROWEST:
                break
            width *= _NARROWER
    refined = PathSolution(np.zeros_like(solution.q), np.zeros_like(solution.rho), solution.reached, solution.driven)
    refined.q[there], refined.rho[there] = q, relaxation.unwound(rho)
    return replace(refined, driven=driven_edges(refined.q, solution.reached, jump)), largest


def _best(
    chain: SerialChain,
    layers: list[Layer],
    kinds: list[int],
    limits: NDArray[np.float64],
    *,
    cap: float = np.inf,
) -> tuple[NDArray[np.float64], NDArray[np.float64], tuple[int, float, float, float]]:
    """Return the best path through layers, its tool parameters and its cost."""
    search = LayeredSearch(chain, velocity_scale(chain), cap=cap)
    search.add(layers[0], FORCED, limits[0])
    for layer, kind, limit in zip(layers[1:], kinds, limits, strict=True):
        search.add(layer, kind, limit)
    return search.path()
