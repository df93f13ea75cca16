"""The step: closed forms against the paper's formulas, bounded steps against the truth."""

from __future__ import annotations

from dataclasses import replace

import cvxpy as cp
import numpy as np
import pytest
from comparisons.truth import true_step
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import qparm
from qparm.ik import (
    StepProblem,
    active_set,
    chan_dubey_weights,
    check_optimality,
    clamping_weights,
    closed_form,
    step_bounds,
    step_problem,
)
from qparm.ik.active_set_step import active_set_kernel

UNBOUNDED = np.full(8, np.inf)


def random_step(
    rng: np.random.Generator, lam2: float, *, zeros: int = 0, width: float = 0.3, rank: int = 6
) -> StepProblem:
    J = rng.normal(size=(6, 8))
    if rank < 6:
        U, s, Vt = np.linalg.svd(J, full_matrices=False)
        s[rank:] = 0.0
        J = (U * s) @ Vt
    S = rng.uniform(0.05, 1.0, 8)
    S[rng.permutation(8)[:zeros]] = 0.0
    size = 10 ** rng.uniform(-4, -1)
    return StepProblem(
        J=J, e=size * rng.normal(size=6), S=S, c=0.1 * size * rng.normal(size=8), lam2=lam2,
        lb=-width * size * rng.uniform(0, 1, 8), ub=width * size * rng.uniform(0, 1, 8),
    )  # fmt: skip


# --- the paper's formulas -----------------------------------------------------------------------------


def test_wln_is_equation_3(rng: np.random.Generator) -> None:
    J, e, W, lam2 = rng.normal(size=(6, 8)), rng.normal(size=6), rng.uniform(1, 50, 8), 1e-4
    step = StepProblem(J=J, e=e, S=W**-0.5, c=np.zeros(8), lam2=lam2, lb=-UNBOUNDED, ub=UNBOUNDED)
    Wi = np.diag(1 / W)
    expected = Wi @ J.T @ np.linalg.solve(J @ Wi @ J.T + lam2 * np.eye(6), e)
    np.testing.assert_allclose(closed_form(step), expected, rtol=1e-9, atol=1e-12)


def test_cwln_is_equation_4(rng: np.random.Generator) -> None:
    J, e, phi, lam2 = rng.normal(size=(6, 8)), rng.normal(size=6), 0.1 * rng.normal(size=8), 1e-4
    W = rng.uniform(0, 1, 8)
    W[3] = 0.0
    step = StepProblem(J=J, e=e, S=W**0.5, c=-(1 - W) * phi, lam2=lam2, lb=-UNBOUNDED, ub=UNBOUNDED)
    Wt, clamp = np.diag(W), (1 - W) * phi
    expected = -clamp + Wt @ J.T @ np.linalg.solve(J @ Wt @ J.T + lam2 * np.eye(6), e + J @ clamp)
    np.testing.assert_allclose(closed_form(step), expected, rtol=1e-9, atol=1e-12)
    assert closed_form(step)[3] == -phi[3]


