"""Ruckig's profiles from state to state, as phases of constant jerk.

Ruckig's own intermediate waypoints are never used: in the free package they are sent to a web service.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from qparm.errors import PackageMissing

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.robot.motion_limits import MotionLimits

__all__ = ["LONGEST", "RuckigProfiles", "load_ruckig"]

# Residues below this make Ruckig fail ("error in step 2"): they are rest.
_REST = 1e-10
# A profile longer than its interval by more than this would be a detour.
_LONGER = 1e-6
# Ruckig gives up beyond 7,600 s.
LONGEST = 7000.0
# The most phases that a joint has: two of a brake, and seven.
_PHASES = 9


def load_ruckig() -> Any:
    """Return the package.

    Raises
    ------
    PackageMissing
        If it is not installed.
    """
    try:
        import ruckig
    except ImportError:
        raise PackageMissing("ruckig", "--timing quintic") from None
    return ruckig


class RuckigProfiles:
    """Ruckig with the limits of n joints."""

    def __init__(self, limits: MotionLimits) -> None:
        ruckig = load_ruckig()
        self._jerk = limits.jerk.tolist()
        self._generator, self._request = ruckig.Ruckig(limits.n), ruckig.InputParameter(limits.n)
        self._request.max_velocity = limits.velocity.tolist()
        self._request.max_acceleration = limits.acceleration.tolist()
        self._trajectory = lambda: ruckig.Trajectory(limits.n)
        # beyond 7,600 s it is a ValueError
        self._refusals = (ruckig.RuckigError, ValueError)

    def phases(
        self, first: NDArray[np.float64], last: NDArray[np.float64], duration: NDArray[np.float64],
        jerk: NDArray[np.float64],
    ) -> tuple[NDArray[np.bool_], NDArray[np.float64], NDArray[np.float64]]:  # fmt: skip
        """Return profiles between states.

        Parameters
        ----------
        first, last : (3, P, n) ndarray
        duration : (P,) ndarray
            s.
        jerk : (P, n) ndarray
            What each may take, to begin with.

        Returns
        -------
        found : (P,) ndarray of bool
            Whether Ruckig has one of that duration.
        ends, jerks : (P, n, 9) ndarray
            When phases end (s), the last for good; their jerks.
        """
        P, n = jerk.shape
        found, ends, jerks = np.zeros(P, dtype=bool), np.zeros((P, n, _PHASES)), np.zeros((P, n, _PHASES))
        starts, targets, allowed = first.swapaxes(0, 1).tolist(), last.swapaxes(0, 1).tolist(), jerk.tolist()
        for k, dt in enumerate(duration.tolist()):
            profile = self._profile(starts[k], targets[k], dt, allowed[k])
            if profile is None:
                continue
            found[k] = True
            for i, joint in enumerate(profile.profiles[0]):
                brake = joint.brake
                ends[k, i] = (*brake.t, *joint.t)
                jerks[k, i] = (*brake.j, *joint.j)
        return found, np.cumsum(ends, axis=2), jerks

    def _profile(self, start: Any, target: Any, dt: float, jerk: list[float]) -> Any | None:
        """Return Ruckig's profile; None where it refuses or would take longer."""
        # a NaN would end the process inside Ruckig
        if dt > LONGEST or not all(math.isfinite(sum(part)) for part in (*start, *target)):
            return None
        request = self._request
        request.current_position = start[0]
        request.current_velocity = _snapped(start[1])
        request.current_acceleration = _snapped(start[2])
        request.target_position = target[0]
        request.target_velocity = _snapped(target[1])
        request.target_acceleration = _snapped(target[2])
        request.minimum_duration = dt
        profile = self._trajectory()
        for bound in (jerk, self._jerk):
            request.max_jerk = bound
            try:
                self._generator.calculate(request, profile)
            except self._refusals:
                continue
            if profile.duration <= dt * (1 + _LONGER):
                return profile
        return None


def _snapped(values: list[float]) -> list[float]:
    return [0.0 if abs(x) < _REST else x for x in values]
