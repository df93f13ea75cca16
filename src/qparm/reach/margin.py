"""Attainable margin from singularity at a pose: the best configuration of the pose's self-motion set.

    max over q of sigma_min(J(q))      s.t.  the tool at the pose, q within the limits

with J the scaled Jacobian (positions over the characteristic length, prismatic joints times it). A planner's path takes
one configuration of each pose; this is what the *arm* offers there, whatever the planner.

sigma_min is not smooth where two singular values meet, and there its maxima like to lie. So what is climbed is

    f = (sum_i sigma_i^-2p)^(-1/2p),      f <= sigma_min <= 6^(1/2p) f

with p = 32 (6^(1/64) = 1.03), its gradient exact: d sigma_i = u_i' dJ w_i. Each step is the bounded convex problem of
:mod:`qparm.ik` with c along the gradient and the step before: the tool stays, the limits hold, what is left of c is
self-motion. Maxima are local, so several starts per pose are climbed from, and then the best of the neighbouring poses,
in rounds, as long as that pays. The largest found is a lower bound on the true one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from qparm.compiled.kernels import b1, c1, c2, c3, f8, i8, kernel, kernel_helper, o1, o2, void
from qparm.compiled.threads import in_threads
from qparm.errors import InvalidInput
from qparm.ik.active_set_step import active_set_kernel
from qparm.ik.closed_form_step import M
from qparm.ik.iterate import REACHED, advance, iterate_kernel
from qparm.ik.step import METHODS, form_bounds, form_task, is_positive, trust_region
from qparm.reach.starts import nearest_poses, nearest_starts
from qparm.robot import check_poses
from qparm.robot.kernels import forward_and_jacobian
from qparm.robot.reach import reach_excess

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from qparm.robot import SerialChain

__all__ = ["AttainableMargin", "attainable_margin"]

_DLS = METHODS["dls"]
# Largest entry along the gradient in scaled joints: at first, at most, and where a climb ends. The part of it that
# self-motion can follow may be small; that part is held to the largest step.
_FIRST_STEP, _LONGEST, _LEAST_STEP = 0.1, 10.0, 2e-3
_LARGEST_STEP = 0.4
_AT_REST = 1e-5
_MOMENTUM = 0.7
_STEPS = 60
_POWER = 32.0  # p
# Three gains in a row below this share end a climb.
_NO_GAIN = 1e-4
# How exactly the pose is held on the way (scaled), and the steps back onto it.
_ON_POSE, _BACK_ONTO_POSE = 1e-4, 5
_DAMPING = 1e-6
_SWEEPS = 12
# A neighbour's configuration is climbed from where it is better than the pose's own by this factor.
_WORTH = 1.01
_ROUNDS = 30
# Starts for each climb that is wanted: not every one reaches its pose.
_STARTS_A_CLIMB = 4
_CHUNK = 8


@dataclass(frozen=True, eq=False)
class AttainableMargin:
    """The largest sigma_min found at each of P poses.

    Attributes
    ----------
    margin : (P,) ndarray
        Smallest singular value of the scaled Jacobian; NaN where the pose was not reached.
    q : (P, n) ndarray
        The configuration that has it, at the pose and within the limits; NaN where there is none.
    """

    margin: NDArray[np.float64]
    q: NDArray[np.float64]


@kernel_helper
def symmetric_eigen(A, V):
    """Diagonalise a symmetric (6, 6) matrix in place by Jacobi rotations; the columns of V are its eigenvectors."""
    for a in range(M):
        for b in range(M):
            V[a, b] = 1.0 if a == b else 0.0
    for _ in range(_SWEEPS):
        off, diagonal = 0.0, 0.0
        for a in range(M):
            diagonal += A[a, a] * A[a, a]
            for b in range(a):
                off += A[a, b] * A[a, b]
        if off <= 1e-28 * diagonal:
            break
        for a in range(M - 1):
            for b in range(a + 1, M):
                if A[a, b] == 0.0:
                    continue
                t = (A[b, b] - A[a, a]) / (2.0 * A[a, b])
                t = (1.0 if t >= 0.0 else -1.0) / (abs(t) + math.sqrt(1.0 + t * t))
                c = 1.0 / math.sqrt(1.0 + t * t)
                s = t * c
                for k in range(M):
                    x, y = A[a, k], A[b, k]
                    A[a, k], A[b, k] = c * x - s * y, s * x + c * y
                for k in range(M):
                    x, y = A[k, a], A[k, b]
                    A[k, a], A[k, b] = c * x - s * y, s * x + c * y
                    x, y = V[k, a], V[k, b]
                    V[k, a], V[k, b] = c * x - s * y, s * x + c * y


@kernel_helper
def soft_margin(JT, power, A, V, sigma):
    """Write singular values and left vectors of the scaled Jacobian; return (f, sigma_min)."""
    n = JT.shape[0]
    for a in range(M):
        for b in range(a + 1):
            t = 0.0
            for i in range(n):
                t += JT[i, a] * JT[i, b]
            A[a, b] = A[b, a] = t
    symmetric_eigen(A, V)
    least = math.inf
    for a in range(M):
        sigma[a] = math.sqrt(max(A[a, a], 1e-30))
        least = min(least, sigma[a])
    total = 0.0
    for a in range(M):
        total += (least / sigma[a]) ** (2 * power)
    return least * total ** (-0.5 / power), least


@kernel_helper
def ascent(JT, raw, scale, length, power, f, V, sigma, G, g):
    """Write the gradient of f in scaled joints; ``raw`` is the Jacobian without scales."""
    n = JT.shape[0]
    # G[j] = sum_i (f / sigma_i)^(2p+1) u_i w_ij, with w_i = J' u_i / sigma_i: then df = sum_j G[j] . dJ_j
    for j in range(n):
        for k in range(M):
            G[j, k] = 0.0
        for i in range(M):
            w = 0.0
            for k in range(M):
                w += JT[j, k] * V[k, i]
            w *= (f / sigma[i]) ** (2 * power + 1) / sigma[i]
            for k in range(M):
                G[j, k] += w * V[k, i]
    for k in range(n):
        total = 0.0
        vx, vy, vz, wx, wy, wz = raw[k, 0], raw[k, 1], raw[k, 2], raw[k, 3], raw[k, 4], raw[k, 5]
        for j in range(n):
            if k < j:  # the joint turns the axis and the lever behind it
                a, b, c = raw[j, 0], raw[j, 1], raw[j, 2]
                linear = G[j, 0] * (wy * c - wz * b) + G[j, 1] * (wz * a - wx * c) + G[j, 2] * (wx * b - wy * a)
                a, b, c = raw[j, 3], raw[j, 4], raw[j, 5]
                angular = G[j, 3] * (wy * c - wz * b) + G[j, 4] * (wz * a - wx * c) + G[j, 5] * (wx * b - wy * a)
            else:  # the joint moves the tool against the axis
                a, b, c = raw[j, 3], raw[j, 4], raw[j, 5]
                linear = G[j, 0] * (b * vz - c * vy) + G[j, 1] * (c * vx - a * vz) + G[j, 2] * (a * vy - b * vx)
                angular = 0.0
            total += scale[j] * (linear / length + angular)
        g[k] = total * scale[k]


@kernel(f8(c3, b1, c1, c1, c1, f8, c1, c2, f8, f8, o1))
def climb_kernel(
    fixed, prismatic, lower, upper, scale, length, trust, target, position_tolerance, rotation_tolerance, q
):
    """Move ``q`` from a configuration of the pose to a better one; return its sigma_min, -1 if the pose is lost."""
    n = q.shape[0]
    pose, JT, raw, e, z = np.empty((4, 4)), np.empty((n, M)), np.empty((n, M)), np.empty(M), np.empty(M)
    S, c, lb, ub, d = np.ones(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    A, V, sigma, G, g = np.empty((M, M)), np.empty((M, M)), np.empty(M), np.empty((n, M)), np.empty(n)
    unbounded, trial, errors = np.full(n, math.inf), q.copy(), np.empty(2)
    last, counts, trace = np.zeros(n), np.zeros(4, dtype=np.int64), np.empty((0, n))
    step, share, value, dull = _FIRST_STEP, 1.0, -1.0, 0
    for attempt in range(_STEPS):
        # a step along the tangent leaves the pose by its square: what is compared is the margin at the pose
        end = iterate_kernel(
            fixed, prismatic, lower, upper, scale, length, trust, target, _DLS, trial, 0.0,
            _ON_POSE * length, _ON_POSE, _BACK_ONTO_POSE, trial, errors, counts, trace,
        )  # fmt: skip
        f = -1.0
        if end == REACHED or attempt == 0:
            form_task(fixed, prismatic, trial, target, scale, length, pose, JT, e, errors)
            f, _ = soft_margin(JT, _POWER, A, V, sigma)
        if f > value:
            dull = dull + 1 if f < value * (1.0 + _NO_GAIN) else 0
            if dull == 3:
                break
            value = f
            for i in range(n):
                last[i] = 0.0 if attempt == 0 else (trial[i] - q[i]) / scale[i]
                q[i] = trial[i]
            forward_and_jacobian(fixed, prismatic, q, pose, raw)
            ascent(JT, raw, scale, length, _POWER, f, V, sigma, G, g)
            largest = 0.0
            for i in range(n):
                largest = max(largest, abs(g[i]))
            for i in range(n):
                g[i] /= max(largest, 1e-12)
            step = min(2.0 * step, _LONGEST)
        else:
            step *= 0.3 * share
            last[:] = 0.0
            if step < _LEAST_STEP:
                break
        form_task(fixed, prismatic, q, target, scale, length, pose, JT, e, errors)
        form_bounds(q, lower, upper, scale, unbounded, lb, ub)
        for i in range(n):
            c[i] = min(max(step * g[i] + _MOMENTUM * last[i], lb[i]), ub[i])
        active_set_kernel(JT, S, c, e, _DAMPING, lb, ub, d, z)
        moved = 0.0
        for i in range(n):
            moved = max(moved, abs(d[i]))
        if moved < _AT_REST:
            break
        share = _LARGEST_STEP / moved if moved > _LARGEST_STEP else 1.0
        for i in range(n):
            trial[i] = q[i]
            d[i] *= share
        advance(trial, d, lower, upper, scale)
    end = iterate_kernel(
        fixed, prismatic, lower, upper, scale, length, trust, target, _DLS, q, 0.0,
        position_tolerance, rotation_tolerance, 30, q, errors, counts, trace,
    )  # fmt: skip
    if end != REACHED:
        return -1.0
    form_task(fixed, prismatic, q, target, scale, length, pose, JT, e, errors)
    _, least = soft_margin(JT, _POWER, A, V, sigma)
    return least


@kernel(void(c3, b1, c1, c1, c1, f8, c1, c3, c3, i8, f8, f8, i8, i8, o1, o2))
def margin_kernel(
    fixed, prismatic, lower, upper, scale, length, trust, targets, starts, climbs, position_tolerance,
    rotation_tolerance, first, last, margin, Q,
):  # fmt: skip
    """Climb from up to ``climbs`` of a pose's starts that reach it; keep what is better than ``margin``, ``Q``."""
    n = Q.shape[1]
    q, errors, counts, trace = np.empty(n), np.empty(2), np.zeros(4, dtype=np.int64), np.empty((0, n))
    for k in range(first, last):
        climbed = 0
        for s in range(starts.shape[1]):
            for i in range(n):
                q[i] = starts[k, s, i]
            end = iterate_kernel(
                fixed, prismatic, lower, upper, scale, length, trust, targets[k], _DLS, q, 0.0,
                position_tolerance, rotation_tolerance, 100, q, errors, counts, trace,
            )  # fmt: skip
            if end != REACHED:
                continue
            found = climb_kernel(
                fixed, prismatic, lower, upper, scale, length, trust, targets[k], position_tolerance,
                rotation_tolerance, q,
            )  # fmt: skip
            if found > margin[k]:
                margin[k] = found
                for i in range(n):
                    Q[k, i] = q[i]
            climbed += 1
            if climbed == climbs:
                break


