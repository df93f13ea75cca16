"""A path variable in which leaving rest is smooth.

Near rest with bounded jerk the way grows with the third power of time, so the squared speed by s has no derivative
there and no spline in s holds it. With s = s(u) of third order at both ends, the squared speed by u is free and
positive everywhere, and rest without a step of acceleration comes by itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["SoftEnds"]

# Of a soft end of width w, the way is this share of w.
_WAY = 0.6
# Steps that its inverse takes to the last digits: they double with each.
_NEWTON = 6


@dataclass(frozen=True)
class SoftEnds:
    """The map s(u): for x = u / w up to 1, s = w (2 x^3 - 2 x^4 + 0.6 x^5); then s' = 1; mirrored at the end.

    Attributes
    ----------
    length : float
        S, the path's length in s.
    start, end : float
        Widths in u of the soft ends; together they hold less than the path.
    """

    length: float
    start: float
    end: float

    @property
    def total(self) -> float:
        """U, the path's length in u."""
        return self.length + (1 - _WAY) * (self.start + self.end)

    def at(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return s and its first three derivatives by u, (4, P)."""
        table = np.zeros((4, len(u)))
        table[0], table[1] = u - (1 - _WAY) * self.start, 1.0
        first, last = u < self.start, u > self.total - self.end
        table[:, first] = _soft(u[first], self.start)
        ending = _soft(self.total - u[last], self.end)
        table[:, last] = ending * np.array([-1.0, 1.0, -1.0, 1.0])[:, None]
        table[0, last] += self.length
        return table

    def inverse(self, s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return u at given s."""
        u = s + (1 - _WAY) * self.start
        first, last = s < _WAY * self.start, s > self.length - _WAY * self.end
        u[first] = _inverse_soft(s[first], self.start)
        u[last] = self.total - _inverse_soft(self.length - s[last], self.end)
        return u


def _soft(u: NDArray[np.float64], width: float) -> NDArray[np.float64]:
    x = np.maximum(u / width, 0.0)
    return np.stack(
        [
            width * x**3 * (2 + x * (-2 + 0.6 * x)),
            x**2 * (6 + x * (-8 + 3 * x)),
            x * (12 + x * (-24 + 12 * x)) / width,
            (12 + x * (-48 + 36 * x)) / width**2,
        ]
    )


def _inverse_soft(s: NDArray[np.float64], width: float) -> NDArray[np.float64]:
    """Return u by Newton's method on the cube root of the way, which is nearly a straight line in u."""
    root = np.cbrt(np.maximum(s, 0.0) / width)
    x = root / np.cbrt(2.0)
    for _ in range(_NEWTON):
        inner = 2 + x * (-2 + 0.6 * x)
        slope = (6 + x * (-8 + 3 * x)) / (3.0 * np.cbrt(inner) ** 2)
        x = np.clip(x - (x * np.cbrt(inner) - root) / slope, 0.0, 1.0)
    return width * x
