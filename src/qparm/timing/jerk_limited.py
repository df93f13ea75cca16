"""The timing as Ruckig profiles: jerk-limited from state to state, each from the state that the last one reached.

Ruckig's own intermediate waypoints are never used: in the free package they are sent to a web service. Between two
states of the timing the timing itself is a motion within all limits, so a profile of that duration exists. Ruckig
always takes all the jerk it is given: it gets little more than the timing needs there, and so stays near the path.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from qparm.errors import PackageMissing
from qparm.path import JointPath, Trajectory
from qparm.path.quintic import quintic_coefficients
from qparm.robot.motion_limits import MotionLimits
from qparm.timing.law import PathTiming, time_path, tool_way
from qparm.timing.path_speed import SpeedProfile
from qparm.timing.profile_pieces import ProfilePieces
from qparm.timing.straight import StraightMotion
from qparm.timing.subdivide import (
    Deviation,
    deviation_on,
    looks,
    resting_trajectory,
    shortest_piece,
    spaced,
    split,
    timed_segments,
    tool_deviation,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.robot import SerialChain

__all__ = ["ruckig_form", "ruckig_trajectory"]

# Residues below this make Ruckig fail ("error in step 2"): they are rest.
_REST = 1e-10
# A profile longer than its interval by more than this would be a detour; one over several intervals takes its place,
# or one that is a little later.
_LONGER, _DELAY = 1e-6, 1e-3
_MORE = (1, 2, 3, 4, 6, 8, 12, 16)
# Ruckig gives up beyond 7,600 s.
_LONGEST = 7000.0
# Jerk that Ruckig gets over the largest that the timing has in a piece, and what it gets at least: of the limit, and
# to make up for the 1e-8 by which it misses positions.
_JERK, _MISSED = 1.25, 2e-6
_LEVELS = 12
# Places inside a profile at which it is compared with the path: with three, some were a third farther off in between.
_LOOKS = np.array([0.2, 0.35, 0.5, 0.65, 0.8])
# An arm's trajectory is timed with these shares of its limits of acceleration and jerk, the first that will do:
# controllers interpolate quintically between the phases' borders, and those closer than some microseconds cannot be
# told to them.
_SHARES = ((0.998, 0.95), (0.995, 0.9), (0.99, 0.8))
# On shorter intervals (s) the jerk of such a quintic is rounding; the mean counts.
_SHORT = 1e-4

State = tuple[list[float], list[float], list[float]]
Phases = list[list[tuple[float, float]]]  # for each joint: (duration, jerk)


def ruckig_trajectory(
    chain: SerialChain,
    path: JointPath,
    *,
    feed: float | None = None,
    position: float = 5e-6,
    rotation: float = 20e-6,
    reasons: tuple[str, ...] = (),
) -> Trajectory:
    """Return a joint path timed, as jerk-limited profiles.

    Parameters
    ----------
    chain, path, feed, position, rotation, reasons
        See :func:`qparm.timing.quintic_trajectory`.

    Returns
    -------
    Trajectory

    Raises
    ------
    PackageMissing
        If the package ruckig is not installed.
    """
    if len(path.q) < 2:
        _ruckig()
        return resting_trajectory(path, "ruckig", reasons)
    whole, tool = MotionLimits.of(chain), tool_deviation(chain, position=position, rotation=rotation, feed=feed)
    for acceleration, jerk in _SHARES[:-1]:
        limits = MotionLimits(whole.velocity, acceleration * whole.acceleration, jerk * whole.jerk)
        trajectory = ruckig_form(time_path(path, limits, feed=feed, tool=tool_way(chain)), tool=tool, reasons=reasons)
        if _kept_as_told(trajectory, whole):
            return trajectory
    acceleration, jerk = _SHARES[-1]
    limits = MotionLimits(whole.velocity, acceleration * whole.acceleration, jerk * whole.jerk)
    return ruckig_form(time_path(path, limits, feed=feed, tool=tool_way(chain)), tool=tool, reasons=reasons)


def _kept_as_told(trajectory: Trajectory, limits: MotionLimits) -> bool:
    """Return whether quintics between the phases' borders, as they are told to a controller, keep the limits."""
    from qparm.timing.kernels import quintic_peaks

    t = trajectory.boundaries
    q, v, a = (np.ascontiguousarray(trajectory(t, order)) for order in range(3))
    h, unbounded = np.diff(t), np.full(limits.n, np.inf)
    peaks = np.empty((len(h), limits.n, 5))
    quintic_peaks(q, v, a, h, limits.table, -unbounded, unbounded, peaks)
    short = h < _SHORT
    peaks[short, :, 2] = np.abs(np.diff(a, axis=0)[short]) / h[short, None]
    return bool((peaks[:, :, :3] <= limits.table.T).all())


