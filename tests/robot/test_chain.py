"""The chain as data: what it refuses and how it says so, read-only arrays, limits."""

from __future__ import annotations

import pickle
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import qparm
from conftest import cell_data
from qparm.errors import InvalidInput, QparmError
from qparm.robot import (
    DHRow,
    Joint,
    SerialChain,
    chain_from_dh,
    check_poses,
    rest_to_rest_time,
)

Array = NDArray[np.float64]


def joint(**changes: Any) -> Joint:
    values: dict[str, Any] = {
        "name": "elbow",
        "kind": "revolute",
        "transform_previous_joint": np.eye(4),
        "position": (-1.0, 2.0),
        "velocity": 1.0,
        "acceleration": 2.0,
        "jerk": 3.0,
    }
    return Joint(**values | changes)


def small_chain(*joints: Joint, **changes: Any) -> SerialChain:
    values: dict[str, Any] = {
        "name": "small",
        "joints": joints or (joint(),),
        "transform_base": np.eye(4),
        "transform_tool": np.eye(4),
    }
    return SerialChain(**values | changes)


def no_transform(what: str) -> Array:
    T = np.eye(4)
    match what:
        case "mirror":
            T[0, 0] = -1.0
        case "scaled":
            T[:3, :3] *= 1.01
        case "sheared":
            T[0, 1] = 1e-3
        case "last row":
            T[3, 0] = 1e-3
        case "nan":
            T[1, 3] = np.nan
        case "inf":
            T[1, 1] = np.inf
        case "3x4":
            return T[:3]
    return T


NOT_RIGID = ["mirror", "scaled", "sheared", "last row", "nan", "inf", "3x4"]


# --- configurations -----------------------------------------------------------------------------------


@pytest.mark.parametrize("shape", [(7,), (9,), (3, 7), (8, 3), (2, 3, 8), (0,), ()])
@pytest.mark.parametrize("method", ["forward", "jacobian", "scaled_jacobian", "frames", "within_limits"])
def test_wrong_shapes_are_refused_with_both_shapes_named(
    chain: SerialChain, method: str, shape: tuple[int, ...]
) -> None:
    with pytest.raises(InvalidInput, match=r"has 8 joints: q must be \(8,\) or \(N, 8\), not \(") as caught:
        getattr(chain, method)(np.zeros(shape))
    assert str(shape if shape else (1,)) in str(caught.value)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("method", ["forward", "jacobian", "scaled_jacobian", "frames", "within_limits"])
def test_a_value_that_is_not_finite_names_its_joint(chain: SerialChain, method: str, bad: float) -> None:
    q = np.zeros(8)
    q[4] = bad
    with pytest.raises(InvalidInput, match=r"joint 'theta5': (nan|inf|-inf) is not finite"):
        getattr(chain, method)(q)


@pytest.mark.parametrize("method", ["forward", "jacobian", "within_limits"])
def test_a_value_that_is_not_finite_names_its_joint_and_configuration(chain: SerialChain, method: str) -> None:
    Q = np.zeros((6, 8))
    Q[3, 0] = np.nan
    Q[5, 7] = np.nan
    with pytest.raises(InvalidInput, match="configuration 3, joint 'd1'"):
        getattr(chain, method)(Q)


def test_refusals_are_both_qparm_errors_and_value_errors(chain: SerialChain) -> None:
    with pytest.raises(QparmError):
        chain.forward(np.zeros(3))
    with pytest.raises(ValueError):
        chain.forward(np.zeros(3))


def test_within_limits_is_elementwise_with_the_limits_included(chain: SerialChain) -> None:
    assert chain.within_limits(chain.lower).all()
    assert chain.within_limits(chain.upper).all()
    for sign, limit in ((-1, chain.lower), (1, chain.upper)):
        outside = chain.within_limits(limit + sign * 1e-6 * np.eye(8))
        assert np.array_equal(outside, ~np.eye(8, dtype=bool))
        assert chain.within_limits(limit + sign * 1e-6 * np.eye(8), tolerance=1.1e-6).all()
        assert not chain.within_limits(limit + sign * 1e-6 * np.eye(8), tolerance=0.9e-6).all()


