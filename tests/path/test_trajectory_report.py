"""A trajectory joined, scaled and verified: and the report finds what is wrong with one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import PPoly

import qparm
from qparm.path import Trajectory
from qparm.robot import MotionLimits
from qparm.timing import PathTiming, quintic_form, time_waypoints

LIMITS = MotionLimits([1.0, 2.0], [3.0, 4.0], [30.0, 40.0])


@pytest.fixture(scope="module")
def timing() -> PathTiming:
    s = np.linspace(0.0, 6.0, 25)
    return time_waypoints(np.stack([np.sin(s), np.cos(0.7 * s)], axis=1), LIMITS)


@pytest.fixture(scope="module")
def trajectory(timing: PathTiming) -> Trajectory:
    return quintic_form(timing)


def altered(trajectory: Trajectory, change: np.ndarray, piece: int = 20) -> Trajectory:
    """Return it with one polynomial of the first joint changed."""
    first = trajectory.polynomials[0]
    c = first.c.copy()
    c[:, piece] += change
    return replace(trajectory, polynomials=(PPoly(c, first.x), *trajectory.polynomials[1:]))


def test_the_report_agrees_with_the_trajectorys_own_derivatives(trajectory: Trajectory, timing: PathTiming) -> None:
    report = trajectory.verify(LIMITS, path=timing.path)
    x = trajectory.polynomials[0].x
    t = (x[:-1, None] + np.diff(x)[:, None] * np.linspace(0, 1, 17)[:-1]).ravel()
    own = [np.abs(trajectory(t, order)).max(axis=0) for order in (1, 2, 3)] / LIMITS.table
    np.testing.assert_allclose(report.shares, own, rtol=1e-3)
    assert report.problems() == ()
    for order in range(3):
        for joint in range(2):
            at = trajectory(report.share_times[order, joint] - 1e-9, order + 1)[joint]
            assert abs(at) / LIMITS.table[order, joint] == pytest.approx(report.shares[order, joint], rel=1e-2)
    np.testing.assert_array_equal(report.waypoint_times, trajectory.knots)


@pytest.mark.parametrize("order", range(3))
def test_a_limit_that_is_one_percent_lower_is_found(trajectory: Trajectory, order: int) -> None:
    table = LIMITS.table.copy()
    report = trajectory.verify(LIMITS)
    joint = int(report.shares[order].argmax())
    table[order, joint] *= 0.99 * report.shares[order, joint]
    (problem,) = trajectory.verify(MotionLimits(*table)).problems()
    name = ("velocity", "acceleration", "jerk")[order]
    assert f"joint 'joint_{joint + 1}' exceeds its {name} limit by 1.01%" in problem


@pytest.mark.parametrize(
    ("change", "words"), [([0, 0, 0, 0, 0, 1e-5], "position steps"), ([0, 0, 0, 0, 1e-5, 0], "velocity steps"),
                          ([0, 0, 0, 1e-3, 0, 0], "acceleration steps"), ([0, 0, 15.0, 0, 0, 0], "jerk limit")],
)  # fmt: skip
def test_a_changed_piece_is_found(trajectory: Trajectory, change: list[float], words: str) -> None:
    problems = altered(trajectory, np.array(change)).verify(LIMITS).problems()
    assert any(words in problem for problem in problems)


def test_a_missed_waypoint_is_found(trajectory: Trajectory, timing: PathTiming) -> None:
    q = timing.path.q.copy()
    q[7, 1] += 1e-4
    report = trajectory.verify(LIMITS, path=replace(timing.path, q=q))
    assert report.waypoint_deviation == pytest.approx(1e-4, rel=1e-3)
    assert any("waypoint is missed by 1.0e-04" in problem for problem in report.problems())


def test_a_path_or_limits_of_others_are_refused(trajectory: Trajectory, timing: PathTiming) -> None:
    with pytest.raises(qparm.InvalidInput, match="limits are of 1 joints"):
        trajectory.verify(MotionLimits([1.0], [1.0], [1.0]))
    with pytest.raises(qparm.InvalidInput, match="belong together"):
        trajectory.verify(LIMITS, path=replace(timing.path, joint_names=("a", "b")))


def test_samples_hold_all_orders(trajectory: Trajectory) -> None:
    t, derivatives = trajectory.sample(0.1)
    assert derivatives.shape == (4, len(t), 2)
    assert t[-1] == trajectory.duration
    for order in range(4):
        np.testing.assert_array_equal(derivatives[order], trajectory(t, order))


@pytest.mark.parametrize("factor", [0.5, 1.0, 3.0])
def test_scaling_time_scales_all_orders(trajectory: Trajectory, factor: float) -> None:
    slower = trajectory.scaled(factor)
    assert slower.duration == pytest.approx(factor * trajectory.duration)
    t = np.linspace(0.0, trajectory.duration, 97)[1:-1]
    for order in range(3):
        np.testing.assert_allclose(
            slower(factor * t, order), trajectory(t, order) / factor**order, rtol=1e-9, atol=1e-9
        )
    assert slower.segments[-1].end == pytest.approx(slower.duration)
    np.testing.assert_allclose(slower(slower.knots), trajectory(trajectory.knots), atol=1e-12)


@pytest.mark.parametrize("factor", [0.0, -1.0, np.nan, np.inf])
def test_time_does_not_run_backwards(trajectory: Trajectory, factor: float) -> None:
    with pytest.raises(qparm.InvalidInput, match="finite and positive"):
        trajectory.scaled(factor)


def test_a_faster_motion_must_be_verified_before_it_is_executed(trajectory: Trajectory) -> None:
    assert trajectory.scaled(1.0).executable
    assert trajectory.scaled(2.0).executable
    faster = trajectory.scaled(0.5)
    assert not faster.executable
    assert faster.reasons == ("made 2 times as fast: its limits have not been verified anew",)
    # slower again, it is no better known
    assert not faster.scaled(2.0).executable
    assert not replace(trajectory, executable=False, reasons=("a gap",)).scaled(2.0).executable


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda trajectory: trajectory.scaled(1e-300), "factor must be between 1e-06 and 1e.06, not 1e-300"),
        (lambda trajectory: trajectory.scaled(1e300), "factor must be between"),
        (lambda trajectory: trajectory.scaled("a"), "factor must be a number, not 'a'"),
        (lambda trajectory: trajectory("a"), "times must be a number of seconds or a list of such, not 'a'"),
        (lambda trajectory: trajectory(["0.1"]), "times must be a number of seconds"),
        (lambda trajectory: trajectory([[0.1], [0.1, 0.2]]), "times must be a number of seconds"),
        (lambda trajectory: trajectory(np.nan), "a time is not finite"),
        (lambda trajectory: trajectory(0.1, order=np.array([1])), "order must be 0, 1, 2 or 3"),
        (lambda trajectory: trajectory(0.1, order="1"), "order must be 0, 1, 2 or 3"),
        (lambda trajectory: trajectory.sample("a"), "period must be a number of seconds, not 'a'"),
        (lambda trajectory: trajectory.segment_at("a"), "times must be a number of seconds"),
    ],
)  # fmt: skip
def test_what_is_no_time_is_refused(trajectory: Trajectory, call: Callable[[Trajectory], object], words: str) -> None:
    with pytest.raises(qparm.InvalidInput, match=words):
        call(trajectory)
    assert trajectory([]).shape == (0, 2)


def test_trajectories_are_joined_where_they_meet(trajectory: Trajectory, timing: PathTiming) -> None:
    back = quintic_form(time_waypoints(timing.path.q[::-1], LIMITS))
    both = trajectory.then(back)
    assert both.duration == pytest.approx(trajectory.duration + back.duration)
    np.testing.assert_allclose(both(both.duration), timing.path.q[0], atol=1e-9)
    t = np.linspace(0.01, back.duration - 0.01, 50)
    for order in range(4):
        np.testing.assert_allclose(both(trajectory.duration + t, order), back(t, order), atol=1e-8)
    assert both.verify(LIMITS).problems() == ()
    assert [s.start for s in both.segments] == [0.0, trajectory.duration]
    with pytest.raises(qparm.InvalidInput, match="positions do not meet: joint 'joint_2'"):
        trajectory.then(trajectory)
    other = quintic_form(time_waypoints(timing.path.q[::-1], LIMITS, names=("a", "b")))
    with pytest.raises(qparm.InvalidInput, match="different joints"):
        trajectory.then(other)
