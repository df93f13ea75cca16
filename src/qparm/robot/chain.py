"""The serial chain: joints, their limits, and the kinematics that every stage uses."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np

from qparm.arrays import real_array
from qparm.errors import InvalidInput
from qparm.names import wrong_joint_name, wrong_name

if TYPE_CHECKING:
    from types import ModuleType

    from numpy.typing import ArrayLike, NDArray

    from qparm.robot.reach import ReachBound

__all__ = ["CONTINUOUS_RANGE", "Joint", "SerialChain", "check_pose", "check_poses"]

JointKind = Literal["prismatic", "revolute"]

# The limits of a continuous joint (rad): ten thousand turns either way, more than any path has poses for. They are
# finite, so that all that is scaled by a joint's range is a number.
CONTINUOUS_RANGE = (-2e4 * np.pi, 2e4 * np.pi)
# Joint values and coordinates beyond this (rad, m) are refused: their squares would not be finite.
LARGEST = 1e100


@dataclass(frozen=True, eq=False)
class Joint:
    """One joint: where it sits, how it moves, what it may do.

    Attributes
    ----------
    name : str
        Unique in the chain.
    kind : {"prismatic", "revolute"}
        Motion along or about the joint's own z axis.
    transform_previous_joint : (4, 4) ndarray
        The joint's frame at zero in the frame of the joint before it (the base for the first).
    position : tuple of float
        Lower and upper limit (m or rad).
    velocity, acceleration, jerk : float
        Symmetric limits, per second, second squared and cubed.
    continuous : bool
        Whether a revolute joint turns without end: angles 2 pi apart are then the same place. ``position`` is
        :data:`CONTINUOUS_RANGE`, so that a path turns on instead of back; random starts are drawn from one turn.
    """

    name: str
    kind: JointKind
    transform_previous_joint: NDArray[np.float64]
    position: tuple[float, float]
    velocity: float
    acceleration: float
    jerk: float
    continuous: bool = False

    def __post_init__(self) -> None:
        wrong = wrong_joint_name(self.name)
        if wrong:
            raise InvalidInput(f"joint {self.name!r:.60}: {wrong}")
        transform = real_array(self.transform_previous_joint, what="transform_previous_joint").copy()
        _require_pose(transform, f"transform of joint {self.name!r}")
        transform.flags.writeable = False
        object.__setattr__(self, "transform_previous_joint", transform)
        if self.kind not in get_args(JointKind):
            raise InvalidInput(f"joint {self.name!r}: kind must be one of {get_args(JointKind)}, not {self.kind!r}")
        if len(self.position) != 2:
            raise InvalidInput(f"joint {self.name!r}: position limits must be two numbers, not {self.position}")
        lower, upper = self.position
        if not (np.isfinite(lower) and np.isfinite(upper) and lower < upper):
            raise InvalidInput(f"joint {self.name!r}: position limits {self.position} must be finite and ascending")
        if self.continuous and not (self.kind == "revolute" and lower <= -np.pi and upper >= np.pi):
            raise InvalidInput(f"joint {self.name!r}: only a revolute joint with a turn to work in is continuous")
        for name in ("velocity", "acceleration", "jerk"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise InvalidInput(f"joint {self.name!r}: {name} limit must be finite and positive, not {value}")


@dataclass(frozen=True, eq=False)
class SerialChain:
    """A serial arm of prismatic and revolute joints, in SI units.

        T(q) = transform_base F_1 M_1(q_1) ... F_n M_n(q_n) transform_tool

    Attributes
    ----------
    name : str
    joints : tuple of Joint
    transform_base : (4, 4) ndarray
        Where the arm's first frame stands in the base frame in which poses are given.
    transform_tool : (4, 4) ndarray
        The tool's frame in the frame of the last joint.
    characteristic_length : float
        The length (m) that counts as one radian wherever lengths and angles meet: positions in the
        pose error, and prismatic joints beside revolute ones.
    """

    name: str
    joints: tuple[Joint, ...]
    transform_base: NDArray[np.float64]
    transform_tool: NDArray[np.float64]
    characteristic_length: float = 0.4

    def __post_init__(self) -> None:
        if not self.joints:
            raise InvalidInput("a chain needs at least one joint")
        wrong = wrong_name(self.name)
        if wrong:
            raise InvalidInput(f"name of the chain: {wrong}")
        names = [joint.name for joint in self.joints]
        if len(set(names)) != len(names):
            raise InvalidInput(f"joint names must differ: {names}")
        if not (np.isfinite(self.characteristic_length) and self.characteristic_length > 0):
            raise InvalidInput(f"characteristic_length must be positive, not {self.characteristic_length}")
        for name in ("transform_base", "transform_tool"):
            transform = real_array(getattr(self, name), what=name).copy()
            _require_pose(transform, name)
            transform.flags.writeable = False
            object.__setattr__(self, name, transform)

    def __repr__(self) -> str:
        return f"SerialChain({self.name!r}, {self.n} joints: {', '.join(self.names)})"

    # --- what the joints say, as arrays -----------------------------------------------------------

    @property
    def n(self) -> int:
        """The number of joints."""
        return len(self.joints)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Joint names in order."""
        return tuple(joint.name for joint in self.joints)

    @cached_property
    def prismatic(self) -> NDArray[np.bool_]:
        """Whether each joint is prismatic, (n,)."""
        return _frozen(np.array([joint.kind == "prismatic" for joint in self.joints]))

    @property
    def units(self) -> tuple[str, ...]:
        """``"m"`` or ``"rad"`` for each joint."""
        return tuple("m" if joint.kind == "prismatic" else "rad" for joint in self.joints)

    @cached_property
    def continuous(self) -> NDArray[np.bool_]:
        """Whether each joint turns without end, (n,)."""
        return _frozen(np.array([joint.continuous for joint in self.joints]))

    @cached_property
    def lower(self) -> NDArray[np.float64]:
        """Lower position limits, (n,), m and rad."""
        return _frozen(np.array([joint.position[0] for joint in self.joints], dtype=float))

    @cached_property
    def upper(self) -> NDArray[np.float64]:
        """Upper position limits, (n,), m and rad."""
        return _frozen(np.array([joint.position[1] for joint in self.joints], dtype=float))

    @cached_property
    def velocity(self) -> NDArray[np.float64]:
        """Velocity limits, (n,)."""
        return _frozen(np.array([joint.velocity for joint in self.joints], dtype=float))

    @cached_property
    def acceleration(self) -> NDArray[np.float64]:
        """Acceleration limits, (n,)."""
        return _frozen(np.array([joint.acceleration for joint in self.joints], dtype=float))

    @cached_property
    def jerk(self) -> NDArray[np.float64]:
        """Jerk limits, (n,)."""
        return _frozen(np.array([joint.jerk for joint in self.joints], dtype=float))

    @cached_property
    def scale(self) -> NDArray[np.float64]:
        """D of the scaled joints, (n,): characteristic length for prismatic joints, 1 rad for revolute ones."""
        return _frozen(np.where(self.prismatic, self.characteristic_length, 1.0))

    @cached_property
    def fixed(self) -> NDArray[np.float64]:
        """Constant transforms for the kernels, (n + 1, 3, 4): base times first joint, ..., tool."""
        transforms = [joint.transform_previous_joint for joint in self.joints] + [self.transform_tool]
        transforms[0] = self.transform_base @ transforms[0]
        return _frozen(np.ascontiguousarray(np.stack(transforms)[:, :3, :]))

    @cached_property
    def reach_bound(self) -> ReachBound | None:
        """The greatest reach of the links; None with fewer than two revolute joints."""
        from qparm.robot.reach import reach_bound

        return reach_bound(self)

    # --- kinematics ------------------------------------------------------------------------------

    def forward(self, q: ArrayLike) -> NDArray[np.float64]:
        """Return the tool's pose in the base frame.

        Parameters
        ----------
        q : (n,) or (N, n) array_like
            Joint values in m and rad.

        Returns
        -------
        (4, 4) or (N, 4, 4) ndarray

        Raises
        ------
        InvalidInput
            If the shape does not fit the chain, or a value is not finite.
        """
        q = self.check_configuration(q)
        if q.ndim == 1:
            pose = np.empty((4, 4))
            _kernels().forward(self.fixed, self.prismatic, q, pose)
            return pose
        poses = np.empty((q.shape[0], 4, 4))
        _kernels().forward_batch(self.fixed, self.prismatic, q, poses)
        return poses

    def jacobian(self, q: ArrayLike) -> NDArray[np.float64]:
        """Return the geometric Jacobian of the tool's frame, in the base frame.

        Parameters
        ----------
        q : (n,) or (N, n) array_like

        Returns
        -------
        (6, n) or (N, 6, n) ndarray
            Rows: velocity of the tool's origin, then angular velocity.
        """
        q = self.check_configuration(q)
        if q.ndim == 1:
            pose, JT = np.empty((4, 4)), np.empty((self.n, 6))
            _kernels().jacobian(self.fixed, self.prismatic, q, pose, JT)
            return np.ascontiguousarray(JT.T)
        poses, JTs = np.empty((q.shape[0], 4, 4)), np.empty((q.shape[0], self.n, 6))
        _kernels().jacobian_batch(self.fixed, self.prismatic, q, poses, JTs)
        return np.ascontiguousarray(JTs.transpose(0, 2, 1))

    def scaled_jacobian(self, q: ArrayLike) -> NDArray[np.float64]:
        """Return the Jacobian without units: positions over the characteristic length, joints scaled by D.

        Its singular values, unlike those of the plain Jacobian, can be compared and thresholded.
        """
        J = self.jacobian(q) * self.scale
        J[..., :3, :] /= self.characteristic_length
        return J

    def frames(self, q: ArrayLike) -> NDArray[np.float64]:
        """Return the (n + 2, 4, 4) frames at one configuration: base, each joint's, tool."""
        q = self.check_one_configuration(q)
        poses = np.empty((self.n + 2, 4, 4))
        _kernels().frames(self.fixed, self.prismatic, q, poses)
        return poses

    def pose_error(self, pose: ArrayLike, target: ArrayLike) -> NDArray[np.float64]:
        """Return the split error ``(p_d - p, log(R_d R^T))`` of poses against their targets.

        Parameters
        ----------
        pose, target : (4, 4) or (N, 4, 4) array_like

        Returns
        -------
        (6,) or (N, 6) ndarray
            In m and rad, base frame.
        """
        pose = np.ascontiguousarray(pose, dtype=float)
        target = np.ascontiguousarray(target, dtype=float)
        if pose.shape != target.shape or pose.shape[-2:] != (4, 4) or pose.ndim not in (2, 3):
            raise InvalidInput(f"poses must both be (4, 4) or (N, 4, 4), not {pose.shape} and {target.shape}")
        if not (np.isfinite(pose).all() and np.isfinite(target).all()):
            raise InvalidInput("a pose has an entry that is not finite")
        if pose.ndim == 2:
            e = np.empty(6)
            _kernels().pose_error(pose, target, e)
            return e
        E = np.empty((pose.shape[0], 6))
        _kernels().pose_error_batch(pose, target, E)
        return E

    # --- checks ----------------------------------------------------------------------------------

    def check_configuration(self, q: ArrayLike) -> NDArray[np.float64]:
        """Return ``q`` as a contiguous float array, or raise naming what is wrong with it."""
        q = real_array(q, what="q")
        if q.ndim not in (1, 2) or q.shape[-1] != self.n:
            raise InvalidInput(
                f"{self.name!r} has {self.n} joints: q must be ({self.n},) or (N, {self.n}), not {q.shape}"
            )
        if not (np.abs(q) <= LARGEST).all():
            index = tuple(int(i) for i in np.argwhere(~(np.abs(q) <= LARGEST))[0])
            where = f"configuration {index[0]}, " if len(index) == 2 else ""
            raise InvalidInput(f"{where}joint {self.names[index[-1]]!r}: {q[index]} is {_unusable(q[index])}")
        return q

    def check_one_configuration(self, q: ArrayLike, *, what: str = "q") -> NDArray[np.float64]:
        """Return one configuration as a contiguous float array (n,), or raise naming what is wrong with it."""
        array = self.check_configuration(q)
        if array.ndim != 1:
            raise InvalidInput(f"{what} must be one configuration of shape ({self.n},), not {array.shape}")
        return array

    def within_limits(self, q: ArrayLike, *, tolerance: float = 0.0) -> NDArray[np.bool_]:
        """Return whether each joint value is within its position limits, elementwise."""
        q = self.check_configuration(q)
        return (q >= self.lower - tolerance) & (q <= self.upper + tolerance)

    def random(self, rng: np.random.Generator, count: int) -> NDArray[np.float64]:
        """Return (count, n) configurations drawn uniformly within the limits, within one turn where they are wider.

        See :attr:`one_turn`.
        """
        lower, upper = self.one_turn
        return rng.uniform(lower, upper, size=(count, self.n))

    @cached_property
    def one_turn(self) -> NDArray[np.float64]:
        """Lower and upper ends of where joints are searched, (2, n).

        The limits; of joints whose limits are two turns apart, or more, one turn: about zero, or next to it where the
        limits ask for that. All else is the same again.
        """
        wide = ~self.prismatic & (self.continuous | (self.upper - self.lower >= 4 * np.pi * (1 - 1e-6)))
        middle = np.clip(0.0, np.where(wide, self.lower + np.pi, 0.0), np.where(wide, self.upper - np.pi, 0.0))
        return _frozen(np.where(wide, [middle - np.pi, middle + np.pi], [self.lower, self.upper]))

    def with_position_limits(self, lower: ArrayLike, upper: ArrayLike) -> SerialChain:
        """Return the arm with other position limits, (n,) each (m, rad)."""
        limits = zip(np.asarray(lower, dtype=float).tolist(), np.asarray(upper, dtype=float).tolist(), strict=True)
        joints = (replace(joint, position=pair) for joint, pair in zip(self.joints, limits, strict=True))
        return replace(self, joints=tuple(joints))

    def distance_to_limits(self, q: ArrayLike) -> NDArray[np.float64]:
        """Return how far configurations (..., n) stay from their limits (...), as share of the nearest one's range."""
        q = real_array(q, what="q")
        return (np.minimum(q - self.lower, self.upper - q) / (self.upper - self.lower)).min(axis=-1)

    def index(self, name: str) -> int:
        """Return the index of a joint by name."""
        try:
            return self.names.index(name)
        except ValueError:
            raise InvalidInput(f"no joint {name!r} in {self.name!r}; its joints are {', '.join(self.names)}") from None


