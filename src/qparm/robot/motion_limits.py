"""The limits of joints: velocity, acceleration and jerk, without the arm around them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from qparm.errors import InvalidInput
from qparm.files.reading import shown_value

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

    from qparm.robot.chain import SerialChain

__all__ = ["MotionLimits"]

_LEAST, _MOST = 1e-6, 1e12
_ORDERS = ("velocity", "acceleration", "jerk")


@dataclass(frozen=True, eq=False)
class MotionLimits:
    """Symmetric limits of n joints.

    Attributes
    ----------
    velocity, acceleration, jerk : (n,) ndarray
        m or rad per second, second squared and cubed; positive and finite.
    """

    velocity: NDArray[np.float64]
    acceleration: NDArray[np.float64]
    jerk: NDArray[np.float64]

    def __post_init__(self) -> None:
        for name in _ORDERS:
            values: ArrayLike | Sequence[float] = getattr(self, name)
            try:
                array = np.array(values, dtype=np.float64)
            except (TypeError, ValueError, OverflowError):
                raise InvalidInput(f"the {name} limits must be a list of numbers, not {shown_value(values)}") from None
            if array.ndim != 1 or not len(array):
                raise InvalidInput(f"the {name} limits must be a list with one number per joint")
            # what numpy takes for numbers all the same
            for joint, value in enumerate(np.asarray(values, dtype=object).tolist()):
                if isinstance(value, bool | str | bytes):
                    raise InvalidInput(f"the {name} limit of joint {joint} must be a number, not {value!r}")
            bad = np.flatnonzero(~(np.isfinite(array) & (array > 0)))
            if len(bad):
                raise InvalidInput(
                    f"the {name} limit of joint {bad[0]} must be finite and positive, not {array[bad[0]]}"
                )
            # outside this range durations and their powers leave what floating point can hold
            bad = np.flatnonzero((array < _LEAST) | (array > _MOST))
            if len(bad):
                raise InvalidInput(
                    f"the {name} limit of joint {bad[0]} must lie between {_LEAST:g} and {_MOST:g}, not"
                    f" {array[bad[0]]:g}"
                )
            object.__setattr__(self, name, array)
        counts = [len(getattr(self, name)) for name in _ORDERS]
        if len(set(counts)) > 1:
            raise InvalidInput(f"velocity, acceleration and jerk limits are of {counts} joints; they must be as many")

    @property
    def n(self) -> int:
        """The number of joints."""
        return len(self.velocity)

    @property
    def table(self) -> NDArray[np.float64]:
        """The three orders, (3, n)."""
        return np.stack([self.velocity, self.acceleration, self.jerk])

    @classmethod
    def of(cls, chain: SerialChain) -> MotionLimits:
        """Return the limits of an arm's joints."""
        return cls(chain.velocity, chain.acceleration, chain.jerk)
