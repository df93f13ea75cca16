"""Kinematics against Pinocchio, plain matrix products, textbooks and finite differences."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import qparm
from conftest import cell_data
from qparm.errors import InvalidInput
from qparm.robot import DHRow, SerialChain, chain_from_dh
from qparm.verify.kinematics import joint_transforms, rotation_angle, scaled_singular_values

Array = NDArray[np.float64]

# Table 1 of the paper with L1 = 480, L2 = 400, L3 = 418, L4 = 120 mm: (prismatic, alpha deg, a m, d m, theta deg)
DOME_TABLE = (
    (True, -90, 0.0, 0.0, -90),
    (False, 180, 0.480, 0.0, 0),
    (False, 90, 0.0, 0.0, 90),
    (False, 90, 0.0, 0.400, 0),
    (False, -90, 0.0, 0.0, 0),
    (False, 90, 0.0, 0.418, 0),
    (False, -90, 0.0, 0.0, 0),
    (False, 90, 0.0, 0.120, 90),
)


def screw(axis: str, angle: float, distance: float) -> Array:
    """Return the turn about and the shift along x or z, written out."""
    c, s = np.cos(angle), np.sin(angle)
    if axis == "x":
        return np.array([[1, 0, 0, distance], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1]])
    return np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, distance], [0, 0, 0, 1]])


def rigid(rotation_vector: Array, translation: Array) -> Array:
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(rotation_vector).as_matrix()
    T[:3, 3] = translation
    return T


def dh_row(prismatic: bool, alpha: float, a: float, d: float, theta: float, name: str) -> DHRow:
    kind = "prismatic" if prismatic else "revolute"
    return DHRow(name, kind, alpha, a, d, theta, (-3.0, 3.0), 1.0, 1.0, 1.0)


def plain_forward(
    table: list[tuple[bool, float, float, float, float]], convention: str, base: Array, tool: Array, q: Array
) -> Array:
    """Multiply a table out, link by link, with the joint's value in its place."""
    T = base
    for (prismatic, alpha, a, d, theta), value in zip(table, q, strict=True):
        turn = screw("z", theta + (0.0 if prismatic else value), d + (value if prismatic else 0.0))
        T = T @ screw("x", alpha, a) @ turn if convention == "modified" else T @ turn @ screw("x", alpha, a)
    return T @ tool


def central_differences(forward: Callable[[Array], Array], q: Array, h: float = 1e-5) -> Array:
    """Return the geometric Jacobian by fourth-order central differences."""
    R, J = forward(q)[:3, :3], np.empty((6, len(q)))
    for i in range(len(q)):
        dT = np.zeros((4, 4))
        for k, weight in ((-2, 1 / 12), (-1, -8 / 12), (1, 8 / 12), (2, -1 / 12)):
            moved = q.copy()
            moved[i] += k * h
            dT += weight * forward(moved) / h
        S = dT[:3, :3] @ R.T
        J[:, i] = [*dT[:3, 3], S[2, 1], S[0, 2], S[1, 0]]
    return J


