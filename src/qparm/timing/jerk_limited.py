"""Ruckig timing: jerk-limited profiles from state to state, through the states of the quintic timing.

Ruckig's own intermediate waypoints are never used: in the free package they are sent to a web service.
Between two waypoints the quintic is itself a motion within all limits that takes the time dt, so a
jerk-limited profile of that duration exists between the same two states. Each segment starts from the
state the last one reached; runs that start and end at rest with nothing in between (approach, break,
retract) are time-optimal.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from qparm.errors import PackageMissing
from qparm.path import JointPath, Trajectory
from qparm.timing.quintic import quintic_coefficients, quintic_timing, resting_trajectory, timed_segments

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.robot import SerialChain

__all__ = ["ruckig_trajectory"]

# Residues below this make Ruckig fail ("error in step 2"): they are rest.
_REST = 1e-10
# A profile longer than its interval by more than this would be a detour; the quintic takes its place.
_LONGER = 1e-6
# Ruckig gets this share of the jerk limits; the rest is for controllers that interpolate quintically between the
# phase boundaries, of which those closer than a few hundred microseconds cannot all be told to them.
_JERK_SHARE = 0.95
# Ruckig gives up beyond this duration (s).
_LONGEST = 7600.0


def ruckig_trajectory(chain: SerialChain, path: JointPath, *, feed: float, reasons: tuple[str, ...] = ()) -> Trajectory:
    """Return the jerk-limited trajectory through all waypoints of a joint path.

    Parameters
    ----------
    chain, path, feed
        See :func:`qparm.timing.quintic_timing`.
    reasons : tuple of str
        Why the trajectory must not be executed as it is; empty if it may.

    Returns
    -------
    Trajectory
        Its polynomials are cubic, but for intervals on which Ruckig found only a detour or would leave a
        position limit: there they are the quintic's.

    Raises
    ------
    PackageMissing
        If the package ruckig is not installed.
    """
    try:
        import ruckig
    except ImportError:
        raise PackageMissing("ruckig", "use --timing quintic") from None
    if len(path.q) < 2:
        return resting_trajectory(path, "ruckig", reasons)
    chain = replace(chain, joints=tuple(replace(joint, jerk=_JERK_SHARE * joint.jerk) for joint in chain.joints))
    timing = quintic_timing(chain, path, feed=feed)
    n = path.n
    generator = ruckig.Ruckig(n)
    alone = {segment.first for segment in path.segments if segment.last == segment.first + 1}
    # near the workpiece only the quintics keep to the curve: Ruckig's profiles swing to either side of it
    curved = {
        k
        for segment in path.segments
        if not segment.process_on and segment.last > segment.first + 1
        for k in range(segment.first, segment.last)
    }
    builder = _Builder(n)
    q, v, a = path.q[0].copy(), np.zeros(n), np.zeros(n)
    knots = np.empty(len(path.q))
    knots[0] = 0.0
    for k, dt in enumerate(timing.dt):
        target = path.q[k + 1], timing.velocity[k + 1], timing.acceleration[k + 1]
        profile = None
        if k not in curved:
            profile = _profile(ruckig, generator, chain, (q, v, a), target, None if k in alone else float(dt))
        if profile is None:
            coefficients = quintic_coefficients(q, v, a, *target, dt)
            builder.add_quintic(coefficients, dt)
            q, v, a = (np.array(x, dtype=float) for x in target)
            knots[k + 1] = knots[k] + dt
        else:
            duration, phases = profile
            q, v, a = builder.add_phases(phases, q, v, a, duration)
            knots[k + 1] = knots[k] + duration
    return Trajectory(
        joint_names=path.joint_names,
        polynomials=builder.polynomials(),
        knots=knots,
        segments=timed_segments(path, knots),
        timing="ruckig",
        executable=not reasons,
        reasons=reasons,
    )


State = tuple["NDArray[np.float64]", "NDArray[np.float64]", "NDArray[np.float64]"]
Phases = list[list[tuple[float, float]]]  # for each joint: (duration, jerk)


def _profile(
    ruckig: Any, generator: Any, chain: SerialChain, start: State, target: State, dt: float | None
) -> tuple[float, Phases] | None:
    """Return duration and phases of Ruckig's profile; None where the quintic must take its place."""
    n = chain.n
    if not all(np.isfinite(x).all() for x in (*start, *target)) or (dt is not None and dt > _LONGEST):
        return None  # a NaN would end the process inside Ruckig
    request = ruckig.InputParameter(n)
    request.current_position = start[0].tolist()
    request.current_velocity = _snapped(start[1])
    request.current_acceleration = _snapped(start[2])
    request.target_position = target[0].tolist()
    request.target_velocity = _snapped(target[1])
    request.target_acceleration = _snapped(target[2])
    request.max_velocity = chain.velocity.tolist()
    request.max_acceleration = chain.acceleration.tolist()
    request.max_jerk = chain.jerk.tolist()
    if dt is not None:
        request.minimum_duration = dt
    else:
        # from rest to rest all joints share one profile: a straight line in joint space, as it was planned
        request.synchronization = ruckig.Synchronization.Phase
    profile = ruckig.Trajectory(n)
    try:
        generator.calculate(request, profile)
    except (ruckig.RuckigError, ValueError):  # beyond 7,600 s it is a ValueError
        return None
    duration = float(profile.duration)
    if dt is not None and duration > dt * (1 + _LONGER):
        return None
    for joint, extrema in enumerate(profile.position_extrema):
        if extrema.min < chain.lower[joint] - 1e-9 or extrema.max > chain.upper[joint] + 1e-9:
            return None
    phases = []
    for joint_profile in profile.profiles[0]:
        brake, main = joint_profile.brake, joint_profile
        # what is left after a joint's last phase is rest at its target
        phases.append(
            [(t, j) for t, j in (*zip(brake.t, brake.j, strict=True), *zip(main.t, main.j, strict=True)) if t > 0]
        )
    return duration, phases


