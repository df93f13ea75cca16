"""Compiled iteration for poses that leave the tool some freedom: arm and tool are moved together.

The tool may stand at ``pose exp(tilt_x, tilt_y, 0) Rz(spin)`` (:mod:`qparm.path.relaxation`). Its parameters rho are
moved as if they were three more joints, each step the bounded least-norm step of :mod:`qparm.ik` on

    J d - B d_rho = e

with e the error against the pose at rho and B the angular velocity of that pose. The tilt is stepped outwards and
sideways of where it leans, so that the cone is a bound on the one.
"""

from __future__ import annotations

import math

import numpy as np

from qparm.compiled.kernels import b1, c1, c2, c3, f8, i8, kernel, kernel_helper, o1
from qparm.ik.active_set_step import bounded_least_norm
from qparm.ik.closed_form_step import M, least_norm
from qparm.ik.iterate import NOT_CONVERGED, REACHED, STALL_WINDOW, STALLED, advance, improved, inside
from qparm.ik.step import form_bounds, form_task

__all__ = ["nearest_parameters", "nearest_parameters_kernel", "offset_of", "relaxed_iterate_kernel", "turned"]

# The tool turns by this much in a step at most (rad), as a revolute joint.
_TRUST = 0.3
# Below this the tilt has no direction (rad).
_UPRIGHT = 1e-9
# Of the cone's half angle: rounding must not lead out of it.
_WITHIN = 1.0 - 1e-12


@kernel_helper
def offset_of(rho, out):
    """Write exp(tilt_x, tilt_y, 0) Rz(spin)."""
    x, y, spin = rho[0], rho[1], rho[2]
    angle = np.sqrt(x * x + y * y)
    if angle > 1e-9:
        x, y = x / angle, y / angle
    c, s = np.cos(angle), np.sin(angle)
    a00, a01, a02 = c + x * x * (1 - c), x * y * (1 - c), y * s
    a10, a11, a12 = x * y * (1 - c), c + y * y * (1 - c), -x * s
    a20, a21, a22 = -y * s, x * s, c
    c, s = np.cos(spin), np.sin(spin)
    out[0, 0], out[0, 1], out[0, 2] = a00 * c + a01 * s, a01 * c - a00 * s, a02
    out[1, 0], out[1, 1], out[1, 2] = a10 * c + a11 * s, a11 * c - a10 * s, a12
    out[2, 0], out[2, 1], out[2, 2] = a20 * c + a21 * s, a21 * c - a20 * s, a22


@kernel_helper
def turned(target, offset, out):
    """Write the target with the tool turned by ``offset`` (3, 3) about its own origin."""
    for a in range(3):
        for b in range(3):
            out[a, b] = target[a, 0] * offset[0, b] + target[a, 1] * offset[1, b] + target[a, 2] * offset[2, b]
        out[a, 3] = target[a, 3]


@kernel_helper
def nearest_parameters(target, pose, cone, rho):
    """Write the parameters with which the tool comes nearest to a pose, and return the angle that is left (rad).

    cone : half angle of the tilt, and 1 where the spin is free.
    """
    R = np.empty((3, 3))
    for a in range(3):
        for b in range(3):
            R[a, b] = target[0, a] * pose[0, b] + target[1, a] * pose[1, b] + target[2, a] * pose[2, b]
    # R = exp(tilt) Rz(spin): the tilt takes z to R z, what is left turns about z
    sine = math.sqrt(R[0, 2] * R[0, 2] + R[1, 2] * R[1, 2])
    lean = math.atan2(sine, R[2, 2])
    spin = math.atan2(R[1, 0] - R[0, 1], R[0, 0] + R[1, 1])
    kept = min(lean, _WITHIN * cone[0])
    rho[0] = -kept * R[1, 2] / sine if sine > _UPRIGHT else 0.0
    rho[1] = kept * R[0, 2] / sine if sine > _UPRIGHT else 0.0
    rho[2] = spin if cone[1] > 0.0 else 0.0
    return math.sqrt((lean - kept) ** 2 + (spin - rho[2]) ** 2)


@kernel(f8(c2, c2, c1, o1))
def nearest_parameters_kernel(target, pose, cone, rho):
    """Compiled :func:`nearest_parameters`."""
    return nearest_parameters(target, pose, cone, rho)


