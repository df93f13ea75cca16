"""The motion between the samples of a file: quintics between states, which the file gives or differences make.

What a motion within the limits can do between two samples that such a quintic does not show is bounded: the quintic
misses it by at most c h³ J per joint, J being the jerk limit, h the time between the samples. The c is the largest
integral of the absolute Peano kernel of the interpolation (third derivative): 0.0062 with exact states, 0.043 with
states by differences over five samples.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from qparm.verify.files import KnotTable
from qparm.verify.interpolate import positions_at

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.verify.clock import Clock
    from qparm.verify.motion import MotionTable

__all__ = ["BY_DIFFERENCES", "EXACT_STATES", "MotionStates", "motion_states", "state_differences"]

EXACT_STATES, BY_DIFFERENCES = 0.0062, 0.0428
# A column's last digit counts for no less than this many of the position's (relative to their sizes).
_DIGITS = 10.0
# What differences of rounded positions add in between, in roundings.
_AMPLIFIED = 2.0


@dataclass(frozen=True, eq=False)
class MotionStates:
    """A motion that can be asked for its positions at any time.

    Attributes
    ----------
    knots : KnotTable
        Times and position, velocity, acceleration (3, T, n).
    given : bool
        Whether the file gives velocities and accelerations.
    rounding : (4, n) ndarray
        How far position, velocity, acceleration, jerk in the file may be off.
    hidden : (n,) ndarray
        How far a joint may be, between samples, from where it is taken to be (m, rad).
    """

    knots: KnotTable
    given: bool
    rounding: NDArray[np.float64]
    hidden: NDArray[np.float64]

    def __call__(self, t: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return positions (k, n)."""
        return positions_at(self.knots, t)


def motion_states(table: MotionTable, clock: Clock, limits: NDArray[np.float64]) -> MotionStates:
    """Return the motion in a file.

    Parameters
    ----------
    table : MotionTable
    clock : Clock
        Of its times.
    limits : (3, n) ndarray
    """
    size = np.maximum(np.abs(table.q).max(axis=0), 1e-3)
    rounding = np.zeros((4, len(table.joints)))
    # late on, the rounding of the time moves a position more than its own
    rounding[0] = table.position_rounding + np.spacing(size) + np.spacing(float(clock.t[-1])) * limits[0]
    for order, column in enumerate((table.velocity, table.acceleration, table.jerk), 1):
        if column is not None:
            rounding[order] = rounding[0] * _DIGITS * np.maximum(1.0, np.abs(column).max(axis=0) / size)
    late = float(clock.rounding.max(initial=0.0)) * limits[0]
    given = table.velocity is not None and table.acceleration is not None
    longest = clock.period if clock.sampled else float(np.diff(clock.t).max(initial=0.0))
    if given:
        assert table.velocity is not None
        assert table.acceleration is not None
        derivatives = np.stack([table.q, table.velocity, table.acceleration])
        # the points of a JointTrajectory are the ends of quintics: nothing is hidden between them
        hidden = EXACT_STATES * longest**3 * limits[2] if clock.sampled else np.zeros(len(limits[2]))
        hidden = hidden + rounding[0] + late
    else:
        derivatives = np.stack([table.q, *state_differences(clock.t, table.q)])
        hidden = BY_DIFFERENCES * longest**3 * limits[2] + _AMPLIFIED * (rounding[0] + late)
    return MotionStates(KnotTable(table.joints, clock.t, derivatives), given, rounding, hidden)


def state_differences(
    t: NDArray[np.float64], q: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return velocities and accelerations (T, n) at samples, of the quartics through five samples around each."""
    v, a = np.zeros_like(q), np.zeros_like(q)
    width = min(5, len(t))
    if width < 3:
        return v, a
    h = np.diff(t)
    even = np.zeros(len(t), dtype=bool)
    if width == 5:
        alike = np.abs(h - h[0]) <= 1e-9 * h[0] + 1e-12
        even[2:-2] = alike[:-3] & alike[1:-2] & alike[2:-1] & alike[3:]
        v[2:-2] = (q[:-4] - 8 * q[1:-3] + 8 * q[3:-1] - q[4:]) / (12 * h[0])
        a[2:-2] = (-q[:-4] + 16 * q[1:-3] - 30 * q[2:-2] + 16 * q[3:-1] - q[4:]) / (12 * h[0] ** 2)
    rest = np.flatnonzero(~even)
    around = np.clip(rest - 2, 0, len(t) - width)[:, None] + np.arange(width)
    scale = t[around[:, -1]] - t[around[:, 0]]
    x = (t[around] - t[rest, None]) / scale[:, None]
    coefficients = np.linalg.solve(x[:, :, None] ** np.arange(width), q[around] - q[rest, None])
    v[rest] = coefficients[:, 1] / scale[:, None]
    a[rest] = 2 * coefficients[:, 2] / scale[:, None] ** 2
    return v, a
