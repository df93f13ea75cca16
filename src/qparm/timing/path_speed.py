"""Time-optimal path speed: the squared path speed as a spline, with every joint limit in between too.

The problem is solved at collocation points (:mod:`qparm.timing.speed_kernels`), looked at 16 times an interval and
where a peak lies between two looks, and solved again with the limits of those intervals lowered that were exceeded in
between. What then is left over, some tenths of a permille, is taken out by slowing the whole path down.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from qparm.errors import KernelError
from qparm.path.curve import piecewise
from qparm.timing.soft_ends import SoftEnds
from qparm.timing.ticks import slow_to_whole, whole

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from scipy.interpolate import PPoly

    from qparm.robot.motion_limits import MotionLimits

__all__ = ["ON_THE_SPOT", "FeedSections", "SpeedProfile", "fastest_profile"]

# Intervals of the spline: so many at least, or so many between two waypoints on paths that are not long.
_LEAST_INTERVALS, _PER_GAP, _LONG = 200, 3, 6000
# In a soft end an interval is this share of its width; beyond, at most that share of the distance to the end.
_FINE, _GRADING = 1 / 14, 0.15
# The widest soft end, as a share of the path.
_WIDEST = 0.12
# Limits are aimed at with this share: what remains after the last round need not slow the whole path.
_AIM = 0.9997
# Gap of the barrier's optimum to the true one, about 1 / weight.
_WEIGHT = 4000.0
# Rounds, and after how many of them limits are lowered by twice as much more each time: a narrow peak between two
# points of an interval is not reached by lowering the limit at these by what is exceeded.
_ROUNDS, _PATIENT = 9, 2
# What is left over at the end: the whole path is slowed by its cube root.
_OVER = 1.0004
# Largest share of a limit in the end. What is left lets the forms come near in pieces that are not short: a closer
# profile would be followed in pieces so short that rounding takes more of the limits than this.
_KEPT = 1 - 1e-4
# Next to a border between feed and none, an interval is this share of the way in which acceleration is built up there.
_FINE_BORDER = 0.1
# A second lost where the feed is to be kept counts as so many elsewhere: the feed is kept up to the border, and the
# barrier stays as much nearer to it.
_WORTH = 30.0
# A tool that moves less per s turns on the spot.
ON_THE_SPOT = 0.5
# No path takes less than this (s).
_SHORTEST = 1e-6
_LOOKS = 16
# Points looked at together: what they take in memory stays small.
_CHUNK = 32768


@dataclass(frozen=True, eq=False)
class FeedSections:
    """A largest speed that differs along the path.

    Attributes
    ----------
    borders : (k + 1,) ndarray
        In s, from 0 to the path's length.
    speeds : (k,) ndarray
        Largest speed of the tool between each two (m/s); infinity for none.
    way : callable, optional
        How far the tool moves per s at each s, (k,) for (k,); 1 without it. Where it is less than a half the tool turns
        on the spot, and the speed is that of s.
    """

    borders: NDArray[np.float64]
    speeds: NDArray[np.float64]
    way: Callable[[NDArray[np.float64]], NDArray[np.float64]] | None = None

    def at(self, s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the largest ds/dt at each s; on a border the lower one."""
        slack = 1e-9 * self.borders[-1]
        before, after = (
            self.speeds[np.clip(np.searchsorted(self.borders, s + d) - 1, 0, len(self.speeds) - 1)]
            for d in (-slack, slack)
        )
        speeds = np.minimum(before, after)
        bounded = np.flatnonzero(np.isfinite(speeds))
        if self.way is not None and len(bounded):
            way = self.way(s[bounded])
            speeds[bounded] /= np.where(way > ON_THE_SPOT, way, 1.0)
        return speeds