def attainable_margin(
    chain: SerialChain,
    poses: ArrayLike,
    *,
    starts: ArrayLike | None = None,
    climbs: int = 6,
    seed: int = 0,
    position_tolerance: float = 1e-6,
    rotation_tolerance: float = 1e-5,
    threads: int | None = None,
) -> AttainableMargin:
    """Return how far from singular an arm can be at each pose: the largest sigma_min found on its self-motion set.

    Parameters
    ----------
    chain : SerialChain
    poses : (P, 4, 4) array_like
        Poses of the tool in the base frame.
    starts : (P, K, n) array_like, optional
        Where the climbs of each pose start, best first, for those who have sampled its solutions already
        (m, rad); by default random configurations near it.
    climbs : int
        Configurations of each pose that are climbed from, before those of its neighbours.
    seed : int
        Of the random configurations that the starts are taken from.
    position_tolerance, rotation_tolerance : float
        How exactly the pose is held (m, rad).
    threads : int, optional
        All cores by default; the answer does not depend on it.

    Returns
    -------
    AttainableMargin

    Raises
    ------
    InvalidInput
        If a shape does not fit or a value is not finite.
    """
    poses = check_poses(poses)
    if poses.ndim != 3:
        raise InvalidInput(f"poses must be (P, 4, 4), not {poses.shape}")
    for name, value in (("position_tolerance", position_tolerance), ("rotation_tolerance", rotation_tolerance)):
        if not is_positive(value):
            raise InvalidInput(f"{name} must be finite and positive, not {value}")
    workers = 1 if threads is None else threads
    for name, value, least in (("climbs", climbs, 1), ("seed", seed, 0), ("threads", workers, 1)):
        if not isinstance(value, (int, np.integer)) or value < least:
            raise InvalidInput(f"{name} must be a whole number from {least}, not {value!r}")
    P, n = len(poses), chain.n
    given = None if starts is None else np.ascontiguousarray(starts, dtype=float)
    if given is not None and (given.ndim != 3 or given.shape[0] != P or given.shape[2] != n):
        raise InvalidInput(f"starts must be ({P}, K, {n}), not {given.shape}")
    if given is not None and not np.isfinite(given).all():
        k = int(np.argwhere(~np.isfinite(given))[0, 0])
        raise InvalidInput(f"starts of pose {k} are not finite")
    margin, Q = np.full(P, -1.0), np.full((P, n), np.nan)
    too_far, too_near = reach_excess(chain, poses)
    possible = (too_far <= 0) & (too_near <= 0)

    def climb(which: NDArray[np.intp], starts: NDArray[np.float64], climbs: int) -> None:
        targets, best, q = poses[which], margin[which], Q[which]

        def solve(first: int, last: int) -> None:
            margin_kernel(
                chain.fixed, chain.prismatic, chain.lower, chain.upper, chain.scale, chain.characteristic_length,
                trust_region(chain), targets, starts, climbs, position_tolerance, rotation_tolerance, first, last,
                best, q,
            )  # fmt: skip

        in_threads(solve, len(which), _CHUNK, threads)
        margin[which], Q[which] = best, q

    which = np.flatnonzero(possible)
    if given is None:
        climb(which, nearest_starts(chain, poses[which], _STARTS_A_CLIMB * climbs, seed=seed), climbs)
    else:
        climb(which, np.ascontiguousarray(given[which]), climbs)
    neighbours = nearest_poses(poses, chain.characteristic_length)
    tried = np.full(P, -1.0)
    for _ in range(_ROUNDS if neighbours.shape[1] else 0):
        best = neighbours[np.arange(P), margin[neighbours].argmax(axis=1)]
        # a start is worth a climb once: a neighbour's that has not improved since leads to the same end
        which = np.flatnonzero(possible & (margin[best] > _WORTH * np.maximum(margin, tried)))
        if not len(which):
            break
        tried[which] = margin[best[which]]
        climb(which, np.ascontiguousarray(Q[best[which]][:, None]), 1)
    reached = margin >= 0
    return AttainableMargin(margin=np.where(reached, margin, np.nan), q=Q)
