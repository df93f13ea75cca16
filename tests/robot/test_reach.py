"""The greatest reach of the links: its value where it is known, and that nothing ever exceeds it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from qparm.robot import DHRow, SerialChain, chain_from_dh
from qparm.robot.reach import excess_of_reach, reach_bound

Array = NDArray[np.float64]
Line = tuple[str, float, float, float, float, tuple[float, float]]

TURN = (-np.pi, np.pi)


def arm(*lines: Line, convention: str = "modified", tool: Array | None = None) -> SerialChain:
    """Return the chain of lines (kind, alpha, a, d, theta, limits)."""
    rows = [
        DHRow(str(i), kind, alpha, a, d, theta, limits, 1.0, 1.0, 1.0)  # type: ignore[arg-type]
        for i, (kind, alpha, a, d, theta, limits) in enumerate(lines)
    ]
    return chain_from_dh(rows, convention=convention, transform_tool=tool)  # type: ignore[arg-type]


def shift(x: float, y: float, z: float) -> Array:
    T = np.eye(4)
    T[:3, 3] = x, y, z
    return T


def planar(*links: float) -> SerialChain:
    """Return parallel revolute axes, links apart; the tool is 0.3 m beyond the last."""
    return arm(*(("revolute", 0, a, 0, 0, TURN) for a in (0.0, *links)), tool=shift(0.3, 0, 0))


# --- the reference arm --------------------------------------------------------------------------------


def test_the_reference_arm_reaches_upper_arm_plus_forearm(chain: SerialChain) -> None:
    bound = reach_bound(chain)
    assert bound is not None
    assert bound.reach == pytest.approx(0.818, abs=1e-9)
    # folded by 120 deg: the law of cosines with 60 deg at the elbow
    assert bound.least_reach == pytest.approx(np.sqrt(0.400**2 + 0.418**2 - 0.400 * 0.418), abs=1e-9)
    np.testing.assert_allclose(bound.shoulder, [0, 0, 0.480], atol=1e-6)
    np.testing.assert_allclose(bound.wrist, [0, 0, -0.120], atol=1e-6)
    np.testing.assert_allclose(bound.travel_axes, [[0], [1], [0]], atol=1e-15)
    assert np.array_equal(bound.travel, [[0.0, 0.8]])


def test_the_chain_keeps_its_bound(chain: SerialChain) -> None:
    assert chain.reach_bound is chain.reach_bound
    assert chain.reach_bound is not None
    assert chain.reach_bound.reach == reach_bound(chain).reach  # type: ignore[union-attr]


def test_the_stretched_arm_just_reaches(chain: SerialChain) -> None:
    stretched = chain.forward(np.zeros(8))
    assert -3e-6 < excess_of_reach(chain, stretched) <= 0
    for beyond in (3e-6, 1e-3, 0.5):
        excess = excess_of_reach(chain, shift(0, 0, beyond) @ stretched)
        assert excess == pytest.approx(beyond, abs=3e-6)
        assert excess > 0


def test_excess_is_the_wrists_distance_from_the_shoulders_rail(chain: SerialChain, rng: np.random.Generator) -> None:
    """The shoulder slides from (0, 0, 480) to (0, 800, 480) mm; the wrist is 120 mm behind the tool."""
    for _ in range(300):
        pose = shift(*rng.uniform([-1.5, -1.5, -1.5], [1.5, 2.5, 2.0]))
        pose[:3, :3] = Rotation.random(rng=rng).as_matrix()
        wrist = pose[:3, 3] - 0.120 * pose[:3, 2]
        shoulder = np.array([0.0, np.clip(wrist[1], 0.0, 0.8), 0.480])
        expected = np.linalg.norm(wrist - shoulder) - 0.818
        assert excess_of_reach(chain, pose) == pytest.approx(expected, abs=2e-6)


def test_random_configurations_of_the_reference_arm_are_within_the_bound(
    chain: SerialChain, rng: np.random.Generator
) -> None:
    assert max(excess_of_reach(chain, pose) for pose in chain.forward(chain.random(rng, 3000))) <= 0


# --- chains whose reach is known -----------------------------------------------------------------------


def test_parallel_axes_reach_the_sum_of_the_links() -> None:
    chain = planar(0.5, 0.4)
    assert chain.reach_bound is not None
    assert chain.reach_bound.reach == pytest.approx(0.9, abs=1e-7)
    assert -2e-6 < excess_of_reach(chain, chain.forward([0.3, 0, 0])) <= 0
    assert excess_of_reach(chain, shift(1.3, 0, 0)) == pytest.approx(0.1, abs=2e-6)


def test_offsets_along_parallel_axes_count_once() -> None:
    """Heights of 0.3 and -0.3 m along parallel axes are no reach: points may be picked at any height."""
    chain = arm(("revolute", 0, 0, 0, 0, TURN), ("revolute", 0, 0.5, 0.3, 0, TURN), ("revolute", 0, 0.4, -0.3, 0, TURN))
    assert chain.reach_bound is not None
    assert chain.reach_bound.reach == pytest.approx(0.9, abs=1e-6)


def test_a_prismatic_joint_between_adds_its_greatest_travel() -> None:
    """A boom that slides out along the link, 0.2 to 0.6 m beyond its 0.1 m offset."""
    chain = arm(
        ("revolute", 0, 0, 0, 0, TURN),
        ("prismatic", np.pi / 2, 0, 0.1, 0, (0.2, 0.6)),
        ("revolute", -np.pi / 2, 0, 0, 0, TURN),
    )
    assert chain.reach_bound is not None
    assert chain.reach_bound.reach == pytest.approx(0.7, abs=1e-6)
    assert -2e-6 < excess_of_reach(chain, chain.forward([0.4, 0.6, 1.0])) <= 0


@pytest.mark.parametrize("limits", [(0.2, 0.6), (-0.6, -0.2), (-0.6, 0.1)])
def test_a_prismatic_joint_at_the_end_adds_its_greatest_travel(limits: tuple[float, float]) -> None:
    chain = arm(
        ("revolute", 0, 0, 0, 0, TURN),
        ("revolute", 0, 0.5, 0, 0, TURN),
        ("prismatic", np.pi / 2, 0, 0, 0, limits),
    )
    assert chain.reach_bound is not None
    assert chain.reach_bound.reach == pytest.approx(1.1, abs=1e-6)


def test_leading_prismatic_joints_move_the_shoulder_only() -> None:
    """A gantry of three axes with limits that exclude zero, then two parallel revolute axes 0.5 m apart."""
    chain = arm(
        ("prismatic", 0, 0, 0, 0, (1.0, 2.0)),
        ("prismatic", np.pi / 2, 0, 0, np.pi / 2, (-3.0, -2.0)),
        ("prismatic", np.pi / 2, 0, 0, 0, (0.5, 0.7)),
        ("revolute", 0, 0, 0, 0, TURN),
        ("revolute", 0, 0.5, 0, 0, TURN),
    )
    bound = chain.reach_bound
    assert bound is not None
    assert bound.reach == pytest.approx(0.5, abs=1e-7)
    assert bound.travel.tolist() == [[1.0, 2.0], [-3.0, -2.0], [0.5, 0.7]]
    np.testing.assert_allclose(bound.travel_axes.T @ bound.travel_axes, np.eye(3), atol=1e-15)
    rng = np.random.default_rng(3)
    for wrist in rng.uniform(-4, 4, size=(50, 3)):
        box = bound.travel_axes.T @ (wrist - bound.shoulder)
        nearest = bound.shoulder + bound.travel_axes @ np.clip(box, bound.travel[:, 0], bound.travel[:, 1])
        distance = np.linalg.norm(wrist - nearest)
        found = np.linalg.norm(wrist - bound.nearest_shoulder(wrist))
        assert found == pytest.approx(distance, abs=1e-7)


@pytest.mark.parametrize("kinds", [["prismatic"], ["revolute"], ["prismatic", "revolute", "prismatic"]])
def test_fewer_than_two_revolute_joints_have_no_bound(kinds: list[str]) -> None:
    chain = arm(*((kind, 0.3, 0.1, 0, 0, (-1.0, 1.0)) for kind in kinds))
    assert chain.reach_bound is None
    assert excess_of_reach(chain, shift(100, 0, 0)) == -np.inf


# --- any chain: the bound is one --------------------------------------------------------------------------

angles = st.one_of(
    st.sampled_from([0.0, np.pi / 2, -np.pi / 2, np.pi]),
    st.integers(-3000, 3000).map(lambda k: k / 1000),
)
lengths = st.one_of(st.just(0.0), st.integers(-500, 500).map(lambda k: k / 1000))
travels = st.sampled_from([(-0.3, 0.4), (0.2, 0.6), (-0.6, -0.2), (0.0, 0.5), (-0.8, 0.1)])
revolute_lines = st.tuples(st.just("revolute"), angles, lengths, lengths, angles, st.just(TURN))
prismatic_lines = st.tuples(st.just("prismatic"), angles, lengths, lengths, angles, travels)
mixed = st.lists(st.one_of(revolute_lines, revolute_lines, prismatic_lines), min_size=0, max_size=5)


def farthest(chain: SerialChain, q: Array, sweeps: int, values: int) -> float:
    """Return the greatest excess found by going through the joints and keeping each one's worst value."""
    candidates = [np.linspace(low, high, values) for low, high in zip(chain.lower, chain.upper, strict=True)]
    worst = -np.inf
    for _ in range(sweeps):
        for i in range(chain.n):
            Q = np.tile(q, (values, 1))
            Q[:, i] = candidates[i]
            excess = [excess_of_reach(chain, pose) for pose in chain.forward(Q)]
            q = Q[int(np.argmax(excess))]
            worst = max(worst, *excess)
    return worst


