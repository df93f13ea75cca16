"""Compiled kinematics of a serial chain: forward kinematics, geometric Jacobian, pose error.

The chain is given by three arrays (see :class:`qparm.robot.SerialChain`):

- ``fixed`` (n + 1, 3, 4): the constant transform in front of each joint and, last, the tool;
- ``prismatic`` (n,): whether a joint moves along (True) or about (False) its own z axis;
- ``q`` (n,): joint values in m and rad.

    T(q) = fixed[0] M_0(q_0) fixed[1] M_1(q_1) ... M_{n-1}(q_{n-1}) fixed[n]

Poses are the upper three rows of the 4 x 4 matrix. Jacobians are stored transposed, (n, 6), one row a
joint, so that a joint's column lies contiguous in memory: ``JT[i] = (v_i, w_i)``, the velocity of the
tool's origin and the angular velocity, both in the base frame.
"""

from __future__ import annotations

import math

import numpy as np

from qparm.compiled.kernels import b1, c1, c2, c3, kernel, kernel_helper, o1, o2, o3, void

__all__ = [
    "forward",
    "forward_batch",
    "frames",
    "jacobian",
    "jacobian_batch",
    "pose_error",
    "pose_error_batch",
]

# Below this the angle's sine carries no more digits than its series, and above it the vector part of
# R - R^T vanishes with the distance to pi: there the axis comes from the symmetric part.
_NEAR_PI = -0.99


@kernel_helper
def forward_and_axes(fixed, prismatic, q, pose, JT):
    """Write the tool's pose, and each joint's axis origin and direction into ``JT``."""
    n = q.shape[0]
    F = fixed[0]
    r00, r01, r02, x = F[0, 0], F[0, 1], F[0, 2], F[0, 3]
    r10, r11, r12, y = F[1, 0], F[1, 1], F[1, 2], F[1, 3]
    r20, r21, r22, z = F[2, 0], F[2, 1], F[2, 2], F[2, 3]
    for i in range(n):
        if prismatic[i]:
            x += r02 * q[i]
            y += r12 * q[i]
            z += r22 * q[i]
        else:
            c = math.cos(q[i])
            s = math.sin(q[i])
            r00, r01 = c * r00 + s * r01, c * r01 - s * r00
            r10, r11 = c * r10 + s * r11, c * r11 - s * r10
            r20, r21 = c * r20 + s * r21, c * r21 - s * r20
        JT[i, 0] = x
        JT[i, 1] = y
        JT[i, 2] = z
        JT[i, 3] = r02
        JT[i, 4] = r12
        JT[i, 5] = r22
        F = fixed[i + 1]
        f00, f01, f02, f03 = F[0, 0], F[0, 1], F[0, 2], F[0, 3]
        f10, f11, f12, f13 = F[1, 0], F[1, 1], F[1, 2], F[1, 3]
        f20, f21, f22, f23 = F[2, 0], F[2, 1], F[2, 2], F[2, 3]
        x += r00 * f03 + r01 * f13 + r02 * f23
        y += r10 * f03 + r11 * f13 + r12 * f23
        z += r20 * f03 + r21 * f13 + r22 * f23
        a, b, d = r00, r01, r02
        r00, r01, r02 = a * f00 + b * f10 + d * f20, a * f01 + b * f11 + d * f21, a * f02 + b * f12 + d * f22
        a, b, d = r10, r11, r12
        r10, r11, r12 = a * f00 + b * f10 + d * f20, a * f01 + b * f11 + d * f21, a * f02 + b * f12 + d * f22
        a, b, d = r20, r21, r22
        r20, r21, r22 = a * f00 + b * f10 + d * f20, a * f01 + b * f11 + d * f21, a * f02 + b * f12 + d * f22
    pose[0, 0], pose[0, 1], pose[0, 2], pose[0, 3] = r00, r01, r02, x
    pose[1, 0], pose[1, 1], pose[1, 2], pose[1, 3] = r10, r11, r12, y
    pose[2, 0], pose[2, 1], pose[2, 2], pose[2, 3] = r20, r21, r22, z


