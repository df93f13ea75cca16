"""Shortest times of rest-to-rest motions within the joint limits."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from qparm.robot.chain import SerialChain

__all__ = ["rest_to_rest_time"]

# Peaks of the rest-to-rest quintic 10 x^3 - 15 x^4 + 6 x^5 over a unit step in unit time:
# velocity 15/8 at the middle, acceleration 10/sqrt(3), jerk 60 at the ends.
QUINTIC_PEAKS = (1.875, 10 / np.sqrt(3), 60.0)


def rest_to_rest_time(chain: SerialChain, q0: ArrayLike, q1: ArrayLike) -> NDArray[np.float64]:
    """Return the shortest time in which a quintic goes from rest at ``q0`` to rest at ``q1``.

    Parameters
    ----------
    chain : SerialChain
        Gives the velocity, acceleration and jerk limits.
    q0, q1 : (..., n) array_like

    Returns
    -------
    (...,) ndarray
        Seconds; the slowest joint decides.
    """
    step = np.abs(np.asarray(q1, dtype=float) - np.asarray(q0, dtype=float))
    by_velocity = QUINTIC_PEAKS[0] * step / chain.velocity
    by_acceleration = np.sqrt(QUINTIC_PEAKS[1] * step / chain.acceleration)
    by_jerk = np.cbrt(QUINTIC_PEAKS[2] * step / chain.jerk)
    return np.maximum(np.maximum(by_velocity, by_acceleration), by_jerk).max(axis=-1)
