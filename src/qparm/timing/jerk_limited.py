"""The timing as Ruckig profiles: jerk-limited from state to state, each from the state that the last one reached.

Ruckig's own intermediate waypoints are never used: in the free package they are sent to a web service. Between two
states of the timing the timing itself is a motion within all limits, so a profile of that duration exists. Ruckig
always takes all the jerk it is given: it gets little more than the timing needs there, and so stays near the path.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from qparm.errors import PackageMissing
from qparm.path import JointPath, SegmentKind, Trajectory
from qparm.robot.motion_limits import MotionLimits
from qparm.timing.law import Motion, PathTiming, time_path
from qparm.timing.profile_pieces import ProfilePieces
from qparm.timing.quintic import quintic_coefficients
from qparm.timing.straight import StraightMotion
from qparm.timing.subdivide import (
    LOOKS,
    Deviation,
    joint_deviation,
    looks,
    resting_trajectory,
    shortest_piece,
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
# A profile longer than its interval by more than this would be a detour; the quintic takes its place.
_LONGER = 1e-6
# Ruckig gives up beyond 7,600 s.
_LONGEST = 7000.0
# Jerk that Ruckig gets over the largest that the timing has in a piece, and what it gets at least: of the limit, and
# to make up for the 1e-8 by which it misses positions.
_JERK, _MISSED = 1.25, 2e-6
_LEVELS = 12
# An arm's trajectory is timed with these shares of its limits of acceleration and jerk: controllers interpolate
# quintically between the phases' borders, and those closer than some microseconds cannot be told to them.
_SHARES = (1.0, 0.998, 0.95)

State = tuple["NDArray[np.float64]", "NDArray[np.float64]", "NDArray[np.float64]"]
Phases = list[list[tuple[float, float]]]  # for each joint: (duration, jerk)


def ruckig_trajectory(
    chain: SerialChain, path: JointPath, *, feed: float | None = None, reasons: tuple[str, ...] = ()
) -> Trajectory:
    """Return a joint path timed, as jerk-limited profiles.

    Parameters
    ----------
    chain, path, feed, reasons
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
    limits = MotionLimits(*(share * row for share, row in zip(_SHARES, MotionLimits.of(chain).table, strict=True)))
    timing = time_path(path, limits, feed=feed)
    return ruckig_form(timing, tool=tool_deviation(chain), reasons=reasons)


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
    generator = ruckig.Ruckig(n)
    builder = ProfilePieces(n)
    start = path.q[0].copy(), np.zeros(n), np.zeros(n)
    knots = np.zeros(len(path.q))
    for index, segment in enumerate(path.segments):
        motion, at = timing.motions[index], timing.waypoints[index]
        on_path = tool is not None and segment.kind in (SegmentKind.ROW, SegmentKind.TRANSITION)
        deviation = tool if on_path and tool is not None else joint_deviation
        chained = _Chain(ruckig, generator, motion, timing.limits, start)
        if isinstance(motion, StraightMotion):
            # the timing is such a profile already, phase by phase
            u, pieces = motion.knots, [_constant_jerk(motion, k) for k in range(len(motion.phases))]
        else:
            u, pieces = chained.subdivided(np.unique(at), deviation)
        ends = np.empty(len(pieces))
        elapsed = knots[segment.first]
        for k, (duration, phases, states) in enumerate(pieces):
            elapsed += duration
            ends[k] = elapsed
            if phases is None:
                builder.add_quintic(quintic_coefficients(states, np.array([duration]))[:, 0], duration)
            else:
                builder.add_phases(phases, states[:, 0], duration)
        start = chained.end
        if isinstance(motion, StraightMotion):
            start = path.q[segment.last].copy(), np.zeros(n), np.zeros(n)
            knots[segment.first + 1 : segment.last + 1] = knots[segment.first] + at[1:]
            knots[segment.last] = elapsed
        else:
            knots[segment.first + 1 : segment.last + 1] = ends[np.searchsorted(u, at[1:]) - 1]
    return Trajectory(
        joint_names=path.joint_names,
        polynomials=builder.polynomials(),
        knots=knots,
        segments=timed_segments(path, knots),
        timing="ruckig",
        executable=not reasons,
        reasons=reasons,
    )


# Duration, phases of each joint (none: a quintic), and the states at both ends (3, 2, n).
Piece = tuple[float, "Phases | None", "NDArray[np.float64]"]


def _constant_jerk(motion: StraightMotion, k: int) -> Piece:
    states = motion.states(motion.knots[k : k + 2])[:3]
    h = float(motion.phases[k])
    return h, [[(h, float(motion.jerks[k] * step))] for step in motion.step], states


