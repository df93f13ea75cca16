"""One differential-IK step in real time: towards a target within the velocity limits, or at rest.

The step is the bounded convex problem of :mod:`qparm.ik.step` with the velocity limits of the time step as
bounds, in closed form or by the active set, and then held to a rule that the linearisation alone cannot give:
the pose error falls. Where no share of the step lowers it, the step is zero and the status says so. The arm is
at rest when it has reached the pose, and when it has got as near as it can.
"""

from __future__ import annotations

import math
from enum import StrEnum
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from qparm.compiled.kernels import b1, c1, c2, c3, f8, i8, kernel, kernel_helper, o1, o2
from qparm.errors import InvalidInput
from qparm.ik.active_set_step import active_set, bounded_least_norm, write_step, y_bounds
from qparm.ik.closed_form_step import M, least_norm, weighted_task
from qparm.ik.iterate import advance, inside
from qparm.ik.solvers import StepSolver, make_solver
from qparm.ik.step import (
    METHODS,
    WLN,
    Method,
    StepProblem,
    finite_gain,
    form_bounds,
    form_step_kernel,
    form_task,
    form_weights,
    is_positive,
    reference_configuration,
    trust_region,
    wln_direction,
)
from qparm.robot import check_pose
from qparm.robot.chain import LARGEST
from qparm.robot.kernels import forward_and_axes, split_pose_error

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from qparm.robot import SerialChain

__all__ = ["DifferentialIK", "DifferentialStep", "StepStatus"]

# The squared error must fall by this share, by the step or by one of its halvings; less is no progress.
_LEAST_FALL = 1e-6
_HALVINGS = 10
# Errors below this (scaled) are rounding.
_ROUNDING = 1e-12
# How far a target's rotation may be from orthonormal, as in qparm.robot.check_pose.
_RIGID = 1e-6

MOVING, AT_REST, REACHED, RETURNING, NOT_USABLE = range(5)


class StepStatus(StrEnum):
    """What a differential step does."""

    MOVING = "moving"
    """The pose error falls."""
    AT_REST = "at rest"
    """No share of the step lowers the error: out of reach, held by limits, or singular. The step is zero."""
    REACHED = "reached"
    """The error is nothing but rounding. The step is zero."""
    RETURNING = "returning"
    """A joint is outside its range and comes back as fast as its velocity limit allows."""


_STATUS = (StepStatus.MOVING, StepStatus.AT_REST, StepStatus.REACHED, StepStatus.RETURNING)


class DifferentialStep(NamedTuple):
    """One step.

    Attributes
    ----------
    q : (n,) ndarray
        Configuration after the step (m, rad).
    velocity : (n,) ndarray
        Joint velocities that lead there in the time step (m/s, rad/s).
    status : StepStatus
    position_error, rotation_error : float
        Before the step (m, rad).
    """

    q: NDArray[np.float64]
    velocity: NDArray[np.float64]
    status: StepStatus
    position_error: float
    rotation_error: float


@kernel_helper
def usable(q, target):
    """Return whether the joints and the target are no larger than LARGEST, and the target a rigid transform."""
    for i in range(q.shape[0]):
        if not abs(q[i]) <= LARGEST:
            return False
    for i in range(3):
        if not abs(target[i, 3]) <= LARGEST or target[3, i] != 0.0:
            return False
        for j in range(i + 1):
            gram = -1.0 if i == j else 0.0
            for k in range(3):
                gram += target[k, i] * target[k, j]
            if not abs(gram) <= _RIGID:
                return False
    handed = 0.0
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        handed += target[0, i] * (target[1, j] * target[2, k] - target[1, k] * target[2, j])
    return target[3, 3] == 1.0 and handed > 0.0


@kernel_helper
def squared_error(fixed, prismatic, q, target, length, pose, JT, e):
    """Return the squared scaled pose error; ``pose``, ``JT`` and ``e`` are overwritten."""
    forward_and_axes(fixed, prismatic, q, pose, JT)
    split_pose_error(pose, target, e)
    p = (e[0] * e[0] + e[1] * e[1] + e[2] * e[2]) / (length * length)
    return p + e[3] * e[3] + e[4] * e[4] + e[5] * e[5]


@kernel_helper
def descend(fixed, prismatic, lower, upper, scale, length, target, before, q, d, q_next, pose, JT, e):
    """Write the first of d, d/2, d/4, ... that lowers the error into q_next and d; return whether one does."""
    n = q.shape[0]
    for _ in range(_HALVINGS):
        for i in range(n):
            q_next[i] = q[i]
        advance(q_next, d, lower, upper, scale)
        if squared_error(fixed, prismatic, q_next, target, length, pose, JT, e) <= before * (1.0 - _LEAST_FALL):
            return True
        for i in range(n):
            d[i] *= 0.5
    for i in range(n):
        q_next[i] = q[i]
    return False


