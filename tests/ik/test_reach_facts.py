"""Which poses of the reference cell are out of reach, for which links, and why."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import qparm
from conftest import cell_data
from qparm.errors import InvalidInput
from qparm.reach.verdict import Reach, ReachReason
from qparm.robot import DHRow, SerialChain, chain_from_dh

Array = NDArray[np.float64]


def cell_with(change: Callable[[dict[str, Any]], object] | None = None) -> qparm.Cell:
    data = cell_data()
    if change is not None:
        change(data)
    return qparm.Cell.load(data)


def with_lengths(L1: float, L3: float) -> qparm.Cell:
    """Return the reference cell with link lengths in mm."""
    return cell_with(lambda data: data["arm"]["lengths"].update(L1=f"{L1} mm", L3=f"{L3} mm"))


def verdicts(cell: qparm.Cell, seed: int = 0) -> list[Reach]:
    return qparm.check_reach(cell.chain(), cell.tool_path().poses, rng=np.random.default_rng(seed))


def out_of_reach(found: list[Reach]) -> int:
    return sum(verdict.reason is not ReachReason.WITHIN_REACH for verdict in found)


def wrist_excess(cell: qparm.Cell) -> Array:
    """Return by how far each pose's wrist lies from the reach of the shoulder on its rail, in closed form."""
    L1, L2, L3, L4 = (cell.arm.lengths[name] for name in ("L1", "L2", "L3", "L4"))
    poses = cell.tool_path().poses
    wrist = poses[:, :3, 3] - L4 * poses[:, :3, 2]
    shoulder = np.column_stack([0 * wrist[:, 0], np.clip(wrist[:, 1], 0.0, 0.8), L1 + 0 * wrist[:, 0]])
    return np.linalg.norm(wrist - shoulder, axis=1) - (L2 + L3)


# --- the facts of the design --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("L1", "L3", "count"),
    [
        (480, 418, 0),
        (500, 400, 0),
        (480, 460, 0),
        (600, 480, 0),
        (480, 400, 0),
        (460, 400, 2),
        (440, 380, 12),
        (300, 480, 20),
    ],
)
def test_poses_out_of_reach_for_given_links(L1: float, L3: float, count: int) -> None:
    found = verdicts(with_lengths(L1, L3))
    assert len(found) == 915
    assert out_of_reach(found) == count


def test_391_mm_is_the_shortest_forearm_that_covers_the_dome() -> None:
    assert out_of_reach(verdicts(with_lengths(480, 391))) == 0
    assert out_of_reach(verdicts(with_lengths(480, 390))) > 0


def test_a_shorter_arm_with_a_short_first_link_covers_the_dome() -> None:
    assert out_of_reach(verdicts(with_lengths(340, 500))) == 0


def wider(data: dict[str, Any]) -> None:
    data["workpiece"]["azimuth"] = ["-75 deg", "75 deg"]
    data["process"]["points"] = 76


def test_the_outermost_poses_of_a_wider_dome_are_out_of_reach() -> None:
    cell = cell_with(wider)
    found = verdicts(cell)
    assert len(found) == 1140
    assert out_of_reach(found) == 90
    # all of them farther round than the reference cell's 60 deg
    x, y, _ = (cell.tool_path().poses[:, :3, 3] - [0, 1.5, 0.36]).T
    azimuth = np.degrees(np.arctan2(x, -y))
    far = np.array([verdict.reason is not ReachReason.WITHIN_REACH for verdict in found])
    assert np.abs(azimuth[far]).min() > 60


@pytest.mark.parametrize(
    "change",
    [
        wider,
        lambda data: data["arm"]["lengths"].update(L1="460 mm", L3="400 mm"),
        lambda data: data["arm"]["lengths"].update(L1="300 mm", L3="480 mm"),
        lambda data: data["workpiece"].update(radius="300 mm"),
        lambda data: data["workpiece"].update(radius="800 mm"),
        lambda data: data["workpiece"]["pose"].update(position=["300 mm", "1900 mm", "360 mm"]),
    ],
    ids=["wider", "460/400", "300/480", "radius 300 mm", "radius 800 mm", "farther away"],
)
def test_too_far_is_said_exactly_where_the_wrist_is(change: Callable[[dict[str, Any]], object]) -> None:
    """By the closed form of this arm: the shoulder's rail, the wrist behind the tool, upper arm plus forearm.

    Few starts: only the proof is looked at.
    """
    cell = cell_with(change)
    poses, excess = cell.tool_path().poses, wrist_excess(cell)
    assert (np.abs(excess) > 1e-5).all()
    found = qparm.check_reach(cell.chain(), poses, rng=np.random.default_rng(0), starts=1)
    told = np.array([verdict.reason is ReachReason.TOO_FAR for verdict in found])
    assert np.array_equal(told, excess > 0)
    by = np.array([verdict.excess for verdict in found])
    np.testing.assert_allclose(by[told], excess[told], rtol=0, atol=2e-6)
    assert np.array_equal(by[~told], np.zeros((~told).sum()))