class _Chain:
    """Profiles of one segment, one after the other."""

    def __init__(self, ruckig: Any, generator: Any, motion: Motion, limits: MotionLimits, start: State) -> None:
        self._ruckig, self._generator = ruckig, generator
        self._motion, self._limits, self._start = motion, limits, start
        self.end = start

    def subdivided(self, u: NDArray[np.float64], deviation: Deviation) -> tuple[NDArray[np.float64], list[Piece]]:
        """Return borders and pieces such that every piece stays on the path."""
        motion, n = self._motion, self._limits.n
        least = 4 * shortest_piece(motion, self._limits)
        for level in range(_LEVELS):
            t = motion.times(u)
            h = np.diff(t)
            long = h > _LONGEST
            if long.any():
                u = split(u, long, motion.knots)
                continue
            pieces, positions = self._pieces(u, t)
            off = deviation(positions.reshape(-1, n), motion.states(looks(u))[0]).reshape(-1, len(LOOKS)).max(axis=1)
            bad = (off > 1.0) & (h > 2 * least)
            if not bad.any() or level == _LEVELS - 1:
                return u, pieces
            u = split(u, bad, motion.knots)
        raise AssertionError("the last level returns")

    def _pieces(self, u: NDArray[np.float64], t: NDArray[np.float64]) -> tuple[list[Piece], NDArray[np.float64]]:
        """Return the pieces between borders, and the positions they pass at the places looked at."""
        states = self._motion.states(u)
        h = np.diff(t)
        inner = looks(u)
        between = np.abs(self._motion.states(inner)[3]).reshape(len(h), len(LOOKS), -1).max(axis=1)
        ends = np.abs(states[3])
        limit = self._limits.jerk
        jerk = _JERK * np.maximum(np.maximum(between, ends[1:]), ends[:-1])
        jerk = np.minimum(jerk + _MISSED / h[:, None] ** 3, limit)
        at = (self._motion.times(inner).reshape(-1, len(LOOKS)) - t[:-1, None]).tolist()
        positions = np.empty((len(h), len(LOOKS), self._limits.n))
        pieces: list[Piece] = []
        state = self._start
        for k, dt in enumerate(h.tolist()):
            target = states[0, k + 1], states[1, k + 1], states[2, k + 1]
            profile = self._profile(state, target, dt, jerk[k])
            before = np.stack(state)
            if profile is None:
                both = np.stack([before, np.stack(target)], axis=1)
                pieces.append((dt, None, both))
                c = quintic_coefficients(both, np.array([dt]))[:, 0]
                for m, x in enumerate(at[k]):
                    positions[k, m] = [np.polyval(c[:, i], x) for i in range(self._limits.n)]
                state = target
                continue
            for m, x in enumerate(at[k]):
                positions[k, m] = profile.at_time(x)[0]
            duration = float(profile.duration)
            reached = tuple(np.array(part) for part in profile.at_time(duration))
            state = reached[0], reached[1], reached[2]
            pieces.append((duration, _phases(profile), np.stack([before, np.stack(state)], axis=1)))
        self.end = state
        return pieces, positions

    def _profile(self, start: State, target: State, dt: float, jerk: NDArray[np.float64]) -> Any | None:
        """Return Ruckig's profile; None where it refuses or would take longer."""
        if not all(np.isfinite(x).all() for x in (*start, *target)):
            return None  # a NaN would end the process inside Ruckig
        ruckig, n = self._ruckig, self._limits.n
        request = ruckig.InputParameter(n)
        request.current_position = start[0].tolist()
        request.current_velocity = _snapped(start[1])
        request.current_acceleration = _snapped(start[2])
        request.target_position = target[0].tolist()
        request.target_velocity = _snapped(target[1])
        request.target_acceleration = _snapped(target[2])
        request.max_velocity = self._limits.velocity.tolist()
        request.max_acceleration = self._limits.acceleration.tolist()
        request.minimum_duration = dt
        profile = ruckig.Trajectory(n)
        for bound in (jerk, self._limits.jerk):
            request.max_jerk = bound.tolist()
            try:
                self._generator.calculate(request, profile)
            except (ruckig.RuckigError, ValueError):  # beyond 7,600 s it is a ValueError
                continue
            if float(profile.duration) <= dt * (1 + _LONGER):
                return profile
        return None


def _phases(profile: Any) -> Phases:
    phases = []
    for joint in profile.profiles[0]:
        brake = joint.brake
        both = (*zip(brake.t, brake.j, strict=True), *zip(joint.t, joint.j, strict=True))
        phases.append([(t, j) for t, j in both if t > 0])
    return phases


def _snapped(values: NDArray[np.float64]) -> list[float]:
    return np.where(np.abs(values) < _REST, 0.0, values).tolist()


def _ruckig() -> Any:
    try:
        import ruckig
    except ImportError:
        raise PackageMissing("ruckig", "use --timing quintic") from None
    return ruckig
