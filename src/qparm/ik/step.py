"""One IK step as one convex problem, and how each method fills it in.

    min  1/2 |J d - e|^2  +  1/2 lambda^2 (d - c)^T R (d - c)      s.t.  lb <= d <= ub

    method   R            c                     seed
    dls      I            0
    wln      W            0                     eq. 3, Chan-Dubey weights
    cwln     W~^-1        -(I - W~) phi         eqs. 4, 5
    gpm      I            H                     eq. 2, here H = -k (q - q_reference)

W~^-1 is never formed: with S = R^(-1/2), d = c + S y and min 1/2 |J S y - (e - J c)|^2 + 1/2 lambda^2 |y|^2.
Everything is in scaled joints (prismatic joints over the characteristic length) and scaled errors
(positions over the same length), so no metre is ever compared with a radian.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from numbers import Real
from typing import TYPE_CHECKING, Literal

import numpy as np

from qparm.compiled.kernels import b1, c1, c2, c3, f8, i8, kernel, kernel_helper, o1, o2, void
from qparm.errors import InvalidInput
from qparm.ik.closed_form_step import M, least_norm, weighted_task
from qparm.ik.weights import chan_dubey_gradient, clamp, clamping_mobility, damping, fade
from qparm.robot import check_pose
from qparm.robot.kernels import forward_and_jacobian, split_pose_error

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from qparm.robot import SerialChain

__all__ = ["METHODS", "Method", "StepProblem", "step_bounds", "step_problem", "trust_region"]

Method = Literal["dls", "wln", "cwln", "gpm"]
METHODS: dict[str, int] = {"dls": 0, "wln": 1, "cwln": 2, "gpm": 3}
WLN, CWLN, GPM = 1, 2, 3

# While iterating, a linearisation is trusted this far: 0.3 rad, 0.1 m.
_TRUST_REVOLUTE = 0.3
_TRUST_PRISMATIC = 0.1


@dataclass(frozen=True, eq=False)
class StepProblem:
    """The data of one bounded step, in scaled joints and scaled errors.

    Attributes
    ----------
    J : (6, n) ndarray
        Scaled Jacobian.
    e : (6,) ndarray
        Scaled pose error.
    S : (n,) ndarray
        Square roots of the mobilities, R^(-1/2) >= 0; zeros allowed.
    c : (n,) ndarray
        Where the step goes in the absence of a task; within the bounds.
    lam2 : float
        lambda^2 >= 0; zero makes the task an equality.
    lb, ub : (n,) ndarray
        Bounds of the step; infinite entries allowed.

    Raises
    ------
    InvalidInput
        If a shape does not fit, an entry is NaN, lb > ub, S < 0 or lambda^2 < 0; the entry is named.
    """

    J: NDArray[np.float64]
    e: NDArray[np.float64]
    S: NDArray[np.float64]
    c: NDArray[np.float64]
    lam2: float
    lb: NDArray[np.float64]
    ub: NDArray[np.float64]

    def __post_init__(self) -> None:
        J = np.ascontiguousarray(self.J, dtype=float)
        object.__setattr__(self, "J", J)
        if J.ndim != 2 or J.shape[0] != M or J.shape[1] == 0:
            raise InvalidInput(f"J must be (6, n) with n > 0, not {J.shape}")
        n = J.shape[1]
        for name, size in (("e", M), ("S", n), ("c", n), ("lb", n), ("ub", n)):
            array = np.ascontiguousarray(getattr(self, name), dtype=float)
            object.__setattr__(self, name, array)
            if array.shape != (size,):
                raise InvalidInput(f"{name} must be ({size},), not {array.shape}")
        for name in ("J", "e", "S", "c"):
            array = getattr(self, name)
            if not np.isfinite(array).all():
                raise InvalidInput(f"{name} has an entry that is not finite at {_first(~np.isfinite(array))}")
        if not (math.isfinite(self.lam2) and self.lam2 >= 0):
            raise InvalidInput(f"lambda^2 must be finite and not negative, not {self.lam2}")
        if (self.S < 0).any():
            raise InvalidInput(f"S must not be negative, S[{_first(self.S < 0)}] is {self.S.min()}")
        for name in ("lb", "ub"):
            if np.isnan(getattr(self, name)).any():
                raise InvalidInput(f"{name} has a NaN at {_first(np.isnan(getattr(self, name)))}")
        if (self.lb > self.ub).any():
            i = _first(self.lb > self.ub)
            raise InvalidInput(f"bounds are reversed at {i}: lb = {self.lb[i]} > ub = {self.ub[i]}")
        if (self.lb == np.inf).any() or (self.ub == -np.inf).any():
            raise InvalidInput("a lower bound of inf or an upper bound of -inf leaves no step")
        object.__setattr__(self, "c", np.clip(self.c, self.lb, self.ub))

    @classmethod
    def formed(
        cls,
        JT: NDArray[np.float64],
        e: NDArray[np.float64],
        S: NDArray[np.float64],
        c: NDArray[np.float64],
        lam2: float,
        lb: NDArray[np.float64],
        ub: NDArray[np.float64],
    ) -> StepProblem:
        """Return a step from arrays that a kernel formed: contiguous, finite, in order; nothing is checked."""
        step = object.__new__(cls)
        step.__dict__.update(J=JT.T, JT=JT, e=e, S=S, c=c, lam2=lam2, lb=lb, ub=ub)
        return step

    @property
    def n(self) -> int:
        """The number of joints."""
        return self.J.shape[1]

    @cached_property
    def JT(self) -> NDArray[np.float64]:
        """The transposed Jacobian (n, 6), contiguous, as the kernels take it."""
        return np.ascontiguousarray(self.J.T)

    def objective(self, d: NDArray[np.float64]) -> float:
        """Return the objective at a step; inf where a joint with S = 0 leaves c."""
        w = self.J @ d - self.e
        offset = np.abs(d - self.c)
        moved = np.divide(offset, self.S, out=np.full(self.n, np.inf), where=self.S > 0)
        moved[(self.S == 0) & (offset == 0)] = 0.0
        return float(0.5 * w @ w + 0.5 * self.lam2 * moved @ moved)

    def within_bounds(self, d: NDArray[np.float64], *, tolerance: float = 0.0) -> bool:
        """Return whether a step keeps its bounds."""
        return bool(((d >= self.lb - tolerance) & (d <= self.ub + tolerance)).all())


@kernel_helper
def form_task(fixed, prismatic, q, target, scale, length, pose, JT, e, errors):
    """Write pose, scaled Jacobian and scaled error; return lambda^2. ``errors``: |position| m, |rotation| rad."""
    forward_and_jacobian(fixed, prismatic, q, pose, JT)
    split_pose_error(pose, target, e)
    errors[0] = math.sqrt(e[0] * e[0] + e[1] * e[1] + e[2] * e[2])
    errors[1] = math.sqrt(e[3] * e[3] + e[4] * e[4] + e[5] * e[5])
    inverse = 1.0 / length
    for k in range(3):
        e[k] *= inverse
    for i in range(q.shape[0]):
        s = scale[i]
        for k in range(3):
            JT[i, k] *= s * inverse
            JT[i, k + 3] *= s
    return damping(math.sqrt((errors[0] * inverse) ** 2 + errors[1] ** 2))


@kernel_helper
def form_bounds(q, lower, upper, scale, largest, lb, ub):
    """Write the step's bounds: the position limits, no further than ``largest`` (scaled joints).

    Outside its range a joint gets lb = ub = +-largest until it is back: no faster, and no slower.
    """
    for i in range(q.shape[0]):
        t = largest[i]
        lb[i] = min(max((lower[i] - q[i]) / scale[i], -t), t)
        ub[i] = min(max((upper[i] - q[i]) / scale[i], -t), t)


@kernel_helper
def form_weights(method, q, lower, upper, scale, reference, gain, towards, e_norm, lb, ub, S, c):
    """Write S and c of a method; ``towards`` tells WLN which joints move towards their nearer limit."""
    shrink = fade(e_norm)
    for i in range(q.shape[0]):
        S[i] = 1.0
        c[i] = 0.0
        if method == WLN:
            if towards[i] > 0.0:
                s = scale[i]
                S[i] = 1.0 / math.sqrt(1.0 + abs(chan_dubey_gradient(q[i] / s, lower[i] / s, upper[i] / s)))
        elif method == CWLN:
            mobility = clamping_mobility(q[i], lower[i], upper[i])
            if mobility < 1.0:
                S[i] = math.sqrt(mobility)
                c[i] = -shrink * (1.0 - mobility) * clamp(q[i], lower[i], upper[i])
        elif method == GPM:
            c[i] = -shrink * gain * (q[i] - reference[i]) / scale[i]
        c[i] = min(max(c[i], lb[i]), ub[i])


@kernel_helper
def wln_direction(q, lower, upper, JT, e, lam2, BT, A, r, z, y, S, c, towards):
    """Mark with 1 the joints that the unweighted step would move towards their nearer limit."""
    for i in range(q.shape[0]):
        S[i] = 1.0
        c[i] = 0.0
    weighted_task(JT, S, c, e, BT, r)
    least_norm(BT, r, lam2, A, z, y)
    for i in range(q.shape[0]):
        towards[i] = 1.0 if y[i] * (2.0 * q[i] - upper[i] - lower[i]) > 0.0 else 0.0


@kernel(f8(c3, b1, c1, c2, c1, c1, c1, f8, c1, i8, c1, f8, o1, o2, o2, o1, o1, o1, o1, o1, o1))
def form_step_kernel(
    fixed, prismatic, q, target, lower, upper, scale, length, largest, method, reference, gain, towards,
    pose, JT, e, S, c, lb, ub, errors,
):  # fmt: skip
    """Write one whole step problem; return lambda^2. ``towards[0] < 0`` asks for WLN's direction test."""
    lam2 = form_task(fixed, prismatic, q, target, scale, length, pose, JT, e, errors)
    form_bounds(q, lower, upper, scale, largest, lb, ub)
    if method == WLN and towards[0] < 0.0:
        n = q.shape[0]
        wln_direction(
            q, lower, upper, JT, e, lam2, np.empty((n, M)), np.empty((M, M)), np.empty(M), np.empty(M), np.empty(n),
            S, c, towards,
        )  # fmt: skip
    e_norm = math.sqrt((errors[0] / length) ** 2 + errors[1] ** 2)
    form_weights(method, q, lower, upper, scale, reference, gain, towards, e_norm, lb, ub, S, c)
    return lam2


