"""Chains from URDF: the kinematics of Pinocchio's reader, limits, continuous joints, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from made_arm import URDF
from qparm.errors import InvalidInput
from qparm.ik import solve_pose
from qparm.robot import CONTINUOUS_RANGE, Joint, JointLimits, SerialChain, chain_from_urdf

LIMITS = JointLimits(acceleration=5.0, jerk=50.0)


def chain_of(text: str = URDF, *, base: str = "floor", tip: str = "tip", **options: object) -> SerialChain:
    return chain_from_urdf(text, base=base, tip=tip, **({"revolute": LIMITS, "prismatic": LIMITS} | options))


def pinocchio_forward(text: str, chain: SerialChain, q: np.ndarray, tip: str) -> np.ndarray:
    model = pin.buildModelFromXML(text)
    data, full = model.createData(), pin.neutral(model)
    for name, value in zip(chain.names, q, strict=True):
        joint = model.joints[model.getJointId(name)]
        full[joint.idx_q : joint.idx_q + joint.nq] = [value] if joint.nq == 1 else [np.cos(value), np.sin(value)]
    pin.framesForwardKinematics(model, data, full)
    return data.oMf[model.getFrameId(tip)].homogeneous


def random_urdf(rng: np.random.Generator, joints: int) -> str:
    """Return a chain with any axes and origins, every kind of joint, fixed ones between."""
    lines = ['<robot name="r"><link name="k0"/>']
    for k in range(joints):
        kind = rng.choice(["fixed", "revolute", "continuous", "prismatic"]) if k else "revolute"
        xyz, rpy, axis = rng.normal(size=3), rng.uniform(-4, 4, 3), rng.normal(size=3)
        if rng.random() < 0.4:
            axis = rng.choice([-1.0, 1.0]) * np.eye(3)[rng.integers(3)]
        lines.append(
            f'<link name="k{k + 1}"/><joint name="j{k}" type="{kind}"><parent link="k{k}"/><child link="k{k + 1}"/>'
            f'<origin xyz="{" ".join(map(str, xyz))}" rpy="{" ".join(map(str, rpy))}"/>'
            f'<axis xyz="{" ".join(map(str, axis))}"/>'
            '<limit lower="-1" upper="2" velocity="1.5" effort="1"/></joint>'
        )
    return "".join(lines) + "</robot>"


# --- kinematics -------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(25))
def test_poses_are_those_of_pinocchio(seed: int) -> None:
    rng = np.random.default_rng(seed)
    text = random_urdf(rng, 8)
    chain = chain_of(text, base="k0", tip="k8")
    for q in chain.random(rng, 10):
        np.testing.assert_allclose(chain.forward(q), pinocchio_forward(text, chain, q, "k8"), atol=2e-12)


def test_the_made_up_arm_has_the_poses_of_pinocchio(rng: np.random.Generator) -> None:
    chain = chain_of()
    assert chain.name == "seven"
    assert chain.names == tuple(f"a{k}" for k in range(1, 8))
    for q in chain.random(rng, 20):
        np.testing.assert_allclose(chain.forward(q), pinocchio_forward(URDF, chain, q, "tip"), atol=1e-14)


def test_the_jacobian_turns_about_the_files_axes(rng: np.random.Generator) -> None:
    chain, h = chain_of(), 1e-6
    q = chain.random(rng, 1)[0]
    J = chain.jacobian(q)
    for i in range(chain.n):
        e = chain.pose_error(chain.forward(q - h * np.eye(7)[i]), chain.forward(q + h * np.eye(7)[i])) / (2 * h)
        np.testing.assert_allclose(J[:, i], e, atol=1e-8)


def test_a_part_of_the_arm_with_its_own_base_and_tool() -> None:
    lift = np.eye(4)
    lift[2, 3] = 0.5
    whole, part = chain_of(), chain_of(base="l1", tip="l4", transform_base=lift, transform_tool=lift, name="part")
    assert part.names == ("a2", "a3", "a4")
    assert part.name == "part"
    q = np.array([0.3, -0.2, 0.5])
    frames = whole.frames(np.concatenate([[0.0], q, np.zeros(3)]))
    # link l4 in link l1, of the whole arm: the frame of a4 turned back to the file's
    expected = lift @ np.linalg.inv(chain_of(tip="l1").forward([0.0])) @ chain_of(tip="l4").forward([0.0, *q]) @ lift
    np.testing.assert_allclose(part.forward(q), expected, atol=1e-14)
    np.testing.assert_allclose(frames[4, :3, 3], chain_of(tip="l4").forward([0.0, *q])[:3, 3], atol=1e-14)


def test_a_file_is_read_like_its_text(tmp_path: Path) -> None:
    file = tmp_path / "arm.urdf"
    file.write_text(URDF, encoding="utf-8")
    for source in (file, str(file)):
        np.testing.assert_array_equal(
            chain_from_urdf(source, base="floor", tip="tip", revolute=LIMITS).fixed, chain_of().fixed
        )


# --- limits -----------------------------------------------------------------------------------------


def test_limits_come_from_the_joint_then_its_kind_then_the_file() -> None:
    one = JointLimits(velocity=0.25, position=(-0.5, 0.75), jerk=7.0)
    chain = chain_of(revolute=JointLimits(velocity=1.0, acceleration=5.0, jerk=50.0), joints={"a3": one})
    assert chain.joints[2].position == (-0.5, 0.75)
    np.testing.assert_array_equal(chain.velocity, [1.0, 1.0, 0.25, 1.0, 1.0, 1.0, 1.0])
    np.testing.assert_array_equal(chain.acceleration, np.full(7, 5.0))
    np.testing.assert_array_equal(chain.jerk, [50.0, 50.0, 7.0, 50.0, 50.0, 50.0, 50.0])
    np.testing.assert_array_equal(chain_of().velocity, [2.0, 2.0, 2.0, 2.0, 3.0, 3.0, 3.0])
    assert not chain.continuous[2]


def test_continuous_joints_turn_on_and_are_drawn_from_one_turn(rng: np.random.Generator) -> None:
    chain = chain_of()
    np.testing.assert_array_equal(chain.continuous, [True, False, True, False, True, False, True])
    assert {joint.position for joint in chain.joints if joint.continuous} == {CONTINUOUS_RANGE}
    drawn = chain.random(rng, 2000)
    assert np.abs(drawn).max(axis=0)[chain.continuous].min() > 3.1
    assert np.abs(drawn[:, chain.continuous]).max() <= np.pi
    assert chain.within_limits(drawn).all()


def test_a_continuous_joint_passes_half_a_turn_without_a_jump(chain: SerialChain) -> None:
    endless = chain_of()
    q = np.array([0.3, 0.6, 0.2, -1.2, 0.4, 0.8, 3.1])
    turned = q.copy()
    for _ in range(40):
        turned[6] += 0.1
        found = solve_pose(endless, endless.forward(turned), q_start=q)
        assert found.reached
        assert np.abs(found.q - q).max() < 0.5
        q = found.q
    assert q[6] > 6.0


@pytest.mark.parametrize(
    ("kind", "position"), [("prismatic", CONTINUOUS_RANGE), ("revolute", (-1.0, 1.0)), ("revolute", (-4.0, 3.0))]
)
def test_only_a_revolute_joint_with_a_turn_to_work_in_is_continuous(kind: str, position: tuple[float, float]) -> None:
    with pytest.raises(InvalidInput, match="'a': only a revolute joint"):
        Joint("a", kind, np.eye(4), position, 1.0, 1.0, 1.0, continuous=True)  # type: ignore[arg-type]


# --- what is refused --------------------------------------------------------------------------------

A2 = '<axis xyz="0 1 0"/><limit lower="-2" upper="2" velocity="2" effort="1"/>'
BAD: list[tuple[str, str, str, str]] = [
    ("mimic", A2, A2 + '<mimic joint="a1"/>', "joint 'a2' mimics another joint"),
    ("floating", 'name="a2" type="revolute"', 'name="a2" type="floating"', "joint 'a2' is of type 'floating'"),
    ("planar", 'name="a2" type="revolute"', 'name="a2" type="planar"', "joint 'a2' is of type 'planar'"),
    ("no type", 'name="a2" type="revolute"', 'name="a2"', "joint 'a2' is of type ''"),
    ("no limit", A2, '<axis xyz="0 1 0"/>', "joint 'a2' (revolute) has no position limits"),
    ("no range", A2, '<limit velocity="2" effort="1"/>', "joint 'a2' (revolute) has no position limits"),
    ("reversed", 'lower="-2" upper="2" velocity="2"', 'lower="2" upper="-2" velocity="2"',
     "joint 'a2': its position limits are reversed or equal: 2 to -2"),
    ("no velocity", A2, '<limit lower="-2" upper="2" effort="1"/>', "joint 'a2' has no velocity limit"),
    ("velocity zero", A2, A2.replace('velocity="2"', 'velocity="0"'), "joint 'a2': its velocity limit"),
    ("nan", A2, A2.replace('upper="2"', 'upper="nan"'), "joint 'a2': upper of its limit is not finite: 'nan'"),
    ("inf", A2, A2.replace('upper="2"', 'upper="inf"'), "joint 'a2': upper of its limit is not finite: 'inf'"),
    ("word", A2, A2.replace('upper="2"', 'upper="2 rad"'), "joint 'a2': upper of its limit must be a number"),
    ("nan origin", 'xyz="0 0 0.2"', 'xyz="0 0 nan"', "joint 'a1': xyz of its origin is not finite: '0 0 nan'"),
    ("two numbers", 'xyz="0 0 0.2"', 'xyz="0 0"', "joint 'a1': xyz of its origin must be 3 numbers, not '0 0'"),
    ("no axis", 'xyz="0 1 0"', 'xyz="0 0 0"', "joint 'a2': its axis has no direction"),
    ("no such parent", '<parent link="l1"/>', '<parent link="l0"/>',
     "joint 'a2' hangs on link 'l0', which the URDF does not have"),
    ("ring", '<parent link="l1"/>', '<parent link="l7"/>', "comes twice above link 'tip'"),
    ("two parents", "<transmission", '<joint name="b" type="fixed"><parent link="base"/><child link="l5"/></joint>'
     "<transmission", "link 'l5' has two parents: joints 'a5' and 'b'"),
    ("no child", '<child link="l2"/>', "", "joint 'a2' has no child link"),
    ("no name", 'name="a2" ', "", "the joint of link 'l2' has no name"),
    ("same name", 'name="a2"', 'name="a3"', "joint 'a3' comes twice above link 'tip'"),
    ("not a robot", "robot", "model", "outermost element must be 'robot', not 'model'"),
    ("external entity", "<robot", '<!DOCTYPE robot [<!ENTITY x SYSTEM "file:///etc/passwd">]><robot', "DOCTYPE"),
    ("entities that grow", "<robot", '<!DOCTYPE robot [<!ENTITY x "xxxx"><!ENTITY y "&x;&x;">]><robot', "DOCTYPE"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "words"), [case[1:] for case in BAD], ids=[case[0] for case in BAD])
def test_what_cannot_be_used_is_refused_by_name(old: str, new: str, words: str) -> None:
    assert old in URDF
    with pytest.raises(InvalidInput) as caught:
        chain_of(URDF.replace(old, new))
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"tip": "tipp"}, "the URDF has no link 'tipp'; did you mean 'tip'?"),
        ({"base": "nothing like it"}, "the URDF has no link 'nothing like it'; its links are floor, base"),
        ({"base": "lamp"}, "link 'tip' does not hang on link 'lamp': the way from it to the root ends at 'floor'"),
        ({"base": "tip", "tip": "floor"}, "link 'floor' does not hang on link 'tip'"),
        ({"base": "tip"}, "no joint moves between link 'tip' and link 'tip'"),
        ({"revolute": None}, "joint 'a1': a URDF has no limit of acceleration"),
        ({"revolute": JointLimits(acceleration=1.0)}, "joint 'a1': a URDF has no limit of jerk"),
        ({"joints": {"b": LIMITS}}, "limits are given for joint 'b', which does not move between"),
        ({"joints": {"a2": JointLimits(jerk=np.nan)}}, "joint 'a2': jerk limit must be finite"),
    ],
)
def test_what_does_not_fit_the_file_is_refused(options: dict, words: str) -> None:
    with pytest.raises(InvalidInput) as caught:
        chain_of(**options)
    assert words in str(caught.value)


def test_what_is_off_the_way_does_not_matter() -> None:
    broken = URDF.replace('<child link="lamp"/>', '<child link="lamp"/><limit lower="x"/><mimic joint="a1"/>')
    np.testing.assert_array_equal(chain_of(broken).fixed, chain_of().fixed)


def test_a_text_cut_short_anywhere_is_refused() -> None:
    for end in range(1, len(URDF.rstrip())):
        with pytest.raises(InvalidInput):
            chain_of(URDF[:end])


@pytest.mark.parametrize(
    ("content", "words"), [(None, "there is no URDF file"), (b"\xff\xfe<", "not UTF-8"), (b"", "not whole XML")]
)
def test_a_file_that_cannot_be_read(tmp_path: Path, content: bytes | None, words: str) -> None:
    file = tmp_path / "arm.urdf"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(InvalidInput, match=words):
        chain_from_urdf(file, base="floor", tip="tip", revolute=LIMITS)
    with pytest.raises(InvalidInput, match="cannot be read"):
        chain_from_urdf("a\0b", base="floor", tip="tip", revolute=LIMITS)
    with pytest.raises(InvalidInput, match="cannot be read"):
        chain_from_urdf(tmp_path, base="floor", tip="tip", revolute=LIMITS)