@settings(max_examples=80, deadline=None, derandomize=True, database=None)
@given(
    rail=st.lists(prismatic_lines, max_size=1),
    first=revolute_lines,
    middle=mixed,
    last=revolute_lines,
    end=st.lists(prismatic_lines, max_size=2),
    convention=st.sampled_from(["modified", "standard"]),
    tool=st.tuples(lengths, lengths, lengths),
    seed=st.integers(0, 2**32 - 1),
)
def test_no_configuration_is_beyond_the_bound(
    rail: list,
    first: Line,
    middle: list,
    last: Line,
    end: list,
    convention: str,
    tool: tuple[float, float, float],
    seed: int,
) -> None:
    chain = arm(*rail, first, *middle, last, *end, convention=convention, tool=shift(*tool))
    rng = np.random.default_rng(seed)
    Q = chain.random(rng, 30)
    Q[:10] = np.where(rng.random((10, chain.n)) < 0.5, chain.lower, chain.upper)
    assert max(excess_of_reach(chain, pose) for pose in chain.forward(Q)) <= 0
    assert farthest(chain, Q[-1], sweeps=2, values=13) <= 0


GANTRY_TILTS = [(90,), (0,), (20,), (90, 90), (30, 50), (90, 0), (90, 90, 40)]


def gantry(tilts: tuple[int, ...]) -> list[Line]:
    """Return prismatic joints, each axis tilted against the one before: parallel, in one plane, in space."""
    limits = [(-0.3, 0.4), (0.2, 0.6), (0.0, 0.5), (-0.8, 0.1)]
    return [
        ("prismatic", np.radians(tilt), 0.1, 0.0, np.pi / 2, travel)
        for tilt, travel in zip((0, *tilts), limits, strict=False)
    ]