class PinocchioArm:
    """The reference arm built joint by joint from :data:`DOME_TABLE`."""

    def __init__(self) -> None:
        self.model = pin.Model()
        parent = 0
        for i, (prismatic, alpha, a, d, theta) in enumerate(DOME_TABLE):
            placement = (
                pin.SE3(pin.utils.rotate("x", np.radians(alpha)), np.zeros(3))
                * pin.SE3(np.eye(3), np.array([a, 0.0, 0.0]))
                * pin.SE3(pin.utils.rotate("z", np.radians(theta)), np.zeros(3))
                * pin.SE3(np.eye(3), np.array([0.0, 0.0, d]))
            )
            joint = pin.JointModelPZ() if prismatic else pin.JointModelRZ()
            parent = self.model.addJoint(parent, joint, placement, f"joint {i}")
        self.tool = self.model.addFrame(pin.Frame("tool", parent, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
        self.data = self.model.createData()

    def forward(self, q: Array) -> Array:
        """Return the tool's pose."""
        pin.framesForwardKinematics(self.model, self.data, q)
        return np.array(self.data.oMf[self.tool].homogeneous)

    def joint_frames(self, q: Array) -> Array:
        """Return the frames of the joints after their motion."""
        pin.forwardKinematics(self.model, self.data, q)
        return np.stack([np.array(M.homogeneous) for M in list(self.data.oMi)[1:]])

    def jacobian(self, q: Array) -> Array:
        """Return the tool's Jacobian in the base frame, linear rows first."""
        frame = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        return np.array(pin.computeFrameJacobian(self.model, self.data, q, self.tool, frame))


@pytest.fixture(scope="module")
def pinocchio_arm() -> PinocchioArm:
    return PinocchioArm()


# --- the reference arm against Pinocchio and finite differences --------------------------------------


def test_forward_agrees_with_pinocchio(
    chain: SerialChain, pinocchio_arm: PinocchioArm, rng: np.random.Generator
) -> None:
    Q = chain.random(rng, 200)
    expected = np.stack([pinocchio_arm.forward(q) for q in Q])
    np.testing.assert_allclose(chain.forward(Q), expected, rtol=0, atol=1e-14)
    np.testing.assert_allclose(np.stack([chain.forward(q) for q in Q]), expected, rtol=0, atol=1e-14)


def test_jacobian_agrees_with_pinocchio(
    chain: SerialChain, pinocchio_arm: PinocchioArm, rng: np.random.Generator
) -> None:
    Q = chain.random(rng, 200)
    expected = np.stack([pinocchio_arm.jacobian(q) for q in Q])
    np.testing.assert_allclose(chain.jacobian(Q), expected, rtol=0, atol=1e-14)
    np.testing.assert_allclose(np.stack([chain.jacobian(q) for q in Q]), expected, rtol=0, atol=1e-14)


def test_jacobian_agrees_with_finite_differences(chain: SerialChain, rng: np.random.Generator) -> None:
    for q in chain.random(rng, 20):
        np.testing.assert_allclose(chain.jacobian(q), central_differences(chain.forward, q), rtol=0, atol=1e-9)


def test_frames_are_base_then_every_joint_then_tool(
    chain: SerialChain, pinocchio_arm: PinocchioArm, rng: np.random.Generator
) -> None:
    for q in chain.random(rng, 20):
        frames = chain.frames(q)
        assert frames.shape == (10, 4, 4)
        assert np.array_equal(frames[0], np.eye(4))
        np.testing.assert_allclose(frames[1:-1], pinocchio_arm.joint_frames(q), rtol=0, atol=1e-14)
        np.testing.assert_allclose(frames[-1], chain.forward(q), rtol=0, atol=1e-14)


def test_frames_takes_one_configuration_only(chain: SerialChain) -> None:
    with pytest.raises(InvalidInput, match="one configuration"):
        chain.frames(np.zeros((2, 8)))


def test_single_and_batch_have_the_documented_shapes(chain: SerialChain) -> None:
    for count in (0, 1, 3):
        assert chain.forward(np.zeros((count, 8))).shape == (count, 4, 4)
        assert chain.jacobian(np.zeros((count, 8))).shape == (count, 6, 8)
        assert chain.scaled_jacobian(np.zeros((count, 8))).shape == (count, 6, 8)
    assert chain.forward(np.zeros(8)).shape == (4, 4)
    assert chain.jacobian(np.zeros(8)).shape == (6, 8)


def test_kinematics_takes_lists_integers_and_strided_arrays(chain: SerialChain, rng: np.random.Generator) -> None:
    Q = chain.random(rng, 6)
    assert np.array_equal(chain.forward(Q.tolist()), chain.forward(Q))
    assert np.array_equal(chain.forward(Q[::2]), chain.forward(Q)[::2])
    assert np.array_equal(chain.jacobian(np.asfortranarray(Q)), chain.jacobian(Q))
    assert np.array_equal(chain.forward([0, 1, 0, 0, 0, 0, 0, 0]), chain.forward([0.0, 1.0, 0, 0, 0, 0, 0, 0]))


def test_kinematics_leaves_its_argument_alone(chain: SerialChain, rng: np.random.Generator) -> None:
    Q = chain.random(rng, 4)
    before = Q.copy()
    chain.forward(Q), chain.jacobian(Q), chain.scaled_jacobian(Q), chain.frames(Q[0])
    assert np.array_equal(Q, before)


def test_scaled_jacobian_has_no_units(chain: SerialChain, rng: np.random.Generator) -> None:
    """Positions over 0.4 m; the rail's column times 0.4 m: its linear part is left as it was."""
    Q = chain.random(rng, 5)
    J, scaled = chain.jacobian(Q), chain.scaled_jacobian(Q)
    np.testing.assert_allclose(scaled[:, :3, 1:], J[:, :3, 1:] / 0.4, rtol=1e-15)
    np.testing.assert_allclose(scaled[:, 3:, 1:], J[:, 3:, 1:], rtol=1e-15)
    np.testing.assert_allclose(scaled[:, :3, 0], J[:, :3, 0], rtol=1e-15)
    assert np.array_equal(scaled[:, 3:, 0], np.zeros((5, 3)))
    np.testing.assert_allclose(np.linalg.norm(scaled[:, :3, 0], axis=1), 1.0, rtol=1e-15)


def test_scaled_jacobian_is_the_same_in_any_unit_of_length(chain: SerialChain, rng: np.random.Generator) -> None:
    """An arm ten times as large, with a characteristic length ten times as large, is the same arm."""
    large = chain_from_dh(
        [
            dh_row(prismatic, np.radians(alpha), 10 * a, 10 * d, np.radians(theta), str(i))
            for i, (prismatic, alpha, a, d, theta) in enumerate(DOME_TABLE)
        ],
        convention="modified",
        characteristic_length=4.0,
    )
    for q in chain.random(rng, 5):
        Q = q * np.where(chain.prismatic, 10.0, 1.0)
        np.testing.assert_allclose(large.scaled_jacobian(Q), chain.scaled_jacobian(q), rtol=0, atol=1e-14)


# --- the facts of the design -------------------------------------------------------------------------


@pytest.mark.parametrize("d1", [0.0, 0.25, 0.8])
def test_all_zero_pose_is_a_pure_translation(chain: SerialChain, d1: float) -> None:
    pose = chain.forward([d1, 0, 0, 0, 0, 0, 0, 0])
    assert np.array_equal(pose[:3, :3], np.eye(3))
    assert np.array_equal(pose[:2, 3], [0.0, d1])
    assert pose[2, 3] == pytest.approx(0.480 + 0.400 + 0.418 + 0.120, abs=1e-15)
    assert np.array_equal(pose[3], [0, 0, 0, 1])


def test_rank_is_four_at_home(chain: SerialChain, dome: qparm.Cell) -> None:
    assert np.array_equal(dome.home(), np.zeros(8))
    singular_values = np.linalg.svd(chain.scaled_jacobian(dome.home()), compute_uv=False)
    assert singular_values[3] > 0.1
    assert singular_values[4] < 1e-15


def test_a_straight_elbow_alone_leaves_the_rank_at_six(chain: SerialChain, rng: np.random.Generator) -> None:
    """Rank six at most configurations with theta5 = 0, unlike an arm without the rail."""
    Q = chain.random(rng, 200)
    Q[:, chain.index("theta5")] = 0.0
    J = chain.scaled_jacobian(Q)
    assert np.median(np.linalg.svd(J, compute_uv=False)[:, 5]) > 0.05
    without_rail = np.linalg.svd(J[:, :, 1:], compute_uv=False)[:, 5]
    with_rail = np.linalg.svd(J, compute_uv=False)[:, 5]
    assert without_rail.max() < 1e-14
    assert (with_rail > 1e-3).mean() > 0.9


# --- the split pose error ------------------------------------------------------------------------------


def pose_pair(rng: np.random.Generator, rotation_vector: Array) -> tuple[Array, Array]:
    """Return a pose and a target whose rotation error is the given vector in the base frame."""
    R = Rotation.random(rng=rng)
    pose, target = np.eye(4), np.eye(4)
    pose[:3, :3] = R.as_matrix()
    target[:3, :3] = (Rotation.from_rotvec(rotation_vector) * R).as_matrix()
    pose[:3, 3], target[:3, 3] = rng.normal(size=3), rng.normal(size=3)
    return pose, target


def unit(rng: np.random.Generator) -> Array:
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-9, 1e-8, 1e-6, 1e-3, 0.1, 1.0, 2.0, 3.0])
def test_pose_error_is_target_minus_pose_in_the_base_frame(
    chain: SerialChain, rng: np.random.Generator, angle: float
) -> None:
    for _ in range(50):
        w = angle * unit(rng)
        pose, target = pose_pair(rng, w)
        e = chain.pose_error(pose, target)
        assert np.array_equal(e[:3], target[:3, 3] - pose[:3, 3])
        # turned the way round it was built, and as scipy sees the same two matrices
        np.testing.assert_allclose(e[3:], w, rtol=0, atol=5e-15 / max(0.1, np.sin(angle)))
        relative = Rotation.from_matrix(target[:3, :3] @ pose[:3, :3].T)
        np.testing.assert_allclose(e[3:], relative.as_rotvec(), rtol=0, atol=1e-12)


