"""Timing: every limit between the samples too, every waypoint passed, in both forms."""

from __future__ import annotations

import itertools
import subprocess
import sys
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import qparm
from conftest import DOME
from qparm.path import JointPath, Segment, SegmentKind, Trajectory
from qparm.timing import quintic_timing, quintic_trajectory, ruckig_trajectory
from qparm.timing.kernels import quintic_peaks

FORMS = {"quintic": quintic_trajectory, "ruckig": ruckig_trajectory}


def row_path(chain: qparm.SerialChain, q: np.ndarray, spacing: float = 0.02) -> JointPath:
    N = len(q)
    return JointPath(
        joint_names=chain.names, q=q, point=np.arange(N), row=np.zeros(N, dtype=int), kind=(SegmentKind.ROW,) * N,
        status=("reached",) * N, s=spacing * np.arange(N), segments=(Segment(SegmentKind.ROW, 0, 0, N - 1),),
        parameters=(spacing * np.arange(N),),
    )  # fmt: skip


def wandering(chain: qparm.SerialChain, rng: np.random.Generator, count: int, step: float) -> np.ndarray:
    walk = np.cumsum(rng.normal(size=(count, chain.n)), axis=0)
    q = 0.5 * (chain.lower + chain.upper) + step * walk * (chain.upper - chain.lower)
    return np.clip(q, chain.lower, chain.upper)


def assert_limits_hold(chain: qparm.SerialChain, trajectory: Trajectory) -> None:
    breaks = np.unique(np.concatenate([polynomial.x for polynomial in trajectory.polynomials]))
    t = np.unique(np.concatenate([a + (b - a) * np.linspace(0, 1, 17) for a, b in itertools.pairwise(breaks)]))
    for order, limit in ((1, chain.velocity), (2, chain.acceleration), (3, chain.jerk)):
        assert (np.abs(trajectory(t, order)) / limit).max() <= 1 + 1e-9
    q = trajectory(t)
    assert (q >= chain.lower - 1e-8).all()
    assert (q <= chain.upper + 1e-8).all()


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("step", [1e-4, 3e-3, 3e-2, 0.2])
def test_limits_hold_between_the_samples_on_rough_paths(chain: qparm.SerialChain, form: str, step: float) -> None:
    """Also where joints run along their position limits, which a quintic would overshoot."""
    q = wandering(chain, np.random.default_rng(3), 60, step)
    trajectory = FORMS[form](chain, row_path(chain, q), feed=0.02)
    assert_limits_hold(chain, trajectory)
    np.testing.assert_allclose(trajectory(trajectory.knots), q, atol=2e-8)
    assert (np.diff(trajectory.knots) > 0).all()


@pytest.mark.parametrize("form", FORMS)
def test_the_dome_is_timed_within_limits_and_rests_at_segment_ends(dome_plan: qparm.Plan, form: str) -> None:
    chain, path = dome_plan.chain, dome_plan.joint_path
    trajectory = FORMS[form](chain, path, feed=dome_plan.cell.process.feed)
    assert_limits_hold(chain, trajectory)
    np.testing.assert_allclose(trajectory(trajectory.knots), path.q, atol=2e-8)
    ends = [trajectory.segments[0].start, *(segment.end for segment in trajectory.segments)]
    np.testing.assert_allclose(trajectory(ends, 1), 0.0, atol=1e-7)
    # an acceleration steps nowhere: position, velocity and acceleration agree on both sides of every break
    for polynomial in trajectory.polynomials:
        inner, width = polynomial.x[1:-1], np.diff(polynomial.x)[:-1]
        for order, tolerance in ((0, 1e-10), (1, 1e-9), (2, 1e-7)):
            left = sum(
                polynomial.derivative(order).c[k, :-1] * width ** (polynomial.derivative(order).c.shape[0] - 1 - k)
                for k in range(polynomial.derivative(order).c.shape[0])
            )
            np.testing.assert_allclose(left, polynomial.derivative(order).c[-1, 1:], atol=tolerance)
            assert len(left) == len(inner)


def test_the_feed_is_kept_where_the_joints_allow(chain: qparm.SerialChain) -> None:
    q = 0.5 * (chain.lower + chain.upper) + np.linspace(0, 0.05, 40)[:, None] * np.ones(8)
    timing = quintic_timing(chain, row_path(chain, q, spacing=0.02), feed=0.02)
    np.testing.assert_allclose(timing.dt[1:-1], 1.0)
    np.testing.assert_allclose(timing.dt[[0, -1]], 2.0)


def test_stretching_is_local(chain: qparm.SerialChain) -> None:
    """One wild step does not slow the rest of the row."""
    q = 0.5 * (chain.lower + chain.upper) + np.linspace(0, 0.05, 61)[:, None] * np.ones(8)
    q[30:, 3] += 2.0
    timing = quintic_timing(chain, row_path(chain, q), feed=0.02)
    assert timing.dt[30 - 1] > 2.0 / chain.velocity[3]
    np.testing.assert_allclose(timing.dt[2:20], 1.0, rtol=1e-3)
    np.testing.assert_allclose(timing.dt[42:-2], 1.0, rtol=1e-3)


def test_ruckig_is_never_slower_than_the_quintic(dome_plan: qparm.Plan) -> None:
    chain, path = dome_plan.chain, dome_plan.joint_path
    quintic, ruckig = (FORMS[form](chain, path, feed=0.02) for form in FORMS)
    assert ruckig.duration < quintic.duration
    assert (np.diff(ruckig.knots) <= np.diff(quintic.knots) * (1 + 2e-6)).all()


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
    assert len(seen) == 29
    assert all(positions == [] for positions in seen)
    assert capfd.readouterr().out == ""


NO_SOCKET = """
import os, resource, sys
import numpy as np, ruckig, scipy.interpolate
import qparm, qparm.timing.jerk_limited as form
from qparm.timing import kernels

plan = qparm.plan(sys.argv[1], timing="ruckig")
profile, answered = form._profile, []
def watched(*arguments):
    answered.append(profile(*arguments))
    return answered[-1]
form._profile = watched
# from here on no file descriptor is left, and a socket, opened by whatever language, cannot be had
least = os.dup(0)
os.close(least)
resource.setrlimit(resource.RLIMIT_NOFILE, (least, least))
again = form.ruckig_trajectory(plan.chain, plan.joint_path, feed=plan.cell.process.feed)
assert len(answered) > 100 and all(answer is not None for answer in answered)
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
    from qparm.timing.quintic import quintic_coefficients

    c = quintic_coefficients(q[0], v[0], a[0], q[1], v[1], a[1], dt[0])[:, 0]
    t = np.linspace(0, dt[0], 20001)
    values = [np.polyval(np.polyder(c, order) if order else c, t) for order in range(4)]
    expected = [
        np.abs(values[1]).max(),
        np.abs(values[2]).max(),
        np.abs(values[3]).max(),
        values[0].min(),
        values[0].max(),
    ]
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
    trajectory = FORMS[form](chain, row_path(chain, np.array([q, q + 0.01])), feed=0.02)
    assert_limits_hold(chain, trajectory)
    still = FORMS[form](chain, row_path(chain, np.array([q, q, q])), feed=0.02)
    np.testing.assert_allclose(still(still.knots), [q, q, q], atol=1e-12)