# --- joints --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "position", [(1.0, -1.0), (1.0, 1.0), (np.nan, 1.0), (0.0, np.nan), (-np.inf, 1.0), (0.0, np.inf)]
)
def test_unusable_position_limits_name_the_joint(position: tuple[float, float]) -> None:
    with pytest.raises(InvalidInput, match=r"joint 'elbow': position limits .* finite and ascending"):
        joint(position=position)


@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf])
@pytest.mark.parametrize("limit", ["velocity", "acceleration", "jerk"])
def test_unusable_limits_name_the_joint_and_the_limit(limit: str, value: float) -> None:
    with pytest.raises(InvalidInput, match=f"joint 'elbow': {limit} limit must be finite and positive"):
        joint(**{limit: value})


@pytest.mark.parametrize("what", NOT_RIGID)
def test_a_joints_transform_that_is_none_names_the_joint(what: str) -> None:
    with pytest.raises(InvalidInput, match="transform of joint 'elbow'"):
        joint(transform_previous_joint=no_transform(what))


@pytest.mark.parametrize("kind", ["Prismatic", "rotary", "fixed", ""])
def test_an_unknown_kind_of_joint_is_refused(kind: str) -> None:
    """Not taken for a revolute joint."""
    with pytest.raises(InvalidInput, match="elbow"):
        joint(kind=kind)


def test_a_joint_keeps_its_own_copy_of_the_transform() -> None:
    T = np.eye(4)
    kept = joint(transform_previous_joint=T)
    T[0, 3] = 5.0
    assert np.array_equal(kept.transform_previous_joint, np.eye(4))


# --- chains --------------------------------------------------------------------------------------------


def test_a_chain_without_joints_is_refused() -> None:
    with pytest.raises(InvalidInput, match="at least one joint"):
        small_chain(joints=())
    with pytest.raises(InvalidInput, match="at least one joint"):
        chain_from_dh([], convention="modified")


def test_repeated_names_are_refused_and_listed() -> None:
    with pytest.raises(InvalidInput, match=r"joint names must differ: \['a', 'b', 'a'\]"):
        small_chain(joint(name="a"), joint(name="b"), joint(name="a"))


@pytest.mark.parametrize("what", NOT_RIGID)
@pytest.mark.parametrize("name", ["transform_base", "transform_tool"])
def test_a_base_or_tool_that_is_no_transform_is_refused_by_name(name: str, what: str) -> None:
    with pytest.raises(InvalidInput, match=name):
        small_chain(**{name: no_transform(what)})


@pytest.mark.parametrize("length", [0.0, -0.4, np.nan, np.inf])
def test_an_unusable_characteristic_length_is_refused(length: float) -> None:
    with pytest.raises(InvalidInput, match="characteristic_length"):
        small_chain(characteristic_length=length)


def test_a_chain_of_one_joint_is_enough() -> None:
    assert small_chain().forward([0.3]).shape == (4, 4)
    assert small_chain().jacobian([0.3]).shape == (6, 1)


def test_arrays_are_read_only(chain: SerialChain) -> None:
    for name in ("prismatic", "lower", "upper", "velocity", "acceleration", "jerk", "scale", "fixed"):
        array = getattr(chain, name)
        with pytest.raises(ValueError, match="read-only"):
            array[0] = array[-1]
    for array in (
        chain.transform_base,
        chain.transform_tool,
        *(j.transform_previous_joint for j in chain.joints),
    ):
        with pytest.raises(ValueError, match="read-only"):
            array[0, 3] = 1.0


def test_a_chain_keeps_its_own_copy_of_base_and_tool() -> None:
    base, tool = np.eye(4), np.eye(4)
    arm = small_chain(transform_base=base, transform_tool=tool)
    base[0, 3] = tool[0, 3] = 5.0
    assert np.array_equal(arm.forward([0.0]), np.eye(4))


def test_a_chain_says_what_the_cell_says(chain: SerialChain) -> None:
    assert chain.n == 8
    assert chain.names == ("d1", "theta2", "theta3", "theta4", "theta5", "theta6", "theta7", "theta8")
    assert np.array_equal(chain.prismatic, [True] + 7 * [False])
    angles = np.radians([170, 120, 170, 120, 170, 120, 175])
    np.testing.assert_allclose(chain.lower, [0.0, *-angles], rtol=1e-15)
    np.testing.assert_allclose(chain.upper, [0.8, *angles], rtol=1e-15)
    np.testing.assert_allclose(chain.velocity, [0.2, *7 * [np.radians(60)]], rtol=1e-15)
    np.testing.assert_allclose(chain.acceleration, [0.6, *7 * [np.radians(180)]], rtol=1e-15)
    np.testing.assert_allclose(chain.jerk, [6.0, *7 * [np.radians(1800)]], rtol=1e-15)
    assert np.array_equal(chain.scale, [0.4] + 7 * [1.0])


