"""The way along a curve of points, and back from ways to the curve's own parameter: exact to rounding."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["ArcLength", "chebyshev_speed"]

Function = Callable[["NDArray[np.float64]"], "NDArray[np.float64]"]

# Degree of the speed's polynomial on a piece; a piece is halved until it has settled, so many times at most.
_DEGREE, _SETTLED, _HALVINGS = 24, 1e-12, 10
# Smaller shares of the speed are rounding: a curve that is passed evenly has none of them.
_ROUNDING = 3e-12
_ANGLES = np.pi * (np.arange(_DEGREE + 1) + 0.5) / (_DEGREE + 1)
_NODES = np.cos(_ANGLES)
# From values at the nodes to coefficients of Chebyshev polynomials.
_TO_COEFFICIENTS = 2.0 / (_DEGREE + 1) * np.cos(np.arange(_DEGREE + 1)[:, None] * _ANGLES)
_TO_COEFFICIENTS[0] *= 0.5
_NEWTON, _NEAR = 30, 1e-15
# Places at a time: their coefficients stay in the cache.
_CHUNK = 16_384
# Degree of the polynomials through a smooth curve of a surface.
_SMOOTH = 64


class ArcLength:
    """The way along a curve whose speed is smooth between given borders.

    Parameters
    ----------
    speed : callable
        The curve's speed over its parameter x, (k,) for (k,).
    borders : (m + 1,) array_like
        Ascending x; between two of them the speed is smooth.

    Attributes
    ----------
    length : float
        The whole way (m).
    """

    def __init__(self, speed: Function, borders: NDArray[np.float64]) -> None:
        first, last = np.asarray(borders[:-1], dtype=float), np.asarray(borders[1:], dtype=float)
        done: list[tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]] = []
        for level in range(_HALVINGS + 1):
            x = 0.5 * (first + last)[:, None] + 0.5 * (last - first)[:, None] * _NODES
            coefficients = speed(x.ravel()).reshape(x.shape) @ _TO_COEFFICIENTS.T
            rest = np.abs(coefficients[:, -3:]).max(axis=1)
            rough = rest > _SETTLED * np.abs(coefficients).max(axis=1)
            coefficients[np.abs(coefficients) < _ROUNDING * np.abs(coefficients[:, :1])] = 0.0
            if level == _HALVINGS:
                rough[:] = False
            done.append((first[~rough], last[~rough], coefficients[~rough]))
            if not rough.any():
                break
            middle = 0.5 * (first + last)[rough]
            first, last = np.concatenate([first[rough], middle]), np.concatenate([middle, last[rough]])
        first, last, coefficients = (np.concatenate(parts) for parts in zip(*done, strict=True))
        order = np.argsort(first, kind="stable")
        self._x = np.append(first[order], last[order][-1])
        self._half = 0.5 * (last - first)[order]
        self._speed = coefficients[order]
        self._integral = _integrated(self._speed) * self._half[:, None]
        self._ways = np.concatenate([[0.0], np.cumsum(self._integral.sum(axis=1))])
        self.length = float(self._ways[-1])

    def way(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the way from the first border to each x."""
        x = np.asarray(x, dtype=float)
        at = np.clip(np.searchsorted(self._x, x, side="right") - 1, 0, len(self._half) - 1)
        return self._ways[at] + _chebyshev(self._integral[at], (x - self._x[at]) / self._half[at] - 1.0)

    def place(self, s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the x at which each way is reached; beyond the ends those of the ends."""
        s = np.clip(np.asarray(s, dtype=float), 0.0, self.length)
        x = np.empty_like(s)
        for start in range(0, len(s), _CHUNK):
            x[start : start + _CHUNK] = self._place(s[start : start + _CHUNK])
        return x

    def _place(self, s: NDArray[np.float64]) -> NDArray[np.float64]:
        at = np.clip(np.searchsorted(self._ways, s, side="right") - 1, 0, len(self._half) - 1)
        own, half = s - self._ways[at], self._half[at]
        whole = np.maximum(self._ways[at + 1] - self._ways[at], 1e-300)
        g, integral, speed = 2.0 * own / whole - 1.0, self._integral[at], self._speed[at]
        for _ in range(_NEWTON):
            step = (_chebyshev(integral, g) - own) / np.maximum(half * _chebyshev(speed, g), 1e-9 * whole)
            g = np.clip(g - step, -1.0, 1.0)
            if np.abs(step).max(initial=0.0) < _NEAR * 4:
                break
        return self._x[at] + half * (g + 1.0)


def chebyshev_speed(points: Function, first: float, last: float) -> Function:
    """Return the speed of a smooth curve of points (k, 3) over its parameter, differentiated as a polynomial."""
    from numpy.polynomial import Chebyshev

    parts = [
        Chebyshev.interpolate(lambda x, axis=axis: points(x)[:, axis], _SMOOTH, domain=[first, last]).deriv()
        for axis in range(3)
    ]
    return lambda x: np.sqrt(sum(part(x) ** 2 for part in parts))


def _integrated(coefficients: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the coefficients (m, d + 2) of integrals from -1."""
    m, count = coefficients.shape
    padded = np.concatenate([coefficients, np.zeros((m, 2))], axis=1)
    integral = np.zeros((m, count + 1))
    k = np.arange(1, count + 1)
    integral[:, 1:] = (padded[:, k - 1] - padded[:, k + 1]) / (2.0 * k)
    integral[:, 1] += 0.5 * coefficients[:, 0]
    integral[:, 0] = -(integral[:, 1:] * (-1.0) ** k).sum(axis=1)
    return integral


def _chebyshev(coefficients: NDArray[np.float64], g: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the sums of Chebyshev polynomials with coefficients (k, d + 1) at places (k,) from -1 to 1."""
    b1 = np.zeros_like(g)
    b2 = np.zeros_like(g)
    for k in range(coefficients.shape[1] - 1, 0, -1):
        b1, b2 = coefficients[:, k] + 2.0 * g * b1 - b2, b1
    return coefficients[:, 0] + g * b1 - b2
