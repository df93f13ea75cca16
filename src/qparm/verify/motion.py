"""A motion as a file holds it: times, positions, and what else the format carries."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

__all__ = ["MotionTable"]


@dataclass(frozen=True, eq=False)
class MotionTable:
    """What a trajectory file holds, in SI, whatever its format.

    Attributes
    ----------
    format : str
        As ``qparm export`` names it.
    joints : tuple of str
        Names, in the file's order.
    t : (T,) ndarray
        s, from the start of the motion.
    q : (T, n) ndarray
        Positions (m, rad).
    velocity, acceleration, jerk : (T, n) ndarray or None
        None where the format has none.
    position_rounding : (n,) ndarray
        How far a position in the file may be from the one that was written (m, rad).
    time_rounding : float
        The same of a time (s).
    row : (T,) ndarray of int or None
    segment : (T,) ndarray of str or None
        Row and kind of segment of every sample, where the format tells them.
    executable : bool
        False if the file says of itself that it must not be executed.
    """

    format: str
    joints: tuple[str, ...]
    t: NDArray[np.float64]
    q: NDArray[np.float64]
    velocity: NDArray[np.float64] | None
    acceleration: NDArray[np.float64] | None
    jerk: NDArray[np.float64] | None
    position_rounding: NDArray[np.float64]
    time_rounding: float
    row: NDArray[np.int64] | None = None
    segment: NDArray[np.str_] | None = None
    executable: bool = True