def test_gpm_is_equation_2_with_the_task_as_equality(rng: np.random.Generator) -> None:
    J, e, H = rng.normal(size=(6, 8)), rng.normal(size=6), rng.normal(size=8)
    step = StepProblem(J=J, e=e, S=np.ones(8), c=H, lam2=0.0, lb=-UNBOUNDED, ub=UNBOUNDED)
    expected = np.linalg.pinv(J) @ e + (np.eye(8) - np.linalg.pinv(J) @ J) @ H
    np.testing.assert_allclose(closed_form(step), expected, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(active_set(step), expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("method", ["dls", "wln", "cwln", "gpm"])
def test_methods_fill_in_their_row_of_the_table(
    chain: qparm.SerialChain, rng: np.random.Generator, method: str
) -> None:
    for _ in range(20):
        q = chain.random(rng, 1)[0]
        target = chain.forward(np.clip(q + 0.02 * chain.scale, chain.lower, chain.upper))
        step = step_problem(chain, q, target, method=method)
        e_norm = float(np.linalg.norm(step.e))
        assert step.lam2 == pytest.approx(1e-3 * e_norm**2 + 1e-12, rel=1e-12)
        np.testing.assert_allclose(step.J, chain.scaled_jacobian(q), atol=1e-14)
        if method == "dls":
            R, c = np.ones(8), np.zeros(8)
        elif method == "wln":
            direction = closed_form(step_problem(chain, q, target, method="dls"))
            R, c = chan_dubey_weights(chain, q, direction), np.zeros(8)
        elif method == "cwln":
            W, phi = clamping_weights(chain, q)
            np.testing.assert_allclose(step.S**2, W, atol=1e-14)
            c = np.clip(-(1 - W) * phi * min(1.0, e_norm / 1e-2), step.lb, step.ub)
            np.testing.assert_allclose(step.c, c, atol=1e-14)
            continue
        else:
            middle = 0.5 * (chain.lower + chain.upper)
            R, c = np.ones(8), -0.1 * (q - middle) / chain.scale * min(1.0, e_norm / 1e-2)
            c = np.clip(c, step.lb, step.ub)
        np.testing.assert_allclose(step.S**-2, R, rtol=1e-9)
        np.testing.assert_allclose(step.c, c, atol=1e-14)


# --- weights ------------------------------------------------------------------------------------------


def test_clamping_weight_is_a_mobility_and_the_clamp_points_outwards(chain: qparm.SerialChain) -> None:
    middle = 0.5 * (chain.lower + chain.upper)
    W, phi = clamping_weights(chain, middle)
    np.testing.assert_array_equal(W, 1.0)
    np.testing.assert_allclose(phi, 0.0, atol=1e-15)
    W, phi = clamping_weights(chain, chain.upper)
    np.testing.assert_array_equal(W, 0.0)
    np.testing.assert_allclose(phi, 0.1)
    W, phi = clamping_weights(chain, chain.lower)
    np.testing.assert_allclose(phi, -0.1)
    assert (-(1 - W) * phi > 0).all(), "the centre of the step pulls back into the range"


def test_clamping_weight_falls_steadily_and_without_a_step(chain: qparm.SerialChain) -> None:
    x = np.linspace(0, 1, 2001)[:, None]
    Q = chain.lower + x * (chain.upper - chain.lower)
    W = np.array([clamping_weights(chain, q)[0] for q in Q])
    rising, falling = np.diff(W[:201], axis=0), np.diff(W[1800:], axis=0)
    assert (rising >= 0).all()
    assert (falling <= 0).all()
    assert np.abs(np.diff(W, axis=0)).max() < 0.01
    np.testing.assert_array_equal(W[201:1800], 1.0)


def test_chan_dubey_weight_is_the_gradient_of_its_potential(chain: qparm.SerialChain, rng: np.random.Generator) -> None:
    D = chain.scale

    def potential(q: np.ndarray) -> np.ndarray:
        lower, upper, x = chain.lower / D, chain.upper / D, q / D
        return 0.25 * (upper - lower) ** 2 / ((upper - x) * (x - lower))

    q = chain.lower + rng.uniform(0.05, 0.95, 8) * (chain.upper - chain.lower)
    h = 1e-6
    gradient = (potential(q + h * D) - potential(q - h * D)) / (2 * h)
    np.testing.assert_allclose(chan_dubey_weights(chain, q), 1 + np.abs(gradient), rtol=1e-5)
    away = -np.sign(gradient)
    np.testing.assert_array_equal(chan_dubey_weights(chain, q, away), 1.0)


# --- bounds -------------------------------------------------------------------------------------------


def test_bounds_keep_position_limits_trust_region_and_velocity(chain: qparm.SerialChain) -> None:
    q = chain.upper - 0.01 * chain.scale
    lb, ub, returning = step_bounds(chain, q)
    np.testing.assert_allclose(ub, 0.01, atol=1e-12)
    np.testing.assert_allclose(lb, [-0.25, *[-0.3] * 7])
    assert not returning.any()
    lb, ub, _ = step_bounds(chain, 0.5 * (chain.lower + chain.upper), time_step=0.05)
    np.testing.assert_allclose(ub * chain.scale, 0.05 * chain.velocity)
    np.testing.assert_allclose(lb, -ub)


def test_a_joint_outside_its_range_comes_back_as_fast_as_allowed(chain: qparm.SerialChain) -> None:
    q = 0.5 * (chain.lower + chain.upper)
    q[2] = chain.upper[2] + 0.5
    lb, ub, returning = step_bounds(chain, q, time_step=0.1)
    assert lb[2] == ub[2] == pytest.approx(-0.1 * chain.velocity[2])
    np.testing.assert_array_equal(np.flatnonzero(returning), [2])


# --- the bounded step -----------------------------------------------------------------------------------

LAM2 = st.sampled_from([1e-2, 1e-4, 1e-6, 1e-8, 1e-10])


@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(seed=st.integers(0, 10**9), lam2=LAM2, zeros=st.integers(0, 4), width=st.sampled_from([1e-3, 0.1, 1.0, 10.0]))
def test_active_set_is_the_true_step(seed: int, lam2: float, zeros: int, width: float) -> None:
    step = random_step(np.random.default_rng(seed), lam2, zeros=zeros, width=width)
    d = active_set(step)
    assert step.within_bounds(d)
    truth = true_step(step, d)
    assert truth is not None
    assert float(np.abs(d - truth).max()) <= 1e-10


@settings(max_examples=200, deadline=None)
@given(seed=st.integers(0, 10**9), lam2=st.sampled_from([1e-2, 1e-6]), rank=st.integers(0, 5))
def test_rank_deficient_jacobians_are_handled(seed: int, lam2: float, rank: int) -> None:
    step = random_step(np.random.default_rng(seed), lam2, rank=rank)
    d = active_set(step)
    assert step.within_bounds(d)
    truth = true_step(step, d)
    assert truth is not None
    assert float(np.abs(d - truth).max()) <= 1e-10


@settings(max_examples=200, deadline=None)
@given(seed=st.integers(0, 10**9), lam2=LAM2)
def test_the_closed_form_is_the_bounded_step_where_it_keeps_the_bounds(seed: int, lam2: float) -> None:
    step = random_step(np.random.default_rng(seed), lam2, width=3.0)
    d = closed_form(step)
    if step.within_bounds(d):
        np.testing.assert_allclose(active_set(step), d, atol=1e-8)
    else:
        assert np.abs(active_set(step) - d).max() > 0


@settings(max_examples=200, deadline=None)
@given(seed=st.integers(0, 10**9), lam2=LAM2, exponent=st.floats(-12, -2))
def test_the_error_bound_is_a_bound(seed: int, lam2: float, exponent: float) -> None:
    """Whatever is handed in as a step, the proved bound is not less than its true error."""
    rng = np.random.default_rng(seed)
    step = random_step(rng, lam2, zeros=int(rng.integers(0, 3)))
    d, z = np.empty(8), np.empty(6)
    assert active_set_kernel(step.JT, step.S, step.c, step.e, step.lam2, step.lb, step.ub, d, z) > 0
    truth = true_step(step, d)
    assert truth is not None
    moved = np.clip(d + 10**exponent * rng.normal(size=8) * (step.S > 0), step.lb, step.ub)
    error = float(np.linalg.norm(moved - truth))
    found = check_optimality(step, moved, z)
    assert found.error_bound >= error * (1 - 1e-6) - 1e-15
    assert not (error > 1e-8 and found.holds())


def test_the_right_step_is_proved(rng: np.random.Generator) -> None:
    """With the damping that the iteration uses, also where the task cannot be met within the bounds."""
    for _ in range(200):
        drawn = random_step(rng, 1.0, zeros=int(rng.integers(0, 3)))
        step = replace(drawn, lam2=1e-3 * float(drawn.e @ drawn.e) + 1e-12)
        d, z = np.empty(8), np.empty(6)
        active_set_kernel(step.JT, step.S, step.c, step.e, step.lam2, step.lb, step.ub, d, z)
        assert check_optimality(step, d, z).holds()


def test_steps_of_the_arm_agree_with_cvxpy(chain: qparm.SerialChain, rng: np.random.Generator) -> None:
    for method in ("dls", "wln", "cwln", "gpm"):
        for _ in range(5):
            q = chain.random(rng, 1)[0]
            target = chain.forward(np.clip(q + 0.2 * rng.normal(size=8) * chain.scale, chain.lower, chain.upper))
            step = step_problem(chain, q, target, method=method)
            S = np.maximum(step.S, 1e-300)
            y = cp.Variable(8)
            B, r = step.J * step.S, step.e - step.J @ step.c
            movable = step.S > 1e-9
            bounds = [y[movable] >= ((step.lb - step.c) / S)[movable], y[movable] <= ((step.ub - step.c) / S)[movable]]
            # both terms divided by lambda^2: the solver's tolerances are absolute
            cost = cp.sum_squares(y) + cp.sum_squares(B @ y - r) / step.lam2
            cp.Problem(cp.Minimize(0.5 * cost), bounds).solve(solver="DAQP")
            expected = step.c + step.S * y.value
            np.testing.assert_allclose(active_set(step), expected, atol=1e-8)


# --- what is refused ------------------------------------------------------------------------------------


def valid() -> dict:
    return {"J": np.ones((6, 2)), "e": np.ones(6), "S": np.ones(2), "c": np.zeros(2), "lam2": 1e-3,
            "lb": -np.ones(2), "ub": np.ones(2)}  # fmt: skip


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"J": np.ones((5, 2))}, "J must be"),
        ({"J": np.ones((6, 0))}, "n > 0"),
        ({"e": np.array([1, 2, np.nan, 4, 5, 6])}, "e has an entry that is not finite at 2"),
        ({"S": np.array([1.0, -1.0])}, r"S\[1\]"),
        ({"lam2": -1.0}, "lambda"),
        ({"lam2": np.nan}, "lambda"),
        ({"lb": np.array([0.0, np.nan])}, "lb has a NaN at 1"),
        ({"lb": np.array([0.0, 2.0])}, "reversed at 1: lb = 2.0 > ub = 1.0"),
        ({"c": np.zeros(3)}, "c must be"),
    ],
)
def test_unusable_steps_are_refused_by_name(change: dict, words: str) -> None:
    with pytest.raises(qparm.InvalidInput, match=words):
        StepProblem(**(valid() | change))


