"""Time-optimal path speed: the squared path speed as a spline, with every joint limit in between too.

The problem is solved at collocation points (:mod:`qparm.timing.speed_kernels`), looked at 16 times an interval and
where a peak lies between two looks, and solved again with the limits of those intervals lowered that were exceeded in
between. What then is left over, some tenths of a permille, is taken out by slowing the whole path down.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from qparm.errors import KernelError
from qparm.path.curve import piecewise
from qparm.timing.speed_knots import halved_knots, soft_ends, speed_knots
from qparm.timing.ticks import slow_to_whole, whole

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from scipy.interpolate import PPoly

    from qparm.robot.motion_limits import MotionLimits
    from qparm.timing.soft_ends import SoftEnds

__all__ = ["ON_THE_SPOT", "FeedSections", "SpeedProfile", "fastest_profile"]

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
# A second lost where the feed is to be kept counts as so many elsewhere: the feed is kept up to the border, and the
# barrier stays as much nearer to it.
_WORTH = 30.0
# A tool that moves less per s turns on the spot.
ON_THE_SPOT = 0.5
# No path takes less than this (s).
_SHORTEST = 1e-6
_LOOKS = 16
# Of the quadrature of the time, on [-1, 1].
_GAUSS_NODES, _GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(8)
# Quadrature of the time is exact to so much (s, and as a share), with intervals halved so often.
_QUADRATURE, _PANEL_LEVELS = 1e-13, 40
# Where warm starts are slowed until they lie within limits.
_SHRINKS = (0.99, 0.95, 0.8, 0.5)
# Where the tool is slower than the feed by this share, a joint takes this share of a limit within so long (s), or knots
# are too far apart: they are halved there, as often as this.
_IDLE, _BUSY, _SOON, _REFINEMENTS = 1.2e-3, 0.8, 0.08, 3
_IDLE_LOOKS = 4
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
    def _panels(self) -> NDArray[np.float64]:
        """The knots, and places between them where the speed nearly vanishes: between two the quadrature is exact."""
        done, first, last = [self.knots], self.knots[:-1], self.knots[1:]
        for _ in range(_PANEL_LEVELS):
            middle = 0.5 * (first + last)
            halves = self._between(first, middle) + self._between(middle, last)
            rough = np.abs(self._between(first, last) - halves) > _QUADRATURE * (1.0 + halves)
            if not rough.any():
                break
            done.append(middle[rough])
            first, last = (np.concatenate([a[rough], b[rough]]) for a, b in ((first, middle), (middle, last)))
        return np.sort(np.concatenate(done))

    @cached_property
    def _times(self) -> NDArray[np.float64]:
        return np.concatenate([[0.0], np.cumsum(self._between(self._panels[:-1], self._panels[1:]))])

    @property
    def duration(self) -> float:
        """Seconds."""
        return float(self._times[-1])

    def _between(self, first: NDArray[np.float64], last: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the seconds from first to last, which lie in one interval."""
        half = 0.5 * (last - first)
        u = (0.5 * (last + first))[:, None] + half[:, None] * _GAUSS_NODES
        return half * (_GAUSS_WEIGHTS / np.sqrt(self._speed(u))).sum(axis=1)

    def times(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return when each u is passed, seconds."""
        at = np.clip(np.searchsorted(self._panels, u, side="right") - 1, 0, len(self._panels) - 2)
        return self._times[at] + self._between(self._panels[at], u)

    def places(self, t: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the u that are passed at given times."""
        at = np.clip(np.searchsorted(self._times, t, side="right") - 1, 0, len(self._panels) - 2)
        start, end = self._panels[at], self._panels[at + 1]
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
        slower = replace(
            self, coefficients=self.coefficients / factor**2, shares=self.shares / factor ** np.arange(1, 4)
        )
        # where the quadrature is hard is no matter of how fast
        slower.__dict__["_panels"] = self._panels
        return slower

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
    if not isinstance(feed, FeedSections):
        feed = FeedSections(curve.x[[0, -1]], np.array([np.inf if feed is None else feed]))
    ends = soft_ends(curve, limits, feed)
    knots = speed_knots(ends, curve, limits, feed)
    profile = _solved(curve, limits, feed, ends, knots)
    for _ in range(_REFINEMENTS):
        idle = _idle(profile, limits, feed)
        if not idle.any():
            break
        finer = halved_knots(profile.knots, idle)
        profile = _solved(curve, limits, feed, ends, finer, start=_on_knots(profile, finer))
    return profile


def _solved(
    curve: PPoly, limits: MotionLimits, feed: FeedSections, ends: SoftEnds, knots: NDArray[np.float64],
    start: NDArray[np.float64] | None = None,
) -> SpeedProfile:  # fmt: skip
    """Return the fastest way whose squared speed is a spline with these knots; ``start``: coefficients near its own."""
    from qparm.timing.speed_kernels import PER_INTERVAL, cubic_basis, solve_speed

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

    def solve(start: NDArray[np.float64] | None) -> tuple[NDArray[np.float64], int]:
        """Return coefficients and Newton steps: from near ones, slowed until they are within limits, or from none."""
        for shrink in (*(_SHRINKS if start is not None else ()), 0.0):
            trial = start * shrink if start is not None and shrink else np.full(M + 3, _feasible(rows, cap))
            steps = solve_speed(rows, cap, width, worth, basis, _WEIGHT / 16 if shrink else 4.0, _WEIGHT, trial)
            if steps >= 0:
                return trial, steps
        raise KernelError("the path-speed problem has no feasible start")

    coefficients, newton = solve(start)
    rounds = 1
    while True:
        profile = SpeedProfile(curve, ends, knots, coefficients, np.zeros(3), newton, rounds)
        shares = _shares(profile, limits)
        if not (shares > _OVER).any() or rounds > _ROUNDS:
            break
        harder = 2.0 ** max(0, rounds - _PATIENT)
        _lower(rows, cap, np.where(shares > 1.0, 1.0 + harder * (shares * 1.0002 - 1.0), 1.0))
        coefficients, steps = solve(coefficients)
        newton, rounds = newton + steps, rounds + 1
    slower = max(1.0, *(float(shares[:, k].max() / _KEPT) ** (1 / (k + 1)) for k in range(3)))
    return SpeedProfile(curve, ends, knots, coefficients, shares.max(axis=0), newton, rounds).slowed(slower)


def _idle(profile: SpeedProfile, limits: MotionLimits, feed: FeedSections) -> NDArray[np.bool_]:
    """Return in which intervals the feed is given up though no joint is near a limit then, or was, or will be soon.

    The fastest motion is at a limit or at the feed at any time. A spline is not where its knots are too far apart for
    the turns that it would have to take.
    """
    knots, M = profile.knots, len(profile.knots) - 1
    u = (knots[:-1, None] + np.diff(knots)[:, None] * (np.arange(_IDLE_LOOKS) + 0.5) / _IDLE_LOOKS).ravel()
    fastest = feed.at(profile.ends.at(u)[0])
    slow = profile.path_speed(u) < (1.0 - _IDLE) * fastest
    slow &= np.isfinite(fastest)
    if not slow.any():
        return np.zeros(M, dtype=bool)
    t = profile.times(u)
    # looked at is what is near a slow place only
    first, last = (np.searchsorted(t, t[slow] + d) for d in (-_SOON, _SOON))
    near = np.cumsum(np.bincount(first, minlength=len(t) + 1) - np.bincount(last, minlength=len(t) + 1))[:-1] > 0
    beside = u[near]
    busy = np.concatenate([
        (np.abs(profile.states(beside[k : k + _CHUNK])[1:]) / limits.table[:, None]).max(axis=(0, 2))
        for k in range(0, len(beside), _CHUNK)
    ]) >= _BUSY  # fmt: skip
    at = np.concatenate([[-np.inf], t[near][busy], [np.inf]])
    after = np.searchsorted(at, t)
    idle = slow & (np.minimum(t - at[np.maximum(after - 1, 0)], at[after] - t) > _SOON)
    return np.asarray(idle.reshape(M, _IDLE_LOOKS).any(axis=1))


def _on_knots(profile: SpeedProfile, knots: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the coefficients of a profile's spline over knots of which its own are a part."""
    from scipy.interpolate import BSpline

    spline = BSpline(_clamped(profile.knots), profile.coefficients, 3)
    for knot in np.setdiff1d(knots, profile.knots):
        spline = spline.insert_knot(knot)
    return np.ascontiguousarray(spline.c)


def _clamped(knots: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.concatenate([np.repeat(knots[0], 3), knots, np.repeat(knots[-1], 3)])


def _by_u(curve: PPoly, s: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the first three derivatives of the curve by u, each (P, n)."""
    c1, c2, c3 = (curve(s[0], order) for order in (1, 2, 3))
    s1, s2, s3 = s[1:, :, None]
    return c1 * s1, c2 * s1**2 + c1 * s2, c3 * s1**3 + 3.0 * c2 * s1 * s2 + c1 * s3


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