def ruckig_form(timing: PathTiming, *, tool: Deviation | None = None, reasons: tuple[str, ...] = ()) -> Trajectory:
    """Return a timing as jerk-limited profiles.

    Parameters
    ----------
    timing, tool, reasons
        See :func:`qparm.timing.quintic_form`.

    Returns
    -------
    Trajectory
        Its polynomials are cubic, but for pieces on which Ruckig found only a detour: there they are quintic.

    Raises
    ------
    PackageMissing
        If the package ruckig is not installed.
    """
    ruckig = _ruckig()
    path, n = timing.path, timing.path.n
    calculator = _Calculator(ruckig, timing.limits)
    builder = ProfilePieces(n)
    start: State = path.q[0].tolist(), [0.0] * n, [0.0] * n
    knots = np.zeros(len(path.q))
    for run, motion, at in zip(path.runs, timing.motions, timing.waypoints, strict=True):
        first, last = path.segments[run[0]].first, path.segments[run[-1]].last
        if isinstance(motion, StraightMotion):
            # the timing is such a profile already, phase by phase
            _add_straight(builder, motion)
            start = path.q[last].tolist(), [0.0] * n, [0.0] * n
            knots[first + 1 : last + 1] = knots[first] + at[1:]
            continue
        deviation = deviation_on(path, run, tool)
        u = calculator.borders(motion, at, deviation)
        u, durations, start = calculator.chain(motion, u, start, builder, deviation)
        ends = knots[first] + np.concatenate([[0.0], np.cumsum(durations)])
        passed = np.interp(motion.times(at[1:-1]), motion.times(u), ends)
        knots[first + 1 : last + 1] = np.append(passed, ends[-1])
    return Trajectory(
        joint_names=path.joint_names,
        polynomials=builder.polynomials(),
        knots=knots,
        segments=timed_segments(path, knots),
        timing="ruckig",
        executable=not reasons,
        reasons=reasons,
    )


def _add_straight(builder: ProfilePieces, motion: StraightMotion) -> None:
    states = motion.states(motion.knots)[:3]
    for k, (h, jerk) in enumerate(zip(motion.phases.tolist(), motion.jerks.tolist(), strict=True)):
        builder.add_phases([[(h, jerk * step)] for step in motion.step.tolist()], states[:, k].tolist(), h)