def test_what_the_links_reach_and_the_limits_do_not() -> None:
    """With L1 = 300 mm some poses are too far, the rest of the 20 fail on joint limits alone."""
    cell = with_lengths(300, 480)
    reasons = Counter(verdict.reason for verdict in verdicts(cell))
    too_far = int((wrist_excess(cell) > 0).sum())
    assert 0 < too_far < 20
    assert reasons == {
        ReachReason.WITHIN_REACH: 895,
        ReachReason.TOO_FAR: too_far,
        ReachReason.LIMITS: 20 - too_far,
    }


# --- the same answer again ------------------------------------------------------------------------------------


def test_the_same_seed_gives_the_same_verdicts() -> None:
    cell = with_lengths(300, 480)
    poses = cell.tool_path().poses
    first, again = np.random.default_rng(5), np.random.default_rng(5)
    assert qparm.check_reach(cell.chain(), poses, rng=first) == qparm.check_reach(cell.chain(), poses, rng=again)
    # and draws the same numbers on the way: what follows does not depend on the verdicts' history
    assert first.bit_generator.state == again.bit_generator.state


def test_the_verdicts_depend_neither_on_the_seed_nor_on_the_order() -> None:
    cell = with_lengths(300, 480)
    poses, order = cell.tool_path().poses, np.random.default_rng(1).permutation(915)
    shuffled = qparm.check_reach(cell.chain(), poses[order], rng=np.random.default_rng(2))
    in_order = verdicts(cell)
    assert shuffled == [in_order[k] for k in order]


def test_check_reach_leaves_numpys_global_generator_alone() -> None:
    np.random.seed(0)  # noqa: NPY002
    expected = np.random.random()  # noqa: NPY002
    np.random.seed(0)  # noqa: NPY002
    cell = with_lengths(300, 480)
    qparm.check_reach(cell.chain(), cell.tool_path().poses[:80], rng=np.random.default_rng(0), starts=3)
    assert np.random.random() == expected  # noqa: NPY002


# --- each reason by a case made for it ----------------------------------------------------------------------------


def planar_arm(elbow: float = 2.0) -> SerialChain:
    """Return two parallel revolute axes 0.5 m apart with the tool 0.4 m beyond; the elbow turns by +-elbow."""
    rows = [
        DHRow("shoulder", "revolute", 0, 0, 0, 0, (-3.0, 3.0), 1, 1, 1),
        DHRow("elbow", "revolute", 0, 0.5, 0, 0, (-elbow, elbow), 1, 1, 1),
    ]
    return chain_from_dh(rows, convention="modified", transform_tool=shift(0.4, 0, 0))


def shift(x: float, y: float, z: float) -> Array:
    T = np.eye(4)
    T[:3, 3] = x, y, z
    return T


def turn_x(angle: float) -> Array:
    T = np.eye(4)
    T[1:3, 1:3] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    return T


def verdict_on(chain: SerialChain, pose: Array, starts: int = 20) -> Reach:
    (verdict,) = qparm.check_reach(chain, pose[None], rng=np.random.default_rng(0), starts=starts)
    return verdict


def test_within_reach() -> None:
    chain = planar_arm()
    for q in ([0.3, 1.9], [-2.9, -1.9], [0.0, 0.0]):
        assert verdict_on(chain, chain.forward(q)) == Reach(ReachReason.WITHIN_REACH)


def test_too_far() -> None:
    verdict = verdict_on(planar_arm(), shift(1.0, 0, 0))
    assert verdict.reason is ReachReason.TOO_FAR
    assert verdict.excess == pytest.approx(0.1, abs=2e-6)
    assert str(verdict) == "too far: the wrist lies 100.0 mm beyond the greatest reach"


def test_too_near() -> None:
    verdict = verdict_on(planar_arm(), shift(0.6, 0, 0))
    assert verdict.reason is ReachReason.TOO_NEAR
    assert verdict.excess == pytest.approx(0.3, abs=2e-6)
    assert str(verdict) == "too near: the wrist lies 300.0 mm nearer than the arm folds"


