"""The reach of many designs: the known counts, the arm's own geometry, and what a verdict must not depend on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from comparisons.reach_map import FACTS, cell_of, chain_of
from comparisons.wrist_arm import best_margin
from scipy.spatial.transform import Rotation

import qparm
from made_arm import elsewhere_data
from qparm.errors import InvalidInput
from qparm.reach import DesignReach, reach_of_designs
from qparm.reach.many_arms import nearest_poses
from qparm.verify.kinematics import joint_transforms, rotation_angle


@pytest.fixture(scope="module")
def poses(dome: qparm.Cell) -> np.ndarray:
    return dome.tool_path().poses


@pytest.fixture(scope="module")
def designs(chain: qparm.SerialChain) -> list[qparm.SerialChain]:
    """Return designs in all corners of the map: all, most and a third of the poses out of reach."""
    return [chain_of(chain, *lengths) for lengths in ((300, 480), (480, 390), (330, 400), (600, 300), (300, 300))]


@pytest.fixture(scope="module")
def found(designs: list[qparm.SerialChain], poses: np.ndarray) -> DesignReach:
    return reach_of_designs(designs, poses)


# --- right ----------------------------------------------------------------------------------------------------


def test_the_counts_that_were_found_independently(chain: qparm.SerialChain, poses: np.ndarray) -> None:
    reach = reach_of_designs([chain_of(chain, *lengths) for lengths in FACTS], poses)
    assert reach.missed.tolist() == list(FACTS.values())


def test_lengths_set_in_the_chain_are_those_of_the_cell(chain: qparm.SerialChain) -> None:
    for lengths in ((300, 480), (333.5, 401.25)):
        np.testing.assert_allclose(chain_of(chain, *lengths).fixed, cell_of(*lengths).chain().fixed, atol=1e-15)


def test_what_is_missed_without_proof_is_out_of_reach_by_the_arms_geometry(
    found: DesignReach, poses: np.ndarray
) -> None:
    lengths = [(300, 480), (480, 390), (330, 400), (600, 300), (300, 300)]
    missed = np.argwhere(~found.reached & ~found.proved)
    assert len(missed) >= 6
    assert max(best_margin(cell_of(*lengths[d]), poses[k]) for d, k in missed) < 0
    # and the geometry can say yes: a sample of what is reached
    reached = np.argwhere(found.reached)[:: found.reached.sum() // 20]
    assert min(best_margin(cell_of(*lengths[d]), poses[k]) for d, k in reached) > 0


def test_proofs_say_by_how_much(found: DesignReach, poses: np.ndarray) -> None:
    """By the closed form of this arm, as in the facts of check_reach; and both ways agree on every verdict."""
    L1, L2, L3, L4 = 0.330, 0.400, 0.400, 0.120
    wrist = poses[:, :3, 3] - L4 * poses[:, :3, 2]
    shoulder = np.column_stack([0 * wrist[:, 0], np.clip(wrist[:, 1], 0.0, 0.8), L1 + 0 * wrist[:, 0]])
    excess = np.linalg.norm(wrist - shoulder, axis=1) - (L2 + L3)
    np.testing.assert_allclose(found.too_far[2], np.maximum(excess, 0), atol=2e-6)
    assert (found.too_far[2] > 0).sum() > 50
    assert not found.too_near.any()
    assert not (found.proved & found.reached).any()


def test_the_same_verdicts_as_check_reach(
    designs: list[qparm.SerialChain], found: DesignReach, poses: np.ndarray
) -> None:
    verdicts = qparm.check_reach(designs[0], poses, rng=np.random.default_rng(0))
    one_by_one = [verdict.reason.value == "within reach" for verdict in verdicts]
    assert one_by_one == found.reached[0].tolist()


def test_configurations_reach_the_poses_within_the_limits(poses: np.ndarray) -> None:
    cell = cell_of(300, 480)
    reach = reach_of_designs([cell.chain()], poses, keep_q=True)
    assert reach.q is not None
    (q,), (reached,) = reach.q, reach.reached
    there, _ = joint_transforms(cell, q[reached])
    assert np.linalg.norm(there[:, :3, 3] - poses[reached, :3, 3], axis=1).max() <= 1.001e-6
    turned = poses[reached, :3, :3] @ there[:, :3, :3].transpose(0, 2, 1)
    assert rotation_angle(turned).max() <= 1.001e-5
    assert cell.chain().within_limits(q[reached]).all()
    assert np.isnan(q[~reached]).all()


def test_poses_that_an_arm_took_itself_are_reached() -> None:
    """Seven joints that turn without end, poses far from each other: neighbours help little, starts must."""
    arm = qparm.Cell.load(elsewhere_data()).chain()
    own = arm.forward(arm.random(np.random.default_rng(1), 200))
    assert reach_of_designs([arm], own).reached.all()
    lifted = own.copy()
    lifted[:, :3, 3] *= 10.0
    assert not reach_of_designs([arm], lifted).reached.any()


def test_too_near_is_proved(chain: qparm.SerialChain) -> None:
    """The wrist at the middle of a rail shortened to 0.1 m: the elbow folds by 120 degrees, no more."""
    lower, upper = np.array(chain.lower), np.array(chain.upper)
    lower[0], upper[0] = 0.35, 0.45
    short = chain.with_position_limits(lower, upper)
    pose = np.eye(4)
    pose[:3, 3] = 0.0, 0.4, 0.480 + 0.120
    reach = reach_of_designs([short, chain], pose[None], restarts=2)
    folded = np.sqrt(0.400**2 + 0.418**2 - 0.400 * 0.418)
    assert reach.too_near[0, 0] == pytest.approx(folded - 0.05, abs=2e-6)
    assert reach.proved[:, 0].tolist() == [True, True]
    assert reach.too_near[1, 0] == pytest.approx(folded - 0.4, abs=2e-6)


# --- and depends on nothing that it should not ---------------------------------------------------------------


@pytest.mark.parametrize("threads", [1, 3])
def test_the_same_bits_on_any_number_of_threads(
    designs: list[qparm.SerialChain], poses: np.ndarray, threads: int
) -> None:
    some = poses[::5]
    first = reach_of_designs(designs, some, keep_q=True, threads=2)
    again = reach_of_designs(designs, some, keep_q=True, threads=threads)
    for name in ("reached", "too_far", "too_near", "q"):
        np.testing.assert_array_equal(getattr(first, name), getattr(again, name))


def test_a_design_alone_is_judged_as_among_others(
    designs: list[qparm.SerialChain], poses: np.ndarray, found: DesignReach
) -> None:
    alone = reach_of_designs(designs[1:2], poses, keep_q=True)
    np.testing.assert_array_equal(alone.reached[0], found.reached[1])
    twice = reach_of_designs(designs[:2], poses, keep_q=True)
    assert alone.q is not None
    assert twice.q is not None
    np.testing.assert_array_equal(alone.q[0], twice.q[1])


def test_poses_of_each_design_its_own(designs: list[qparm.SerialChain], poses: np.ndarray, found: DesignReach) -> None:
    each = np.stack([poses, np.roll(poses, 100, axis=0)])
    own = reach_of_designs(designs[:2], each)
    np.testing.assert_array_equal(own.reached[0], found.reached[0])
    np.testing.assert_array_equal(own.reached[1], np.roll(found.reached[1], 100))
    np.testing.assert_array_equal(own.too_far[1], np.roll(found.too_far[1], 100))


def test_verdicts_do_not_depend_on_the_seed(
    designs: list[qparm.SerialChain], poses: np.ndarray, found: DesignReach
) -> None:
    for seed in (1, 2):
        np.testing.assert_array_equal(reach_of_designs(designs, poses, seed=seed).reached, found.reached)


def test_arms_of_different_kinds_in_one_call(chain: qparm.SerialChain, poses: np.ndarray) -> None:
    six = replace(chain, joints=chain.joints[2:], transform_base=chain.forward(np.zeros(8)) @ np.eye(4))
    reach = reach_of_designs([chain, six], poses[:50])
    assert reach.reached.shape == (2, 50)
    assert reach.reached[0].all()
    with pytest.raises(InvalidInput, match="chain 0 has 8, chain 1 has 6"):
        reach_of_designs([chain, six], poses[:50], keep_q=True)


# --- neighbours -------------------------------------------------------------------------------------------------


def test_the_nearest_poses_are_those_of_all_pairs(rng: np.random.Generator) -> None:
    poses = np.tile(np.eye(4), (60, 1, 1))
    poses[:, :3, 3] = rng.normal(scale=0.1, size=(60, 3))
    poses[:, :3, :3] = Rotation.from_rotvec(rng.normal(scale=0.1, size=(60, 3))).as_matrix()
    poses[1] = poses[0]  # twins
    distance = np.array(
        [
            [
                np.hypot(
                    np.linalg.norm(a[:3, 3] - b[:3, 3]) / 0.4,
                    2 * np.sin(Rotation.from_matrix(a[:3, :3].T @ b[:3, :3]).magnitude() / 2),
                )
                for b in poses
            ]
            for a in poses
        ]
    )
    np.fill_diagonal(distance, np.inf)
    nearest = nearest_poses(poses, 0.4)
    assert nearest.shape == (60, 8)
    rows = np.arange(60)[:, None]
    np.testing.assert_allclose(distance[rows, nearest], np.sort(distance, axis=1)[:, :8], atol=1e-7)


@pytest.mark.parametrize("count", [0, 1, 2, 5])
def test_few_poses(chain: qparm.SerialChain, count: int) -> None:
    poses = chain.forward(chain.random(np.random.default_rng(3), count)).reshape(count, 4, 4)
    assert reach_of_designs([chain], poses).reached.tolist() == [[True] * count]


def test_no_designs(poses: np.ndarray) -> None:
    reach = reach_of_designs([], poses)
    assert reach.reached.shape == (0, 915)
    assert reach.missed.tolist() == []


# --- refusals ---------------------------------------------------------------------------------------------------


def test_poses_that_do_not_fit_the_designs_are_refused(chain: qparm.SerialChain) -> None:
    with pytest.raises(InvalidInput, match=r"\(P, 4, 4\) or \(2, P, 4, 4\)"):
        reach_of_designs([chain, chain], np.tile(np.eye(4), (3, 5, 1, 1)))
    broken = np.tile(np.eye(4), (3, 1, 1))
    broken[2, 0, 3] = np.nan
    with pytest.raises(InvalidInput, match="pose 2"):
        reach_of_designs([chain], broken)


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("position_tolerance", 0.0),
        ("rotation_tolerance", np.nan),
        ("restarts", 0),
        ("restarts", 2.5),
        ("restarts", 5000),
        ("seed", -1),
        ("threads", 0),
    ],
)
def test_an_option_that_is_none_is_refused(chain: qparm.SerialChain, option: str, value: object) -> None:
    with pytest.raises(InvalidInput, match=option):
        reach_of_designs([chain], np.eye(4)[None], **{option: value})  # type: ignore[arg-type]
