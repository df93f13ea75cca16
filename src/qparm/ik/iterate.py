"""The iteration of eq. 5, compiled: step, bound, advance, until the pose is reached or nothing improves."""

from __future__ import annotations

import math

import numpy as np

from qparm.compiled.kernels import b1, c1, c2, c3, f8, i8, kernel, kernel_helper, o1, o2, oi, void
from qparm.ik.active_set_step import bounded_least_norm, write_step, y_bounds
from qparm.ik.closed_form_step import M, least_norm, weighted_task
from qparm.ik.step import WLN, form_bounds, form_task, form_weights, wln_direction

__all__ = ["NOT_CONVERGED", "REACHED", "STALLED", "iterate_kernel"]

REACHED, STALLED, NOT_CONVERGED = 0, 1, 2

# The error must fall by one part in a hundred within this many iterations, or the iteration is at rest.
STALL_WINDOW = 20
STALL_FACTOR = 0.99

# positions in the array of counts
ITERATIONS, CLOSED_FORM, ACTIVE_SET, FAILED = range(4)


@kernel_helper
def inside(q, lower, upper):
    """Return whether every joint is within its position limits."""
    within = True
    for i in range(q.shape[0]):
        within = within and lower[i] <= q[i] <= upper[i]
    return within


@kernel_helper
def advance(q, d, lower, upper, scale):
    """Move q by the scaled step d; a joint that was inside its range stays inside to the last bit."""
    for i in range(q.shape[0]):
        moved = q[i] + scale[i] * d[i]
        if q[i] <= upper[i]:
            moved = min(moved, upper[i])
        if q[i] >= lower[i]:
            moved = max(moved, lower[i])
        q[i] = moved


@kernel_helper
def improved(e_norm, best, since):
    """Return the best error so far and the iterations since it last fell by a hundredth."""
    if e_norm < STALL_FACTOR * best:
        return e_norm, 0
    return best, since + 1


@kernel(void(o1, c1, c1, c1, c1))
def advance_kernel(q, d, lower, upper, scale):
    """Compiled :func:`advance`."""
    advance(q, d, lower, upper, scale)


@kernel(i8(c3, b1, c1, c1, c1, f8, c1, c2, i8, c1, f8, f8, f8, i8, o1, o1, oi, o2))
def iterate_kernel(
    fixed, prismatic, lower, upper, scale, length, largest, target, method, reference, gain,
    position_tolerance, rotation_tolerance, max_iterations, q, errors, counts, trace,
):  # fmt: skip
    """Iterate ``q`` in place towards ``target``; return REACHED, STALLED or NOT_CONVERGED.

    ``errors`` receives the last position and rotation error (m, rad), ``counts`` is added to, and
    ``trace`` (rows, n) receives the first configurations at which a step was formed.
    """
    n = q.shape[0]
    pose, JT, BT, A, G = (
        np.empty((4, 4)),
        np.empty((n, M)),
        np.empty((n, M)),
        np.empty((M, M)),
        np.empty((n, n)),
    )
    e, r, z, residual, g = np.empty(M), np.empty(M), np.empty(M), np.empty(M), np.empty(max(n, M))
    S, c, lb, ub, lo, hi = np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    y, y_new, d, towards = np.empty(n), np.empty(n), np.empty(n), np.zeros(n)
    state = np.empty(n, dtype=np.int64)
    best, since = math.inf, 0
    for iteration in range(max_iterations + 1):
        lam2 = form_task(fixed, prismatic, q, target, scale, length, pose, JT, e, errors)
        within = inside(q, lower, upper)
        if errors[0] <= position_tolerance and errors[1] <= rotation_tolerance and within:
            return REACHED
        e_norm = math.sqrt((errors[0] / length) ** 2 + errors[1] ** 2)
        best, since = improved(e_norm, best, since)
        if since >= STALL_WINDOW and within:
            return STALLED
        if iteration == max_iterations:
            return NOT_CONVERGED
        if iteration < trace.shape[0]:
            for i in range(n):
                trace[iteration, i] = q[i]
        form_bounds(q, lower, upper, scale, largest, lb, ub)
        if method == WLN and iteration == 0:
            wln_direction(q, lower, upper, JT, e, lam2, BT, A, r, z, y, S, c, towards)
        form_weights(method, q, lower, upper, scale, reference, gain, towards, e_norm, lb, ub, S, c)
        weighted_task(JT, S, c, e, BT, r)
        counts[ITERATIONS] += 1
        solved = least_norm(BT, r, lam2, A, z, y)
        bounded = solved
        if solved:
            for i in range(n):
                d[i] = c[i] + S[i] * y[i]
                if d[i] < lb[i] or d[i] > ub[i]:
                    bounded = False
        if bounded:
            counts[CLOSED_FORM] += 1
        else:
            y_bounds(S, c, lb, ub, lo, hi)
            if not solved:
                y[:] = 0.0
            if bounded_least_norm(BT, r, lam2, lo, hi, y, z, state, A, G, y_new, residual, g) > 0:
                counts[ACTIVE_SET] += 1
            else:
                counts[FAILED] += 1
            write_step(S, c, y, state, lb, ub, d)
        advance(q, d, lower, upper, scale)
    return NOT_CONVERGED