@kernel(i8(c3, b1, c1, c1, c1, f8, c1, c1, c2, i8, c1, f8, o1, o1))
def differential_kernel(
    fixed, prismatic, lower, upper, scale, length, largest, q, target, method, reference, gain, q_next, errors
):
    """Write the configuration after one step and the errors before it; return the status code."""
    n = q.shape[0]
    if not usable(q, target):
        return NOT_USABLE
    pose, JT, BT, A, G = np.empty((4, 4)), np.empty((n, M)), np.empty((n, M)), np.empty((M, M)), np.empty((n, n))
    e, r, z, residual, g = np.empty(M), np.empty(M), np.empty(M), np.empty(M), np.empty(max(n, M))
    S, c, lb, ub, lo, hi = np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    y, y_new, d, towards = np.empty(n), np.empty(n), np.empty(n), np.zeros(n)
    lam2 = form_task(fixed, prismatic, q, target, scale, length, pose, JT, e, errors)
    before = (errors[0] / length) ** 2 + errors[1] ** 2
    within = inside(q, lower, upper)
    if before <= _ROUNDING * _ROUNDING and within:
        for i in range(n):
            q_next[i] = q[i]
        return REACHED
    form_bounds(q, lower, upper, scale, largest, lb, ub)
    if method == WLN:
        wln_direction(q, lower, upper, JT, e, lam2, BT, A, r, z, y, S, c, towards)
    form_weights(method, q, lower, upper, scale, reference, gain, towards, math.sqrt(before), lb, ub, S, c)
    weighted_task(JT, S, c, e, BT, r)
    bounded = least_norm(BT, r, lam2, A, z, y)
    if bounded:
        for i in range(n):
            d[i] = c[i] + S[i] * y[i]
            if d[i] < lb[i] or d[i] > ub[i]:
                bounded = False
    if not bounded:
        y_bounds(S, c, lb, ub, lo, hi)
        state = np.empty(n, dtype=np.int64)
        bounded_least_norm(BT, r, lam2, lo, hi, y, z, state, A, G, y_new, residual, g)
        write_step(S, c, y, state, lb, ub, d)
    if not within:
        for i in range(n):
            q_next[i] = q[i]
        advance(q_next, d, lower, upper, scale)
        return RETURNING
    if descend(fixed, prismatic, lower, upper, scale, length, target, before, q, d, q_next, pose, JT, e):
        return MOVING
    return AT_REST


@kernel(f8(c3, b1, c2, f8, c1, c2, i8, f8, o2, o2, o1, o2, o1))
def form_kernel(fixed, prismatic, joints, length, q, target, method, gain, pose, JT, e, rows, errors):
    """Write the step problem for a solver; return lambda^2, negative if q or target is not usable.

    Rows of ``joints``: lower, upper, scale, largest, reference. Rows of ``rows``: S, c, lb, ub, towards.
    """
    if not usable(q, target):
        return -1.0
    rows[4, 0] = -1.0
    return form_step_kernel(
        fixed, prismatic, q, target, joints[0], joints[1], joints[2], length, joints[3], method, joints[4], gain,
        rows[4], pose, JT, e, rows[0], rows[1], rows[2], rows[3], errors,
    )  # fmt: skip


@kernel(i8(c3, b1, c2, f8, f8, c2, c1, c2, c1, o1, o1, o1))
def descend_kernel(fixed, prismatic, joints, length, time_step, target, q, rows, errors, d, q_next, velocity):
    """Write the share of a solver's step, cut to its bounds, that lowers the error; return the status code."""
    n = q.shape[0]
    lower, upper, scale = joints[0], joints[1], joints[2]
    for i in range(n):
        d[i] = min(max(d[i], rows[2, i]), rows[3, i])
        q_next[i] = q[i]
    before = (errors[0] / length) ** 2 + errors[1] ** 2
    if not inside(q, lower, upper):
        advance(q_next, d, lower, upper, scale)
        code = RETURNING
    elif before <= _ROUNDING * _ROUNDING:
        code = REACHED
    else:
        pose, JT, e = np.empty((4, 4)), np.empty((n, M)), np.empty(M)
        found = descend(fixed, prismatic, lower, upper, scale, length, target, before, q, d, q_next, pose, JT, e)
        code = MOVING if found else AT_REST
    for i in range(n):
        velocity[i] = (q_next[i] - q[i]) / time_step
    return code