def test_infinite_bounds_are_handled() -> None:
    step = StepProblem(**(valid() | {"lb": np.array([-np.inf, -1.0]), "ub": np.array([np.inf, np.inf])}))
    np.testing.assert_allclose(active_set(step), closed_form(step), atol=1e-12)


def test_a_bound_far_off_is_no_bound_and_no_mark_of_a_joint_that_does_not_move() -> None:
    open_step = StepProblem(**(valid() | {"lb": np.full(2, -np.inf), "ub": np.full(2, np.inf)}))
    for far in (1e299, 1e300, 1e301, np.finfo(float).max):
        step = StepProblem(**(valid() | {"lb": np.full(2, -far), "ub": np.full(2, far)}))
        np.testing.assert_array_equal(active_set(step), active_set(open_step))


def test_a_step_that_is_not_finite_keeps_no_bound(rng: np.random.Generator) -> None:
    step = StepProblem(J=rng.normal(size=(6, 8)), e=np.ones(6), S=np.ones(8), c=np.zeros(8), lam2=1e-6,
                       lb=-np.ones(8), ub=np.ones(8))  # fmt: skip
    d = active_set(step)
    for bad in (np.nan, np.inf, -np.inf):
        for at in (0, 7):
            broken = d.copy()
            broken[at] = bad
            found = check_optimality(step, broken, np.zeros(6))
            assert found.bound_violation == np.inf
            assert not found.holds()


