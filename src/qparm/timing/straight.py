"""A straight line in joint space from rest to rest, in the shortest time: all joints share one jerk-limited profile."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from qparm.timing.ticks import slow_to_whole, whole

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.robot.motion_limits import MotionLimits

__all__ = ["StraightMotion", "straight_duration", "straight_motion"]

# What a motion without a way takes (s).
_STILL = 1e-3
# Phases are longer by this share than the limits ask for: the forms keep as far from them.
_SLACK = 6e-6
# A phase shorter than this (s) is joined to those beside it: none is told from its neighbours in a file's digits.
_NO_PHASE = 1e-5


@dataclass(frozen=True, eq=False)
class StraightMotion:
    """From ``start`` to ``start + step`` through phases of constant jerk. Its path variable u is time.

    Attributes
    ----------
    start, step : (n,) ndarray
    phases : (k,) ndarray
        Durations (s).
    jerks : (k,) ndarray
        Of the share of the way (1 / s^3).
    """

    start: NDArray[np.float64]
    step: NDArray[np.float64]
    phases: NDArray[np.float64]
    jerks: NDArray[np.float64]

    @cached_property
    def knots(self) -> NDArray[np.float64]:
        """Where phases begin and end."""
        return whole(np.concatenate([[0.0], np.cumsum(self.phases)]))

    @property
    def duration(self) -> float:
        """Seconds."""
        return float(self.knots[-1])

    def times(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return u: it is time."""
        return u

    def places(self, t: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return t: it is the path variable."""
        return t

    def on_whole(self, u: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the whole nanoseconds (s) next to the times of places, and where it is then."""
        t = whole(u)
        return t, t

    def slowed(self, factor: float) -> StraightMotion:
        """Return the same in about ``factor`` times the time: each phase ends on a whole nanosecond."""
        phases = self.phases * factor
        phases *= [slow_to_whole(phase) for phase in phases.tolist()]
        # the way comes out as one whatever rounding does to the phases
        way = _way(phases, self.jerks)
        return replace(self, phases=phases, jerks=self.jerks / way if way > 0 else self.jerks)

    @cached_property
    def _at_knots(self) -> NDArray[np.float64]:
        """Share of the way, its velocity and acceleration at the knots, (k + 1, 3)."""
        table = np.zeros((len(self.phases) + 1, 3))
        for k, (h, jerk) in enumerate(zip(self.phases, self.jerks, strict=True)):
            x, v, a = table[k]
            table[k + 1] = x + h * (v + h * (a / 2 + h * jerk / 6)), v + h * (a + h * jerk / 2), a + h * jerk
        # rest is exact: what rounding has left of it would be a step in every derivative
        table[-1] = 1.0, 0.0, 0.0
        return table

    def states(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return position, velocity, acceleration and jerk at each u, (4, P, n)."""
        at = np.clip(np.searchsorted(self.knots, u, side="right") - 1, 0, len(self.phases) - 1)
        h = u - self.knots[at]
        (x, v, a), jerk = self._at_knots[at].T, self.jerks[at]
        shares = np.stack([x + h * (v + h * (a / 2 + h * jerk / 6)), v + h * (a + h * jerk / 2), a + h * jerk, jerk])
        ended = u >= self.knots[-1]
        shares[:3, ended] = self._at_knots[-1][:, None]
        states = shares[:, :, None] * self.step
        states[0] += self.start
        return states

    def waypoint(self) -> NDArray[np.float64]:
        """Return where the two waypoints are passed."""
        return np.array([0.0, self.duration])


def straight_motion(
    start: NDArray[np.float64],
    end: NDArray[np.float64],
    limits: MotionLimits,
    *,
    speed: float | None = None,
) -> StraightMotion:
    """Return the fastest motion along a straight line.

    Parameters
    ----------
    start, end : (n,) ndarray
    limits : MotionLimits
    speed : float, optional
        Largest share of the way a second.

    Returns
    -------
    StraightMotion
        One millisecond of rest where there is no way to go.
    """
    step = end - start
    if not np.abs(step).max(initial=0.0) > 0:
        return StraightMotion(start, step, np.array([_STILL]), np.zeros(1))
    moving = np.abs(step) > 0
    V, A, J = (float((row[moving] / np.abs(step[moving])).min()) for row in limits.table)
    V = min(V, np.inf if speed is None else speed)
    ramp, hold, cruise = (float(phase) for phase in _phases(*np.array([V, A, J])))
    if hold < _NO_PHASE:
        ramp, hold = ramp + hold, 0.0
    if cruise < _NO_PHASE:
        ramp, hold, cruise = (ramp, hold + cruise, 0.0) if hold > 0 else (ramp + 0.5 * cruise, 0.0, 0.0)
    ramp = max(ramp, _NO_PHASE)
    phases = np.array([ramp, hold, ramp, cruise, ramp, hold, ramp])
    jerks = np.array([1.0, 0.0, -1.0, 0.0, -1.0, 0.0, 1.0])
    kept = phases > 0
    return StraightMotion(start, step, phases[kept], jerks[kept]).slowed(1 + _SLACK)


def straight_duration(step: NDArray[np.float64], limits: MotionLimits) -> float:
    """Return the seconds that the fastest straight motions along some steps (N, n) take, each from rest to rest."""
    step = np.abs(step[step.any(axis=1)])
    with np.errstate(divide="ignore"):
        V, A, J = ((row / step).min(axis=1) for row in limits.table)
    ramp, hold, cruise = _phases(V, A, J)
    return float((4 * ramp + 2 * hold + cruise).sum()) * (1 + _SLACK)


def _phases(
    V: NDArray[np.float64], A: NDArray[np.float64], J: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return how long jerk, acceleration and speed are held, for limits of the share of the way."""
    full = V * J > A * A
    ramp = np.where(full, A / J, np.sqrt(V / J))
    hold = np.where(full, np.maximum(V / A - ramp, 0.0), 0.0)
    cruise = 1.0 / V - (2 * ramp + hold)
    # without the way to reach full speed: with full acceleration, or without that
    short = 0.5 * (np.sqrt((A / J) ** 2 + 4 / A) - 3 * A / J)
    ramp = np.where(cruise < 0.0, np.where(short < 0.0, np.cbrt(0.5 / J), A / J), ramp)
    hold = np.where(cruise < 0.0, np.maximum(short, 0.0), hold)
    return ramp, hold, np.maximum(cruise, 0.0)


def _way(phases: NDArray[np.float64], jerks: NDArray[np.float64]) -> float:
    """Return the way from rest through phases of constant jerk."""
    x = v = a = 0.0
    for h, jerk in zip(phases.tolist(), jerks.tolist(), strict=True):
        x, v, a = x + h * (v + h * (a / 2 + h * jerk / 6)), v + h * (a + h * jerk / 2), a + h * jerk
    return x
