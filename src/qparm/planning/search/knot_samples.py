"""The samples of all knots of a path, block by block: blocks are drawn side by side, and kept where they fit."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from qparm.path.relaxation import Relaxation
from qparm.planning.search.sampling import Layer, Sampling, sample_block

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.planning.solution import PathSolution
    from qparm.robot import SerialChain

__all__ = ["KnotSamples"]

# Knots sampled together: short enough to share a path among cores, long enough for solutions to spread.
_BLOCK = 64
# Samples kept for another search, in case one is needed.
_MOST_KEPT = 3_000_000


class KnotSamples:
    """The samples of all knots; kept where they fit, drawn again where they do not.

    Parameters
    ----------
    chain : SerialChain
    poses : (K, 4, 4) ndarray
        Of the knots, base frame.
    row : (K,) ndarray of int
        Of each.
    seed : int
    relaxation : Relaxation
    sampling : Sampling
    beside : PathSolution, optional
        Of the knots: what is reached in it is among the samples.
    """

    def __init__(
        self,
        chain: SerialChain,
        poses: NDArray[np.float64],
        row: NDArray[np.int64],
        seed: int,
        relaxation: Relaxation,
        sampling: Sampling,
        beside: PathSolution | None = None,
    ) -> None:
        self._chain, self._poses, self._seed = chain, poses, seed
        self._relaxation, self._sampling, self._beside = relaxation, sampling, beside
        self.blocks = blocks_of(row)
        self.count = 0
        self._kept: dict[int, list[Layer]] = {}
        self._counted: set[int] = set()

    def draw(self, index: int) -> list[Layer]:
        """Return the layers of a block."""
        if index in self._kept:
            return self._kept[index]
        first, last = self.blocks[index]
        rng = np.random.default_rng([self._seed, 0, index])
        layers = sample_block(
            self._chain, self._poses[first:last], rng=rng, sampling=self._sampling, relaxation=self._relaxation
        )
        if self._beside is None:
            return layers
        return [_with(layer, self._beside, k) for k, layer in zip(range(first, last), layers, strict=True)]

    @property
    def layers(self) -> list[Layer] | None:
        """The layers of all knots, or None if they were not kept."""
        if len(self._kept) < len(self.blocks):
            return None
        return [layer for index in range(len(self.blocks)) for layer in self._kept[index]]

    def keep(self, index: int, layers: list[Layer]) -> None:
        """Count a block's samples once, and keep them while there is room."""
        if index not in self._counted:
            self._counted.add(index)
            self.count += sum(len(layer.q) for layer in layers)
        if self.count <= _MOST_KEPT:
            self._kept[index] = layers


def _with(layer: Layer, path: PathSolution, k: int) -> Layer:
    """Return a layer and what a path has there."""
    if not path.reached[k]:
        return layer
    return Layer(np.concatenate([path.q[k : k + 1], layer.q]), np.concatenate([path.rho[k : k + 1], layer.rho]))


def blocks_of(row: NDArray[np.int64]) -> list[tuple[int, int]]:
    """Return runs of at most ``_BLOCK`` knots within rows."""
    borders = np.flatnonzero(np.diff(row)) + 1
    blocks = []
    for first, last in zip([0, *borders.tolist()], [*borders.tolist(), len(row)], strict=True):
        pieces = -(-(last - first) // _BLOCK)
        cuts = np.linspace(first, last, pieces + 1).round().astype(int).tolist()
        blocks += list(pairwise(cuts))
    return blocks