def configurations(chain: SerialChain, rng: np.random.Generator) -> Array:
    """Return configurations of which most have joints at their limits."""
    Q = chain.random(rng, 60)
    Q[:40] = np.where(rng.random((40, chain.n)) < 0.5, chain.lower, chain.upper)
    return Q


@pytest.mark.parametrize("tilts", GANTRY_TILTS, ids=str)
def test_no_configuration_of_an_arm_on_a_gantry_is_beyond_the_bound(
    tilts: tuple[int, ...], rng: np.random.Generator
) -> None:
    chain = arm(*gantry(tilts), ("revolute", 0.3, 0, 0, 0, TURN), ("revolute", 0, 0.05, 0.2, 0, TURN))
    Q = configurations(chain, rng)
    assert max(excess_of_reach(chain, pose) for pose in chain.forward(Q)) <= 0


@pytest.mark.parametrize("tilts", GANTRY_TILTS, ids=str)
def test_no_configuration_of_a_wrist_on_a_gantry_is_beyond_the_bound(
    tilts: tuple[int, ...], rng: np.random.Generator
) -> None:
    """A gantry with a spherical wrist: the axes meet in one point, the links reach nowhere."""
    quarter = np.pi / 2
    wrist = [("revolute", alpha, 0, 0, 0, TURN) for alpha in (0.3, quarter, -quarter)]
    chain = arm(*gantry(tilts), *wrist, tool=shift(0, 0, 0.2))
    Q = configurations(chain, rng)
    assert max(excess_of_reach(chain, pose) for pose in chain.forward(Q)) <= 0


def test_a_wrist_on_a_gantry_reaches_its_travel_and_no_farther() -> None:
    chain = arm(
        *gantry((90, 90)),
        *(("revolute", alpha, 0, 0, 0, TURN) for alpha in (0, np.pi / 2, -np.pi / 2)),
        tool=shift(0, 0, 0.2),
    )
    for q in ([-0.3, 0.2, 0.0], [0.4, 0.6, 0.5], [0.0, 0.4, 0.2]):
        pose = chain.forward([*q, 0.3, 0.4, 0.5])
        assert excess_of_reach(chain, pose) <= 0
    outside = chain.forward([0.4 + 0.03, 0.4, 0.5 + 0.04, 0.3, 0.4, 0.5])
    assert excess_of_reach(chain, outside) == pytest.approx(0.05, abs=3e-6)