def test_an_exact_task_on_a_singular_jacobian_is_refused(rng: np.random.Generator) -> None:
    J = rng.normal(size=(6, 8))
    J[5] = J[4]
    step = StepProblem(J=J, e=np.ones(6), S=np.ones(8), c=np.zeros(8), lam2=0.0, lb=-UNBOUNDED, ub=UNBOUNDED)
    J[5] = 0.0
    singular = StepProblem(J=J, e=np.ones(6), S=np.ones(8), c=np.zeros(8), lam2=0.0, lb=-UNBOUNDED, ub=UNBOUNDED)
    assert step.n == 8
    with pytest.raises(qparm.InvalidInput, match="full row rank"):
        closed_form(singular)


def test_what_would_be_read_past_its_end_is_refused(chain: qparm.SerialChain) -> None:
    """The kernels and the solvers' workspaces trust their sizes: nothing of another size may reach them."""
    from qparm.ik import check_optimality, make_solver

    q, target = np.zeros(8), chain.forward(np.full(8, 0.1))
    step = step_problem(chain, q, target)
    for towards in (np.array([-1.0]), np.ones(3), np.full(8, np.nan)):
        with pytest.raises(qparm.InvalidInput, match="towards"):
            step_problem(chain, q, target, method="wln", towards=towards)
    for name in ("proxqp", "osqp", "daqp"):
        with pytest.raises(qparm.InvalidInput, match="7 joints, not 8"):
            make_solver(name, 7).solve(step)
    for d, z in ((np.zeros(3), np.zeros(6)), (np.zeros(8), np.zeros(2))):
        with pytest.raises(qparm.InvalidInput, match="d must be"):
            check_optimality(step, d, z)


