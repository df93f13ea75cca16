"""Flips: exact other configurations of the same pose, known from the arm's structure alone.

Where the axes of three revolute joints in a row stand square on each other, turning the outer two by half a turn
and mirroring the middle one may leave all that follows where it was: the wrist of a spherical wrist, its shoulder,
and the elbow between them. A path flipped as a whole keeps its pose and the size of every difference.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.robot.chain import SerialChain

__all__ = ["Flip", "flips"]

# Poses that differ by no more than this are the same (m and entries of the rotation).
_SAME = 1e-9
_TRIALS = 4


@dataclass(frozen=True, eq=False)
class Flip:
    """The map q -> sign q + shift, up to whole turns of revolute joints.

    Attributes
    ----------
    sign, shift : (n,) ndarray
    """

    sign: NDArray[np.float64]
    shift: NDArray[np.float64]

    def then(self, other: Flip) -> Flip:
        """Return this flip followed by another."""
        return Flip(other.sign * self.sign, other.sign * self.shift + other.shift)

    def path(self, chain: SerialChain, Q: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """Return a path (N, n) flipped as a whole, by whole turns within the limits, or None where it does not fit."""
        flipped = self.sign * Q + self.shift
        low, high = flipped.min(axis=0), flipped.max(axis=0)
        turns = np.round((0.5 * (chain.lower + chain.upper) - 0.5 * (low + high)) / (2 * np.pi))
        moved = np.where(chain.prismatic, 0.0, 2 * np.pi * turns)
        if ((low + moved < chain.lower) | (high + moved > chain.upper)).any():
            return None
        return flipped + moved


def flips(chain: SerialChain) -> tuple[Flip, ...]:
    """Return all flips of a chain and their compositions, without the one that changes nothing.

    Each is found from the directions of three axes, and proved by the poses of several configurations.

    Parameters
    ----------
    chain : SerialChain
    """
    n = chain.n
    rng = np.random.default_rng(0)
    trials = rng.uniform(-2.0, 2.0, (_TRIALS, n))
    poses = chain.forward(trials)
    frames = chain.frames(np.zeros(n))
    found: list[Flip] = []
    for i in range(n - 2):
        if chain.prismatic[i : i + 3].any():
            continue
        # frame k + 1 is that of joint k
        a, b, c = frames[i + 1 : i + 4, :3, 2]
        if abs(a @ b) > _SAME or abs(b @ c) > _SAME:
            continue
        # how far the middle joint has turned the third axis away from the first one's at zero
        angle = np.arctan2(b @ np.cross(a, c), a @ c)
        sign, shift = np.ones(n), np.zeros(n)
        sign[i + 1] = -1.0
        shift[i : i + 3] = np.pi, -2.0 * angle, np.pi
        flip = Flip(sign, shift)
        if np.abs(chain.forward(sign * trials + shift) - poses).max() <= _SAME * max(1.0, np.abs(poses).max()):
            found.append(flip)
    every = [Flip(np.ones(n), np.zeros(n))]
    for flip in found:
        every += [other.then(flip) for other in every]
    return tuple(every[1:])
