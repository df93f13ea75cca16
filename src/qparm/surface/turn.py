"""The turn from one row to the next that can be passed without a stop: round two corners, on the surface.

On a tool path with a corner the tool has to stand: at any speed its velocity would step. So the turn leaves the row
along its tangent, a little beyond its end, and comes back along the next row's. In the tangent plane it is a corner,
a straight line across and another corner. On each corner the curvature along the way, x from -1 to 1, is

    kappa(x) ~ (1 - x^6)^3,

nearly an arc of a circle, but zero at both ends with its first two derivatives: row, corners and line join four times
continuously differentiable.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial

from qparm.surface.arc_length import ArcLength, chebyshev_speed
from qparm.surface.frames import tool_frames

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from qparm.surface.frames import ParametricSurface

__all__ = ["TurnCurve"]

# Degree of the polynomials: the functions are entire, and rounding is reached well before.
_DEGREE = 64
# Waypoints inside a corner.
_PER_CORNER = 3


class TurnCurve:
    """Poses on the turn by the tool's arc length. A class, not a closure: paths must pickle.

    Parameters
    ----------
    surface : ParametricSurface
        Defined a little beyond u = 0 and 1, too.
    u : float
        Where the rows end, 0 or 1: the turn lies outside.
    v0, v1 : float
        Of the two rows.
    overrun : float
        How far the turn leads beyond the rows' ends (m); at most half of the rows' distance.
    stand_off, lift : float
        Heights over the surface (m), of rows and in the turn's middle over that.

    Attributes
    ----------
    length : float
        The tool's way, at its stand-off and with its lift (m).
    overrun : float
    """

    def __init__(
        self,
        surface: ParametricSurface,
        u: float,
        v0: float,
        v1: float,
        *,
        overrun: float,
        stand_off: float = 0.0,
        lift: float = 0.0,
    ) -> None:
        self._surface, self._u, self._v0, self._v1 = surface, u, v0, v1
        self._stand_off, self._lift = stand_off, lift
        self._rows = surface.row_length(v0), surface.row_length(v1)
        self._distance = surface.column_length(v0, v1)
        self.overrun = min(overrun, 0.5 * self._distance)
        curvature = (1.0 - Polynomial([0.0, 1.0], domain=[0.0, 1.0], window=[-1.0, 1.0]) ** 6) ** 3
        direction = curvature.integ(lbnd=0.0)
        angle = direction * (0.5 * np.pi / direction(1.0))
        # a corner of unit length, along the row and across it; it is as wide as it is long
        along, across = (_integral(lambda g, f=f: f(angle(g))) for f in (np.cos, np.sin))
        corner = self.overrun / float(along(1.0))
        self._corner = corner, along * corner, across * corner
        line = self._distance - 2.0 * self.overrun
        borders = [0.0, corner, corner + line, 2.0 * corner + line]
        self._pieces = [(first, last) for first, last in pairwise(borders) if last - first > 1e-9 * borders[-1]]
        speeds = [chebyshev_speed(self._points, first, last) for first, last in self._pieces]
        starts = np.array([first for first, _ in self._pieces])

        def speed(x: NDArray[np.float64]) -> NDArray[np.float64]:
            piece, values = np.searchsorted(starts, x, side="right") - 1, np.empty(len(x))
            # each on its own piece alone: far beyond it, a polynomial overflows
            for k, one in enumerate(speeds):
                values[piece == k] = one(x[piece == k])
            return values

        self._arc = ArcLength(speed, np.append(starts, self._pieces[-1][1]))
        self.length = self._arc.length

    def via(self, spacing: float) -> NDArray[np.float64]:
        """Return places for waypoints: a few in every corner, elsewhere no farther apart than the spacing (m)."""
        places = []
        for number, piece in enumerate(self._pieces):
            start, end = self._arc.way(np.array(piece)).tolist()
            on_line = len(self._pieces) == 3 and number == 1
            count = int(np.ceil((end - start) / spacing)) if on_line else _PER_CORNER + 1
            places.append(np.linspace(start, end, count + 1)[1:])
        return np.concatenate(places)[:-1]

    def __call__(self, s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the (k, 4, 4) poses at arc lengths s, workpiece frame."""
        x = self._arc.place(s)
        u, v = self._coordinates(x)
        return tool_frames(self._surface, u, v, stand_off=self._stand_off + self._height(x))

    def _coordinates(self, x: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return u and v at lengths x in the tangent plane."""
        corner, along, across = self._corner
        whole = 2.0 * corner + self._distance - 2.0 * self.overrun
        second = x > 0.5 * whole
        g = np.where(second, whole - x, x)
        inside = np.minimum(g / corner, 1.0)
        out, over = along(inside), across(inside) + np.maximum(g - corner, 0.0)
        over = np.where(second, self._distance - over, over) / self._distance
        first, last = self._rows
        sign = 1.0 if self._u > 0.5 else -1.0
        return self._u + sign * out / (first + over * (last - first)), self._v0 + over * (self._v1 - self._v0)

    def _height(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        f = x / (2.0 * self._corner[0] + self._distance - 2.0 * self.overrun)
        return self._lift * (4.0 * f * (1.0 - f)) ** 5

    def _points(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        u, v = self._coordinates(x)
        height = self._stand_off + self._height(x)
        return self._surface.point(u, v) + height[:, None] * self._surface.normal(u, v)


def _integral(function: Callable[[NDArray[np.float64]], NDArray[np.float64]]) -> Chebyshev:
    """Return the integral of a function from 0, as a polynomial on [0, 1]."""
    return Chebyshev.interpolate(function, _DEGREE, domain=[0, 1]).integ(lbnd=0.0)
