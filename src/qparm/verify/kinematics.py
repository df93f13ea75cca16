"""A second, plain kinematics, straight from the cell's Denavit-Hartenberg table or its URDF.

It shares no line with :mod:`qparm.robot`: what is checked with it does not rest on the planner's own.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from qparm.cell.urdf import UrdfArm
from qparm.verify.urdf import urdf_transforms

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.cell import Cell

__all__ = ["joint_transforms", "rotation_angle", "scaled_singular_values", "tool_rotation_error",
           "tool_velocities"]  # fmt: skip


def _link(alpha: float, a: float) -> NDArray[np.float64]:
    """Return the constant part of a row of the table: a turn about x, then a way along it, (4, 4)."""
    c, s = np.cos(alpha), np.sin(alpha)
    return np.array([[1.0, 0.0, 0.0, a], [0.0, c, -s, 0.0], [0.0, s, c, 0.0], [0.0, 0.0, 0.0, 1.0]])


def _times(T: NDArray[np.float64], constant: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return frames (3, 4, N) times one constant (4, 4)."""
    # no matrix product: where cores are busy, the threads of a linear algebra library wait for each other for long
    product = np.zeros_like(T)
    for k, j in zip(*np.nonzero(constant[:3]), strict=True):
        product[:, j] += constant[k, j] * T[:, k]
    product[:, 3] += T[:, 3]
    return product


def _moved(T: NDArray[np.float64], theta: NDArray[np.float64], d: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return frames (3, 4, N) turned about their own z and moved along it."""
    c, s = np.cos(theta), np.sin(theta)
    return np.stack([c * T[:, 0] + s * T[:, 1], c * T[:, 1] - s * T[:, 0], T[:, 2], T[:, 3] + d * T[:, 2]], axis=1)


def joint_transforms(cell: Cell, Q: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the tool's poses and the frames in which the joints move, multiplied out from the table or the URDF.

    Parameters
    ----------
    cell : Cell
    Q : (N, n) ndarray
        m and rad.

    Returns
    -------
    poses : (N, 4, 4) ndarray
        Tool in the base frame.
    axes : (N, n, 4, 4) ndarray
        Frames whose z axes are the joint axes, base frame.
    """
    if isinstance(cell.arm, UrdfArm):
        return urdf_transforms(cell.arm, Q)
    N = len(Q)
    # one entry of all frames after another, so that whole rows of numbers are multiplied
    T = np.repeat(cell.arm.base.matrix()[:3, :, None], N, axis=2)
    axes = np.empty((N, len(cell.arm.joints), 4, 4))
    axes[:, :, 3] = (0.0, 0.0, 0.0, 1.0)
    for i, joint in enumerate(cell.arm.joints):
        a, d = (cell.arm.lengths[x] if isinstance(x, str) else x for x in (joint.dh.a, joint.dh.d))
        slides = joint.type == "prismatic"
        theta = np.full(N, joint.dh.theta) if slides else joint.dh.theta + Q[:, i]
        d = d + Q[:, i] if slides else np.full(N, d)
        link = _link(joint.dh.alpha, a)
        if cell.arm.convention == "modified":
            T = _moved(_times(T, link), theta, d)
            axes[:, i, :3] = T.transpose(2, 0, 1)
        else:
            axes[:, i, :3] = T.transpose(2, 0, 1)
            T = _times(_moved(T, theta, d), link)
    poses = np.empty((N, 4, 4))
    poses[:, :3] = _times(T, cell.arm.tool.matrix()).transpose(2, 0, 1)
    poses[:, 3] = (0.0, 0.0, 0.0, 1.0)
    return poses, axes


def rotation_angle(R: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the angles (rad) of rotations (N, 3, 3), exact for small ones too."""
    vector = np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], axis=-1)
    return np.arctan2(0.5 * np.linalg.norm(vector, axis=-1), 0.5 * (np.trace(R, axis1=1, axis2=2) - 1.0))


def scaled_singular_values(cell: Cell, poses: NDArray[np.float64], axes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the smallest singular value of the scaled Jacobian at N configurations, (N,).

    Positions over the characteristic length, prismatic joints times it.
    """
    length = cell.arm.characteristic_length
    z, origin = axes[:, :, :3, 2], axes[:, :, :3, 3]
    turning = np.array([joint.type == "revolute" for joint in cell.arm.joints])
    angular = np.where(turning[None, :, None], z, 0.0)
    linear = np.where(
        turning[None, :, None], np.cross(z, poses[:, None, :3, 3] - origin) / length, z
    )  # a prismatic joint's scale and the error's cancel
    J = np.concatenate([linear, angular], axis=2).transpose(0, 2, 1)
    return np.linalg.svd(J, compute_uv=False)[:, -1]


def tool_velocities(
    cell: Cell, Q: NDArray[np.float64], V: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the speeds of the tool point and of the tool's turning at configurations and joint velocities (N, n).

    Returns
    -------
    moving, turning : (N,) ndarray
        m/s and rad/s.
    """
    poses, axes = joint_transforms(cell, Q)
    z, origin = axes[:, :, :3, 2], axes[:, :, :3, 3]
    revolute = np.array([joint.type == "revolute" for joint in cell.arm.joints])[None, :, None]
    linear = np.where(revolute, np.cross(z, poses[:, None, :3, 3] - origin), z)
    angular = np.where(revolute, z, 0.0)
    moving, turning = ((V[:, :, None] * part).sum(axis=1) for part in (linear, angular))
    return np.linalg.norm(moving, axis=1), np.linalg.norm(turning, axis=1)


def tool_rotation_error(cell: Cell, R: NDArray[np.float64], R_target: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return by how much the tool's rotations (N, 3, 3) miss what the cell asks for, (N,), rad.

    A tool that may spin is judged by its axis, one that may tilt by how far its axis is outside the cone.
    """
    process = cell.process
    relative = R_target.transpose(0, 2, 1) @ R
    if process.tool_spin == "fixed" and process.tool_tilt == 0:
        return rotation_angle(relative)
    axis = relative[:, :, 2]
    lean = np.arctan2(np.hypot(axis[:, 0], axis[:, 1]), axis[:, 2])
    beyond = np.maximum(lean - process.tool_tilt, 0.0)
    if process.tool_spin == "free":
        return beyond
    # the rotation that takes z to the axis the short way, undone: what is left turns about z
    x, y, z = axis.T
    swing = np.zeros_like(relative)
    d = 1.0 / (1.0 + z)
    swing[:, 0, 0], swing[:, 0, 1], swing[:, 0, 2] = 1 - x * x * d, -x * y * d, x
    swing[:, 1, 0], swing[:, 1, 1], swing[:, 1, 2] = -x * y * d, 1 - y * y * d, y
    swing[:, 2, 0], swing[:, 2, 1], swing[:, 2, 2] = -x, -y, z
    return np.maximum(beyond, rotation_angle(swing.transpose(0, 2, 1) @ relative))
