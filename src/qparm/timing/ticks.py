"""Whole nanoseconds: files hold times in them, so motions are made on them, and what rounding is left is known."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

__all__ = ["SHORT", "jerk_of_rounding", "shortest_pieces", "slow_to_whole", "whole"]

_PER_SECOND = 1e9
# A quintic's jerk follows a position at one of its ends by this over the third power of its duration.
_JERK_OF_POSITION = 60.0
_EPSILON, _SMALLEST = 2.3e-16, 1e-3
# Rounding makes this share of a jerk limit over the shortest piece.
_ROUNDING = 1e-6
# On shorter pieces (s) whoever reads the states takes the mean jerk.
SHORT = 1e-4


def whole(t: ArrayLike) -> NDArray[np.float64]:
    """Return times (s) moved to the nearest whole nanosecond."""
    return np.round(np.asarray(t, dtype=np.float64) * _PER_SECOND) / _PER_SECOND


def slow_to_whole(duration: float) -> float:
    """Return by how much a duration (s) is to be multiplied to be the next whole number of nanoseconds."""
    return max(float(np.ceil(duration * _PER_SECOND * (1 - 1e-15))), 1.0) / (duration * _PER_SECOND)


def _unsure(states: NDArray[np.float64], clock: float) -> NDArray[np.float64]:
    """Return how far positions are unsure through their own digits and those of the time, (K, n)."""
    return _EPSILON * np.maximum(np.abs(states[0]), _SMALLEST) + np.spacing(clock) * np.abs(states[1])


def jerk_of_rounding(
    states: NDArray[np.float64], h: NDArray[np.float64], jerk: NDArray[np.float64], clock: float
) -> NDArray[np.float64]:
    """Return the share of a jerk limit that rounding makes when quintics are taken from written states.

    Parameters
    ----------
    states : (2 or more, K, n) ndarray
        Position, velocity, ...
    h : (K - 1,) ndarray
        Seconds between them.
    jerk : (n,) ndarray
        The limits.
    clock : float
        The latest time that is written (s): late on, a number of seconds has fewer digits after the point.

    Returns
    -------
    (K - 1,) ndarray
    """
    worst = (_unsure(states, clock) / jerk).max(axis=1)
    return _JERK_OF_POSITION * np.maximum(worst[:-1], worst[1:]) / h**3


def shortest_pieces(states: NDArray[np.float64], jerk: NDArray[np.float64], clock: float) -> NDArray[np.float64]:
    """Return the duration (s) below which rounding would make jerk, at each state, (K,); see `jerk_of_rounding`."""
    return np.cbrt(_JERK_OF_POSITION / _ROUNDING * (_unsure(states, clock) / jerk).max(axis=1))