def check_poses(poses: ArrayLike, *, what: str = "pose") -> NDArray[np.float64]:
    """Return poses as a contiguous (..., 4, 4) array after checking that they are rigid transforms."""
    array = real_array(poses, what=f"a {what}")
    if array.shape[-2:] != (4, 4):
        raise InvalidInput(f"a {what} must be a (4, 4) matrix, not {array.shape}")
    flat = array.reshape(-1, 4, 4)
    for k in range(flat.shape[0]) if not _are_poses(flat) else ():
        _require_pose(flat[k], what if len(flat) == 1 else f"{what} {k}")
    return array


def check_pose(pose: ArrayLike, *, what: str = "pose") -> NDArray[np.float64]:
    """Return one pose as a contiguous (4, 4) array after checking that it is a rigid transform."""
    array = check_poses(pose, what=what)
    if array.ndim != 2:
        raise InvalidInput(f"{what} must be one (4, 4) matrix, not {array.shape}")
    return array


def _are_poses(poses: NDArray[np.float64]) -> bool:
    if not (np.abs(poses) <= LARGEST).all():
        return False
    R = poses[:, :3, :3]
    gram = np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max(initial=0.0)
    return bool(gram < 1e-6 and (np.linalg.det(R) > 0).all() and (poses[:, 3] == (0, 0, 0, 1)).all())


def _require_pose(T: NDArray[np.float64], what: str) -> None:
    if T.shape != (4, 4):
        raise InvalidInput(f"{what} must be a (4, 4) matrix, not {T.shape}")
    if not (np.abs(T) <= LARGEST).all():
        i, j = (int(k) for k in np.argwhere(~(np.abs(T) <= LARGEST))[0])
        raise InvalidInput(f"{what} has an entry that is {_unusable(T[i, j])} at ({i}, {j})")
    R = T[:3, :3]
    if np.abs(R @ R.T - np.eye(3)).max() > 1e-6 or np.linalg.det(R) < 0 or not np.array_equal(T[3], (0, 0, 0, 1)):
        raise InvalidInput(f"{what} is not a rigid transform: a rotation matrix, a translation and (0, 0, 0, 1)")


def _unusable(value: float) -> str:
    return f"beyond {LARGEST:.0e}" if np.isfinite(value) else "not finite"


def _frozen(array: NDArray) -> NDArray:
    array.flags.writeable = False
    return array


def _kernels() -> ModuleType:
    # numba is heavy: loaded when something is computed, not when a chain is described
    from qparm.robot import kernels

    return kernels
