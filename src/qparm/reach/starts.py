"""Starts of the search for many poses: the nearest of a bank of random configurations, and neighbouring poses."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from qparm.compiled.kernels import c3, f8, kernel, kernel_helper, oi2, void
from qparm.ik.relaxed import nearest_parameters

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.robot import SerialChain

__all__ = ["BANK", "nearest_of_bank", "nearest_of_relaxed_bank", "nearest_poses", "nearest_starts"]

# Random configurations of which each pose takes the nearest as its starts.
BANK = 4096
# Poses that count as a pose's neighbours.
_NEIGHBOURS = 8


@kernel_helper
def nearest_of_bank(target, bank_poses, length, distance, out):
    """Write the indices of the bank's nearest poses, nearest first."""
    B = bank_poses.shape[0]
    for b in range(B):
        square = 0.0
        trace = 0.0
        for a in range(3):
            t = (bank_poses[b, a, 3] - target[a, 3]) / length
            square += t * t
            for c in range(3):
                trace += bank_poses[b, a, c] * target[a, c]
        # the chordal distance of rotations: 2 (1 - cos) is angle^2 for small angles
        distance[b] = square + (3.0 - trace)
    _take_least(distance, out)


@kernel_helper
def nearest_of_relaxed_bank(target, bank_poses, cone, length, distance, out):
    """Write the indices of the bank's poses that are nearest when the tool turns as ``cone`` allows, nearest first."""
    rho = np.empty(3)
    for b in range(bank_poses.shape[0]):
        square = nearest_parameters(target, bank_poses[b], cone, rho) ** 2
        for a in range(3):
            square += ((bank_poses[b, a, 3] - target[a, 3]) / length) ** 2
        distance[b] = square
    _take_least(distance, out)


@kernel_helper
def _take_least(distance, out):
    """Write the indices of the least distances, least first; they count as infinite then."""
    for r in range(out.shape[0]):
        best = 0
        for b in range(distance.shape[0]):
            if distance[b] < distance[best]:
                best = b
        out[r] = best
        distance[best] = math.inf


@kernel(void(c3, c3, f8, oi2))
def nearest_starts_kernel(targets, bank_poses, length, out):
    """Write the indices of each target's nearest bank poses (N, K), nearest first."""
    distance = np.empty(bank_poses.shape[0])
    for k in range(targets.shape[0]):
        nearest_of_bank(targets[k], bank_poses, length, distance, out[k])


def nearest_starts(chain: SerialChain, poses: NDArray[np.float64], count: int, *, seed: int) -> NDArray[np.float64]:
    """Return the starts of each pose, (P, count, n): of a bank of random configurations those nearest to it."""
    bank = chain.random(np.random.default_rng([seed, chain.n]), BANK)
    nearest = np.empty((len(poses), count), dtype=np.int64)
    nearest_starts_kernel(poses, chain.forward(bank), chain.characteristic_length, nearest)
    return bank[nearest]


def nearest_poses(poses: NDArray[np.float64], length: float) -> NDArray[np.int64]:
    """Return the indices of each pose's nearest others, nearest first, (P, at most 8).

    Near is meant in position over ``length`` and the chord of the rotation, which is its angle where it is small.
    """
    from scipy.spatial import KDTree

    P = len(poses)
    if P < 2:
        return np.empty((P, 0), dtype=np.int64)
    # |R - R'|_F is 2 sqrt(2) sin(angle / 2)
    places = np.column_stack([poses[:, :3, 3] / length, poses[:, :3, :3].reshape(P, 9) / math.sqrt(2)])
    nearest = np.asarray(KDTree(places).query(places, k=min(_NEIGHBOURS + 1, P))[1])
    # a pose is its own nearest but for twins, of which any may come first
    others = np.array([row[row != k][: nearest.shape[1] - 1] for k, row in enumerate(nearest)])
    return np.ascontiguousarray(others, dtype=np.int64)
