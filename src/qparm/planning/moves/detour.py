"""From one lifted configuration to another: directly, or over others drawn at random."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from qparm.planning.moves.clearance import Distance, stays_clear
from qparm.planning.moves.escape import Escape
from qparm.robot.limits import rest_to_rest_time

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.robot import SerialChain

__all__ = ["Way", "connect"]

# Ways around: how many configurations are drawn at first, how often four times as many, and how many of the shortest
# ways are checked each time before it is given up: where there is none yet, and where there is one to be improved.
_FIRST, _ROUNDS, _MOST_CHECKS, _CHECKS_TO_IMPROVE = 48, 3, 400, 60
# Half of the configurations are drawn around the line between two ends, this far off (share of the joint ranges).
_SPREAD = 0.15
# A free end takes no time to leave, but what takes less than 1e-8 s counts as no line at all in SciPy's graphs.
_NO_TIME = 1e-6


@dataclass(frozen=True, eq=False)
class Way:
    """How to go from the surface to the surface.

    Attributes
    ----------
    leave, arrive : Escape
        The latter to be passed backwards.
    via : tuple of (n,) ndarray
        Configurations between them, each reached by a straight line in joint space (m, rad).
    """

    leave: Escape
    via: tuple[NDArray[np.float64], ...]
    arrive: Escape


def connect(
    chain: SerialChain,
    leaves: list[Escape],
    arrivals: list[Escape],
    *,
    distance: Distance | None,
    clearance: float,
    rng: np.random.Generator,
) -> Way | None:
    """Return the quickest way found between two sets of lifted configurations, None if there is none.

    Parameters
    ----------
    chain : SerialChain
    leaves, arrivals : list of Escape
        Not empty.
    distance : Distance or None
        See :func:`qparm.planning.plan_motion`; None: nothing is checked.
    clearance : float
        m.
    rng : numpy.random.Generator
    """
    A, B = np.stack([way.q for way in leaves]), np.stack([way.q for way in arrivals])
    off, on = np.array([way.time for way in leaves]), np.array([way.time for way in arrivals])
    total = off[:, None] + rest_to_rest_time(chain, A[:, None], B[None]) + on
    known: dict[tuple[int, int], bool] = {}
    direct, time = None, np.inf
    for k in np.argsort(total, axis=None, kind="stable").tolist():
        i, j = divmod(k, len(B))
        clear = distance is None or stays_clear(A[i], B[j], distance=distance, least=clearance)
        known[i, len(A) + j] = clear
        if clear:
            direct, time = Way(leaves[i], (), arrivals[j]), float(total[i, j])
            break
    if distance is None or time <= total.min():  # nothing can be quicker
        return direct
    nodes = np.concatenate([A, B])
    for count in _FIRST * 4 ** np.arange(1 if direct else _ROUNDS):
        drawn = _drawn(chain, A, B, int(count), rng)
        nodes = np.concatenate([nodes, drawn[distance(drawn) >= clearance]])
        path = _shortest(chain, nodes, off, on, known, distance, clearance, slower_than=time)
        if path is not None:
            return Way(leaves[path[0]], tuple(nodes[k] for k in path[1:-1]), arrivals[path[-1] - len(A)])
    return direct


def _drawn(
    chain: SerialChain, A: NDArray[np.float64], B: NDArray[np.float64], count: int, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Return (count, n) configurations: half around lines between ends, half anywhere within the limits."""
    near = count // 2
    a, b = A[rng.integers(len(A), size=near)], B[rng.integers(len(B), size=near)]
    spread = _SPREAD * np.diff(chain.one_turn, axis=0) * rng.standard_normal((near, chain.n))
    around = np.clip(a + rng.random((near, 1)) * (b - a) + spread, chain.lower, chain.upper)
    return np.concatenate([around, chain.random(rng, count - near)])


def _shortest(
    chain: SerialChain,
    nodes: NDArray[np.float64],
    off: NDArray[np.float64],
    on: NDArray[np.float64],
    known: dict[tuple[int, int], bool],
    distance: Distance,
    clearance: float,
    *,
    slower_than: float,
) -> list[int] | None:
    """Return the quickest chain of nodes from a leaving end to an arriving one, checking lines only as needed.

    ``nodes`` are the leaving ends, the arriving ends, then others; ``known`` holds verdicts on lines and is added to.
    None as well if there is one, but none that takes less than ``slower_than`` (s).
    """
    from scipy.sparse.csgraph import dijkstra

    N, a, b = len(nodes), len(off), len(on)
    # two more nodes, the surface at either end, whose lines are the ways off and on
    cost = np.full((N + 2, N + 2), np.inf)
    cost[:N, :N] = rest_to_rest_time(chain, nodes[:, None], nodes[None])
    cost[:N, :a] = np.inf
    cost[a : a + b, :N] = np.inf
    cost[N, :a], cost[a : a + b, N + 1] = off + _NO_TIME, on + _NO_TIME
    for (i, j), clear in known.items():
        if not clear:
            cost[i, j] = cost[j, i] = np.inf
    for _ in range(_MOST_CHECKS if np.isinf(slower_than) else _CHECKS_TO_IMPROVE):
        length, before = dijkstra(cost, indices=N, return_predecessors=True)
        if not length[N + 1] < slower_than:
            return None
        path = [N + 1]
        while path[-1] != N:
            path.append(int(before[path[-1]]))
        path = path[-2:0:-1]
        blocked = False
        for i, j in pairwise(path):
            if (i, j) not in known:
                known[i, j] = known[j, i] = stays_clear(nodes[i], nodes[j], distance=distance, least=clearance)
            if not known[i, j]:
                cost[i, j] = cost[j, i] = np.inf
                blocked = True
        if not blocked:
            return path
    return None
