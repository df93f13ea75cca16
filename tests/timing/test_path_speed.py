"""The path-speed problem: its optimum where it is known, limits everywhere, the feed, still and long paths."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from qparm.path.curve import joint_curve, piecewise
from qparm.robot import MotionLimits
from qparm.timing import fastest_profile, straight_motion
from qparm.timing.soft_ends import SoftEnds
from qparm.timing.speed_kernels import cubic_basis


def wave(count: int = 30, size: float = 1.0, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    knots = np.cumsum(size * rng.normal(size=(8, 3)), axis=0)
    s = np.linspace(0.0, 2.0, count)
    return s, make_interp_spline(np.linspace(0.0, 2.0, 8), knots, k=5)(s)


LIMITS = MotionLimits(np.array([1.0, 2.0, 1.5]), np.array([3.0, 2.0, 4.0]), np.array([30.0, 25.0, 50.0]))


@pytest.mark.parametrize(("distance", "share"), [(0.002, 5e-3), (0.8, 2e-3), (40.0, 2e-3)])
def test_a_straight_line_takes_as_long_as_the_jerk_limited_optimum(distance: float, share: float) -> None:
    limits = MotionLimits([1.0], [3.0], [30.0])
    s = np.linspace(0.0, 1.0, 9)
    profile = fastest_profile(piecewise(joint_curve(s, distance * s[:, None])), limits)
    best = straight_motion(np.zeros(1), np.array([distance]), limits).duration
    assert best <= profile.duration <= best * (1 + share)


def test_limits_hold_between_all_points() -> None:
    s, q = wave()
    profile = fastest_profile(piecewise(joint_curve(s, q)), LIMITS)
    u = np.unique(np.concatenate([np.linspace(0, profile.ends.total, 40_001), profile.knots]))
    states = profile.states(u)
    shares = np.abs(states[1:]) / LIMITS.table[:, None]
    assert shares.max() <= 1.001
    # some limit is near everywhere: it cannot be passed much faster
    assert np.mean(shares.max(axis=(0, 2)) > 0.9) > 0.9
    np.testing.assert_allclose(states[1:3, [0, -1]], 0.0, atol=1e-12)
    np.testing.assert_allclose(states[0, [0, -1]], q[[0, -1]], atol=1e-14)


@pytest.mark.parametrize("feed", [None, 0.02])
@pytest.mark.parametrize("jerk", [0.1, 1.0, 10.0, 1e3, 1e4])
@pytest.mark.parametrize(
    ("size", "count", "seed"), [(1e-4, 5, 2), (0.01, 5, 2), (1.0, 30, 1), (1.0, 5, 2), (0.3, 30, 1)]
)
def test_no_peak_is_missed_between_looks(size: float, count: int, seed: int, jerk: float, feed: float | None) -> None:
    """Of jerk limits far above those of acceleration, whose peaks at either end are narrow: 0.3 % were missed there."""
    s, q = wave(count, size, seed)
    limits = MotionLimits(LIMITS.velocity, LIMITS.acceleration, jerk * LIMITS.acceleration)
    profile = fastest_profile(piecewise(joint_curve(s, q)), limits, feed=feed)
    u = (profile.knots[:-1, None] + np.diff(profile.knots)[:, None] * np.arange(65) / 64).ravel()
    shares = (np.abs(profile.states(u)[1:]) / limits.table[:, None]).max(axis=(1, 2))
    assert shares.max() <= 1.0
    # what is told is no less, and little more
    assert (profile.shares >= shares - 1e-5).all()
    np.testing.assert_allclose(profile.shares, shares, atol=1e-3)


@pytest.mark.parametrize(
    ("seed", "size", "jerk", "feed"), [(3, 0.3, 2.0, 0.1791), (4, 0.3, 2.0, 0.1644), (6, 1.0, 3.0, 0.1217)]
)
def test_the_feed_gives_way_only_near_a_limit(seed: int, size: float, jerk: float, feed: float) -> None:
    """With knots only as close as the path asks for it is left by two permille where nothing requires it."""
    s, q = wave(8, size, seed)
    limits = MotionLimits(LIMITS.velocity, LIMITS.acceleration, jerk * LIMITS.acceleration)
    profile = fastest_profile(piecewise(joint_curve(s, q)), limits, feed=feed)
    t = np.arange(0.0, profile.duration, 2e-3)
    u = profile.places(t)
    shares = (np.abs(profile.states(u)[1:]) / limits.table[:, None]).max(axis=(0, 2))
    slow, busy = profile.path_speed(u) < (1 - 1.5e-3) * feed, shares >= 0.75
    assert slow.any()
    assert np.abs(t[slow][:, None] - t[busy]).min(axis=1).max() <= 0.1


def test_times_are_exact_where_the_speed_nearly_vanishes_between_knots() -> None:
    """There 1 / speed is far from any polynomial; a time that is not its integral contradicts positions and speeds."""
    s, q = wave()
    profile = fastest_profile(piecewise(joint_curve(s, q)), LIMITS)
    k = len(profile.coefficients) // 2
    u = np.linspace(profile.knots[k - 3], profile.knots[k + 1], 4002)[1:-1]
    alone = replace(profile, coefficients=np.eye(len(profile.coefficients))[k])
    # one coefficient lowered until the spline all but touches zero
    most = (profile._speed(u) / alone._speed(u)).min()
    slowed = replace(profile, coefficients=profile.coefficients - (1 - 1e-5) * most * alone.coefficients)
    speed = np.asarray(slowed._speed(u))
    assert 0 < speed.min() < 1e-3 * speed.max()
    t = slowed.times(u)
    x, w = np.polynomial.legendre.leggauss(20)
    half = 0.5 * np.diff(u)
    inner = (0.5 * (u[1:] + u[:-1]))[:, None] + half[:, None] * x
    np.testing.assert_allclose(np.diff(t), half * (w / np.sqrt(slowed._speed(inner))).sum(axis=1), rtol=1e-9)
    np.testing.assert_allclose(slowed.places(t), u, atol=1e-10)


def test_velocity_acceleration_and_jerk_are_derivatives_by_time() -> None:
    s, q = wave(seed=1)
    profile = fastest_profile(piecewise(joint_curve(s, q)), LIMITS)
    t = np.linspace(0.1, profile.duration - 0.1, 50)
    d = 1e-5
    before, at, after = (profile.states(profile.places(t + x)) for x in (-d, 0.0, d))
    for order in range(3):
        np.testing.assert_allclose((after[order] - before[order]) / (2 * d), at[order + 1], atol=1e-3, rtol=1e-3)
    np.testing.assert_allclose(profile.times(profile.places(t)), t, atol=1e-12)


def test_the_feed_is_kept_but_for_the_ends() -> None:
    s, q = wave(size=0.05)
    profile = fastest_profile(piecewise(joint_curve(s, q)), LIMITS, feed=0.02)
    u = np.linspace(0.0, profile.ends.total, 20_001)
    place, speed = profile.ends.at(u)[0], profile.path_speed(u)
    inside = (place > 0.02) & (place < 1.98)
    np.testing.assert_allclose(speed[inside], 0.02, rtol=5e-5)
    assert speed.max() <= 0.02 * (1 + 1e-3)
    assert profile.duration < 2.0 / 0.02 * 1.01


def test_a_narrow_peak_between_two_points_does_not_slow_the_whole_path() -> None:
    """Of waypoints whose distances differ a hundredfold: 0.9 % of jerk were left, and the feed missed everywhere."""
    rng, feed = np.random.default_rng(210), 0.05
    gaps = 10.0 ** rng.uniform(-3.3, -1.3, size=40)
    q = np.cumsum(np.vstack([np.zeros(3), gaps[:, None] * rng.normal(size=(40, 3))]), axis=0)
    q *= rng.choice([0.03, 0.3, 3.0, 30.0])
    limits = MotionLimits(LIMITS.velocity, LIMITS.acceleration, 10 * LIMITS.acceleration)
    profile = fastest_profile(piecewise(joint_curve(np.append(0.0, np.cumsum(gaps)), q)), limits, feed=feed)
    assert (profile.shares <= 1.0).all()
    assert profile.path_speed(np.linspace(0.0, profile.ends.total, 20_001)).max() >= feed * (1 - 3e-4)


def test_a_larger_jerk_limit_is_never_slower() -> None:
    s, q = wave()
    curve = piecewise(joint_curve(s, q))
    times = [fastest_profile(curve, MotionLimits(LIMITS.velocity, LIMITS.acceleration, k * LIMITS.jerk)).duration
             for k in (0.1, 1.0, 10.0)]  # fmt: skip
    assert times[0] > times[1] > times[2]


def test_the_optimum_scales_with_time_and_joints() -> None:
    """Seconds, or joints of a thousandth the size, do not change the answer."""
    s, q = wave()
    plain = fastest_profile(piecewise(joint_curve(s, q)), LIMITS).duration
    k = 1e-3
    table = LIMITS.table * k ** -np.arange(1, 4.0)[:, None]
    quick = fastest_profile(piecewise(joint_curve(s, q)), MotionLimits(*table)).duration
    assert quick == pytest.approx(k * plain, rel=1e-4)
    small = fastest_profile(piecewise(joint_curve(1e-3 * s, 1e-3 * q)), MotionLimits(*(1e-3 * LIMITS.table))).duration
    assert small == pytest.approx(plain, rel=1e-4)


def test_joints_that_rest_for_a_while_do_not_hold_the_others_up() -> None:
    s = np.linspace(0.0, 1.0, 21)
    q = np.stack([s, np.where(s < 0.5, 0.0, (s - 0.5) ** 4), np.zeros(21)], axis=1)
    profile = fastest_profile(piecewise(joint_curve(s, q)), LIMITS)
    assert profile.duration < 1.6
    assert (profile.shares <= 1.0).all()


def test_the_soft_ends_are_smooth_and_inverted() -> None:
    ends = SoftEnds(2.0, 0.3, 0.1)
    u = np.linspace(0.0, ends.total, 2001)
    table = ends.at(u)
    assert table[0, 0] == pytest.approx(0.0)
    assert table[0, -1] == pytest.approx(2.0)
    np.testing.assert_allclose(ends.inverse(table[0].copy()), u, atol=1e-5)
    for order in range(3):
        np.testing.assert_allclose(np.gradient(table[order], u)[5:-5], table[order + 1, 5:-5], rtol=0.02, atol=0.02 * (
            np.abs(table[order + 1]).max()))  # fmt: skip


def test_the_basis_is_that_of_cubic_splines() -> None:
    rng = np.random.default_rng(0)
    knots = np.cumsum(rng.uniform(0.1, 2.0, size=9))
    clamped = np.concatenate([np.repeat(knots[0], 3), knots, np.repeat(knots[-1], 3)])
    c = rng.normal(size=len(knots) + 2)
    x = np.append((knots[:-1, None] + np.diff(knots)[:, None] * np.arange(4) / 4).ravel(), knots[-1])
    basis = np.empty((len(x), 3, 4))
    cubic_basis(clamped, x, basis)
    from scipy.interpolate import BSpline

    spline = BSpline(clamped, c, 3)
    first = np.minimum(np.arange(len(x)) // 4, len(knots) - 2)
    local = c[first[:, None] + np.arange(4)]
    for order in range(3):
        np.testing.assert_allclose((basis[:, order] * local).sum(axis=1), spline(x, order), atol=1e-10)
