"""Polynomial pieces collected joint by joint, for profiles whose phases change at times of their own in every joint."""

from __future__ import annotations

from array import array
from typing import TYPE_CHECKING

import numpy as np

from qparm.timing.ticks import whole

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray
    from scipy.interpolate import PPoly

__all__ = ["ProfilePieces"]


class ProfilePieces:
    """Pieces of n joints, in order of time; the breaks of the joints differ."""

    def __init__(self, n: int) -> None:
        # arrays of plain numbers: a long trajectory has millions
        self._breaks = [array("d", [0.0]) for _ in range(n)]
        self._pieces = [array("d") for _ in range(n)]

    def add_quintic(self, coefficients: NDArray[np.float64], duration: float) -> None:
        """Add one quintic a joint, coefficients (6, n) with the highest power first."""
        for breaks, pieces, column in zip(self._breaks, self._pieces, coefficients.T.tolist(), strict=True):
            breaks.append(breaks[-1] + duration)
            pieces.extend(column)

    def add_phases(
        self, phases: list[list[tuple[float, float]]], start: Sequence[Sequence[float]], duration: float
    ) -> None:
        """Add phases (duration, jerk) of each joint from a state (3, n); what is left is without jerk."""
        for i, (joint_phases, state) in enumerate(zip(phases, zip(*start, strict=True), strict=True)):
            breaks, pieces = self._breaks[i], self._pieces[i]
            first = breaks[-1]
            p, v, a = state
            elapsed = 0.0
            for index, (t, j) in enumerate(joint_phases):
                if index == len(joint_phases) - 1:
                    t = duration - elapsed
                if t <= 0:
                    continue
                pieces.extend((0.0, 0.0, j / 6, a / 2, v, p))
                p += t * (v + t * (a / 2 + t * j / 6))
                v += t * (a + t * j / 2)
                a += t * j
                elapsed += t
                breaks.append(first + elapsed)
            if elapsed < duration:
                pieces.extend((0.0, 0.0, 0.0, a / 2, v, p))
                breaks.append(first + duration)
            breaks[-1] = first + duration

    def polynomials(self) -> tuple[PPoly, ...]:
        """Return one piecewise polynomial a joint; its breaks are whole nanoseconds."""
        from scipy.interpolate import PPoly

        return tuple(
            PPoly(np.ascontiguousarray(np.frombuffer(pieces).reshape(-1, 6).T), whole(np.array(breaks)))
            for breaks, pieces in zip(self._breaks, self._pieces, strict=True)
        )