def test_joint_limits() -> None:
    chain = planar_arm(elbow=2.0)
    pose = chain.forward([0.3, 2.5])
    verdict = verdict_on(chain, pose)
    assert verdict == Reach(ReachReason.LIMITS)
    assert "limits" in str(verdict)
    assert verdict_on(planar_arm(elbow=2.6), pose).reason is ReachReason.WITHIN_REACH


def test_limits_of_a_prismatic_joint() -> None:
    rows = [
        DHRow("rail", "prismatic", np.pi / 2, 0, 0, 0, (0.0, 0.5), 1, 1, 1),
        DHRow("turn", "revolute", 0, 0, 0, 0, (-3.0, 3.0), 1, 1, 1),
    ]
    chain = chain_from_dh(rows, convention="modified")
    assert verdict_on(chain, chain.forward([0.5, 1.0])).reason is ReachReason.WITHIN_REACH
    assert verdict_on(chain, chain.forward([0.6, 1.0])).reason is ReachReason.LIMITS


def test_orientation() -> None:
    """The tool tilted about its own x axis, which no joint of a planar arm can do."""
    chain = planar_arm()
    verdict = verdict_on(chain, chain.forward([0.2, 1.0]) @ turn_x(0.5))
    assert verdict == Reach(ReachReason.ORIENTATION)
    assert "orientation" in str(verdict)


def test_position() -> None:
    """Out of the plane, yet the wrist that goes with it is as far from the shoulder as the link is long."""
    verdict = verdict_on(planar_arm(), shift(0.8, 0, 0.3))
    assert verdict == Reach(ReachReason.POSITION)
    assert "position" in str(verdict)


def test_every_pose_of_the_arm_itself_is_within_reach(chain: SerialChain, rng: np.random.Generator) -> None:
    found = qparm.check_reach(chain, chain.forward(chain.random(rng, 300)), rng=rng)
    assert Counter(verdict.reason for verdict in found) == {ReachReason.WITHIN_REACH: 300}


def test_a_start_at_the_answer_needs_no_random_one(chain: SerialChain, rng: np.random.Generator) -> None:
    before = rng.bit_generator.state
    q = chain.random(np.random.default_rng(4), 1)[0]
    found = qparm.check_reach(chain, chain.forward(q)[None], rng=rng, starts=0, q_start=q)
    assert found == [Reach(ReachReason.WITHIN_REACH)]
    assert rng.bit_generator.state == before


def test_no_poses_have_no_verdicts(chain: SerialChain, rng: np.random.Generator) -> None:
    assert qparm.check_reach(chain, np.empty((0, 4, 4)), rng=rng) == []


# --- refusals ---------------------------------------------------------------------------------------------------


def test_a_pose_that_is_none_is_refused_by_number(chain: SerialChain, rng: np.random.Generator) -> None:
    poses = chain.forward(chain.random(rng, 4))
    poses[2, 0, 3] = np.nan
    with pytest.raises(InvalidInput, match="pose 2 has an entry that is not finite"):
        qparm.check_reach(chain, poses, rng=rng)
    poses[2] = 2 * np.eye(4)
    with pytest.raises(InvalidInput, match="pose 2 is not a rigid transform"):
        qparm.check_reach(chain, poses, rng=rng)


@pytest.mark.parametrize("shape", [(4, 4), (2, 1, 4, 4)])
def test_poses_that_are_no_list_are_refused(
    chain: SerialChain, rng: np.random.Generator, shape: tuple[int, ...]
) -> None:
    with pytest.raises(InvalidInput):
        qparm.check_reach(chain, np.broadcast_to(np.eye(4), shape), rng=rng)


def test_a_start_that_is_none_is_refused(chain: SerialChain, rng: np.random.Generator) -> None:
    pose = chain.forward(np.full((1, 8), 0.1))
    with pytest.raises(InvalidInput, match="8 joints"):
        qparm.check_reach(chain, pose, rng=rng, q_start=np.zeros(7))
    with pytest.raises(InvalidInput, match="theta3"):
        qparm.check_reach(chain, pose, rng=rng, q_start=np.array([0, 0, np.nan, 0, 0, 0, 0, 0]))


@pytest.mark.parametrize("tolerance", ["position_tolerance", "rotation_tolerance"])
def test_a_tolerance_that_is_none_is_refused(chain: SerialChain, rng: np.random.Generator, tolerance: str) -> None:
    with pytest.raises(InvalidInput, match=tolerance):
        qparm.check_reach(chain, np.eye(4)[None], rng=rng, **{tolerance: 0.0})
