"""The turn from one row to the next that can be passed without a stop: a loop beyond the rows' ends, on the surface.

On a tool path with a corner the tool has to stand: at any speed its velocity would step. So the turn leaves the row
along its tangent and comes back along the next row's. In the tangent plane it is nearly half a circle: its curvature
along the way, x from -1 to 1, is

    kappa(x) ~ (1 - x^6)^3,

which is zero at both ends with its first two derivatives: row and turn join four times continuously differentiable.
It leads 0.73 of the rows' distance beyond their ends (half a circle: 0.5), and is twice that distance long.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial

from qparm.surface.frames import tool_frames

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from qparm.surface.frames import ParametricSurface

__all__ = ["TurnCurve"]

# The direction over f = (1 + x) / 2, from 0 to half a turn.
_CURVATURE = (1.0 - Polynomial([0.0, 1.0], domain=[0.0, 1.0], window=[-1.0, 1.0]) ** 6) ** 3
_DIRECTION = _CURVATURE.integ(lbnd=0.0)
_ANGLE = _DIRECTION * (np.pi / _DIRECTION(1.0))
# Degree of the polynomials: the functions are entire, and rounding is reached well before.
_DEGREE = 80
_NEWTON = 8


class TurnCurve:
    """Poses on the turn by arc length on the surface. A class, not a closure: paths must pickle.

    Parameters
    ----------
    surface : ParametricSurface
        Defined a little beyond u = 0 and 1, too.
    u : float
        Where the rows end, 0 or 1: the turn lies outside.
    v0, v1 : float
        Of the two rows.
    stand_off, lift : float
        Heights over the surface (m), of rows and in the turn's middle over that.

    Attributes
    ----------
    length : float
        The way along the surface, the lift included (m).
    overrun : float
        How far the turn leads beyond the rows' ends (m), in the tangent plane.
    """

    def __init__(
        self, surface: ParametricSurface, u: float, v0: float, v1: float, *, stand_off: float = 0.0, lift: float = 0.0
    ) -> None:
        self._surface, self._u, self._v0, self._v1 = surface, u, v0, v1
        self._stand_off, self._lift = stand_off, lift
        self._rows = surface.row_length(v0), surface.row_length(v1)
        x = _integral(lambda f: np.cos(_ANGLE(f)))
        y = _integral(lambda f: np.sin(_ANGLE(f)))
        self._across = y / y(1.0)
        self._along = x * (surface.column_length(v0, v1) / y(1.0)) * (1.0 if u > 0.5 else -1.0)
        self.overrun = float(abs(self._along(0.5)))
        # without the stand-off, as rows are measured
        place = [
            Chebyshev.interpolate(lambda f, axis=axis: self._points(f)[:, axis], _DEGREE, domain=[0, 1]).deriv()
            for axis in range(3)
        ]
        self._way = _integral(lambda f: np.sqrt(sum(part(f) ** 2 for part in place)))
        self.length = float(self._way(1.0))

    def __call__(self, s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the (k, 4, 4) poses at arc lengths s, workpiece frame."""
        s = np.clip(np.asarray(s, dtype=float), 0.0, self.length)
        f, speed = s / self.length, self._way.deriv()
        for _ in range(_NEWTON):
            f = np.clip(f - (self._way(f) - s) / speed(f), 0.0, 1.0)
        u, v = self._coordinates(f)
        return tool_frames(self._surface, u, v, stand_off=self._stand_off + self._height(f))

    def _coordinates(self, f: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        share = self._across(f)
        first, last = self._rows
        return self._u + self._along(f) / (first + share * (last - first)), self._v0 + share * (self._v1 - self._v0)

    def _height(self, f: NDArray[np.float64]) -> NDArray[np.float64]:
        return self._lift * (4.0 * f * (1.0 - f)) ** 5

    def _points(self, f: NDArray[np.float64]) -> NDArray[np.float64]:
        u, v = self._coordinates(f)
        return self._surface.point(u, v) + self._height(f)[:, None] * self._surface.normal(u, v)


def _integral(function: Callable[[NDArray[np.float64]], NDArray[np.float64]]) -> Chebyshev:
    """Return the integral of a function from 0, as a polynomial on [0, 1]."""
    return Chebyshev.interpolate(function, _DEGREE, domain=[0, 1]).integ(lbnd=0.0)
