"""The region that an arm reaches: which points its tool gets to, in any orientation.

A point is asked for, not hit by chance: random configurations crowd where the arm folds and hardly ever stretch, so a
cloud of them shows the region's middle and not its rim. Here the points of a lattice are posed to the arm with three
more axes through the tool's origin, which take any orientation, and are found as any poses are: proof, growth from
neighbours, restarts (:func:`qparm.reach.reach_of_designs`). The share of a lattice that is reached estimates a volume
without bias.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from qparm.errors import InvalidInput
from qparm.reach.many_arms import reach_of_designs
from qparm.reach.verdict import with_free_orientation

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from qparm.robot import SerialChain

__all__ = ["lattice", "reach_box", "reaches_points"]

# How near counts (m): pictures and volumes need no microns.
_TOLERANCE = 1e-4


def reaches_points(
    chain: SerialChain, points: ArrayLike, *, restarts: int = 3, seed: int = 0, threads: int | None = None
) -> NDArray[np.bool_]:
    """Return which points the tool's origin reaches in some orientation, within the position limits.

    Parameters
    ----------
    chain : SerialChain
    points : (N, 3) array_like
        In the base frame (m). Points near each other help each other: hand over a lattice as a whole.
    restarts : int
        Starts that a point gets besides its neighbours' configurations, before it counts as not reached.
    seed : int
        Of the random configurations that the starts are taken from.
    threads : int, optional
        All cores by default; the answer does not depend on it.

    Returns
    -------
    (N,) ndarray of bool

    Raises
    ------
    InvalidInput
        If the shape does not fit or a value is not finite.
    """
    points = np.asarray(points, dtype=float)
    if points.ndim != 2 or points.shape[1] != 3:
        raise InvalidInput(f"points must be (N, 3), not {points.shape}")
    poses = np.tile(np.eye(4), (len(points), 1, 1))
    poses[:, :3, 3] = points
    found = reach_of_designs(
        [with_free_orientation(chain)],
        poses,
        position_tolerance=_TOLERANCE,
        rotation_tolerance=_TOLERANCE,
        restarts=restarts,
        seed=seed,
        threads=threads,
    )
    return found.reached[0]


def reach_box(chain: SerialChain) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the corners of a box that holds every point the tool reaches, lower and upper, (3,) each (m).

    Of the proved bound: the tool's origin is within the greatest reach of the first revolute axis, wherever the leading
    prismatic joints take it.
    """
    free = with_free_orientation(chain)
    bound = free.reach_bound
    assert bound is not None  # three revolute axes at least
    ends = np.array([np.minimum(*(bound.travel_axes * t for t in bound.travel.T)).sum(axis=1),
                     np.maximum(*(bound.travel_axes * t for t in bound.travel.T)).sum(axis=1)])  # fmt: skip
    return bound.shoulder + ends[0] - bound.reach, bound.shoulder + ends[1] + bound.reach


def lattice(
    lower: NDArray[np.float64], upper: NDArray[np.float64], spacing: float
) -> tuple[NDArray[np.float64], tuple[int, ...]]:
    """Return the points of a cubic lattice that fills a box, (N, 3), and how many it has along each axis.

    An axis whose lower and upper are the same has one: a slice.
    """
    counts = np.maximum(np.ceil((upper - lower) / spacing).astype(int), 1)
    middle = 0.5 * (lower + upper)
    axes = [m + spacing * (np.arange(count) - 0.5 * (count - 1)) for m, count in zip(middle, counts, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3), tuple(counts.tolist())
