"""The curve of a joint path: a quintic spline through waypoints."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray
    from scipy.interpolate import BSpline

__all__ = ["joint_curve"]

_DEGREE = 5


def joint_curve(s: NDArray[np.float64], Q: NDArray[np.float64]) -> BSpline:
    """Return the spline q(s) through waypoints, of degree 5 or as high as there are waypoints for.

    Parameters
    ----------
    s : (N,) ndarray
        Ascending parameter, N >= 2.
    Q : (N, n) ndarray
        Configurations (m, rad).

    Returns
    -------
    scipy.interpolate.BSpline
        ``curve(s)`` is (n,) or (k, n).
    """
    from scipy.interpolate import make_interp_spline

    return make_interp_spline(s, Q, k=min(_DEGREE, len(s) - 1))