@dataclass(frozen=True, eq=False)
class SpeedProfile:
    """A path and how fast it is passed.

    Attributes
    ----------
    curve : scipy.interpolate.PPoly
        q(s), s from 0.
    ends : SoftEnds
        s(u).
    knots : (M + 1,) ndarray
        Of the spline, in u; every break of the curve is among them.
    coefficients : (M + 3,) ndarray
        Of the cubic spline b(u) = (du/dt)^2.
    shares : (3, ) ndarray
        Largest share of velocity, acceleration and jerk limits, peaks between the 16 looks of an interval too.
    newton_steps : int
    rounds : int
        Times it was solved.
    """

    curve: PPoly
    ends: SoftEnds
    knots: NDArray[np.float64]
    coefficients: NDArray[np.float64]
    shares: NDArray[np.float64]
    newton_steps: int
    rounds: int

    @cached_property
    def _speed(self) -> PPoly:
        from scipy.interpolate import BSpline

        return piecewise(BSpline(_clamped(self.knots), self.coefficients, 3))

    @cached_property
    def _times(self) -> NDArray[np.float64]:
        return np.concatenate([[0.0], np.cumsum(self._between(self.knots[:-1], self.knots[1:]))])

    @property
    def duration(self) -> float:
        """Seconds."""
        return float(self._times[-1])

    def _between(self, first: NDArray[np.float64], last: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the seconds from first to last, which lie in one interval."""
        x, w = np.polynomial.legendre.leggauss(8)
        half = 0.5 * (last - first)
        u = (0.5 * (last + first))[:, None] + half[:, None] * x
        return half * (w / np.sqrt(self._speed(u))).sum(axis=1)

    def times(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return when each u is passed, seconds."""
        at = np.clip(np.searchsorted(self.knots, u, side="right") - 1, 0, len(self.knots) - 2)
        return self._times[at] + self._between(self.knots[at], u)

    def places(self, t: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the u that are passed at given times."""
        at = np.clip(np.searchsorted(self._times, t, side="right") - 1, 0, len(self.knots) - 2)
        start, end = self.knots[at], self.knots[at + 1]
        u = start + (t - self._times[at]) / (self._times[at + 1] - self._times[at]) * (end - start)
        for _ in range(5):
            u = np.clip(u - (self._times[at] + self._between(start, u) - t) * np.sqrt(self._speed(u)), start, end)
        return u

    def on_whole(self, u: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the whole nanoseconds (s) next to the times of places, and where it is then."""
        exact = self.times(u)
        t = whole(exact)
        at = u + (t - exact) * np.sqrt(self._speed(u))
        return t, np.where((u > 0.0) & (u < self.ends.total), at, u)

    def slowed(self, factor: float) -> SpeedProfile:
        """Return the same in ``factor`` times the time, and up to a nanosecond more: it ends on a whole one."""
        factor *= slow_to_whole(factor * self.duration)
        return replace(self, coefficients=self.coefficients / factor**2, shares=self.shares / factor ** np.arange(1, 4))

    def states(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return position, velocity, acceleration and jerk at each u, (4, P, n)."""
        s = self.ends.at(u)
        q1, q2, q3 = _by_u(self.curve, s)
        b, b1, b2 = (self._speed(u, order)[:, None] for order in range(3))
        root = np.sqrt(b)
        return np.stack(
            [self.curve(s[0]), q1 * root, q2 * b + 0.5 * q1 * b1, root * (q3 * b + 1.5 * q2 * b1 + 0.5 * q1 * b2)]
        )

    def path_speed(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return ds/dt at each u."""
        return self.ends.at(u)[1] * np.sqrt(self._speed(u))


def fastest_profile(curve: PPoly, limits: MotionLimits, *, feed: float | FeedSections | None = None) -> SpeedProfile:
    """Return the fastest way along a curve, from rest to rest.

    Parameters
    ----------
    curve : scipy.interpolate.PPoly
        q(s) with values (n,), four times continuously differentiable, from s = 0.
    limits : MotionLimits
    feed : float or FeedSections, optional
        Largest ds/dt, everywhere or by section.

    Returns
    -------
    SpeedProfile
        Its duration is a whole number of nanoseconds.
    """
    from qparm.timing.speed_kernels import PER_INTERVAL, cubic_basis, solve_speed

    if not isinstance(feed, FeedSections):
        feed = FeedSections(curve.x[[0, -1]], np.array([np.inf if feed is None else feed]))
    ends = _ends(curve, limits, feed)
    knots = _knots(ends, np.union1d(curve.x, _near_borders(curve, limits, feed)))
    M = len(knots) - 1
    x = np.append((knots[:-1, None] + np.diff(knots)[:, None] * np.arange(PER_INTERVAL) / PER_INTERVAL).ravel(),
                  knots[-1])  # fmt: skip
    basis = np.empty((len(x), 3, 4))
    cubic_basis(_clamped(knots), x, basis)
    s = ends.at(x)
    q1, q2, q3 = _by_u(curve, s)
    table = limits.table * _AIM
    rows = np.stack([q2 / table[1], 0.5 * q1 / table[1],
                     q3 / table[2], 1.5 * q2 / table[2], 0.5 * q1 / table[2]], axis=2)  # fmt: skip
    cap = (np.abs(q1) / table[0]).max(axis=1) ** 2
    # where no joint moves, something must bound the speed all the same
    at_feed = feed.at(s[0])
    fastest = np.minimum(at_feed, ends.length / _SHORTEST)
    cap = np.maximum(cap, (s[1] / fastest) ** 2)
    width = np.zeros(len(x))
    step = np.diff(x)
    width[:-1] += 0.5 * step
    width[1:] += 0.5 * step
    del q1, q2, q3
    worth = np.ones(len(x))
    if np.isfinite(feed.speeds).any():
        worth[np.isfinite(at_feed)] = _WORTH
    coefficients = np.full(M + 3, _feasible(rows, cap))
    newton = solve_speed(rows, cap, width, worth, basis, 4.0, _WEIGHT, coefficients)
    if newton < 0:
        raise KernelError("the path-speed problem has no feasible start")
    rounds = 1
    while True:
        profile = SpeedProfile(curve, ends, knots, coefficients, np.zeros(3), newton, rounds)
        shares = _shares(profile, limits)
        if not (shares > _OVER).any() or rounds > _ROUNDS:
            break
        harder = 2.0 ** max(0, rounds - _PATIENT)
        _lower(rows, cap, np.where(shares > 1.0, 1.0 + harder * (shares * 1.0002 - 1.0), 1.0))
        for shrink in (0.99, 0.95, 0.8, 0.5, 0.0):
            trial = coefficients * shrink if shrink else np.full(M + 3, _feasible(rows, cap))
            steps = solve_speed(rows, cap, width, worth, basis, _WEIGHT / 16 if shrink else 4.0, _WEIGHT, trial)
            if steps >= 0:
                coefficients, newton = trial, newton + steps
                break
        rounds += 1
    slower = max(1.0, *(float(shares[:, k].max() / _KEPT) ** (1 / (k + 1)) for k in range(3)))
    return SpeedProfile(curve, ends, knots, coefficients, shares.max(axis=0), newton, rounds).slowed(slower)


def _clamped(knots: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.concatenate([np.repeat(knots[0], 3), knots, np.repeat(knots[-1], 3)])


def _by_u(curve: PPoly, s: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the first three derivatives of the curve by u, each (P, n)."""
    c1, c2, c3 = (curve(s[0], order) for order in (1, 2, 3))
    s1, s2, s3 = s[1:, :, None]
    return c1 * s1, c2 * s1**2 + c1 * s2, c3 * s1**3 + 3.0 * c2 * s1 * s2 + c1 * s3


def _ends(curve: PPoly, limits: MotionLimits, feed: FeedSections) -> SoftEnds:
    """Return soft ends about as wide as the way in which full speed is reached."""
    length = float(curve.x[-1])
    widths = []
    for place, fastest in ((0.0, feed.speeds[0]), (length, feed.speeds[-1])):
        slope = np.abs(curve(place, 1))
        with np.errstate(divide="ignore"):
            speed, acceleration, jerk = (float((row / slope).min()) for row in limits.table)
        speed = min(speed, float(fastest))
        width = _WIDEST * length
        if np.isfinite(speed) and np.isfinite(acceleration):
            swift = speed < acceleration**2 / jerk
            time = 2.0 * np.sqrt(speed / jerk) if swift else speed / acceleration + acceleration / jerk
            width = min(width, speed * time / 1.2)
        widths.append(max(width, 1e-6 * length))
    return SoftEnds(length, *widths)


def _near_borders(curve: PPoly, limits: MotionLimits, feed: FeedSections) -> NDArray[np.float64]:
    """Return the inner borders, and places at either side of them, growing apart: there the speed changes fast."""
    inner = feed.borders[1:-1]
    if not len(inner):
        return inner
    time = float((limits.acceleration / limits.jerk).min())
    places = [inner]
    for border, speeds in zip(inner, pairwise(feed.speeds), strict=True):
        speed = min(speeds)
        if not np.isfinite(speed):
            continue
        first = _FINE_BORDER * speed * time
        gaps = np.diff(curve.x)[np.clip(np.searchsorted(curve.x, border) - 1, 0, len(curve.x) - 2)]
        count = max(0, int(np.log1p(_GRADING * gaps / first) / np.log1p(_GRADING)))
        away = first * np.expm1(np.arange(1, count + 1) * np.log1p(_GRADING)) / _GRADING
        near = np.concatenate([border - away, border + away])
        places.append(near[(near > 0) & (near < curve.x[-1])])
    return np.unique(np.concatenate(places))


def _knots(ends: SoftEnds, breaks: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return knots in u: the curve's breaks, and as many between them as the ends and the path ask for."""
    total = ends.total
    widest = total / max(_LEAST_INTERVALS, min(_PER_GAP * (len(breaks) - 1), _LONG))
    # how fine from either end to where the grading has grown to the widest interval
    sides = []
    for width in (ends.start, ends.end):
        nodes = [0.0]
        while nodes[-1] < 0.5 * total:
            step = min(widest, max(_FINE * width, _GRADING * nodes[-1]))
            nodes.append(nodes[-1] + step)
            if step >= widest:
                break
        sides.append(np.array(nodes))
    left, right = sides[0][sides[0] < 0.5 * total], total - sides[1][sides[1] < 0.5 * total][::-1]
    middle = np.linspace(left[-1], right[0], max(2, int(np.ceil((right[0] - left[-1]) / widest)) + 1))
    nodes = np.concatenate([left, middle[1:-1], right])
    given = ends.inverse(breaks.copy())
    given[0], given[-1] = 0.0, total
    depth = np.interp(given, nodes, np.arange(float(len(nodes))))
    count = np.maximum(np.ceil(np.diff(depth) - 1e-6).astype(np.int64), 1)
    index = np.repeat(np.arange(len(count)), count)
    within = np.arange(len(index)) - np.repeat(np.cumsum(count) - count, count)
    at = depth[index] + np.diff(depth)[index] * within / count[index]
    knots = np.append(np.interp(at, np.arange(float(len(nodes))), nodes), total)
    knots[np.append(np.cumsum(count) - count, len(knots) - 1)] = given
    return knots


def _feasible(rows: NDArray[np.float64], cap: NDArray[np.float64]) -> float:
    """Return a constant b well within all limits."""
    worst = max(float(cap.max()), float(np.abs(rows[:, :, 0]).max()), float(np.abs(rows[:, :, 2]).max()) ** (2.0 / 3.0))
    return 0.5 / worst


def _shares(profile: SpeedProfile, limits: MotionLimits) -> NDArray[np.float64]:
    """Return the largest shares of the three limits in every interval, (M, 3)."""
    from qparm.timing.speed_kernels import cubic_basis, largest_shares

    knots, M = profile.knots, len(profile.knots) - 1
    shares = np.empty((M, 3))
    table, clamped = np.ascontiguousarray(limits.table), _clamped(knots)
    block = _CHUNK // _LOOKS
    for first in range(0, M, block):
        last = min(first + block, M)
        steps = np.diff(knots[first : last + 1])[:, None] * np.arange(_LOOKS) / _LOOKS
        u = np.append((knots[first:last, None] + steps).ravel(), knots[last])
        basis = np.empty((len(u), 3, 4))
        cubic_basis(clamped[first : last + 7], u, basis)
        local = profile.coefficients[first : last + 3]
        windows = np.lib.stride_tricks.sliding_window_view(local, 4)
        b = np.empty((len(u), 3))
        inner = basis[:-1].reshape(last - first, _LOOKS, 3, 4)
        b[:-1] = np.einsum("mpda,ma->mpd", inner, windows).reshape(-1, 3)
        b[-1] = basis[-1] @ windows[-1]
        # a spline may dip below zero between the points at which it is solved
        b[:, 0] = np.maximum(b[:, 0], 1e-12 * local.max())
        part = np.empty((last - first, 3))
        q1, q2, q3 = _by_u(profile.curve, profile.ends.at(u))
        largest_shares(q1, q2, q3, b, table, _LOOKS, part)
        shares[first:last] = part
    return shares


def _lower(rows: NDArray[np.float64], cap: NDArray[np.float64], factor: NDArray[np.float64]) -> None:
    """Divide the limits of intervals by factors (M, 3), at their first and last knots too."""
    from qparm.timing.speed_kernels import PER_INTERVAL

    at_points = np.repeat(factor, PER_INTERVAL, axis=0)
    at_points = np.concatenate([at_points, factor[-1:]])
    at_points[PER_INTERVAL:-1:PER_INTERVAL] = np.maximum(factor[1:], factor[:-1])
    cap *= at_points[:, 0] ** 2
    rows[:, :, :2] *= at_points[:, 1, None, None]
    rows[:, :, 2:] *= at_points[:, 2, None, None]
