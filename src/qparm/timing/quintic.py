"""The timing as quintic polynomials: between states that are the path's own, so C2, and at rest at stops.

Pieces begin and end on whole nanoseconds, in the path's own states at these times: so a file holds what was looked at
here. A piece is halved until it keeps the limits and stays on the path, but not so far that rounding would take more
of a limit than it does. What then is left over, some hundred thousandths, is taken out by slowing the whole run.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from qparm.path import JointPath, Trajectory
from qparm.path.quintic import quintic_coefficients
from qparm.robot import SerialChain
from qparm.robot.motion_limits import MotionLimits
from qparm.timing.law import Motion, PathTiming, time_path, tool_way
from qparm.timing.straight import StraightMotion
from qparm.timing.subdivide import (
    Deviation,
    deviation_on,
    looks,
    resting_trajectory,
    spaced,
    split,
    timed_segments,
    tool_deviation,
)
from qparm.timing.ticks import SHORT, jerk_of_rounding, shortest_pieces, whole

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["SLOWED", "QuinticRun", "quintic_form", "quintic_trajectory"]

_LEVELS = 24
# Places inside a piece at which it is compared with the path.
_LOOKS = np.array([0.2, 0.5, 0.8])
# Share of the deviation allowed: a quintic that is near the path keeps the speed, too.
_OFF = 1 / 3
# Largest share of a limit, and how many times over what rounding makes of jerk must find room below it.
_KEPT, _SURE = 1 - 5e-6, 2.0
# A piece is halved if rounding makes no more than this of a jerk limit in its halves; however short, if it exceeds a
# limit by so many times what rounding makes there: where waypoints lie milliseconds apart jerk swings inside one piece,
# by a quarter of its limit and more.
_ROUNDING, _OVER_ROUNDING = 1e-6, 10.0
# How far a position may be outside its limits: rounding (m, rad).
_OUTSIDE = 5e-10
# Times that a run is slowed: each takes out all that is known to be left over.
SLOWED = 4


def quintic_trajectory(
    chain: SerialChain,
    path: JointPath,
    *,
    feed: float | None = None,
    position: float = 5e-6,
    rotation: float = 20e-6,
    reasons: tuple[str, ...] = (),
) -> Trajectory:
    """Return a joint path timed, as quintics.

    Parameters
    ----------
    chain : SerialChain
        Gives the limits and the tool's place.
    path : JointPath
    feed : float, optional
        Of the tool on rows (m/s).
    position, rotation : float
        How far the tool may be off its path on rows and transitions (m, rad); the form keeps to six tenths of it.
    reasons : tuple of str
        Why the trajectory must not be executed as it is; empty if it may.

    Returns
    -------
    Trajectory
    """
    if len(path.q) < 2:
        return resting_trajectory(path, "quintic", reasons)
    timing = time_path(path, MotionLimits.of(chain), feed=feed, tool=tool_way(chain))
    return quintic_form(
        timing, tool=tool_deviation(chain, position=position, rotation=rotation, feed=feed),
        bounds=np.stack([chain.lower, chain.upper]), reasons=reasons,
    )  # fmt: skip


def quintic_form(
    timing: PathTiming, *, tool: Deviation | None = None, bounds: NDArray[np.float64] | None = None,
    reasons: tuple[str, ...] = (),
) -> Trajectory:  # fmt: skip
    """Return a timing as quintics.

    Parameters
    ----------
    timing : PathTiming
    tool : callable, optional
        How far configurations are from each other on rows and transitions; elsewhere, and without it, joints are
        compared.
    bounds : (2, n) ndarray, optional
        Lower and upper position limits (m, rad).
    reasons : tuple of str

    Returns
    -------
    Trajectory
    """
    from scipy.interpolate import PPoly

    path = timing.path
    pieces, times, knots = [], [0.0], np.zeros(len(path.q))
    for run, motion, at in zip(path.runs, timing.motions, timing.waypoints, strict=True):
        first, last = path.segments[run[0]].first, path.segments[run[-1]].last
        form = QuinticRun(timing.limits, deviation_on(path, run, tool), float(knots[first]), bounds)
        coefficients, ends, passed = form.pieces(motion, at)
        pieces.append(coefficients)
        times.extend(ends.tolist())
        knots[first + 1 : last + 1] = passed
    joined, breaks = np.concatenate(pieces, axis=1), np.array(times)
    return Trajectory(
        joint_names=path.joint_names,
        polynomials=tuple(PPoly(np.ascontiguousarray(joined[:, :, i]), breaks) for i in range(path.n)),
        knots=knots,
        segments=timed_segments(path, knots),
        timing="quintic",
        executable=not reasons,
        reasons=reasons,
    )


@dataclass(frozen=True, eq=False)
class QuinticRun:
    """What the pieces between two stops are held to.

    Attributes
    ----------
    limits : MotionLimits
    deviation : callable
    start : float
        When the first one begins (s).
    bounds : (2, n) ndarray, optional
        Position limits (m, rad).
    """

    limits: MotionLimits
    deviation: Deviation
    start: float
    bounds: NDArray[np.float64] | None = None

    def pieces(
        self, motion: Motion, waypoints: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return coefficients (6, k, n) of the quintics of one run, when they end, and when waypoints are passed (s).

        The times are those of the whole trajectory, and the first waypoint's is left out.
        """
        jerk = self.limits.jerk
        if isinstance(motion, StraightMotion):
            # its phases are polynomials as they are
            u = np.union1d(waypoints, motion.knots)
        else:
            clock = self.start + motion.duration
            u = spaced(motion, waypoints, shortest_pieces(motion.states(np.unique(waypoints)), jerk, clock))
            u = self.halved(motion, u)
        attempts = SLOWED
        while True:
            t, at = motion.on_whole(u)
            states, h = motion.states(at)[:3], np.diff(t)
            passed = whole(motion.times(waypoints[1:]))
            stretch, attempts = self.stretch(states, t, passed), attempts - 1
            if stretch <= 1.0 or not attempts:
                break
            motion = motion.slowed(stretch)
            if isinstance(motion, StraightMotion):
                # the end is the last knot to the last bit
                waypoints = np.linspace(0.0, motion.duration, len(waypoints))
                u = np.union1d(waypoints, motion.knots)
        return quintic_coefficients(states, h), whole(self.start + t[1:]), whole(self.start + passed)

    def halved(self, motion: Motion, u: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return borders in u with pieces halved that exceed limits or leave the path."""
        clock, jerk = self.start + motion.duration, self.limits.jerk
        for _ in range(_LEVELS):
            t, at = motion.on_whole(u)
            states, h = motion.states(at)[:3], np.diff(t)
            rounding = jerk_of_rounding(states, h, jerk, clock)
            # in a half of the piece
            half = 8 * rounding
            shares, outside = self.shares(states, h)
            over = shares.max(axis=1) + _SURE * rounding - _KEPT
            bad = ((over > 0) | outside | (self._off(motion, at, t, states) > _OFF)) & (half <= _ROUNDING)
            bad |= over > _OVER_ROUNDING * half
            if not bad.any():
                break
            u = split(u, bad, motion.knots)
        return u

    def shares(
        self, states: NDArray[np.float64], h: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Return the largest shares of the limits that the quintics between states take, (k, 3).

        Also returns which of them leave position limits, (k,).
        """
        from qparm.timing.kernels import quintic_peaks

        q, v, a = (np.ascontiguousarray(order) for order in states[:3])
        table, n = self.limits.table, self.limits.n
        lower, upper = (np.full(n, -np.inf), np.full(n, np.inf)) if self.bounds is None else self.bounds
        peaks = np.empty((len(h), n, 5))
        quintic_peaks(q, v, a, h, table, lower, upper, peaks)
        outside = (peaks[:, :, 3] < lower - _OUTSIDE) | (peaks[:, :, 4] > upper + _OUTSIDE)
        return (peaks[:, :, :3] / table.T).max(axis=1), np.asarray(outside.any(axis=1))

    def _off(
        self, motion: Motion, u: NDArray[np.float64], t: NDArray[np.float64], states: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return how far the quintics are off the path between states, 1 being as far as they may be, (k,)."""
        coefficients, inner = quintic_coefficients(states, np.diff(t)), looks(u, _LOOKS)
        x = (motion.times(inner).reshape(-1, len(_LOOKS)) - t[:-1, None])[:, :, None]
        form = np.zeros((2, len(t) - 1, len(_LOOKS), self.limits.n))
        for power in coefficients:
            form[1] = form[1] * x + form[0]
            form[0] = form[0] * x + power[:, None]
        off = self.deviation(form.reshape(2, -1, self.limits.n), motion.states(inner)[:2])
        return off.reshape(-1, len(_LOOKS)).max(axis=1)

    def stretch(self, states: NDArray[np.float64], t: NDArray[np.float64], passed: NDArray[np.float64]) -> float:
        """Return how much longer the quintics between states must take to keep the limits; 1 or less if they do.

        Parameters
        ----------
        states : (3, K, n) ndarray
        t : (K,) ndarray
            When they are passed, since the run began (s).
        passed : (k,) ndarray
            When waypoints are passed: these are written, too, and so cut a piece; of a part shorter than
            :data:`SHORT` whoever reads it takes the mean.
        """
        h = np.diff(t)
        shares = self.shares(states, h)[0] / _KEPT
        written = np.union1d(t, passed[(passed > t[0]) & (passed < t[-1])])
        gaps = np.diff(written)
        gaps[gaps < SHORT] = np.inf
        shortest = np.minimum.reduceat(gaps, np.searchsorted(written[:-1], t[:-1]))
        rounding = jerk_of_rounding(states, np.minimum(shortest, h), self.limits.jerk, self.start + float(t[-1]))
        shares[:, 2] += _SURE * rounding
        return max(float(shares[:, k].max()) ** (1 / (k + 1)) for k in range(3))