@pytest.mark.parametrize("angle", [1e-3, 1e-6, 1e-9])
def test_small_pose_errors_are_exact_to_1e_12_of_themselves(
    chain: SerialChain, rng: np.random.Generator, angle: float
) -> None:
    """With the pose at the identity the matrices hold every digit of a small rotation."""
    for _ in range(50):
        w = angle * unit(rng)
        e = chain.pose_error(np.eye(4), rigid(w, np.zeros(3)))
        np.testing.assert_allclose(e[3:], w, rtol=0, atol=1e-12 * angle)


@pytest.mark.parametrize("short_of_pi", [0.2, 0.1415, 0.14, 1e-2, 1e-4, 1e-6, 1e-7, 1e-9, 1e-12])
def test_pose_error_near_pi(chain: SerialChain, rng: np.random.Generator, short_of_pi: float) -> None:
    for _ in range(100):
        w = (np.pi - short_of_pi) * unit(rng)
        pose, target = pose_pair(rng, w)
        e = chain.pose_error(pose, target)[3:]
        np.testing.assert_allclose(e, w, rtol=0, atol=1e-13)


def test_pose_error_near_pi_about_axes_with_zero_entries(chain: SerialChain) -> None:
    for axis in ([1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, -1], [-1, 0, 0], [0.6, -0.8, 0], [0, 0.6, 0.8]):
        for short_of_pi in (0.1, 1e-3, 1e-8):
            w = (np.pi - short_of_pi) * np.array(axis, dtype=float)
            e = chain.pose_error(np.eye(4), rigid(w, np.zeros(3)))[3:]
            np.testing.assert_allclose(e, w, rtol=0, atol=1e-13)