def test_replacing_a_part_forgets_what_was_computed_from_it(chain: SerialChain) -> None:
    assert chain.scale[0] == 0.4
    before = chain.forward(np.zeros(8))
    T = np.eye(4)
    T[0, 3] = 1.0
    moved = replace(chain, transform_base=T, characteristic_length=0.7)
    assert moved.scale[0] == 0.7
    np.testing.assert_allclose(moved.forward(np.zeros(8)) - before, T - np.eye(4), atol=1e-15)


def test_a_chain_pickles_with_everything_it_computes(chain: SerialChain, rng: np.random.Generator) -> None:
    Q = chain.random(rng, 3)
    copy = pickle.loads(pickle.dumps(chain))
    assert copy.names == chain.names
    assert np.array_equal(copy.forward(Q), chain.forward(Q))
    assert copy.reach_bound.reach == chain.reach_bound.reach


# --- random, index ---------------------------------------------------------------------------------------


def test_random_configurations_fill_the_limits_and_stay_within(chain: SerialChain, rng: np.random.Generator) -> None:
    Q = chain.random(rng, 5000)
    assert Q.shape == (5000, 8)
    assert chain.within_limits(Q).all()
    share = (Q - chain.lower) / (chain.upper - chain.lower)
    assert share.min(axis=0).max() < 0.01
    assert share.max(axis=0).min() > 0.99
    np.testing.assert_allclose(share.mean(axis=0), 0.5, atol=0.03)
    assert np.abs(np.corrcoef(share.T) - np.eye(8)).max() < 0.08


def test_random_configurations_follow_the_seed(chain: SerialChain) -> None:
    first, again, other = (chain.random(np.random.default_rng(seed), 4) for seed in (7, 7, 8))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)
    assert chain.random(np.random.default_rng(0), 0).shape == (0, 8)


def test_index_finds_joints_by_name_and_names_those_there_are(chain: SerialChain) -> None:
    assert [chain.index(name) for name in chain.names] == list(range(8))
    with pytest.raises(InvalidInput, match=r"no joint 'theta9' in 'rail arm'; its joints are d1, theta2, .*"):
        chain.index("theta9")


# --- from a table ------------------------------------------------------------------------------------------


def row(**changes: Any) -> DHRow:
    values: dict[str, Any] = {
        "name": "elbow",
        "kind": "revolute",
        "alpha": 0.1,
        "a": 0.2,
        "d": 0.3,
        "theta": 0.4,
        "position": (-1.0, 1.0),
        "velocity": 1.0,
        "acceleration": 1.0,
        "jerk": 1.0,
    }
    return DHRow(**values | changes)


@pytest.mark.parametrize("convention", ["craig", "Modified", "", None])
def test_an_unknown_convention_is_refused(convention: Any) -> None:
    with pytest.raises(InvalidInput, match="'modified' or 'standard', not"):
        chain_from_dh([row()], convention=convention)


def test_there_is_no_default_convention() -> None:
    with pytest.raises(TypeError, match="convention"):
        chain_from_dh([row()])  # type: ignore[call-arg]