class _Calculator:
    """Ruckig with one arm's limits."""

    def __init__(self, ruckig: Any, limits: MotionLimits) -> None:
        self._limits, self._jerk = limits, limits.jerk.tolist()
        self._generator, self._request = ruckig.Ruckig(limits.n), ruckig.InputParameter(limits.n)
        self._request.max_velocity = limits.velocity.tolist()
        self._request.max_acceleration = limits.acceleration.tolist()
        self._trajectory = lambda: ruckig.Trajectory(limits.n)
        # beyond 7,600 s it is a ValueError
        self._refusals = (ruckig.RuckigError, ValueError)

    def borders(
        self, motion: SpeedProfile, waypoints: NDArray[np.float64], deviation: Deviation
    ) -> NDArray[np.float64]:
        """Return borders in u between which profiles stay on the path."""
        least = 8 * shortest_piece(motion, self._limits)
        u = spaced(motion, waypoints, least)
        good: set[tuple[float, float]] = set()
        for _ in range(_LEVELS):
            t = motion.times(u)
            h = np.diff(t)
            bad = h > _LONGEST
            ends = list(pairwise(u.tolist()))
            new = np.array([pair not in good for pair in ends]) & ~bad
            at = np.flatnonzero(new)
            off = self._off(motion, u, t, at, deviation)
            good.update(ends[k] for k, far in zip(at.tolist(), off.tolist(), strict=True) if far <= 1.0)
            bad[at[(off > 1.0) & (h[at] > least)]] = True
            if not bad.any():
                break
            u = split(u, bad, motion.knots)
        return u

    def _off(
        self, motion: SpeedProfile, u: NDArray[np.float64], t: NDArray[np.float64], at: NDArray[np.int64],
        deviation: Deviation,
    ) -> NDArray[np.float64]:  # fmt: skip
        """Return how far the profiles between some borders are off, each from the timing's own state."""
        if not len(at):
            return np.zeros(0)
        ends = np.stack([u[at], u[at + 1]])
        inner = (ends[0][:, None] + (ends[1] - ends[0])[:, None] * _LOOKS).ravel()
        first, last, between = (motion.states(x) for x in (ends[0], ends[1], inner))
        h = t[at + 1] - t[at]
        jerk = self._jerk_between(first, last, between, h)
        looked = (motion.times(inner).reshape(-1, len(_LOOKS)) - t[at][:, None]).tolist()
        form = np.full((2, len(at), len(_LOOKS), self._limits.n), np.inf)
        starts, targets = _rows(first), _rows(last)
        for k, dt in enumerate(h.tolist()):
            profile = self._profile(starts[k], targets[k], dt, jerk[k])
            if profile is not None:
                form[:, k] = np.array([profile.at_time(x)[:2] for x in looked[k]]).transpose(1, 0, 2)
        refused = ~np.isfinite(form).all(axis=(0, 2, 3))
        path = between[:2].reshape(form.shape)
        form[:, refused] = path[:, refused]
        off = deviation(form.reshape(2, -1, self._limits.n), between[:2]).reshape(-1, len(_LOOKS)).max(axis=1)
        return np.where(refused, np.inf, off)

    def chain(
        self,
        motion: SpeedProfile,
        u: NDArray[np.float64],
        start: State,
        builder: ProfilePieces,
        deviation: Deviation,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], State]:
        """Add the profiles between borders, each from the state reached.

        Returns
        -------
        u : (k + 1,) ndarray
            The borders kept: where there is no profile in time, one goes on over some of those that follow.
        durations : (k,) ndarray
        end : State
        """
        t, states = motion.times(u), motion.states(u)
        h, between = np.diff(t), motion.states(looks(u, _LOOKS))
        jerk = self._jerk_between(states[:, :-1], states[:, 1:], between, h)
        targets = _rows(states[:, 1:])
        kept, durations = [0], []
        while kept[-1] < len(h):
            k = kept[-1]
            end, dt = k + 1, float(h[k])
            profile = self._profile(start, targets[k], dt, jerk[k])
            if profile is None:
                end, profile = self._farther(motion, u, k, start, deviation)
                dt = float(t[end] - t[k])
            if profile is None:
                end = self._gentlest(t, states, k, start)
                dt = float(t[end] - t[k])
                both = np.array([start, targets[end - 1]]).transpose(1, 0, 2)
                builder.add_quintic(quintic_coefficients(both, np.array([dt]))[:, 0], dt)
                start = targets[end - 1]
            else:
                dt = float(profile.duration)
                builder.add_phases(_phases(profile), start, dt)
                start = profile.at_time(dt)
            kept.append(end)
            durations.append(dt)
        return u[kept], np.array(durations), start

    def _farther(
        self, motion: SpeedProfile, u: NDArray[np.float64], k: int, start: State, deviation: Deviation
    ) -> tuple[int, Any | None]:
        """Return up to which border, and how, Ruckig can go on from border k near the path; None if it cannot.

        It misses positions by 1e-8. Where the timing is at a limit that cannot be made up for within one short piece.
        """
        for longer in (_LONGER, _DELAY):
            for more in _MORE:
                end = k + more
                if end >= len(u):
                    break
                ends = u[[k, end]]
                first, last = (motion.states(x) for x in (ends[:1], ends[1:]))
                t = motion.times(ends)
                inner = np.union1d(looks(u[k : end + 1], _LOOKS), u[k + 1 : end])
                between = motion.states(inner)
                jerk = np.abs(np.concatenate([first[3], between[3], last[3]])).max(axis=0)
                dt = float(t[1] - t[0])
                jerk = np.minimum(_JERK * jerk + _MISSED / dt**3, self._limits.jerk)
                profile = self._profile(start, _rows(last)[0], dt, jerk.tolist(), longer=longer)
                if profile is None:
                    continue
                slower = profile.duration / dt
                form = [profile.at_time(x)[:2] for x in ((motion.times(inner) - t[0]) * slower).tolist()]
                if deviation(np.array(form).swapaxes(0, 1), between[:2]).max() <= 1.0:
                    return end, profile
        return k + 1, None

    def _gentlest(self, t: NDArray[np.float64], states: NDArray[np.float64], k: int, start: State) -> int:
        """Return up to which border a quintic from border k takes the least share of the limits."""
        from qparm.timing.kernels import quintic_peaks

        unbounded, best, least = np.full(self._limits.n, np.inf), k + 1, np.inf
        for end in (k + more for more in _MORE if k + more < len(t)):
            q, v, a = (np.stack([start[order], states[order, end]]) for order in range(3))
            peaks = np.empty((1, self._limits.n, 5))
            quintic_peaks(q, v, a, np.array([t[end] - t[k]]), self._limits.table, -unbounded, unbounded, peaks)
            share = float((peaks[0, :, :3] / self._limits.table.T).max())
            if share < least:
                best, least = end, share
        return best

    def _jerk_between(
        self, first: NDArray[np.float64], last: NDArray[np.float64], between: NDArray[np.float64],
        h: NDArray[np.float64],
    ) -> list[list[float]]:  # fmt: skip
        """Return the jerk that each profile may take."""
        largest = np.abs(between[3]).reshape(len(h), len(_LOOKS), -1).max(axis=1)
        largest = np.maximum(largest, np.maximum(np.abs(first[3]), np.abs(last[3])))
        return np.minimum(_JERK * largest + _MISSED / h[:, None] ** 3, self._limits.jerk).tolist()

    def _profile(
        self, start: State, target: State, dt: float, jerk: list[float], *, longer: float = _LONGER
    ) -> Any | None:
        """Return Ruckig's profile; None where it refuses or would take longer."""
        # a NaN would end the process inside Ruckig
        if not all(math.isfinite(sum(part)) for part in (*start, *target)):
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
            if profile.duration <= dt * (1 + longer):
                return profile
        return None


def _rows(states: NDArray[np.float64]) -> list[State]:
    """Return position, velocity and acceleration of each state as lists."""
    return list(zip(*(states[order].tolist() for order in range(3)), strict=True))


def _phases(profile: Any) -> Phases:
    phases = []
    for joint in profile.profiles[0]:
        brake = joint.brake
        both = (*zip(brake.t, brake.j, strict=True), *zip(joint.t, joint.j, strict=True))
        phases.append([(t, j) for t, j in both if t > 0])
    return phases


def _snapped(values: list[float]) -> list[float]:
    return [0.0 if abs(x) < _REST else x for x in values]


def _ruckig() -> Any:
    try:
        import ruckig
    except ImportError:
        raise PackageMissing("ruckig", "--timing quintic") from None
    return ruckig
