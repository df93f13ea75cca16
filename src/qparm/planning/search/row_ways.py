"""Ways through one row: smoothed paths of different kinds, found from solutions at its ends.

What flips make of a way (:mod:`qparm.robot.flips`) is as smooth as the way itself: only one of them is smoothed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from qparm.path.relaxation import Relaxation
from qparm.planning.search.continuity import LARGE_STEP
from qparm.planning.search.layered import DRIVEN, LayeredSearch
from qparm.planning.search.projection import project, velocity_scale
from qparm.planning.search.sampling import Layer
from qparm.planning.smoothing.smooth import smooth
from qparm.planning.tolerances import EXACT_POSE
from qparm.robot.flips import Flip

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.robot import SerialChain

__all__ = ["ITERATIONS", "TOLERANCE", "RowWays", "Way", "spread_paths"]

# Solutions tried at either end of a row, and how finely their paths are smoothed to be compared.
_ENDS = 6
_FEW, ITERATIONS, TOLERANCE = 3, 6, 2e-2
# A way that is this much rougher than the row's smoothest after a few iterations is given up.
_HOPELESS = 2.0
# Ways that bend no more than this many times as much as their row's smoothest are carried over to its neighbours.
_CARRIED = 1.5
# Two smoothed paths of a row are one if no velocity-scaled joint differs by more (rad).
_SAME = np.radians(5.0)
# ... and after a few iterations they are on their way to one another.
_LIKE = np.radians(15.0)
# A path that is found lies no farther than this from the smoothed one of its kind, as a rule.
_NEAR = np.radians(30.0)
_PROJECTED = 25


@dataclass(frozen=True, eq=False)
class Way:
    """A smoothed path through a row.

    Attributes
    ----------
    q : (K, n) ndarray
        m, rad.
    rho : (K, 3) ndarray
        The relaxed tool's parameters.
    bend : float
        Sum of the squares of the velocity-scaled joints' second differences (rad²).
    """

    q: NDArray[np.float64]
    rho: NDArray[np.float64]
    bend: float


class RowWays:
    """One row and the ways through it that were found so far.

    Parameters
    ----------
    chain : SerialChain
    poses : (K, 4, 4) ndarray
        Of the row's knots, base frame.
    s : (K,) ndarray
        Their arc length (m).
    jump : (K - 1, n) ndarray
        Of the edges between them (m, rad).
    relaxation : Relaxation
    q, rho : (K, n), (K, 3) ndarray
        The way that is there already: the first.
    flips : sequence of Flip
        The chain's.
    searched : bool
        Whether there may be others: not where the row is not reached and driven in one piece.
    """

    def __init__(
        self,
        chain: SerialChain,
        poses: NDArray[np.float64],
        s: NDArray[np.float64],
        jump: NDArray[np.float64],
        relaxation: Relaxation,
        q: NDArray[np.float64],
        rho: NDArray[np.float64],
        flips: Sequence[Flip],
        *,
        searched: bool,
    ) -> None:
        self._chain, self._poses, self._s = chain, np.ascontiguousarray(poses), s
        self._jump, self._relaxation = jump, relaxation
        self._scale, self._flips = velocity_scale(chain), flips
        self._searched = searched and len(q) > 2
        self.ways = [self._way(q, rho)]
        # smoothing would lead a path near one of these to where it has led another
        self._met = [q]

    @property
    def least(self) -> float:
        """The smoothest way's bend."""
        return min(way.bend for way in self.ways)

    def add_all(self, paths: Sequence[tuple[NDArray[np.float64], NDArray[np.float64]]]) -> None:
        """Add what paths near the poses, q (K, n) and rho (K, 3), become by smoothing."""
        if self._searched:
            for q, rho in paths:
                self._add(q, self._relaxation.unwound(rho))

    def take_over(self, other: RowWays, ways: Sequence[Way], *, least: float) -> None:
        """Add what another row's smooth ways become on this row's poses: each knot takes its nearest one's solution.

        Parameters
        ----------
        other : RowWays
        ways : sequence of Way
            Of that row.
        least : float
            The least bend of all its ways; not looked up here, where other threads may be finding smoother ones.
        """
        if not self._searched:
            return
        away = np.linalg.norm(self._poses[:, None, :3, 3] - other._poses[None, :, :3, 3], axis=2)
        nearest = away.argmin(axis=1)
        for way in ways:
            if way.bend <= _CARRIED * least:
                self._add(way.q[nearest], way.rho[nearest])

    def flipped(self) -> list[Way]:
        """Return the ways and what flips make of them within the limits; the first way first."""
        ways = list(self.ways)
        for way in self.ways if self._searched else ():
            for flip in self._flips:
                q = flip.path(self._chain, way.q)
                if q is not None:
                    ways.append(Way(q, way.rho, way.bend))
        return ways

    def _add(self, q: NDArray[np.float64], rho: NDArray[np.float64]) -> None:
        """Smooth a path near the poses, and keep it if it is another way."""
        if self._is_near(q, self._met, _NEAR):
            return
        self._met.append(q)
        q, there = project(
            self._chain, self._relaxation.targets(self._poses, rho), q, position_tolerance=EXACT_POSE,
            rotation_tolerance=EXACT_POSE, iterations=_PROJECTED, threads=1,
        )  # fmt: skip
        if not there.all() or (np.abs(np.diff(q, axis=0)) > self._jump).any():
            return
        way = self._smoothed(q, rho, _FEW)
        if self._is_near(way.q, [other.q for other in self.ways], _LIKE) or way.bend > _HOPELESS * self.least:
            return
        way = self._smoothed(way.q, way.rho, ITERATIONS)
        if (np.abs(np.diff(way.q, axis=0)) / self._scale).max() <= LARGE_STEP and not self._is_near(
            way.q, [other.q for other in self.ways], _SAME
        ):
            self.ways.append(way)
            self._met.append(way.q)

    def _smoothed(self, q: NDArray[np.float64], rho: NDArray[np.float64], iterations: int) -> Way:
        count = len(q)
        found = smooth(
            self._chain, self._poses, q, s=self._s, run=np.zeros(count, dtype=np.int64),
            linked=np.zeros(count - 1, dtype=bool), step=self._jump, relaxation=self._relaxation, parameters=rho,
            iterations=iterations, tolerance=TOLERANCE, threads=1,
        )  # fmt: skip
        return self._way(found.q, found.parameters)

    def _way(self, q: NDArray[np.float64], rho: NDArray[np.float64]) -> Way:
        return Way(q, rho, float((np.diff(q / self._scale, 2, axis=0) ** 2).sum()))

    def _is_near(self, q: NDArray[np.float64], others: Sequence[NDArray[np.float64]], distance: float) -> bool:
        """Return whether a path lies near another, or near what a flip makes of it."""
        chain, stacked = self._chain, np.stack(others)
        for sign, shift in [(1.0, 0.0), *((flip.sign, flip.shift) for flip in self._flips)]:
            d = sign * stacked + shift - q
            turns = np.where(chain.prismatic, 0.0, np.round(d[:, len(q) // 2] / (2 * np.pi)))
            d -= 2 * np.pi * turns[:, None]
            if (np.abs(d) / self._scale).max(axis=(1, 2)).min() < distance:
                return True
        return False


def spread_paths(
    chain: SerialChain, layers: Sequence[Layer], jump: NDArray[np.float64]
) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Return paths through a row that begin, and paths that end, at solutions far from each other: q and rho of each.

    Parameters
    ----------
    chain : SerialChain
    layers : sequence of Layer
        Samples of every knot; where one has none there are no paths.
    jump : (K - 1, n) ndarray
        Of the edges between them (m, rad).
    """
    if len(layers) < 3 or not all(len(layer.q) for layer in layers):
        return []
    scale = velocity_scale(chain)
    paths = []
    for back in (True, False):
        search = LayeredSearch(chain, scale)
        line, limits = (layers[::-1], jump[::-1]) if back else (layers, jump)
        for k, layer in enumerate(line):
            search.add(layer, DRIVEN, limits[max(k - 1, 0)])
        for end in _spread(search, line[-1].q / scale):
            q, rho, _ = search.path(end)
            paths.append((q[::-1], rho[::-1]) if back else (q, rho))
    return paths


def _spread(search: LayeredSearch, u: NDArray[np.float64]) -> list[int]:
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