def test_the_callers_arrays_are_left_alone(chain: qparm.SerialChain) -> None:
    towards = np.full(8, -1.0)
    step_problem(chain, np.zeros(8), chain.forward(np.full(8, 0.1)), method="wln", towards=towards)
    np.testing.assert_array_equal(towards, -1.0)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"q": np.zeros((2, 8))}, "one configuration"),
        ({"target": np.stack([np.eye(4)] * 2)}, "one"),
        ({"reference": np.zeros((2, 8)), "method": "gpm"}, "reference"),
        ({"gain": np.nan, "method": "gpm"}, "gain"),
        ({"time_step": np.nan}, "time_step"),
    ],
)
def test_unusable_arguments_are_refused_by_name(chain: qparm.SerialChain, change: dict, words: str) -> None:
    arguments = {"q": np.zeros(8), "target": np.eye(4)} | change
    with pytest.raises(qparm.InvalidInput, match=words):
        step_problem(chain, arguments.pop("q"), arguments.pop("target"), **arguments)
    with pytest.raises(qparm.InvalidInput, match="one configuration"):
        step_bounds(chain, np.zeros((2, 8)))


def test_bounds_that_leave_no_step_are_refused() -> None:
    with pytest.raises(qparm.InvalidInput, match="leaves no step"):
        StepProblem(**(valid() | {"lb": np.array([np.inf, 0.0]), "ub": np.array([np.inf, 1.0])}))


def test_joints_that_are_all_but_immovable_cost_no_digits() -> None:
    """WLN at a limit: S of 4e-9 is a free joint by count, but none for the rank of the task."""
    rng = np.random.default_rng(8)
    for _ in range(50):
        drawn = random_step(rng, 1e-10)
        S = drawn.S.copy()
        S[:3] = 4e-9
        step = replace(drawn, S=S, c=np.zeros(8))
        truth = true_step(step, active_set(step))
        assert truth is not None
        assert float(np.abs(active_set(step) - truth).max()) <= 1e-10
