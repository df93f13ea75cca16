"""The curve q(s) through the waypoints of a segment."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from qparm.errors import InvalidInput

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from scipy.interpolate import BSpline, PPoly

__all__ = ["joint_curve", "piecewise"]

_DEGREE = 5


def joint_curve(s: NDArray[np.float64], q: NDArray[np.float64]) -> BSpline:
    """Return the interpolating spline: quintic, four times continuously differentiable.

    Fewer than six waypoints give the polynomial through them, of a lower degree.

    Parameters
    ----------
    s : (N,) ndarray
        Path parameter, strictly ascending (m).
    q : (N, n) ndarray
        Waypoints (m, rad).

    Returns
    -------
    scipy.interpolate.BSpline
        ``curve(s)`` gives (..., n); ``curve.derivative(k)`` its derivatives.

    Raises
    ------
    InvalidInput
        If there are fewer than two waypoints, or s does not ascend.
    """
    from scipy.interpolate import make_interp_spline

    s = np.asarray(s, dtype=float)
    if len(s) < 2:
        raise InvalidInput("a curve needs at least two waypoints")
    if not (np.diff(s) > 0).all():
        index = int(np.flatnonzero(~(np.diff(s) > 0))[0])
        raise InvalidInput(f"the path parameter must ascend: waypoint {index + 1} does not come after {index}")
    degree = min(_DEGREE, len(s) - 1)
    return make_interp_spline(s, q, k=degree)


def piecewise(curve: BSpline) -> PPoly:
    """Return a spline as polynomials between its breaks, moved so that it starts at 0.

    Parameters
    ----------
    curve : scipy.interpolate.BSpline
        With values (n,) or scalar ones.

    Returns
    -------
    scipy.interpolate.PPoly
    """
    from math import factorial

    from scipy.interpolate import PPoly

    breaks = np.unique(curve.t[curve.k : len(curve.t) - curve.k])
    left = breaks[:-1]
    terms = [curve(left, order) / factorial(order) for order in range(curve.k, -1, -1)]
    return PPoly(np.stack(terms), breaks - breaks[0])