def test_pose_error_at_exactly_pi(chain: SerialChain, rng: np.random.Generator) -> None:
    """Either sense is right at pi; the axis and the angle must be."""
    for axis in [*np.eye(3), *-np.eye(3), *(unit(rng) for _ in range(100))]:
        target = np.eye(4)
        target[:3, :3] = 2 * np.outer(axis, axis) - np.eye(3)
        e = chain.pose_error(np.eye(4), target)[3:]
        assert np.linalg.norm(e) == pytest.approx(np.pi, abs=1e-14)
        np.testing.assert_allclose(e * np.sign(e @ axis), np.pi * axis, rtol=0, atol=1e-13)


def test_pose_error_agrees_with_scipy_for_random_rotations(chain: SerialChain, rng: np.random.Generator) -> None:
    A, B = (Rotation.random(2000, rng=rng) for _ in range(2))
    poses, targets = (np.tile(np.eye(4), (2000, 1, 1)) for _ in range(2))
    poses[:, :3, :3], targets[:, :3, :3] = A.as_matrix(), B.as_matrix()
    E = chain.pose_error(poses, targets)
    np.testing.assert_allclose(E[:, 3:], (B * A.inv()).as_rotvec(), rtol=0, atol=1e-12)
    assert np.array_equal(E, [chain.pose_error(a, b) for a, b in zip(poses, targets, strict=True)])


def test_the_jacobian_is_the_derivative_of_the_pose_error(chain: SerialChain, rng: np.random.Generator) -> None:
    """A small step's error is J d: sign, frame and order of rows of the two fit together."""
    for q in chain.random(rng, 10):
        d = 1e-5 * rng.normal(size=8)
        e = chain.pose_error(chain.forward(q - d), chain.forward(q + d))
        np.testing.assert_allclose(e, 2 * chain.jacobian(q) @ d, rtol=0, atol=1e-12)