def _snapped(values: NDArray[np.float64]) -> list[float]:
    return np.where(np.abs(values) < _REST, 0.0, values).tolist()


class _Builder:
    """Collects polynomial pieces joint by joint; the breaks of the joints differ."""

    def __init__(self, n: int) -> None:
        self._breaks: list[list[float]] = [[0.0] for _ in range(n)]
        self._pieces: list[list[NDArray[np.float64]]] = [[] for _ in range(n)]

    def add_quintic(self, coefficients: NDArray[np.float64], dt: float) -> None:
        for i, (breaks, pieces) in enumerate(zip(self._breaks, self._pieces, strict=True)):
            breaks.append(breaks[-1] + dt)
            pieces.append(coefficients[:, i])

    def add_phases(
        self,
        phases: Phases,
        q: NDArray[np.float64],
        v: NDArray[np.float64],
        a: NDArray[np.float64],
        duration: float,
    ) -> State:
        """Integrate constant-jerk phases from a state and return the state they end in."""
        end = np.empty((3, len(phases)))
        for i, joint_phases in enumerate(phases):
            breaks, pieces = self._breaks[i], self._pieces[i]
            start = breaks[-1]
            p_i, v_i, a_i, elapsed = float(q[i]), float(v[i]), float(a[i]), 0.0
            for index, (t, j) in enumerate(joint_phases):
                if index == len(joint_phases) - 1:
                    t = duration - elapsed
                if t <= 0:
                    continue
                pieces.append(np.array([0.0, 0.0, j / 6, a_i / 2, v_i, p_i]))
                p_i += t * (v_i + t * (a_i / 2 + t * j / 6))
                v_i += t * (a_i + t * j / 2)
                a_i += t * j
                elapsed += t
                breaks.append(start + elapsed)
            if elapsed < duration:
                pieces.append(np.array([0.0, 0.0, 0.0, a_i / 2, v_i, p_i]))
                p_i += (duration - elapsed) * (v_i + (duration - elapsed) * a_i / 2)
                breaks.append(start + duration)
            breaks[-1] = start + duration
            end[:, i] = p_i, v_i, a_i
        return end[0], end[1], end[2]

    def polynomials(self) -> tuple[Any, ...]:
        from scipy.interpolate import PPoly

        return tuple(
            PPoly(np.ascontiguousarray(np.array(pieces).T), np.array(breaks))
            for breaks, pieces in zip(self._breaks, self._pieces, strict=True)
        )
