"""The two forms of a timing: limits between the samples too, on the path, every waypoint passed, rest at the ends."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import PPoly

import qparm
from conftest import DOME
from qparm.path import JointPath, Segment, SegmentKind
from qparm.path.quintic import quintic_coefficients
from qparm.robot import MotionLimits
from qparm.timing import (
    quintic_form,
    quintic_trajectory,
    ruckig_form,
    ruckig_trajectory,
    straight_motion,
    time_path,
    time_waypoints,
)
from qparm.timing.kernels import quintic_peaks
from qparm.verify.kinematics import joint_transforms, rotation_angle

pytestmark = pytest.mark.slow

FORMS = {"quintic": quintic_trajectory, "ruckig": ruckig_trajectory}


@pytest.fixture(scope="module")
def smooth_plan(dome: qparm.Cell) -> qparm.Plan:
    return qparm.plan(dome, strategy="graph")


@pytest.fixture(scope="module")
def rough_plan(dome: qparm.Cell) -> qparm.Plan:
    """Plan by the baseline, whose path has breaks, jumps and unsmoothed rows."""
    return qparm.plan(dome, strategy="general")


def row_path(chain: qparm.SerialChain, q: np.ndarray, spacing: float = 0.02) -> JointPath:
    N = len(q)
    s = spacing * np.arange(N)
    return JointPath(
        joint_names=chain.names, q=q, point=np.arange(N), row=np.zeros(N, dtype=int), kind=(SegmentKind.ROW,) * N,
        status=("reached",) * N, s=s, segments=(Segment(SegmentKind.ROW, 0, 0, N - 1),), parameters=(s,),
    )  # fmt: skip


def wandering(chain: qparm.SerialChain, rng: np.random.Generator, count: int, step: float) -> np.ndarray:
    walk = np.cumsum(rng.normal(size=(count, chain.n)), axis=0)
    return 0.5 * (chain.lower + chain.upper) + step * walk * (chain.upper - chain.lower)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("step", [1e-4, 3e-3, 3e-2])
def test_rough_paths_keep_limits_and_waypoints(chain: qparm.SerialChain, form: str, step: float) -> None:
    path = row_path(chain, wandering(chain, np.random.default_rng(3), 40, step))
    trajectory = FORMS[form](chain, path, feed=0.02)
    assert trajectory.verify(MotionLimits.of(chain), path=path).problems(waypoint=2e-8) == ()
    assert (np.diff(trajectory.knots) > 0).all()


@pytest.mark.parametrize("form", FORMS)
def test_the_dome_is_timed_on_the_path_and_rests_at_segment_ends(rough_plan: qparm.Plan, form: str) -> None:
    chain, path = rough_plan.chain, rough_plan.joint_path
    trajectory = FORMS[form](chain, path, feed=0.02)
    verified = trajectory.verify(
        MotionLimits.of(chain), path=path, chain=chain, tool_path=rough_plan.tool_path, feed=0.02
    )
    assert verified.shares.max() <= 1.0 + 1e-6
    assert verified.waypoint_deviation <= 2e-8
    assert (verified.steps <= [1e-11, 1e-10, 1e-9]).all()
    ends = [trajectory.segments[0].start, *(segment.end for segment in trajectory.segments)]
    np.testing.assert_allclose(trajectory(ends, 1), 0.0, atol=1e-7)
    np.testing.assert_allclose(trajectory(ends, 2), 0.0, atol=1e-5)


@pytest.mark.parametrize("form", FORMS)
def test_the_tool_stays_within_five_micrometres_and_at_the_feed(smooth_plan: qparm.Plan, form: str) -> None:
    """On the smoothed path; measured against the tool path itself, not the curve that was timed."""
    chain, path = smooth_plan.chain, smooth_plan.joint_path
    trajectory = FORMS[form](chain, path, feed=0.02)
    verified = trajectory.verify(
        MotionLimits.of(chain), path=path, chain=chain, tool_path=smooth_plan.tool_path, feed=0.02
    )
    # six tenths of both tolerances, and what the curve that was timed is off by itself
    assert verified.problems(share=1 + 1e-6, tool=3.3e-6, rotation=14e-6) == ()
    # what rotation adds up to is measured with another kinematics, too
    assert verified.tool_rotation == pytest.approx(turned_off_rows(smooth_plan, trajectory), rel=0.02)
    assert verified.feed_kept.min() > 0.98  # but for the ends
    assert 0.0 < verified.feed_lost < 0.3 * len(verified.feed_kept)


def turned_off_rows(plan: qparm.Plan, trajectory: qparm.Trajectory) -> float:
    """Return the largest angle (rad) off rows and transitions, by the kinematics of ``verify`` at times of its own."""
    worst = 0.0
    for index, segment in enumerate(plan.joint_path.segments):
        if segment.kind not in (SegmentKind.ROW, SegmentKind.TRANSITION):
            continue
        way = (plan.tool_path.rows if segment.kind is SegmentKind.ROW else plan.tool_path.transitions)[segment.row]
        knots = trajectory.knots[segment.first : segment.last + 1]
        # densest where the motion begins and ends at rest: there the forms swing most
        share = np.concatenate([np.linspace(0, 1, 3001), np.linspace(0, 0.02, 1001), np.linspace(0.98, 1, 1001)])
        t = knots[0] + (knots[-1] - knots[0]) * share
        T, _ = joint_transforms(plan.cell, trajectory(t))
        s = np.interp(t, knots, plan.joint_path.parameters[index])
        for _ in range(3):
            here = plan.tool_path.pose_base_workpiece @ way.curve(s)
            ahead = plan.tool_path.pose_base_workpiece @ way.curve(np.minimum(s + 1e-6, way.length))
            way_on = ahead[:, :3, 3] - here[:, :3, 3]
            length = np.maximum((way_on**2).sum(axis=1), 1e-18)
            s = np.clip(s + 1e-6 * ((T - here)[:, :3, 3] * way_on).sum(axis=1) / length, 0.0, way.length)
        nominal = plan.tool_path.pose_base_workpiece @ way.curve(s)
        worst = max(worst, float(rotation_angle(nominal[:, :3, :3].transpose(0, 2, 1) @ T[:, :3, :3]).max()))
    return worst


@pytest.mark.parametrize("form", FORMS)
def test_both_tolerances_of_the_tool_are_kept_each_by_itself(smooth_plan: qparm.Plan, form: str) -> None:
    """Tighter in rotation alone, or in position alone, takes more pieces and holds."""
    chain, path = smooth_plan.chain, smooth_plan.joint_path
    usual = FORMS[form](chain, path, feed=0.02)
    each: tuple[dict[str, Any], ...] = ({"rotation": 3e-6}, {"position": 0.6e-6})
    for tolerances in each:
        tight = FORMS[form](chain, path, feed=0.02, **tolerances)
        verified = tight.verify(MotionLimits.of(chain), path=path, chain=chain, tool_path=smooth_plan.tool_path)
        curve = {"rotation": 1.6e-6, "position": 1.3e-6}
        ((key, allowed),) = tolerances.items()
        found = verified.tool_rotation if key == "rotation" else verified.tool_deviation
        assert found <= allowed + curve[key]
        assert tight.duration == pytest.approx(usual.duration, rel=1e-5)
    assert len(tight.boundaries) > len(usual.boundaries)


@pytest.mark.parametrize("form", FORMS)
def test_the_speed_is_the_feed_where_the_timing_keeps_it(smooth_plan: qparm.Plan, form: str) -> None:
    """Away from the ends of rows, whose timing is no even motion."""
    chain, feed = smooth_plan.chain, 0.02
    trajectory = FORMS[form](chain, smooth_plan.joint_path, feed=feed)
    for segment in trajectory.segments:
        if segment.kind is SegmentKind.ROW:
            t = np.arange(segment.start + 0.5, segment.end - 0.5, 0.005)
            p = [chain.forward(trajectory(t + d))[:, :3, 3] for d in (-1e-4, 1e-4)]
            speed = np.linalg.norm(p[1] - p[0], axis=1) / 2e-4
            assert np.abs(speed / feed - 1).max() < 7e-4


def test_a_tool_that_turns_off_its_path_is_reported(smooth_plan: qparm.Plan) -> None:
    """The last joint turns the tool about itself: thirty microradians of it are thirty of the tool."""
    *others, last = smooth_plan.trajectory.polynomials
    c = last.c.copy()
    c[-1] += 30e-6
    turned = replace(smooth_plan.trajectory, polynomials=(*others, PPoly(c, last.x)))
    chain, path = smooth_plan.chain, smooth_plan.joint_path
    verified = turned.verify(MotionLimits.of(chain), path=path, chain=chain, tool_path=smooth_plan.tool_path)
    (sentence,) = verified.problems(waypoint=40e-6)
    assert sentence.startswith("the tool turns off its path")
    assert verified.tool_rotation == pytest.approx(30e-6, abs=4e-6)
    assert not qparm.report(replace(smooth_plan, trajectory=turned)).executable


@pytest.mark.parametrize("form", FORMS)
def test_a_report_of_either_form_finds_nothing_against_it(smooth_plan: qparm.Plan, form: str) -> None:
    trajectory = FORMS[form](smooth_plan.chain, smooth_plan.joint_path, feed=0.02)
    assert qparm.report(replace(smooth_plan, trajectory=trajectory)).reasons == ()


def test_both_forms_take_the_time_of_the_timing(rough_plan: qparm.Plan) -> None:
    timing = time_path(rough_plan.joint_path, MotionLimits.of(rough_plan.chain), feed=0.02)
    quintic, ruckig = quintic_form(timing), ruckig_form(timing)
    assert quintic.duration == pytest.approx(timing.duration, rel=1e-5)
    np.testing.assert_allclose(ruckig.duration, timing.duration, rtol=1e-6)
    assert (np.diff(ruckig.knots) <= np.diff(quintic.knots) * (1 + 1e-6) + 1e-9).all()


@pytest.mark.parametrize("feed", [None, 0.08, 0.02])
def test_quintics_are_not_slower_than_the_timing(smooth_plan: qparm.Plan, feed: float | None) -> None:
    """Where waypoints lie milliseconds apart jerk swings inside a piece: that is halved, no run is stretched for it."""
    chain, path = smooth_plan.chain, smooth_plan.joint_path
    timing = time_path(path, MotionLimits.of(chain), feed=feed)
    form = quintic_form(timing)
    seconds = [np.ptp(form.knots[[path.segments[run[0]].first, path.segments[run[-1]].last]]) for run in path.runs]
    np.testing.assert_allclose(seconds, [motion.duration for motion in timing.motions], rtol=1e-9)
    assert form.verify(MotionLimits.of(chain), path=path).problems(share=1 + 1e-6) == ()


def test_ruckig_gets_no_intermediate_waypoints(
    chain: qparm.SerialChain, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """The free package sends intermediate waypoints to a web service, and says so on standard output."""
    import ruckig

    seen: list[Any] = []
    real = ruckig.Ruckig

    class Watched:
        def __init__(self, n: int) -> None:
            self._real = real(n)

        def calculate(self, request: Any, trajectory: Any) -> Any:
            seen.append(list(request.intermediate_positions))
            return self._real.calculate(request, trajectory)

    monkeypatch.setattr(ruckig, "Ruckig", Watched)
    ruckig_trajectory(chain, row_path(chain, wandering(chain, np.random.default_rng(1), 30, 3e-3)), feed=0.02)
    assert len(seen) >= 29
    assert all(positions == [] for positions in seen)
    assert capfd.readouterr().out == ""


NO_SOCKET = """
import os, resource, sys
import numpy as np, ruckig, scipy.interpolate
import qparm
from qparm.timing import ruckig_trajectory
from qparm.timing.ruckig_profiles import RuckigProfiles

