"""The timing as Ruckig profiles: jerk-limited from state to state of the timing.

Between two states of the timing the timing itself is a motion within all limits, so a profile of that duration exists.
Ruckig always takes all the jerk it is given: it gets little more than the timing needs there, and so stays near the
path. Its phases are moved onto times that a file can tell apart, and each piece is looked at as it will be read from
there: one that leaves a limit or the path is halved, and where halves would be too short, quintics take its place.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from qparm.path import JointPath, Trajectory
from qparm.path.quintic import quintic_coefficients
from qparm.robot.motion_limits import MotionLimits
from qparm.timing.law import Motion, PathTiming, time_path, tool_way
from qparm.timing.path_speed import SpeedProfile
from qparm.timing.phase_grid import GridPhases, grid_phases
from qparm.timing.profile_pieces import ProfilePieces
from qparm.timing.quintic import SLOWED, QuinticRun
from qparm.timing.ruckig_profiles import LONGEST, RuckigProfiles, load_ruckig
from qparm.timing.straight import StraightMotion
from qparm.timing.subdivide import (
    Deviation,
    deviation_on,
    resting_trajectory,
    spaced,
    split,
    timed_segments,
    tool_deviation,
)
from qparm.timing.ticks import SHORT, jerk_of_rounding, shortest_pieces, whole

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.robot import SerialChain

__all__ = ["ruckig_form", "ruckig_trajectory"]

# Jerk that Ruckig gets over the largest that the timing has in a piece, and what it gets at least: of the limit, and
# to make up for the 1e-8 by which it misses positions.
_JERK, _MISSED = 1.25, 2e-6
_LEVELS = 12
# Places inside a profile at which it is compared with the path: with nine, its speed was off by half as much again in
# between, where a phase ends.
_LOOKS = np.linspace(0.05, 0.95, 19)
# An arm's trajectory is timed with these shares of its limits of acceleration and jerk: phases moved to other times
# take a little more.
_ACCELERATION, _JERK_SHARE = 0.998, 0.95
# The shortest piece, over one in which rounding makes a millionth of a jerk limit, and the shortest phase over it:
# there it makes a thousandth.
_PIECE, _PHASE = 8.0, 0.1
# Largest share of a limit, and how many times over what rounding makes of jerk must find room below it.
_KEPT, _SURE = 1 - 5e-6, 2.0
# Phases are not moved onto fewer steps than this; none is shorter than the last (s).
_LEAST_CELLS, _NO_PHASE = 8, 5e-10
# Pieces looked at together: what they take in memory stays small.
_CHUNK = 256


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
    load_ruckig()
    if len(path.q) < 2:
        return resting_trajectory(path, "ruckig", reasons)
    whole_limits = MotionLimits.of(chain)
    aimed = MotionLimits(
        whole_limits.velocity, _ACCELERATION * whole_limits.acceleration, _JERK_SHARE * whole_limits.jerk
    )
    tool = tool_deviation(chain, position=position, rotation=rotation, feed=feed)
    return ruckig_form(
        time_path(path, aimed, feed=feed, tool=tool_way(chain)), tool=tool, limits=whole_limits,
        bounds=np.stack([chain.lower, chain.upper]), reasons=reasons,
    )  # fmt: skip


def ruckig_form(
    timing: PathTiming, *, tool: Deviation | None = None, limits: MotionLimits | None = None,
    bounds: NDArray[np.float64] | None = None, reasons: tuple[str, ...] = (),
) -> Trajectory:  # fmt: skip
    """Return a timing as jerk-limited profiles.

    Parameters
    ----------
    timing, tool, bounds, reasons
        See :func:`qparm.timing.quintic_form`.
    limits : MotionLimits, optional
        What the form must keep; by default the timing's own limits.

    Returns
    -------
    Trajectory
        Its polynomials are cubic, but where no profile keeps to the path and the limits: there they are quintic.

    Raises
    ------
    PackageMissing
        If the package ruckig is not installed.
    """
    load_ruckig()
    path = timing.path
    limits = timing.limits if limits is None else limits
    builder = ProfilePieces(path.n)
    profiles = RuckigProfiles(timing.limits)
    knots = np.zeros(len(path.q))
    for run, motion, at in zip(path.runs, timing.motions, timing.waypoints, strict=True):
        first, last = path.segments[run[0]].first, path.segments[run[-1]].last
        form = _Run(QuinticRun(limits, deviation_on(path, run, tool), float(knots[first]), bounds), profiles)
        knots[first + 1 : last + 1] = form.add(motion, at, builder)
    return Trajectory(
        joint_names=path.joint_names,
        polynomials=builder.polynomials(),
        knots=knots,
        segments=timed_segments(path, knots),
        timing="ruckig",
        executable=not reasons,
        reasons=reasons,
    )


@dataclass(frozen=True, eq=False)
class _Piece:
    """A profile: phases (duration, jerk) of each joint, the state (3, n) in which they begin, and how long it takes."""

    phases: list[list[tuple[float, float]]]
    start: NDArray[np.float64]
    duration: float


@dataclass(frozen=True, eq=False)
class _Run:
    """What the pieces between two stops are held to, and who makes them."""

    quintics: QuinticRun
    profiles: RuckigProfiles

    def add(self, motion: Motion, waypoints: NDArray[np.float64], builder: ProfilePieces) -> NDArray[np.float64]:
        """Add the pieces of one run; return when all waypoints but the first are passed (s)."""
        if isinstance(motion, StraightMotion):
            # the timing is such a profile already, phase by phase
            coefficients, ends, passed = self.quintics.pieces(motion, waypoints)
            for k, h in enumerate(np.diff(ends, prepend=self.quintics.start).tolist()):
                builder.add_quintic(coefficients[:, k], h)
            return passed
        attempts = SLOWED
        while True:
            passed = whole(motion.times(waypoints[1:]))
            u, good = self._borders(motion, waypoints)
            instead: dict[int, tuple[NDArray[np.float64], NDArray[np.float64]]] = {}
            stretch, attempts = 1.0, attempts - 1
            for k, ends in enumerate(pairwise(u.tolist())):
                if ends not in good:
                    t, at = motion.on_whole(self.quintics.halved(motion, u[k : k + 2]))
                    instead[k] = t, motion.states(at)[:3]
                    stretch = max(stretch, self.quintics.stretch(instead[k][1], t, passed))
            if stretch <= 1.0 or not attempts:
                break
            motion = motion.slowed(stretch)
        for k, ends in enumerate(pairwise(u.tolist())):
            if k not in instead:
                builder.add_phases(good[ends].phases, good[ends].start.tolist(), good[ends].duration)
                continue
            t, states = instead[k]
            coefficients = quintic_coefficients(states, np.diff(t))
            for m, h in enumerate(np.diff(t).tolist()):
                builder.add_quintic(coefficients[:, m], h)
        return whole(self.quintics.start + passed)

    def _borders(
        self, motion: SpeedProfile, waypoints: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], dict[tuple[float, float], _Piece]]:
        """Return borders in u, and the profiles between those that have one."""
        clock, jerk = self.quintics.start + motion.duration, self.quintics.limits.jerk
        distinct = np.unique(waypoints)
        u = spaced(motion, waypoints, _PIECE * shortest_pieces(motion.states(distinct), jerk, clock))
        good: dict[tuple[float, float], _Piece] = {}
        bad: set[tuple[float, float]] = set()
        for level in range(_LEVELS):
            t, at = motion.on_whole(u)
            h, ends = np.diff(t), list(pairwise(u.tolist()))
            least = shortest_pieces(motion.states(at), jerk, clock)
            least = np.maximum(least[:-1], least[1:])
            long = h > LONGEST
            new = np.array([pair not in good and pair not in bad for pair in ends]) & ~long
            # a waypoint inside a piece is written too: between phases' ends it may come too near to one
            new &= np.searchsorted(distinct, u[1:]) - np.searchsorted(distinct, u[:-1], side="right") < 1
            which = np.flatnonzero(new)
            for chunk in np.split(which, range(_CHUNK, len(which), _CHUNK)):
                for k, piece in zip(chunk.tolist(), self._made(motion, t, at, chunk), strict=True):
                    if piece is not None:
                        good[ends[k]] = piece
            halved = np.array([pair not in good and pair not in bad for pair in ends]) & (h > 2 * _PIECE * least)
            bad.update(pair for pair, half in zip(ends, halved.tolist(), strict=True) if not half and pair not in good)
            if not halved.any() or level == _LEVELS - 1:
                break
            u = split(u, halved, motion.knots)
        return u, good

    def _made(
        self, motion: SpeedProfile, t: NDArray[np.float64], at: NDArray[np.float64], which: NDArray[np.int64]
    ) -> list[_Piece | None]:
        """Return the profiles after some borders, each from the timing's own state; None where one will not do."""
        made: list[_Piece | None] = [None] * len(which)
        limits, clock = self.quintics.limits, self.quintics.start + motion.duration
        first, last, h = motion.states(at[which]), motion.states(at[which + 1]), whole(t[which + 1] - t[which])
        inner = at[which][:, None] + (at[which + 1] - at[which])[:, None] * _LOOKS
        between = motion.states(inner.ravel()).reshape(4, *inner.shape, limits.n)
        largest = np.abs(np.concatenate([between[3], first[3][:, None], last[3][:, None]], axis=1)).max(axis=1)
        asked = np.minimum(_JERK * largest + _MISSED / h[:, None] ** 3, limits.jerk)
        cells = (h / np.maximum(_PHASE * shortest_pieces(first, limits.jerk, clock), SHORT)).astype(np.int64)
        found, ends, jerks = self.profiles.phases(first[:3], last[:3], h, asked)
        kept = np.flatnonzero(found & (cells >= _LEAST_CELLS))
        if not len(kept):
            return made
        phases = grid_phases(ends[kept], jerks[kept], (first[:3, kept], last[:3, kept]), h[kept], cells[kept])
        looked = (motion.times(inner.ravel()).reshape(inner.shape) - t[which][:, None])[kept]
        form = phases.states(looked)[:2].reshape(2, -1, limits.n)
        off = self.quintics.deviation(form, between[:2, kept].reshape(2, -1, limits.n)).reshape(looked.shape)
        good = (off.max(axis=1) <= 1.0) & (self._shares(phases, clock) <= _KEPT)
        lengths = np.diff(phases.ends, axis=2, prepend=0.0)
        for k in np.flatnonzero(good).tolist():
            joints = [
                [(length, jerk) for length, jerk in zip(*pair, strict=True) if length > _NO_PHASE]
                for pair in zip(lengths[k].tolist(), phases.jerks[k].tolist(), strict=True)
            ]
            made[kept[k]] = _Piece(joints, first[:3, kept[k]], float(h[kept[k]]))
        return made

    def _shares(self, phases: GridPhases, clock: float) -> NDArray[np.float64]:
        """Return the largest share of a limit that each piece takes as it is read from a file, (P,).

        Infinity where one leaves position limits.
        """
        times = [phases.times(k) for k in range(len(phases.ends))]
        count = np.array([len(one) for one in times])
        padded = np.stack([np.pad(one, (0, count.max() - len(one)), mode="edge") for one in times])
        states = phases.states(padded)
        states[:, np.arange(len(count)), count - 1] = phases.states(phases.duration[:, None])[:, :, 0]
        real = np.arange(count.max()) < count[:, None]
        flat, h = states[:, real], np.diff(padded[real])
        # from one piece to the next there is nothing
        inside = h > 0
        h[~inside] = 1.0
        shares, outside = self.quintics.shares(flat, h)
        shares[:, 2] += _SURE * jerk_of_rounding(flat, h, self.quintics.limits.jerk, clock)
        worst = np.where(inside, np.where(outside, np.inf, shares.max(axis=1)), 0.0)
        return np.maximum.reduceat(np.append(worst, 0.0), np.append(0, np.cumsum(count)[:-1]))
