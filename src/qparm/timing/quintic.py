"""The timing as quintic polynomials: between states that are the path's own, so C2, and at rest at stops.

A piece is halved until it keeps the limits and stays on the path, but not so far that rounding would take more of a
limit than it does. What then is left over, some millionths, is taken out by stretching the whole run.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from qparm.path import JointPath, Trajectory
from qparm.path.quintic import quintic_coefficients
from qparm.robot import SerialChain
from qparm.robot.motion_limits import MotionLimits
from qparm.timing.law import Motion, PathTiming, time_path, tool_way
from qparm.timing.straight import StraightMotion
from qparm.timing.subdivide import (
    ROUNDING,
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

__all__ = ["quintic_form", "quintic_trajectory"]

_LEVELS = 24
# Places inside a piece at which it is compared with the path.
_LOOKS = np.array([0.2, 0.5, 0.8])
# Share of the deviation allowed: a quintic that is near the path keeps the speed, too.
_OFF = 1 / 3
# Largest share of a limit: files hold times in whole nanoseconds.
_KEPT = 1 - 2e-6
# A piece that exceeds a limit by this many times what rounding makes in its halves is halved, however short: where
# waypoints lie milliseconds apart jerk swings inside one piece, by a quarter of its limit and more.
_OVER_ROUNDING = 10.0


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
        timing, tool=tool_deviation(chain, position=position, rotation=rotation, feed=feed), reasons=reasons
    )


def quintic_form(timing: PathTiming, *, tool: Deviation | None = None, reasons: tuple[str, ...] = ()) -> Trajectory:
    """Return a timing as quintics.

    Parameters
    ----------
    timing : PathTiming
    tool : callable, optional
        How far configurations are from each other on rows and transitions; elsewhere, and without it, joints are
        compared.
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
        u, h, coefficients = _pieces(motion, at, timing.limits, deviation_on(path, run, tool))
        pieces.append(coefficients)
        ends = knots[first] + np.cumsum(h)
        times.extend(ends.tolist())
        passed = np.interp(motion.times(at[1:-1]), motion.times(u), np.append(knots[first], ends))
        knots[first + 1 : last + 1] = np.append(passed, ends[-1])
    whole, breaks = np.concatenate(pieces, axis=1), np.array(times)
    return Trajectory(
        joint_names=path.joint_names,
        polynomials=tuple(PPoly(np.ascontiguousarray(whole[:, :, i]), breaks) for i in range(path.n)),
        knots=knots,
        segments=timed_segments(path, knots),
        timing="quintic",
        executable=not reasons,
        reasons=reasons,
    )


def _pieces(
    motion: Motion, waypoints: NDArray[np.float64], limits: MotionLimits, deviation: Deviation
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return borders in u, durations and coefficients (6, k, n) of the quintics of one run."""
    from qparm.timing.kernels import quintic_peaks

    straight = isinstance(motion, StraightMotion)
    least = shortest_piece(motion, limits)
    u = np.union1d(waypoints, motion.knots) if straight else spaced(motion, waypoints, least)
    table, unbounded = limits.table, np.full(limits.n, np.inf)
    level = 0
    while True:
        states, t = motion.states(u), motion.times(u)
        h = np.asarray(np.diff(t), dtype=np.float64)
        peaks = np.empty((len(h), limits.n, 5))
        quintic_peaks(states[0], states[1], states[2], h, table, -unbounded, unbounded, peaks)
        shares = (peaks[:, :, :3] / table.T).max(axis=1)
        coefficients = quintic_coefficients(states, h)
        inner = looks(u, _LOOKS)
        x = (motion.times(inner).reshape(-1, len(_LOOKS)) - t[:-1, None])[:, :, None]
        form = np.zeros((2, len(h), len(_LOOKS), limits.n))
        for power in coefficients:
            form[1] = form[1] * x + form[0]
            form[0] = form[0] * x + power[:, None]
        off = deviation(form.reshape(2, -1, limits.n), motion.states(inner)[:2]).reshape(-1, len(_LOOKS)).max(axis=1)
        over = shares.max(axis=1) - _KEPT
        # the jerk that rounding makes in a half of the piece
        bad = ((over > 0) | (off > _OFF)) & (h > 2 * least) | (over > _OVER_ROUNDING * ROUNDING * (2 * least / h) ** 3)
        level += 1
        # the phases of a straight motion are polynomials as they are
        if straight or not bad.any() or level == _LEVELS:
            break
        u = split(u, bad, motion.knots)
    stretch = max(1.0, *(float(shares[:, k].max() / _KEPT) ** (1 / (k + 1)) for k in range(3)))
    if stretch > 1.0:
        h = h * stretch
        coefficients = quintic_coefficients(states[:3] / stretch ** np.arange(3.0)[:, None, None], h)
    return u, h, coefficients