@pytest.mark.parametrize(("a", "b"), [((4, 4), (1, 4, 4)), ((3, 4), (3, 4)), ((2, 4, 4), (3, 4, 4))])
def test_pose_error_refuses_shapes_that_do_not_fit(chain: SerialChain, a: tuple[int, ...], b: tuple[int, ...]) -> None:
    with pytest.raises(InvalidInput, match=r"\(4, 4\) or \(N, 4, 4\)"):
        chain.pose_error(np.zeros(a), np.zeros(b))


# --- any chain -------------------------------------------------------------------------------------------

# in steps: a table's angle within 1e-12 of a right angle counts as one, on purpose
angles = st.one_of(
    st.sampled_from([0.0, np.pi / 2, -np.pi / 2, np.pi, -np.pi, 3 * np.pi / 2]),
    st.integers(-4000, 4000).map(lambda k: k / 1000),
)
lengths = st.one_of(st.just(0.0), st.floats(-1.0, 1.0))
vectors = st.tuples(st.floats(-2, 2), st.floats(-2, 2), st.floats(-2, 2)).map(np.array)
transforms = st.builds(rigid, vectors, vectors)
tables = st.lists(st.tuples(st.booleans(), angles, lengths, lengths, angles), min_size=1, max_size=9)


@settings(max_examples=150, deadline=None, derandomize=True, database=None)
@given(
    table=tables,
    convention=st.sampled_from(["modified", "standard"]),
    base=transforms,
    tool=transforms,
    data=st.data(),
)
def test_any_chain_agrees_with_plain_matrix_products(
    table: list, convention: str, base: Array, tool: Array, data: st.DataObject
) -> None:
    arm = chain_from_dh(
        [dh_row(*line, name=str(i)) for i, line in enumerate(table)],
        convention=convention,  # type: ignore[arg-type]
        transform_base=base,
        transform_tool=tool,
    )
    q = np.array(data.draw(st.lists(st.floats(-3, 3), min_size=len(table), max_size=len(table))))

    def plain(values: Array) -> Array:
        return plain_forward(table, convention, base, tool, values)

    np.testing.assert_allclose(arm.forward(q), plain(q), rtol=0, atol=1e-13)
    np.testing.assert_allclose(arm.forward(np.stack([q, -q]))[1], plain(-q), rtol=0, atol=1e-13)
    J = arm.jacobian(q)
    np.testing.assert_allclose(J, central_differences(plain, q, h=1e-4), rtol=0, atol=1e-9)
    np.testing.assert_allclose(arm.jacobian(np.stack([-q, q]))[1], J, rtol=0, atol=1e-15)
    frames = arm.frames(q)
    assert np.array_equal(frames[0], np.eye(4))
    np.testing.assert_allclose(frames[-1], plain(q), rtol=0, atol=1e-13)
    # a joint's frame turns about, or slides along, its own z axis
    for i, (prismatic, *_) in enumerate(table):
        z, origin = frames[i + 1, :3, 2], frames[i + 1, :3, 3]
        column = [z, np.zeros(3)] if prismatic else [np.cross(z, frames[-1, :3, 3] - origin), z]
        np.testing.assert_allclose(J[:, i], np.concatenate(column), rtol=0, atol=1e-13)


def test_right_angles_in_a_table_give_exact_zeros() -> None:
    for quarter_turns in range(-8, 9):
        arm = chain_from_dh(
            [dh_row(False, quarter_turns * np.pi / 2, 0.3, 0.2, quarter_turns * np.pi / 2, "only")],
            convention="modified",
        )
        R = arm.forward([0.0])[:3, :3]
        assert set(np.abs(R).ravel()) == {0.0, 1.0}
        expected = screw("x", quarter_turns * np.pi / 2, 0) @ screw("z", quarter_turns * np.pi / 2, 0)
        np.testing.assert_allclose(R, expected[:3, :3], rtol=0, atol=1e-14)


def test_an_angle_close_to_a_right_angle_is_not_rounded() -> None:
    arm = chain_from_dh([dh_row(False, np.pi / 2 + 1e-9, 0, 0, 0, "only")], convention="modified")
    assert arm.forward([0.0])[1, 1] == pytest.approx(-1e-9, rel=1e-6)


# --- arms of textbooks -------------------------------------------------------------------------------------

