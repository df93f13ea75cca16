"""Self-motion: the arm moves, the tool stays, and the configuration draws near to another one.

Step 2 of the paper's strategy, by gradient projection with H = -(q - q_towards), which the paper does not write:

    min  1/2 |J d - e|^2 + 1/2 lambda^2 |d - H|^2      s.t.  joint limits;   then d shortened to 0.1 in scaled joints

With k = 1 this is the whole Gauss-Newton step to the nearest configuration of the same pose; where it overshoots and
the distance grows, the longest step allowed is halved. The pose error e is in
every step, or the tool would drift by centimetres; the limits are in the solve, for a step clipped afterwards loses
the pose. The flow stays in one connected piece of the pose's configurations and ends in a local minimum: it repairs
near misses.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from qparm.compiled.kernels import b1, c1, c2, c3, f8, i8, kernel, o1, oi
from qparm.ik import PoseSolver, StepCounts, StepSolver, active_set, step_problem
from qparm.ik.active_set_step import active_set_kernel
from qparm.ik.closed_form_step import M
from qparm.ik.iterate import ACTIVE_SET, FAILED, ITERATIONS, REACHED, advance, iterate_kernel
from qparm.ik.step import METHODS, form_bounds, form_task, trust_region

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.robot import SerialChain

__all__ = ["draw_near", "draw_near_kernel"]

# A step's largest entry: 0.1 rad, and a tenth of the characteristic length on a rail.
LARGEST_STEP = 0.1
# The motion is at rest when no joint moves further than this in a step (scaled joints).
AT_REST = 1e-4
MAX_STEPS = 100
# lambda^2 while moving: the last digits of the pose come at the end, and solvers find this one well.
LEAST_DAMPING = 1e-6
POLISH_ITERATIONS = 50
_DLS = METHODS["dls"]


@kernel(i8(c3, b1, c1, c1, c1, f8, c1, c2, c1, f8, f8, o1, o1, oi))
def draw_near_kernel(
    fixed, prismatic, lower, upper, scale, length, trust, target, towards, position_tolerance, rotation_tolerance,
    q, errors, counts,
):  # fmt: skip
    """Move ``q`` in place towards ``towards`` at a fixed pose; return 1, or 0 and ``q`` as it was if the pose is lost.

    ``errors`` and ``counts`` as in ``iterate_kernel``; the steps of the motion are counted with those that end it.
    """
    n = q.shape[0]
    pose, JT, e, z = np.empty((4, 4)), np.empty((n, M)), np.empty(M), np.empty(M)
    S, c, lb, ub, d = np.ones(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    unbounded = np.full(n, math.inf)
    before, largest, distance = q.copy(), LARGEST_STEP, math.inf
    for _ in range(MAX_STEPS):
        lam2 = max(form_task(fixed, prismatic, q, target, scale, length, pose, JT, e, errors), LEAST_DAMPING)
        form_bounds(q, lower, upper, scale, unbounded, lb, ub)
        square = 0.0
        for i in range(n):
            c[i] = (towards[i] - q[i]) / scale[i]
            square += c[i] * c[i]
            c[i] = min(max(c[i], lb[i]), ub[i])
        if square >= distance:
            largest *= 0.5
        distance = square
        counts[ITERATIONS] += 1
        counts[ACTIVE_SET if active_set_kernel(JT, S, c, e, lam2, lb, ub, d, z) > 0 else FAILED] += 1
        moved = 0.0
        for i in range(n):
            moved = max(moved, abs(d[i]))
        # shortened, not cut joint by joint: the direction is the gradient's, and the limits hold all the way
        share = largest / moved if moved > largest else 1.0
        for i in range(n):
            d[i] *= share
        advance(q, d, lower, upper, scale)
        if share * moved < AT_REST:
            break
    end = iterate_kernel(
        fixed, prismatic, lower, upper, scale, length, trust, target, _DLS, towards, 0.0,
        position_tolerance, rotation_tolerance, POLISH_ITERATIONS, q, errors, counts, np.empty((0, n)),
    )  # fmt: skip
    if end == REACHED:
        return 1
    for i in range(n):
        q[i] = before[i]
    form_task(fixed, prismatic, q, target, scale, length, pose, JT, e, errors)
    return 0


def draw_near(
    chain: SerialChain,
    target: NDArray[np.float64],
    q: NDArray[np.float64],
    towards: NDArray[np.float64],
    *,
    position_tolerance: float,
    rotation_tolerance: float,
    box: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None,
    solver: StepSolver | None = None,
) -> tuple[NDArray[np.float64], bool, StepCounts]:
    """Return the configuration nearest to another one that self-motion reaches.

    Parameters
    ----------
    chain : SerialChain
    target : (4, 4) ndarray
        The pose that is held, base frame.
    q : (n,) ndarray
        Where the motion starts; a configuration of that pose (m, rad).
    towards : (n,) ndarray
        What it draws near to (m, rad).
    position_tolerance, rotation_tolerance : float
        How exactly the pose is held at the end (m, rad).
    box : tuple of (n,) ndarray, optional
        Further limits, lower and upper, around the start (m, rad).
    solver : StepSolver, optional
        Gets every step; by default the compiled active set does.

    Returns
    -------
    q : (n,) ndarray
        Within the limits and at the pose; the start if the pose was lost on the way.
    held : bool
        Whether the pose was held.
    counts : StepCounts
        How the steps were answered.
    """
    lower, upper = chain.lower, chain.upper
    if box is not None:
        lower, upper = np.maximum(lower, box[0]), np.minimum(upper, box[1])
    if solver is not None:
        return _draw_near_by(
            solver, chain, target, q, towards, lower, upper,
            position_tolerance=position_tolerance, rotation_tolerance=rotation_tolerance,
        )  # fmt: skip
    q, errors, counts = np.array(q), np.empty(2), np.zeros(4, dtype=np.int64)
    held = draw_near_kernel(
        chain.fixed, chain.prismatic, lower, upper, chain.scale, chain.characteristic_length,
        trust_region(chain), target, towards, position_tolerance, rotation_tolerance, q, errors, counts,
    )  # fmt: skip
    closed, bounded, failed = counts[1:].tolist()
    return q, bool(held), StepCounts(closed_form=closed, active_set=bounded, failed=failed)


def _draw_near_by(
    solver: StepSolver,
    chain: SerialChain,
    target: NDArray[np.float64],
    q_start: NDArray[np.float64],
    towards: NDArray[np.float64],
    lower: NDArray[np.float64],
    upper: NDArray[np.float64],
    *,
    position_tolerance: float,
    rotation_tolerance: float,
) -> tuple[NDArray[np.float64], bool, StepCounts]:
    """Do what the kernel does, every step by a solver."""
    q, counts = np.array(q_start), StepCounts()
    largest, distance = LARGEST_STEP, math.inf
    for _ in range(MAX_STEPS):
        step = step_problem(chain, q, target, method="dls")
        lb, ub = (lower - q) / chain.scale, (upper - q) / chain.scale
        H = (towards - q) / chain.scale
        if float(H @ H) >= distance:
            largest *= 0.5
        distance = float(H @ H)
        step = replace(step, c=H, lam2=max(step.lam2, LEAST_DAMPING), lb=lb, ub=ub)
        answer = solver.solve(step)
        counts += StepCounts(solver=1) if answer.accepted else StepCounts(fallback=1)
        d = np.clip(answer.d if answer.accepted else active_set(step), lb, ub)
        d *= min(1.0, largest / max(float(np.abs(d).max()), math.ulp(0.0)))
        q = np.clip(q + chain.scale * d, lower, upper)
        if np.abs(d).max() < AT_REST:
            break
    polished = PoseSolver(
        chain,
        method="dls",
        solver=solver,
        position_tolerance=position_tolerance,
        rotation_tolerance=rotation_tolerance,
        max_iterations=POLISH_ITERATIONS,
    ).solve(target, q)
    counts += polished.counts
    held = polished.reached and bool(((polished.q >= lower) & (polished.q <= upper)).all())
    return (polished.q if held else np.array(q_start)), held, counts