@kernel_helper
def forward_and_jacobian(fixed, prismatic, q, pose, JT):
    """Write the tool's pose and the transposed geometric Jacobian."""
    forward_and_axes(fixed, prismatic, q, pose, JT)
    x, y, z = pose[0, 3], pose[1, 3], pose[2, 3]
    for i in range(q.shape[0]):
        wx, wy, wz = JT[i, 3], JT[i, 4], JT[i, 5]
        if prismatic[i]:
            JT[i, 0], JT[i, 1], JT[i, 2] = wx, wy, wz
            JT[i, 3], JT[i, 4], JT[i, 5] = 0.0, 0.0, 0.0
        else:
            ox, oy, oz = x - JT[i, 0], y - JT[i, 1], z - JT[i, 2]
            JT[i, 0] = wy * oz - wz * oy
            JT[i, 1] = wz * ox - wx * oz
            JT[i, 2] = wx * oy - wy * ox


@kernel_helper
def split_pose_error(pose, target, e):
    """Write ``e = (p_d - p, log(R_d R^T))``: the split error of a pose against its target, base frame."""
    for k in range(3):
        e[k] = target[k, 3] - pose[k, 3]
    # E = R_d R^T
    e00 = target[0, 0] * pose[0, 0] + target[0, 1] * pose[0, 1] + target[0, 2] * pose[0, 2]
    e01 = target[0, 0] * pose[1, 0] + target[0, 1] * pose[1, 1] + target[0, 2] * pose[1, 2]
    e02 = target[0, 0] * pose[2, 0] + target[0, 1] * pose[2, 1] + target[0, 2] * pose[2, 2]
    e10 = target[1, 0] * pose[0, 0] + target[1, 1] * pose[0, 1] + target[1, 2] * pose[0, 2]
    e11 = target[1, 0] * pose[1, 0] + target[1, 1] * pose[1, 1] + target[1, 2] * pose[1, 2]
    e12 = target[1, 0] * pose[2, 0] + target[1, 1] * pose[2, 1] + target[1, 2] * pose[2, 2]
    e20 = target[2, 0] * pose[0, 0] + target[2, 1] * pose[0, 1] + target[2, 2] * pose[0, 2]
    e21 = target[2, 0] * pose[1, 0] + target[2, 1] * pose[1, 1] + target[2, 2] * pose[1, 2]
    e22 = target[2, 0] * pose[2, 0] + target[2, 1] * pose[2, 1] + target[2, 2] * pose[2, 2]
    # the vector part of E is sin(angle) times the axis, the trace gives the cosine
    wx = 0.5 * (e21 - e12)
    wy = 0.5 * (e02 - e20)
    wz = 0.5 * (e10 - e01)
    cosine = 0.5 * (e00 + e11 + e22 - 1.0)
    sine = math.sqrt(wx * wx + wy * wy + wz * wz)
    if cosine > _NEAR_PI:
        factor = math.atan2(sine, cosine) / sine if sine > 1e-8 else 1.0
        e[3] = factor * wx
        e[4] = factor * wy
        e[5] = factor * wz
        return
    # (E + E^T)/2 = cos I + (1 - cos) a a^T: take the axis from its largest diagonal entry
    angle = math.atan2(sine, cosine)
    s = 1.0 / (1.0 - cosine)
    axx, ayy, azz = (e00 - cosine) * s, (e11 - cosine) * s, (e22 - cosine) * s
    if axx >= ayy and axx >= azz:
        ax = math.sqrt(max(axx, 0.0))
        ay, az = 0.5 * (e01 + e10) * s / ax, 0.5 * (e02 + e20) * s / ax
    elif ayy >= azz:
        ay = math.sqrt(max(ayy, 0.0))
        ax, az = 0.5 * (e01 + e10) * s / ay, 0.5 * (e12 + e21) * s / ay
    else:
        az = math.sqrt(max(azz, 0.0))
        ax, ay = 0.5 * (e02 + e20) * s / az, 0.5 * (e12 + e21) * s / az
    sign = -1.0 if ax * wx + ay * wy + az * wz < 0.0 else 1.0
    norm = angle * sign / math.sqrt(ax * ax + ay * ay + az * az)
    e[3] = norm * ax
    e[4] = norm * ay
    e[5] = norm * az