@pytest.mark.parametrize("convention", ["modified", "standard"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("key", ["alpha", "a", "d", "theta"])
def test_a_table_entry_that_is_not_finite_names_the_joint(key: str, value: float, convention: Any) -> None:
    with pytest.raises(InvalidInput, match="elbow"):
        chain_from_dh([row(name="first"), row(**{key: value}), row(name="last")], convention=convention)


def test_a_cell_with_reversed_limits_is_refused_with_the_joint_in_the_key() -> None:
    data = cell_data()
    data["arm"]["joints"][2]["position"] = ["120 deg", "-120 deg"]
    with pytest.raises(qparm.CellError, match=r"arm\.joints\[2\]\.position: the limits are reversed"):
        qparm.Cell.load(data)


# --- poses --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("what", NOT_RIGID[:-1])
def test_check_poses_names_the_first_pose_that_is_none(what: str) -> None:
    poses = np.tile(np.eye(4), (5, 1, 1))
    poses[3] = poses[4] = no_transform(what)
    with pytest.raises(InvalidInput, match=r"^target 3 "):
        check_poses(poses, what="target")
    with pytest.raises(InvalidInput, match=r"^target (is|has)"):
        check_poses(poses[3], what="target")


@pytest.mark.parametrize("shape", [(4,), (3, 4), (5, 3, 4), (4, 4, 5), ()])
def test_check_poses_refuses_shapes_that_are_no_poses(shape: tuple[int, ...]) -> None:
    with pytest.raises(InvalidInput, match=r"must be a \(4, 4\) matrix"):
        check_poses(np.zeros(shape))


def test_check_poses_returns_what_is_right_contiguous() -> None:
    poses = np.tile(np.eye(4), (2, 3, 1, 1))
    assert check_poses(poses).shape == (2, 3, 4, 4)
    assert check_poses(poses[::-1]).flags.c_contiguous
    assert check_poses(np.empty((0, 4, 4))).shape == (0, 4, 4)
    assert check_poses(np.eye(4, dtype=int)).dtype == np.float64


# --- limits over time -----------------------------------------------------------------------------------------


def quintic_ratio(arm: SerialChain, step: Array, time: float) -> float:
    """Return the greatest share of any limit on a densely sampled rest-to-rest quintic."""
    x = np.linspace(0.0, 1.0, 20001)
    derivatives = (
        30 * x**2 - 60 * x**3 + 30 * x**4,
        60 * x - 180 * x**2 + 120 * x**3,
        60 - 360 * x + 360 * x**2,
    )
    limits = (arm.velocity, arm.acceleration, arm.jerk)
    return max(
        float((np.abs(step) * np.abs(shape).max() / time**k / limit).max())
        for k, (shape, limit) in enumerate(zip(derivatives, limits, strict=True), start=1)
    )


def brute_force_time(arm: SerialChain, step: Array) -> float:
    short, long = 1e-6, 1e3
    for _ in range(80):
        middle = np.sqrt(short * long)
        short, long = (short, middle) if quintic_ratio(arm, step, middle) <= 1 else (middle, long)
    return long


@pytest.mark.parametrize("size", [1e-4, 1e-2, 0.2, 3.0])
def test_rest_to_rest_time_is_that_of_the_shortest_quintic(
    chain: SerialChain, rng: np.random.Generator, size: float
) -> None:
    """Small steps are bound by jerk, large ones by velocity, and those between by acceleration."""
    for _ in range(5):
        q0, step = rng.normal(size=8), size * rng.normal(size=8)
        time = float(rest_to_rest_time(chain, q0, q0 + step))
        assert time == pytest.approx(brute_force_time(chain, step), rel=1e-7)


@pytest.mark.parametrize(("limit", "power"), [("velocity", 1), ("acceleration", 2), ("jerk", 3)])
def test_each_limit_alone_decides_the_time(limit: str, power: int) -> None:
    limits = {"velocity": 1e6, "acceleration": 1e6, "jerk": 1e6} | {limit: 0.5}
    arm = small_chain(joint(**limits))
    peak = {"velocity": 15 / 8, "acceleration": 10 / np.sqrt(3), "jerk": 60}[limit]
    assert float(rest_to_rest_time(arm, [0.0], [1.7])) == pytest.approx((peak * 1.7 / 0.5) ** (1 / power))


def test_rest_to_rest_time_of_many_steps(chain: SerialChain, rng: np.random.Generator) -> None:
    A, B = chain.random(rng, 12).reshape(3, 4, 8), chain.random(rng, 12).reshape(3, 4, 8)
    times = rest_to_rest_time(chain, A, B)
    assert times.shape == (3, 4)
    assert times[2, 1] == rest_to_rest_time(chain, A[2, 1], B[2, 1])
    assert np.array_equal(times, rest_to_rest_time(chain, B, A))
    assert np.array_equal(rest_to_rest_time(chain, A, A), np.zeros((3, 4)))
    assert rest_to_rest_time(chain, A[0, 0], B).shape == (3, 4)