@kernel(void(c1, c1, c1, c1, c1, o1, o1))
def form_bounds_kernel(q, lower, upper, scale, largest, lb, ub):
    """Compiled :func:`step_bounds`."""
    form_bounds(q, lower, upper, scale, largest, lb, ub)


def trust_region(chain: SerialChain, time_step: float | None = None) -> NDArray[np.float64]:
    """Return the largest step of each joint, (n,), scaled: 0.3 rad and 0.1 m, or velocity limit times time."""
    if time_step is None:
        largest = np.where(chain.prismatic, _TRUST_PRISMATIC, _TRUST_REVOLUTE)
    elif is_positive(time_step):
        largest = chain.velocity * time_step
    else:
        raise InvalidInput(f"time_step must be finite and positive, not {time_step}")
    return largest / chain.scale


def step_bounds(
    chain: SerialChain, q: ArrayLike, *, time_step: float | None = None
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """Return the bounds of a step from ``q``, and which joints are outside their range.

    Parameters
    ----------
    chain : SerialChain
    q : (n,) array_like
    time_step : float, optional
        Seconds the step stands for; then the velocity limits hold. Without it, the trust region
        of an iteration.

    Returns
    -------
    lb, ub : (n,) ndarray
        Scaled joints. A joint outside its range has lb = ub until it is back: as fast as allowed, no faster.
    returning : (n,) ndarray of bool
    """
    q = chain.check_one_configuration(q)
    lb, ub = np.empty(chain.n), np.empty(chain.n)
    form_bounds_kernel(q, chain.lower, chain.upper, chain.scale, trust_region(chain, time_step), lb, ub)
    return lb, ub, ~chain.within_limits(q)


def step_problem(
    chain: SerialChain,
    q: ArrayLike,
    target: ArrayLike,
    *,
    method: Method = "cwln",
    reference: ArrayLike | None = None,
    gain: float = 0.1,
    time_step: float | None = None,
    towards: NDArray[np.float64] | None = None,
) -> StepProblem:
    """Return the step that takes the tool from ``q`` towards a target pose.

    Parameters
    ----------
    chain : SerialChain
    q : (n,) array_like
        Where the arm is.
    target : (4, 4) array_like
        Where the tool shall be, base frame.
    method : {"dls", "wln", "cwln", "gpm"}
        See the module's table.
    reference : (n,) array_like, optional
        GPM: the configuration to draw near to in the null space; mid range by default.
    gain : float
        GPM: the share k of the way to the reference that H asks for in one step.
    time_step : float, optional
        Seconds the step stands for; see :func:`step_bounds`.
    towards : (n,) ndarray, optional
        WLN: 1 for joints that move towards their nearer limit. The test is made here by default;
        along an iteration it is made once and handed on, or it flips at every iterate.

    Returns
    -------
    StepProblem
    """
    if not (isinstance(method, str) and method in METHODS):
        raise InvalidInput(f"method must be one of {', '.join(METHODS)}, not {method!r}")
    q = chain.check_one_configuration(q)
    target = check_pose(target, what="target")
    n = chain.n
    if towards is not None:
        towards = np.array(towards, dtype=float)
        if towards.shape != (n,) or not np.isfinite(towards).all():
            raise InvalidInput(f"towards must be ({n},) finite numbers, not {towards}")
        towards = np.maximum(towards, 0.0)  # a negative first entry asks the kernel to make the test
    JT, pose, e, errors = np.empty((n, M)), np.empty((4, 4)), np.empty(M), np.empty(2)
    S, c, lb, ub = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    lam2 = form_step_kernel(
        chain.fixed,
        chain.prismatic,
        q,
        target,
        chain.lower,
        chain.upper,
        chain.scale,
        chain.characteristic_length,
        trust_region(chain, time_step),
        METHODS[method],
        reference_configuration(chain, reference),
        finite_gain(gain),
        np.full(n, -1.0) if towards is None else towards,
        pose,
        JT,
        e,
        S,
        c,
        lb,
        ub,
        errors,
    )
    return StepProblem(J=JT.T, e=e, S=S, c=c, lam2=lam2, lb=lb, ub=ub)


def is_positive(value: object) -> bool:
    """Return whether a value is a finite number above zero."""
    return isinstance(value, Real) and 0.0 < float(value) < math.inf


def reference_configuration(chain: SerialChain, reference: ArrayLike | None) -> NDArray[np.float64]:
    """Return GPM's reference configuration: the caller's, or mid range."""
    if reference is None:
        return 0.5 * (chain.lower + chain.upper)
    return chain.check_one_configuration(reference, what="reference")


def finite_gain(gain: float) -> float:
    """Return GPM's gain as a float after checking that it is finite."""
    if not (isinstance(gain, Real) and math.isfinite(gain)):
        raise InvalidInput(f"gain must be finite, not {gain}")
    return float(gain)


def _first(mask: NDArray[np.bool_]) -> int | tuple[int, ...]:
    index = tuple(int(i) for i in np.argwhere(mask)[0])
    return index[0] if len(index) == 1 else index
