"""Compiled projection of configurations onto poses: from each start, the nearest configuration of a pose.

"Nearest" is in joints scaled by their velocity limits (a rail of 200 mm/s against 60 deg/s: 33 mm count as
10 deg), within the position limits: each iteration is the bounded least-norm step of :mod:`qparm.ik`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from qparm.compiled.kernels import b1, c1, c3, f8, i8, kernel, kernel_helper, o3, oi, void
from qparm.compiled.threads import in_threads
from qparm.ik.active_set_step import bounded_least_norm
from qparm.ik.closed_form_step import M, least_norm
from qparm.ik.iterate import advance, inside
from qparm.ik.relaxed import turned
from qparm.ik.step import form_bounds, form_task
from qparm.planning.tolerances import STEP_TRUST

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.robot import SerialChain

__all__ = ["move_onto", "project", "search_scale", "turn_of", "unwound_turns", "velocity_scale"]

# However slow a joint is, a radian (a prismatic joint: the characteristic length) counts for no more than its inverse.
_LEAST_SHARE = 0.3
# Starts a thread takes at a time.
_CHUNK = 32


@kernel_helper
def move_onto(
    fixed, prismatic, lower, upper, scale, length, largest, target, position_tolerance, rotation_tolerance, iterations,
    q, pose, JT, A, G, e, z, y, lo, hi, y_new, residual, g, state, errors,
):  # fmt: skip
    """Move q onto a pose by bounded least-norm steps; return whether it got there."""
    n = q.shape[0]
    for iteration in range(iterations + 1):
        lam2 = form_task(fixed, prismatic, q, target, scale, length, pose, JT, e, errors)
        if errors[0] <= position_tolerance and errors[1] <= rotation_tolerance and inside(q, lower, upper):
            return True
        if iteration == iterations:
            return False
        form_bounds(q, lower, upper, scale, largest, lo, hi)
        bounded = least_norm(JT, e, lam2, A, z, y)
        if bounded:
            for i in range(n):
                if y[i] < lo[i] or y[i] > hi[i]:
                    bounded = False
        else:
            y[:] = 0.0
        if not bounded:
            bounded_least_norm(JT, e, lam2, lo, hi, y, z, state, A, G, y_new, residual, g)
        for i in range(n):
            y[i] = min(max(y[i], lo[i]), hi[i])
        advance(q, y, lower, upper, scale)
    return False


@kernel(void(c3, b1, c1, c1, c1, f8, c1, c3, c3, f8, f8, i8, i8, i8, o3, oi))
def project_kernel(
    fixed, prismatic, lower, upper, scale, length, largest, targets, offsets, position_tolerance, rotation_tolerance,
    iterations, first, last, Q, reached,
):  # fmt: skip
    """Move Q[k, m] (K, M, n) onto targets[k] turned by offsets[k * M + m], for poses ``first`` to ``last``."""
    n, many = Q.shape[2], Q.shape[1]
    target = np.empty((3, 4))
    pose, JT, A, G = np.empty((4, 4)), np.empty((n, M)), np.empty((M, M)), np.empty((n, n))
    e, z, residual, g, errors = np.empty(M), np.empty(M), np.empty(M), np.empty(max(n, M)), np.empty(2)
    y, lo, hi, y_new = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    state = np.empty(n, dtype=np.int64)
    for k in range(first, last):
        for m in range(many):
            turned(targets[k], offsets[k * many + m], target)
            reached[k * many + m] = move_onto(
                fixed, prismatic, lower, upper, scale, length, largest, target, position_tolerance, rotation_tolerance,
                iterations, Q[k, m], pose, JT, A, G, e, z, y, lo, hi, y_new, residual, g, state, errors,
            )  # fmt: skip


def velocity_scale(chain: SerialChain) -> NDArray[np.float64]:
    """Return joint steps that take equal time at the velocity limits, (n,): 1 rad for the fastest revolute joint."""
    revolute = ~chain.prismatic
    unit = chain.velocity[revolute].max() if revolute.any() else chain.velocity.max()
    return chain.velocity / unit


def search_scale(chain: SerialChain) -> NDArray[np.float64]:
    """Return joint steps that count alike where solutions are told apart, (n,): of equal time, within bounds.

    A joint that is much slower than the fastest would count for nearly all otherwise: whether a step is a motion is no
    matter of time.
    """
    far = np.where(chain.prismatic, chain.characteristic_length, 1.0)
    return np.maximum(velocity_scale(chain), _LEAST_SHARE * far)


def project(
    chain: SerialChain,
    targets: NDArray[np.float64],
    q: NDArray[np.float64],
    *,
    position_tolerance: float,
    rotation_tolerance: float,
    offsets: NDArray[np.float64] | None = None,
    iterations: int = 10,
    threads: int | None = None,
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return configurations moved onto poses, and which of them arrived.

    Parameters
    ----------
    chain : SerialChain
    targets : (N, 4, 4) ndarray
        Base frame.
    q : (N, n) or (N, M, n) ndarray
        One start for each pose, or M.
    position_tolerance, rotation_tolerance : float
        m, rad.
    offsets : (N * M, 3, 3) ndarray, optional
        Rotations of the tool against its target, one for each start.
    iterations : int
        At most.
    threads : int, optional
        All cores by default; the answer does not depend on it.

    Returns
    -------
    q : ndarray
        Of the same shape, within the limits.
    reached : (N,) or (N, M) ndarray of bool
    """
    Q = np.array(q if q.ndim == 3 else q[:, None], dtype=float, order="C")
    N, K, n = Q.shape
    reached = np.zeros(N * K, dtype=np.int64)
    offsets = np.broadcast_to(np.eye(3), (N * K, 3, 3)).copy() if offsets is None else np.ascontiguousarray(offsets)
    largest, scale = np.full(n, STEP_TRUST), velocity_scale(chain)
    targets = np.ascontiguousarray(targets)

    def solve(first: int, last: int) -> None:
        project_kernel(
            chain.fixed, chain.prismatic, chain.lower, chain.upper, scale, chain.characteristic_length, largest,
            targets, offsets, position_tolerance, rotation_tolerance, iterations, first, last, Q, reached,
        )  # fmt: skip

    in_threads(solve, N, max(1, _CHUNK // K), threads)
    arrived = reached.reshape(N, K).astype(bool)
    return (Q, arrived) if q.ndim == 3 else (Q[:, 0], arrived[:, 0])


def turn_of(chain: SerialChain) -> NDArray[np.float64]:
    """Return after what angle a joint is in the same place again, (n,): 2 pi for continuous joints, inf for others."""
    return np.where(chain.continuous, 2 * np.pi, np.inf)


def unwound_turns(chain: SerialChain, q: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a path (N, n) whose continuous joints do not leap by full turns, as near to zero as that allows."""
    if not chain.continuous.any() or not len(q):
        return q
    out = q.copy()
    joints = np.flatnonzero(chain.continuous)
    out[:, joints] = np.unwrap(out[:, joints], axis=0)
    middle = 0.5 * (out[:, joints].min(axis=0) + out[:, joints].max(axis=0))
    out[:, joints] -= 2 * np.pi * np.round(middle / (2 * np.pi))
    return out