plan = qparm.plan(sys.argv[1], timing="ruckig", strategy="general")
profile, answered = RuckigProfiles._profile, []
def watched(*arguments):
    answered.append(profile(*arguments))
    return answered[-1]
RuckigProfiles._profile = watched
# from here on no file descriptor is left, and a socket, opened by whatever language, cannot be had
least = os.dup(0)
os.close(least)
resource.setrlimit(resource.RLIMIT_NOFILE, (least, least))
again = ruckig_trajectory(plan.chain, plan.joint_path, feed=plan.cell.process.feed)
assert len(answered) > 100 and sum(answer is None for answer in answered) < 0.01 * len(answered)
assert np.array_equal(again.knots, plan.trajectory.knots)
request, answer = ruckig.InputParameter(1), ruckig.Trajectory(1)
request.current_position, request.target_position = [0.0], [1.0]
request.max_velocity = request.max_acceleration = request.max_jerk = [1.0]
request.intermediate_positions = [[0.5]]
try:
    ruckig.Ruckig(1, 0.01, 1).calculate(request, answer)
except ruckig.RuckigError:
    print("a socket would have been noticed")
"""


@pytest.mark.skipif(sys.platform != "linux", reason="counts file descriptors as Linux does")
def test_ruckig_timing_opens_no_socket() -> None:
    run = subprocess.run(
        [sys.executable, "-c", NO_SOCKET, str(DOME)], capture_output=True, text=True, check=False, timeout=300
    )
    assert run.returncode == 0, run.stderr
    assert "a socket would have been noticed" in run.stdout


@settings(max_examples=300, deadline=None)
@given(seed=st.integers(0, 10**9), size=st.sampled_from([1e-3, 1.0, 30.0]))
def test_peaks_are_exact(seed: int, size: float) -> None:
    rng = np.random.default_rng(seed)
    q, v, a = rng.normal(size=(2, 1)), size * rng.normal(size=(2, 1)), size**2 * rng.normal(size=(2, 1))
    dt = np.array([rng.uniform(0.05, 2.0)])
    peaks = np.empty((1, 1, 5))
    # limits of zero and reversed ranges force the exact branch
    quintic_peaks(q, v, a, dt, np.zeros((3, 1)), np.array([np.inf]), np.array([-np.inf]), peaks)
    c = quintic_coefficients(np.stack([q, v, a]), dt)[:, 0, 0]
    t = np.linspace(0, dt[0], 20001)
    values = [np.polyval(np.polyder(c, order) if order else c, t) for order in range(4)]
    expected = [*(np.abs(values[order]).max() for order in (1, 2, 3)), values[0].min(), values[0].max()]
    scale = max(1.0, *(np.abs(x).max() for x in values))
    np.testing.assert_allclose(peaks[0, 0], expected, rtol=1e-6, atol=1e-7 * scale)


def test_proved_limits_are_never_below_the_exact_peaks() -> None:
    rng = np.random.default_rng(0)
    for _ in range(200):
        q, v, a = rng.normal(size=(2, 1)), rng.normal(size=(2, 1)), rng.normal(size=(2, 1))
        dt = np.array([1.0])
        exact, proved = np.empty((1, 1, 5)), np.empty((1, 1, 5))
        quintic_peaks(q, v, a, dt, np.zeros((3, 1)), np.array([np.inf]), np.array([-np.inf]), exact)
        wide = np.full((3, 1), 1e9)
        quintic_peaks(q, v, a, dt, wide, np.array([-1e9]), np.array([1e9]), proved)
        assert proved[0, 0, 0] >= exact[0, 0, 0] - 1e-12
        assert proved[0, 0, 3] <= exact[0, 0, 3] + 1e-12
        assert proved[0, 0, 4] >= exact[0, 0, 4] - 1e-12


@pytest.mark.parametrize("form", FORMS)
def test_two_waypoints_and_equal_waypoints_are_timed(chain: qparm.SerialChain, form: str) -> None:
    q = 0.5 * (chain.lower + chain.upper)
    path = row_path(chain, np.array([q, q + 0.01]))
    trajectory = FORMS[form](chain, path, feed=0.02)
    assert trajectory.verify(MotionLimits.of(chain), path=path).problems() == ()
    # the feed is that of the tool point, whatever the path's parameter makes of its way
    way = chain.forward(q + 0.01 * np.linspace(0.0, 1.0, 101)[:, None])[:, :3, 3]
    way = np.linalg.norm(np.diff(way, axis=0), axis=1).sum()
    assert way < 0.015
    assert way / 0.02 < trajectory.duration < way / 0.02 + 0.15
    still = FORMS[form](chain, row_path(chain, np.array([q, q, q])), feed=0.02)
    np.testing.assert_allclose(still(still.knots), [q, q, q], atol=1e-12)


@pytest.mark.parametrize("distance", [1e-6, 1e-3, 0.02, 0.5, 3.0])
def test_a_straight_motion_is_ruckigs_optimum(chain: qparm.SerialChain, distance: float) -> None:
    import ruckig

    limits = MotionLimits.of(chain)
    step = distance * np.linspace(-1.0, 0.7, chain.n)
    motion = straight_motion(np.zeros(chain.n), step, limits)
    request, answer = ruckig.InputParameter(chain.n), ruckig.Trajectory(chain.n)
    request.synchronization = ruckig.Synchronization.Phase
    request.current_position, request.target_position = [0.0] * chain.n, step.tolist()
    for name in ("velocity", "acceleration", "jerk"):
        setattr(request, f"max_{name}", getattr(limits, name).tolist())
    ruckig.Ruckig(chain.n).calculate(request, answer)
    assert motion.duration == pytest.approx(answer.duration, rel=1e-5)
    t = np.linspace(0.0, motion.duration, 1001)
    q, *derivatives = motion.states(t)
    np.testing.assert_allclose(q, (q @ step / (step @ step))[:, None] * step, atol=1e-12)
    assert (np.abs(derivatives) / limits.table[:, None]).max() <= 1.0
    np.testing.assert_allclose(q[-1], step)


def test_beyond_what_ruckig_takes_pieces_are_split(chain: qparm.SerialChain) -> None:
    """It refuses 7,600 s: at a micrometre a second a row takes longer between two waypoints."""
    q = 0.5 * (chain.lower + chain.upper) + np.linspace(0, 0.05, 8)[:, None] * np.ones(8)
    path = row_path(chain, q)
    trajectory = ruckig_trajectory(chain, path, feed=1e-6)
    assert np.diff(trajectory.knots).min() > 7600.0
    assert trajectory.verify(MotionLimits.of(chain), path=path).problems() == ()


@pytest.mark.parametrize("corners", ["smooth", "stop"])
@pytest.mark.parametrize("form", [quintic_form, ruckig_form])
def test_waypoints_far_apart_in_time_are_timed(form: Any, corners: Any) -> None:
    """Of more than Ruckig's 7,600 s from one to the next."""
    limits = MotionLimits(1e-5 * np.ones(3), 3e-5 * np.ones(3), 30e-5 * np.ones(3))
    q = 0.1 * np.cumsum(np.random.default_rng(0).normal(size=(12, 3)), axis=0)
    timing = time_waypoints(q, limits, corners=corners)
    trajectory = form(timing)
    assert np.diff(trajectory.knots).max() > 7600.0
    assert trajectory.verify(limits, path=timing.path).problems() == ()


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("value", [0.0, -1e-6, np.nan, np.inf])
@pytest.mark.parametrize("what", ["position", "rotation"])
def test_a_tolerance_that_is_none_is_refused(chain: qparm.SerialChain, form: str, what: str, value: float) -> None:
    path = row_path(chain, wandering(chain, np.random.default_rng(1), 10, 3e-3))
    with pytest.raises(qparm.InvalidInput, match=f"tolerance in {what} must be finite and positive"):
        tolerance: dict[str, Any] = {what: value}
        FORMS[form](chain, path, feed=0.02, **tolerance)


def test_limits_and_feed_are_checked(chain: qparm.SerialChain) -> None:
    path = row_path(chain, wandering(chain, np.random.default_rng(1), 10, 3e-3))
    with pytest.raises(qparm.InvalidInput, match="limits are of 2 joints, the path of 8"):
        time_path(path, MotionLimits([1, 1], [1, 1], [1, 1]))
    for feed in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(qparm.InvalidInput, match="feed must be finite and positive"):
            time_path(path, MotionLimits.of(chain), feed=feed)
    for values, words in (([1.0, 0.0], "velocity limit of joint 1"), ([1.0, np.nan], "velocity limit of joint 1"),
                          ([], "one number per joint"), ("x", "list of numbers")):  # fmt: skip
        with pytest.raises(qparm.InvalidInput, match=words):
            MotionLimits(values, [1.0, 1.0], [1.0, 1.0])  # pyright: ignore[reportArgumentType]
