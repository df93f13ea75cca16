"""Quintic polynomials between states: position, velocity and acceleration at both ends of every piece."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["quintic_coefficients"]


def quintic_coefficients(states: NDArray[np.float64], dt: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the coefficients of the quintics between neighbouring states.

    Parameters
    ----------
    states : (3, K, n) ndarray
        Position, velocity, acceleration.
    dt : (K - 1,) ndarray
        Seconds between them.

    Returns
    -------
    (6, K - 1, n) ndarray
        Highest power of time first.
    """
    q, v, a = states[:3]
    h = dt[:, None]
    v0, a0 = v[:-1], a[:-1]
    D = np.diff(q, axis=0) - v0 * h - 0.5 * a0 * h**2
    E = (np.diff(v, axis=0) - a0 * h) * h
    F = np.diff(a, axis=0) * h**2
    return np.stack(
        [
            (6 * D - 3 * E + 0.5 * F) / h**5,
            (-15 * D + 7 * E - F) / h**4,
            (10 * D - 4 * E + 0.5 * F) / h**3,
            0.5 * a0,
            v0,
            q[:-1],
        ]
    )