@kernel_helper
def _columns_of_tool(target, rho, cone, theta, ux, uy, JT, n):
    """Write the columns of the tool's parameters, -B: outwards, sideways, spin; zero where one is not free."""
    for i in range(3):
        for k in range(M):
            JT[n + i, k] = 0.0
    if cone[0] > 0.0:
        # sideways: a turn of the leaning axis about the pose's z, over the angle by which it leans
        along, across = 0.0, 1.0
        if theta > _UPRIGHT:
            along, across = (1.0 - math.cos(theta)) / theta, math.sin(theta) / theta
        for k in range(3):
            JT[n, 3 + k] = -(target[k, 0] * ux + target[k, 1] * uy)
            JT[n + 1, 3 + k] = -(along * target[k, 2] - across * (target[k, 0] * uy - target[k, 1] * ux))
    if cone[1] > 0.0:
        z = (math.sin(theta) * uy, -math.sin(theta) * ux, math.cos(theta))
        for k in range(3):
            JT[n + 2, 3 + k] = -(target[k, 0] * z[0] + target[k, 1] * z[1] + target[k, 2] * z[2])


@kernel(i8(c3, b1, c1, c1, c1, f8, c1, c2, c1, f8, f8, f8, i8, o1, o1, o1))
def relaxed_iterate_kernel(
    fixed, prismatic, lower, upper, scale, length, largest, target, cone, ease, position_tolerance,
    rotation_tolerance, max_iterations, q, rho, errors,
):  # fmt: skip
    """Iterate ``q`` and ``rho`` in place towards ``target``; return REACHED, STALLED or NOT_CONVERGED.

    cone : half angle of the tilt (rad), and 1 where the spin is free; ease : by how much less a turn of the tool counts
    in the least-norm step than one of a scaled joint. ``errors`` as in ``iterate_kernel``, against the
    target at ``rho``.
    """
    n = q.shape[0]
    m = n + 3
    pose, JT, A, G = np.empty((4, 4)), np.empty((m, M)), np.empty((M, M)), np.empty((m, m))
    e, z, residual, g = np.empty(M), np.empty(M), np.empty(M), np.empty(max(m, M))
    y, lo, hi, y_new, state = np.empty(m), np.empty(m), np.empty(m), np.empty(m), np.empty(m, dtype=np.int64)
    offset, stands = np.empty((3, 3)), np.empty((3, 4))
    best, since = math.inf, 0
    for iteration in range(max_iterations + 1):
        offset_of(rho, offset)
        turned(target, offset, stands)
        lam2 = form_task(fixed, prismatic, q, stands, scale, length, pose, JT[:n], e, errors)
        within = inside(q, lower, upper)
        if errors[0] <= position_tolerance and errors[1] <= rotation_tolerance and within:
            return REACHED
        best, since = improved(math.sqrt((errors[0] / length) ** 2 + errors[1] ** 2), best, since)
        if since >= STALL_WINDOW and within:
            return STALLED
        if iteration == max_iterations:
            return NOT_CONVERGED
        theta = math.sqrt(rho[0] * rho[0] + rho[1] * rho[1])
        ux, uy = (rho[0] / theta, rho[1] / theta) if theta > _UPRIGHT else (1.0, 0.0)
        _columns_of_tool(target, rho, cone, theta, ux, uy, JT, n)
        form_bounds(q, lower, upper, scale, largest, lo[:n], hi[:n])
        side = min(_TRUST, 2.0 * cone[0])
        lo[n], hi[n] = -side, min(_TRUST, max(cone[0] - theta, 0.0))
        lo[n + 1], hi[n + 1] = -side, side
        lo[n + 2], hi[n + 2] = -_TRUST * cone[1], _TRUST * cone[1]
        for i in range(n, m):
            lo[i] /= ease
            hi[i] /= ease
            for k in range(3, M):
                JT[i, k] *= ease
        bounded = least_norm(JT, e, lam2, A, z, y)
        if bounded:
            for i in range(m):
                if y[i] < lo[i] or y[i] > hi[i]:
                    bounded = False
        else:
            y[:] = 0.0
        if not bounded:
            bounded_least_norm(JT, e, lam2, lo, hi, y, z, state, A, G, y_new, residual, g)
        for i in range(m):
            y[i] = min(max(y[i], lo[i]), hi[i])
        for i in range(n, m):
            y[i] *= ease
        advance(q, y[:n], lower, upper, scale)
        if cone[0] > 0.0:
            rho[0] += y[n] * ux - y[n + 1] * uy
            rho[1] += y[n] * uy + y[n + 1] * ux
            theta = math.sqrt(rho[0] * rho[0] + rho[1] * rho[1])
            if theta > _WITHIN * cone[0]:
                rho[0] *= _WITHIN * cone[0] / theta
                rho[1] *= _WITHIN * cone[0] / theta
        rho[2] += y[n + 2]
    return NOT_CONVERGED