# Puma 560, Corke, Robotics, Vision and Control (standard DH): d, a, alpha
PUMA_STANDARD = (
    (0.0, 0.0, 90),
    (0.0, 0.4318, 0),
    (0.15005, 0.0203, -90),
    (0.4318, 0.0, 90),
    (0.0, 0.0, -90),
    (0.0, 0.0, 0),
)


def puma(convention: str) -> SerialChain:
    rows = [
        dh_row(False, np.radians(alpha), a, d, 0.0, f"joint {i + 1}") for i, (d, a, alpha) in enumerate(PUMA_STANDARD)
    ]
    return chain_from_dh(rows, convention=convention)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("q", "rotation", "position"),
    [
        ((0, 0, 0, 0, 0, 0), ((1, 0, 0), (0, 1, 0), (0, 0, 1)), (0.4521, -0.15005, 0.4318)),
        ((0, 90, -90, 0, 0, 0), ((1, 0, 0), (0, 1, 0), (0, 0, 1)), (0.0203, -0.15005, 0.8636)),
        ((0, 0, -90, 0, 0, 0), ((0, 0, -1), (0, 1, 0), (1, 0, 0)), None),
        ((0, 45, 180, 0, 45, 0), ((0, 0, 1), (0, 1, 0), (-1, 0, 0)), (0.5963, -0.15005, -0.01435)),
    ],
    ids=["zero", "ready", "stretch", "nominal"],
)
def test_puma_560_in_the_standard_convention(q: tuple, rotation: tuple, position: tuple | None) -> None:
    """The poses that Corke's toolbox prints for its named configurations."""
    if position is None:  # qs: 0.8636 m straight out along x, the a3 offset up
        position, rotation = (0.8636, -0.15005, -0.0203), ((0, 0, 1), (0, 1, 0), (-1, 0, 0))
    pose = puma("standard").forward(np.radians(q))
    np.testing.assert_allclose(pose[:3, 3], position, rtol=0, atol=5e-5)
    np.testing.assert_allclose(pose[:3, :3], rotation, rtol=0, atol=1e-15)
    assert np.abs(puma("modified").forward(np.radians(q)) - pose).max() > 0.1


def test_puma_560_in_the_modified_convention(rng: np.random.Generator) -> None:
    """Craig, Introduction to Robotics, table of figure 3.21 and eq. 3.14."""
    a2, a3, d3, d4 = 0.4318, 0.0203, 0.1244, 0.4318
    table = ((0, 0, 0), (-90, 0, 0), (0, a2, d3), (-90, a3, d4), (90, 0, 0), (-90, 0, 0))
    arm = chain_from_dh(
        [dh_row(False, np.radians(alpha), a, d, 0.0, str(i)) for i, (alpha, a, d) in enumerate(table)],
        convention="modified",
    )
    for q in rng.uniform(-np.pi, np.pi, size=(20, 6)):
        (c1, c2, _, c4, c5, _), (s1, s2, _, s4, s5, _) = np.cos(q), np.sin(q)
        c23, s23 = np.cos(q[1] + q[2]), np.sin(q[1] + q[2])
        out = a2 * c2 + a3 * c23 - d4 * s23
        expected = np.array(
            [
                [-c1 * (c23 * c4 * s5 + s23 * c5) - s1 * s4 * s5, c1 * out - d3 * s1],
                [-s1 * (c23 * c4 * s5 + s23 * c5) + c1 * s4 * s5, s1 * out + d3 * c1],
                [s23 * c4 * s5 - c23 * c5, -a3 * s23 - a2 * s2 - d4 * c23],
            ]
        )
        np.testing.assert_allclose(arm.forward(q)[:3, 2:], expected, rtol=0, atol=1e-14)


