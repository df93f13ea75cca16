"""A differential step: within its bounds, towards the target, and at rest where it gets no nearer."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import qparm
from qparm.ik import DifferentialIK, StepStatus

DT = 0.05
METHODS = ["dls", "wln", "cwln", "gpm"]


@settings(max_examples=300, deadline=None)
@given(seed=st.integers(0, 10**9), method=st.sampled_from(METHODS), dt=st.sampled_from([1e-3, 0.05, 1.0]))
def test_a_step_never_leaves_its_bounds(chain: qparm.SerialChain, seed: int, method: str, dt: float) -> None:
    rng = np.random.default_rng(seed)
    q, target = chain.random(rng, 1)[0], chain.forward(chain.random(rng, 1)[0])
    at_limit = rng.random(8) < 0.3
    q[at_limit] = chain.upper[at_limit]
    step = DifferentialIK(chain, time_step=dt, method=method).step(q, target)
    assert (np.abs(step.velocity) <= chain.velocity * (1 + 1e-9)).all()
    assert chain.within_limits(step.q).all()
    np.testing.assert_allclose(q + dt * step.velocity, step.q, atol=1e-12)


@settings(max_examples=200, deadline=None)
@given(seed=st.integers(0, 10**9), method=st.sampled_from(METHODS))
def test_the_error_falls_or_the_arm_rests(chain: qparm.SerialChain, seed: int, method: str) -> None:
    rng = np.random.default_rng(seed)
    q, target = chain.random(rng, 1)[0], chain.forward(chain.random(rng, 1)[0])
    ik = DifferentialIK(chain, time_step=DT, method=method)
    first = ik.step(q, target)
    second = ik.step(first.q, target)
    L = chain.characteristic_length
    before, after = (np.hypot(s.position_error / L, s.rotation_error) for s in (first, second))
    if first.status is StepStatus.MOVING:
        assert after < before
    else:
        assert first.status is StepStatus.AT_REST
        np.testing.assert_array_equal(first.velocity, 0.0)


@settings(max_examples=100, deadline=None)
@given(seed=st.integers(0, 10**9), joint=st.integers(0, 7), side=st.sampled_from([-1, 1]), share=st.floats(1e-6, 1.0))
def test_a_joint_outside_its_range_is_brought_back_within_its_velocity_and_said_so(
    chain: qparm.SerialChain, seed: int, joint: int, side: int, share: float
) -> None:
    rng = np.random.default_rng(seed)
    q, target = chain.random(rng, 1)[0], chain.forward(chain.random(rng, 1)[0])
    width = chain.upper[joint] - chain.lower[joint]
    outside = (chain.upper if side > 0 else chain.lower)[joint] + side * share * width
    q[joint] = outside
    ik = DifferentialIK(chain, time_step=DT)
    steps = 0
    while not chain.within_limits(q).all():
        step = ik.step(q, target)
        assert step.status is StepStatus.RETURNING
        assert (np.abs(step.velocity) <= chain.velocity * (1 + 1e-9)).all()
        q, steps = step.q, steps + 1
        assert steps <= share * width / (DT * chain.velocity[joint]) + 2, "as fast as its velocity limit allows"


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.slow
def test_at_rest_when_reached_and_when_out_of_reach(chain: qparm.SerialChain, method: str) -> None:
    """No chatter: once at rest, 10,000 further steps do not move a joint."""
    rng = np.random.default_rng(3)
    ik = DifferentialIK(chain, time_step=DT, method=method)
    ends = []
    for case in range(6):
        q, target = chain.random(rng, 1)[0], chain.forward(chain.random(rng, 1)[0])
        if case % 2:
            target[:3, 3] *= 3.0
        for _ in range(20_000):
            step = ik.step(q, target)
            q = step.q
            if step.status in (StepStatus.REACHED, StepStatus.AT_REST):
                break
        ends.append(step.status)
        rest = q.copy()
        for _ in range(10_000):
            step = ik.step(q, target)
            q = step.q
        np.testing.assert_allclose(q, rest, atol=1e-9)
        assert step.status in (StepStatus.REACHED, StepStatus.AT_REST)
        if step.status is StepStatus.REACHED:
            assert step.position_error < 1e-9
    assert StepStatus.AT_REST in ends[1::2]


@pytest.mark.parametrize("solver", ["proxqp", "osqp", "daqp"])
def test_a_solver_takes_the_same_step(chain: qparm.SerialChain, solver: str) -> None:
    rng = np.random.default_rng(4)
    ours, theirs = DifferentialIK(chain, time_step=DT), DifferentialIK(chain, time_step=DT, solver=solver)
    for _ in range(50):
        q, target = chain.random(rng, 1)[0], chain.forward(chain.random(rng, 1)[0])
        a, b = ours.step(q, target), theirs.step(q, target)
        np.testing.assert_allclose(a.q, b.q, atol=1e-8)
        assert a.status is b.status
    assert theirs.solved + theirs.fallbacks == 50
    assert theirs.solved >= 40


@pytest.mark.parametrize("solver", ["auto", "proxqp"])
def test_nothing_that_is_not_finite_becomes_a_joint(chain: qparm.SerialChain, solver: str) -> None:
    ik = DifferentialIK(chain, time_step=DT, solver=solver)
    q, target = np.zeros(8), np.eye(4)
    for bad in (np.nan, np.inf):
        with pytest.raises(qparm.InvalidInput, match="theta5"):
            ik.step(np.array([0, 0, 0, 0, bad, 0, 0, 0]), target)
        with pytest.raises(qparm.InvalidInput, match="target"):
            ik.step(q, np.where(np.arange(16).reshape(4, 4) == 6, bad, target))
    with pytest.raises(qparm.InvalidInput, match=r"\(8,\)"):
        ik.step(np.zeros(7), target)


@pytest.mark.parametrize("time_step", [0.0, -1.0, np.nan, np.inf, None, "1"])
def test_a_time_step_must_be_positive(chain: qparm.SerialChain, time_step: Any) -> None:
    with pytest.raises(qparm.InvalidInput, match="time_step"):
        DifferentialIK(chain, time_step=time_step)