class DifferentialIK:
    """Steps of one arm towards targets, each within the velocity limits of one time step.

    With ``solver="auto"`` one object serves any number of threads; a solver's workspace serves one.

    Parameters
    ----------
    chain : SerialChain
    time_step : float
        Seconds a step stands for.
    method : {"dls", "wln", "cwln", "gpm"}
    solver : str
        ``"auto"``: closed form, else the compiled active set. Any other name sends every step to that solver.
    reference, gain
        For ``method="gpm"``, see :func:`qparm.ik.step_problem`.

    Attributes
    ----------
    solved, fallbacks : int
        Steps that the solver answered, and those whose answer failed the KKT check.

    Examples
    --------
    >>> import qparm
    >>> chain = qparm.Cell.load("examples/dome.toml").chain()  # doctest: +SKIP
    >>> ik = qparm.ik.DifferentialIK(chain, time_step=0.01)  # doctest: +SKIP
    >>> q, velocity, status, *errors = ik.step(q, target)  # doctest: +SKIP
    """

    def __init__(
        self,
        chain: SerialChain,
        *,
        time_step: float,
        method: Method = "dls",
        solver: str = "auto",
        reference: ArrayLike | None = None,
        gain: float = 0.1,
    ) -> None:
        if not (isinstance(method, str) and method in METHODS):
            raise InvalidInput(f"method must be one of {', '.join(METHODS)}, not {method!r}")
        if not is_positive(time_step):
            raise InvalidInput(f"time_step must be finite and positive, not {time_step}")
        self.chain = chain
        self.time_step = time_step
        self.solved = self.fallbacks = 0
        self._solver: StepSolver | None = None if solver == "auto" else make_solver(solver, chain.n)
        self._largest = trust_region(chain, time_step)
        self._reference = reference_configuration(chain, reference)
        # what the kernel takes before and after the configuration and the target
        self._before = (
            chain.fixed,
            chain.prismatic,
            chain.lower,
            chain.upper,
            chain.scale,
            chain.characteristic_length,
        )
        self._method, self._gain = METHODS[method], finite_gain(gain)
        self._n = n = chain.n
        # what a step for a solver is formed from and in
        self._joints = np.array([chain.lower, chain.upper, chain.scale, self._largest, self._reference])
        self._JT, self._pose, self._e, self._rows = np.empty((n, M)), np.empty((4, 4)), np.empty(M), np.empty((5, n))
        self._S_c_lb_ub = tuple(self._rows[:4])

    def step(self, q: NDArray[np.float64], target: NDArray[np.float64]) -> DifferentialStep:
        """Return one step from ``q`` towards a target pose.

        Parameters
        ----------
        q : (n,) ndarray
            Where the arm is (m, rad); outside its limits too.
        target : (4, 4) ndarray
            A rigid transform: where the tool shall be, base frame.

        Returns
        -------
        DifferentialStep

        Raises
        ------
        InvalidInput
            If a shape does not fit, a value is not finite or beyond 1e100, or the target is no rigid transform.
        """
        n = self._n
        q = np.ascontiguousarray(q, dtype=np.float64)
        target = np.ascontiguousarray(target, dtype=np.float64)
        if q.shape != (n,) or target.shape != (4, 4):
            raise InvalidInput(f"q must be ({n},) and target (4, 4), not {q.shape} and {target.shape}")
        q_next, velocity, errors = np.empty(n), np.empty(n), np.empty(2)
        if self._solver is None:
            code = differential_kernel(
                *self._before, self._largest, q, target, self._method, self._reference, self._gain, q_next, errors
            )
            if code == NOT_USABLE:
                self._refuse(q, target)
            np.subtract(q_next, q, out=velocity)
            velocity /= self.time_step
        else:
            code = self._step_by_solver(self._solver, q, target, q_next, velocity, errors)
        return DifferentialStep(q_next, velocity, _STATUS[code], float(errors[0]), float(errors[1]))

    def _refuse(self, q: NDArray[np.float64], target: NDArray[np.float64]) -> None:
        self.chain.check_configuration(q)
        check_pose(target, what="target")
        raise InvalidInput("target is not a rigid transform")

    def _step_by_solver(
        self,
        solver: StepSolver,
        q: NDArray[np.float64],
        target: NDArray[np.float64],
        q_next: NDArray[np.float64],
        velocity: NDArray[np.float64],
        errors: NDArray[np.float64],
    ) -> int:
        chain, joints, JT, e, rows = self.chain, self._joints, self._JT, self._e, self._rows
        length = chain.characteristic_length
        lam2 = form_kernel(
            chain.fixed, chain.prismatic, joints, length, q, target, self._method, self._gain,
            self._pose, JT, e, rows, errors,
        )  # fmt: skip
        if lam2 < 0.0:
            self._refuse(q, target)
        S, c, lb, ub = self._S_c_lb_ub
        step = StepProblem.formed(JT, e, S, c, lam2, lb, ub)
        answer = solver.solve(step)
        if answer.accepted:
            self.solved += 1
            d = answer.d
        else:
            self.fallbacks += 1
            d = active_set(step)
        return descend_kernel(
            chain.fixed, chain.prismatic, joints, length, self.time_step, target, q, rows, errors, d, q_next, velocity
        )
