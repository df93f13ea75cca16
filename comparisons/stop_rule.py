"""When a pose counts as reached where whole paths are compared: one rule for every method."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import qparm

__all__ = ["within_tolerance"]

_POSITION, _ROTATION = 1e-8, 1e-7  # m, rad


def within_tolerance(chain: qparm.SerialChain, e: NDArray[np.float64]) -> bool:
    """Return whether a scaled pose error (6,) is within both tolerances."""
    position = float(np.linalg.norm(e[:3])) * chain.characteristic_length
    return position <= _POSITION and float(np.linalg.norm(e[3:])) <= _ROTATION
