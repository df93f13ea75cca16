"""Candidates: where a swarm around the best designs might go, far more of them than will be evaluated."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from qparm.design.engines.sobol import sobol_points

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["candidates", "steps_around"]

# Shares of candidates of which some coordinates are put on a bound: good designs are often there.
_ON_BOUNDS = 0.3


def candidates(best: NDArray[np.float64], count: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return candidates within [0, 1]: a third over the whole range, a third steps around the best, a third moves.

    A move goes from one of the best along the way between two others, half of them far beyond (as a swarm with
    momentum does).

    Parameters
    ----------
    best : ndarray, shape (k, d)
    count : int

    Returns
    -------
    ndarray, shape (about count, d)
    """
    third, d = count // 3, best.shape[1]
    around = steps_around(best, third, rng, least=-2.3, most=-0.5)
    one, two, three = (best[rng.integers(len(best), size=third)] for _ in range(3))
    far = np.where(rng.random((third, 1)) < 0.5, rng.uniform(0.2, 1.2, (third, 1)), rng.uniform(1.0, 4.0, (third, 1)))
    moves = one + far * (two - three) + 0.01 * rng.standard_normal((third, d))
    U = np.clip(np.vstack([sobol_points(d, third, rng), around, moves]), 0.0, 1.0)
    put = (rng.random(U.shape) < rng.uniform(0.1, 0.5, (len(U), 1))) & (rng.random((len(U), 1)) < _ON_BOUNDS)
    return np.where(put, np.round(U), U)


def steps_around(
    best: NDArray[np.float64], count: int, rng: np.random.Generator, *, least: float, most: float
) -> NDArray[np.float64]:
    """Return normal steps from the best in some of the coordinates, of sizes 10^least to 10^most, (count, d)."""
    d = best.shape[1]
    steps = 10.0 ** rng.uniform(least, most, (count, 1)) * rng.standard_normal((count, d))
    steps *= rng.random((count, d)) < rng.uniform(0.3, 1.0, (count, 1))
    return np.clip(best[rng.integers(len(best), size=count)] + steps, 0.0, 1.0)