def test_scara_with_its_prismatic_joint_in_the_standard_convention() -> None:
    """Spong, Robot Modeling and Control: the SCARA's tool is at d1 - d3 - d4 and turns by theta1 + theta2 - theta4."""
    a1, a2, d4 = 0.35, 0.25, 0.1
    table = ((False, 0, a1, 0), (False, 180, a2, 0), (True, 0, 0, 0), (False, 0, 0, d4))
    arm = chain_from_dh(
        [dh_row(p, np.radians(alpha), a, d, 0.0, str(i)) for i, (p, alpha, a, d) in enumerate(table)],
        convention="standard",
    )
    t1, t2, d3, t4 = 0.4, 1.1, 0.13, -0.7
    pose = arm.forward([t1, t2, d3, t4])
    tool = [a1 * np.cos(t1) + a2 * np.cos(t1 + t2), a1 * np.sin(t1) + a2 * np.sin(t1 + t2), -d3 - d4]
    np.testing.assert_allclose(pose[:3, 3], tool, rtol=0, atol=1e-15)
    turn = t1 + t2 - t4
    R = [[np.cos(turn), np.sin(turn), 0], [np.sin(turn), -np.cos(turn), 0], [0, 0, -1]]
    np.testing.assert_allclose(pose[:3, :3], R, rtol=0, atol=1e-15)


# --- the verifier's own kinematics ----------------------------------------------------------------------------


def cell_with(convention: str) -> qparm.Cell:
    data = cell_data()
    data["arm"]["convention"] = convention
    data["arm"]["base"] = {"position": ["10 mm", "-20 mm", "30 mm"], "rpy": ["20 deg", "-30 deg", "140 deg"]}
    data["arm"]["tool"] = {"position": ["50 mm", "7 mm", "90 mm"], "rpy": ["-70 deg", "15 deg", "200 deg"]}
    data["arm"]["joints"][3]["dh"] = {"alpha": "33 deg", "a": "71 mm", "d": "-19 mm", "theta": "77 deg"}
    return qparm.Cell.load(data)


@pytest.mark.parametrize("convention", ["modified", "standard"])
def test_the_verifier_agrees_with_the_robot(convention: str, rng: np.random.Generator) -> None:
    cell = cell_with(convention)
    arm = cell.chain()
    Q = arm.random(rng, 100)
    poses, axes = joint_transforms(cell, Q)
    np.testing.assert_allclose(poses, arm.forward(Q), rtol=0, atol=1e-12)
    z, origin, turning = axes[:, :, :3, 2], axes[:, :, :3, 3], ~arm.prismatic[None, :, None]
    linear = np.where(turning, np.cross(z, poses[:, None, :3, 3] - origin), z)
    J = np.concatenate([linear, np.where(turning, z, 0.0)], axis=2).transpose(0, 2, 1)
    np.testing.assert_allclose(J, arm.jacobian(Q), rtol=0, atol=1e-12)
    smallest = np.linalg.svd(arm.scaled_jacobian(Q), compute_uv=False)[:, -1]
    np.testing.assert_allclose(scaled_singular_values(cell, poses, axes), smallest, rtol=0, atol=1e-12)


def test_the_verifier_agrees_with_the_robot_on_the_reference_cell(
    dome: qparm.Cell, chain: SerialChain, rng: np.random.Generator
) -> None:
    Q = chain.random(rng, 200)
    poses, axes = joint_transforms(dome, Q)
    np.testing.assert_allclose(poses, chain.forward(Q), rtol=0, atol=1e-12)
    np.testing.assert_allclose(axes, np.stack([chain.frames(q)[1:-1] for q in Q]), rtol=0, atol=1e-12)


def test_the_verifiers_base_and_tool_are_fixed_axis_roll_pitch_yaw() -> None:
    """About x, then y, then z of the fixed frame: Rz(yaw) Ry(pitch) Rx(roll)."""
    cell = cell_with("modified")
    for pose, rpy in ((cell.arm.base, (20, -30, 140)), (cell.arm.tool, (-70, 15, 200))):
        roll, pitch, yaw = np.radians(rpy)
        expected = pin.utils.rotate("z", yaw) @ pin.utils.rotate("y", pitch) @ pin.utils.rotate("x", roll)
        np.testing.assert_allclose(pose.matrix()[:3, :3], expected, rtol=0, atol=1e-15)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-5, 0.1, 2.0, 3.1, np.pi - 1e-7, np.pi])
def test_the_verifiers_rotation_angle(angle: float, rng: np.random.Generator) -> None:
    R = np.stack([Rotation.from_rotvec(angle * unit(rng)).as_matrix() for _ in range(50)])
    np.testing.assert_allclose(rotation_angle(R), angle, rtol=0, atol=3e-16 + 1e-15 * angle)