@kernel(void(c3, b1, c1, o2))
def forward(fixed, prismatic, q, pose):
    """Write the (4, 4) pose of the tool in the base frame."""
    JT = np.empty((q.shape[0], 6))
    forward_and_axes(fixed, prismatic, q, pose, JT)
    pose[3, 0] = pose[3, 1] = pose[3, 2] = 0.0
    pose[3, 3] = 1.0


@kernel(void(c3, b1, c2, o3))
def forward_batch(fixed, prismatic, Q, poses):
    """Write the (N, 4, 4) poses of N configurations."""
    JT = np.empty((Q.shape[1], 6))
    for k in range(Q.shape[0]):
        pose = poses[k]
        forward_and_axes(fixed, prismatic, Q[k], pose, JT)
        pose[3, 0] = pose[3, 1] = pose[3, 2] = 0.0
        pose[3, 3] = 1.0


@kernel(void(c3, b1, c1, o3))
def frames(fixed, prismatic, q, poses):
    """Write the (n + 2, 4, 4) frames of the chain: base, after each joint's motion, tool."""
    n = q.shape[0]
    F = np.empty((3, 4))
    poses[:] = 0.0
    for a in range(4):
        poses[0, a, a] = 1.0
    for i in range(n + 1):
        for a in range(3):
            for b in range(4):
                F[a, b] = fixed[i, a, b]
        if i < n:
            if prismatic[i]:
                for a in range(3):
                    F[a, 3] += F[a, 2] * q[i]
            else:
                c, s = math.cos(q[i]), math.sin(q[i])
                for a in range(3):
                    F[a, 0], F[a, 1] = c * F[a, 0] + s * F[a, 1], c * F[a, 1] - s * F[a, 0]
        for a in range(3):
            for b in range(4):
                t = poses[i, a, 3] if b == 3 else 0.0
                for k in range(3):
                    t += poses[i, a, k] * F[k, b]
                poses[i + 1, a, b] = t
        poses[i + 1, 3, 3] = 1.0


@kernel(void(c3, b1, c1, o2, o2))
def jacobian(fixed, prismatic, q, pose, JT):
    """Write the (4, 4) pose and the transposed Jacobian (n, 6)."""
    forward_and_jacobian(fixed, prismatic, q, pose, JT)
    pose[3, 0] = pose[3, 1] = pose[3, 2] = 0.0
    pose[3, 3] = 1.0


@kernel(void(c3, b1, c2, o3, o3))
def jacobian_batch(fixed, prismatic, Q, poses, JTs):
    """Write the (N, 4, 4) poses and the transposed Jacobians (N, n, 6)."""
    for k in range(Q.shape[0]):
        pose = poses[k]
        forward_and_jacobian(fixed, prismatic, Q[k], pose, JTs[k])
        pose[3, 0] = pose[3, 1] = pose[3, 2] = 0.0
        pose[3, 3] = 1.0


@kernel(void(c2, c2, o1))
def pose_error(pose, target, e):
    """Write the (6,) split error of one pose (m, rad, base frame)."""
    split_pose_error(pose, target, e)


@kernel(void(c3, c3, o2))
def pose_error_batch(poses, targets, E):
    """Write the (N, 6) split errors of N poses."""
    for k in range(poses.shape[0]):
        split_pose_error(poses[k], targets[k], E[k])
