"""Inverse kinematics of one pose: eq. 5 of the paper, with a verdict."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np

from qparm.errors import InvalidInput
from qparm.ik import iterate
from qparm.ik.active_set_step import active_set_kernel
from qparm.ik.closed_form_step import M, closed_form_kernel
from qparm.ik.solvers import StepSolver, checked, make_solver
from qparm.ik.step import (
    METHODS,
    Method,
    StepProblem,
    finite_gain,
    form_step_kernel,
    is_positive,
    reference_configuration,
    trust_region,
)
from qparm.robot import check_pose
from qparm.robot.reach import is_out_of_reach

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from qparm.robot import SerialChain

__all__ = ["PoseSolution", "PoseSolver", "PoseStatus", "StepCounts", "StepRule", "solve_pose"]

StepRule = Callable[["SerialChain", "NDArray[np.float64]", StepProblem], "StepProblem | NDArray[np.float64]"]


class PoseStatus(StrEnum):
    """How the search for a configuration ended."""

    REACHED = "reached"
    """Within both tolerances and within the position limits."""
    AT_LIMITS = "at limits"
    """At rest away from the pose, held by joints at their position limits."""
    STUCK = "stuck"
    """At rest away from the pose with no joint at a limit: a singular configuration or a local minimum."""
    UNREACHABLE = "unreachable"
    """Proved: the wrist would have to be farther away than the links reach, or nearer than they fold."""
    NOT_CONVERGED = "not converged"
    """Still moving when the iterations ran out."""


@dataclass(frozen=True)
class StepCounts:
    """How the steps were answered.

    Attributes
    ----------
    closed_form : int
        The closed form lay within the bounds.
    active_set : int
        By the compiled active set.
    solver : int
        By the QP solver that was asked for, and accepted by the KKT check.
    fallback : int
        The solver failed or its answer failed the KKT check; the active set answered instead.
    failed : int
        Nothing answered; the step was cut to its bounds.
    """

    closed_form: int = 0
    active_set: int = 0
    solver: int = 0
    fallback: int = 0
    failed: int = 0

    def __add__(self, other: StepCounts) -> StepCounts:
        return StepCounts(
            self.closed_form + other.closed_form,
            self.active_set + other.active_set,
            self.solver + other.solver,
            self.fallback + other.fallback,
            self.failed + other.failed,
        )

    @property
    def total(self) -> int:
        """All steps."""
        return self.closed_form + self.active_set + self.solver + self.fallback + self.failed


@dataclass(frozen=True, eq=False)
class PoseSolution:
    """A configuration for a pose, and how good it is.

    Attributes
    ----------
    q : (n,) ndarray
        The last configuration, reached or not (m, rad).
    status : PoseStatus
    position_error, rotation_error : float
        Of the tool at ``q`` (m, rad).
    iterations : int
        Over all starts.
    starts : int
        How many starts were used, 1 without restarts.
    active_limits : tuple of str
        Joints at a position limit at ``q``, such as ``"theta2 upper"``.
    counts : StepCounts
    trace : (k, n) ndarray
        Configurations at which steps were formed, if asked for.
    """

    q: NDArray[np.float64]
    status: PoseStatus
    position_error: float
    rotation_error: float
    iterations: int
    starts: int
    active_limits: tuple[str, ...]
    counts: StepCounts
    trace: NDArray[np.float64] = field(repr=False)

    @property
    def reached(self) -> bool:
        """Whether the pose is reached."""
        return self.status is PoseStatus.REACHED


class PoseSolver:
    """Solves poses of one chain, with everything that does not change prepared.

    Parameters
    ----------
    chain : SerialChain
    method : {"dls", "wln", "cwln", "gpm"} or StepRule
        A rule of your own is a function ``rule(chain, q, step)``: it gets the damped least-norm step and returns
        another step problem, with its own S and c, or the displacement itself (scaled joints).
    solver : str or StepSolver
        ``"auto"``: closed form where it lies within the bounds, else the active set, all compiled.
        Any other name, or an object with ``name`` and ``solve(step)``, gets *every* step. What such an object
        calls accepted is checked again.
    position_tolerance, rotation_tolerance : float
        m and rad.
    max_iterations : int
        Per start.
    reference, gain
        GPM's reference configuration and the share of the way to it asked for in one step.
    keep_trace : bool
        Keep the configurations of every iteration.
    """

    def __init__(
        self,
        chain: SerialChain,
        *,
        method: Method | StepRule = "cwln",
        solver: str | StepSolver = "auto",
        position_tolerance: float = 1e-9,
        rotation_tolerance: float = 1e-9,
        max_iterations: int = 200,
        reference: ArrayLike | None = None,
        gain: float = 0.1,
        keep_trace: bool = False,
    ) -> None:
        self._rule = method if callable(method) else None
        name_of_method = "dls" if callable(method) else method
        if not (isinstance(name_of_method, str) and name_of_method in METHODS):
            raise InvalidInput(f"method must be one of {', '.join(METHODS)} or a function, not {method!r}")
        for name, value in (
            ("position_tolerance", position_tolerance),
            ("rotation_tolerance", rotation_tolerance),
        ):
            if not is_positive(value):
                raise InvalidInput(f"{name} must be finite and positive, not {value}")
        if not isinstance(max_iterations, (int, np.integer)) or max_iterations < 1:
            raise InvalidInput(f"max_iterations must be a whole number from 1, not {max_iterations}")
        self.chain = chain
        self.solver: StepSolver | None = None
        if not isinstance(solver, str):
            if not (callable(getattr(solver, "solve", None)) and isinstance(getattr(solver, "name", None), str)):
                raise InvalidInput(
                    f"solver must be a name such as 'auto', or an object with a name and solve(step), not {solver!r}"
                )
            self.solver = checked(solver)
        elif solver != "auto":
            self.solver = make_solver(solver, chain.n)
        self._method = METHODS[name_of_method]
        self._tolerances = (position_tolerance, rotation_tolerance)
        self._max_iterations = max_iterations
        self._reference = reference_configuration(chain, reference)
        self._gain = finite_gain(gain)
        self._largest = trust_region(chain)
        self._trace = np.empty((max_iterations if keep_trace else 0, chain.n))

    def solve(self, target: NDArray[np.float64], q_start: NDArray[np.float64]) -> PoseSolution:
        """Solve one pose from one start; both must have been checked (see :func:`solve_pose`)."""
        q, errors, counts = np.array(q_start), np.empty(2), np.zeros(4, dtype=np.int64)
        chain = self.chain
        if self.solver is None and self._rule is None:
            end = iterate.iterate_kernel(
                chain.fixed, chain.prismatic, chain.lower, chain.upper, chain.scale, chain.characteristic_length,
                self._largest, target, self._method, self._reference, self._gain, *self._tolerances,
                self._max_iterations, q, errors, counts, self._trace,
            )  # fmt: skip
            iterations, closed, bounded, failed = counts.tolist()
            step_counts = StepCounts(closed_form=closed, active_set=bounded, failed=failed)
        else:
            end, iterations, step_counts = self._iterate_in_python(target, q, errors)
        active = active_limits(chain, q)
        if end == iterate.REACHED:
            status = PoseStatus.REACHED
        elif is_out_of_reach(chain, target):
            status = PoseStatus.UNREACHABLE
        elif end == iterate.NOT_CONVERGED:
            status = PoseStatus.NOT_CONVERGED
        else:
            status = PoseStatus.AT_LIMITS if active else PoseStatus.STUCK
        return PoseSolution(
            q=q,
            status=status,
            position_error=float(errors[0]),
            rotation_error=float(errors[1]),
            iterations=iterations,
            starts=1,
            active_limits=active,
            counts=step_counts,
            trace=self._trace[: min(iterations, len(self._trace))].copy(),
        )

    def _iterate_in_python(
        self, target: NDArray[np.float64], q: NDArray[np.float64], errors: NDArray[np.float64]
    ) -> tuple[int, int, StepCounts]:
        """Do what the compiled iteration does, with the steps formed or solved by somebody else."""
        chain, n = self.chain, self.chain.n
        towards, counts = np.full(n, -1.0), Counter()
        best, since = math.inf, 0
        for iteration in range(self._max_iterations + 1):
            JT, pose, e = np.empty((n, M)), np.empty((4, 4)), np.empty(M)
            S, c, lb, ub = np.empty((4, n))
            lam2 = form_step_kernel(
                chain.fixed, chain.prismatic, q, target, chain.lower, chain.upper, chain.scale,
                chain.characteristic_length, self._largest, self._method, self._reference, self._gain, towards,
                pose, JT, e, S, c, lb, ub, errors,
            )  # fmt: skip
            inside = bool(((q >= chain.lower) & (q <= chain.upper)).all())
            e_norm = math.hypot(errors[0] / chain.characteristic_length, errors[1])
            best, since = (e_norm, 0) if e_norm < iterate.STALL_FACTOR * best else (best, since + 1)
            end = None
            if errors[0] <= self._tolerances[0] and errors[1] <= self._tolerances[1] and inside:
                end = iterate.REACHED
            elif since >= iterate.STALL_WINDOW and inside:
                end = iterate.STALLED
            elif iteration == self._max_iterations:
                end = iterate.NOT_CONVERGED
            if end is not None:
                return end, iteration, StepCounts(**counts)
            if iteration < len(self._trace):
                self._trace[iteration] = q
            d, answered_by = self._answer(q.copy(), StepProblem.formed(JT, e, S, c, lam2, lb, ub))
            counts[answered_by] += 1
            iterate.advance_kernel(q, np.clip(d, lb, ub), chain.lower, chain.upper, chain.scale)
        raise AssertionError("unreachable: the loop always returns")

    def _answer(self, q: NDArray[np.float64], step: StepProblem) -> tuple[NDArray[np.float64], str]:
        """Return the displacement and which of :class:`StepCounts` answered."""
        if self._rule is not None:
            ruled = self._rule(self.chain, q, step)
            if not isinstance(ruled, StepProblem):
                d = np.asarray(ruled, dtype=float)
                if d.shape != (step.n,) or not np.isfinite(d).all():
                    raise InvalidInput(
                        f"the rule must return a StepProblem or ({step.n},) finite numbers, not {ruled!r}"
                    )
                return d, "closed_form"
            if ruled.n != step.n:
                raise InvalidInput(f"the rule must return a StepProblem of {step.n} joints, not {ruled.n}")
            step = ruled
        d, z = np.empty(step.n), np.empty(M)
        if self.solver is not None:
            answer = self.solver.solve(step)
            if answer.accepted:
                return answer.d, "solver"
        elif closed_form_kernel(step.JT, step.S, step.c, step.e, step.lam2, d, z) and step.within_bounds(d):
            return d, "closed_form"
        if active_set_kernel(step.JT, step.S, step.c, step.e, step.lam2, step.lb, step.ub, d, z) <= 0:
            return d, "failed"
        return d, "active_set" if self.solver is None else "fallback"


def active_limits(chain: SerialChain, q: NDArray[np.float64]) -> tuple[str, ...]:
    """Return the joints at a position limit, such as ``"theta2 upper"``."""
    near = 1e-9 * np.diff(chain.one_turn, axis=0)[0]
    at_lower, at_upper = q <= chain.lower + near, q >= chain.upper - near
    if not (at_lower.any() or at_upper.any()):
        return ()
    return tuple(
        f"{name} {'lower' if low else 'upper'}"
        for name, low, high in zip(chain.names, at_lower, at_upper, strict=True)
        if low or high
    )


def solve_pose(
    chain: SerialChain,
    target: ArrayLike,
    q_start: ArrayLike | None = None,
    *,
    method: Method | StepRule = "cwln",
    solver: str | StepSolver = "auto",
    position_tolerance: float = 1e-9,
    rotation_tolerance: float = 1e-9,
    max_iterations: int = 200,
    restarts: int = 0,
    rng: np.random.Generator | None = None,
    reference: ArrayLike | None = None,
    gain: float = 0.1,
    keep_trace: bool = False,
) -> PoseSolution:
    """Search a configuration whose tool pose is the target (eq. 5 of the paper).

    Every step is the bounded convex problem of :mod:`qparm.ik.step`, damped by lambda^2 = 1e-3 |e|^2 + 1e-12
    (Sugihara), so that convergence is quadratic and the answer has no bias.

    Parameters
    ----------
    chain : SerialChain
    target : (4, 4) array_like
        Pose of the tool in the base frame.
    q_start : (n,) array_like, optional
        Where the search starts; mid range by default. A start outside the limits is brought back within.
    method : {"dls", "wln", "cwln", "gpm"} or StepRule
        Which of the paper's steps, or your own; see :class:`PoseSolver`.
    solver : str or StepSolver
        ``"auto"`` (closed form, else compiled active set), ``"proxqp"``, ``"osqp"``, a qpsolvers name, or your own.
    position_tolerance, rotation_tolerance : float
        When the pose counts as reached (m, rad).
    max_iterations : int
        Per start.
    restarts : int
        How many random configurations to start from after the first start failed.
    rng : numpy.random.Generator, optional
        Where restarts are drawn from; required if ``restarts > 0``.
    reference, gain
        For ``method="gpm"``, see :func:`qparm.ik.step_problem`.
    keep_trace : bool
        Keep the configurations of every iteration in the result.

    Returns
    -------
    PoseSolution
        Of the first start that reached the pose, else of the one that came nearest.

    Raises
    ------
    InvalidInput
        If a shape does not fit or a value is not finite.

    References
    ----------
    Sun et al., Micromachines 2023, 14, 886, eq. 5; Sugihara, IEEE T-RO 27(5), 2011.
    """
    target = check_pose(target, what="target")
    q = 0.5 * (chain.lower + chain.upper) if q_start is None else chain.check_one_configuration(q_start, what="q_start")
    if not isinstance(restarts, (int, np.integer)) or restarts < 0:
        raise InvalidInput(f"restarts must be a whole number and must not be negative, not {restarts}")
    if restarts > 0 and not isinstance(rng, np.random.Generator):
        raise InvalidInput("restarts need rng, a seeded numpy.random.Generator: the same seed gives the same answer")
    pose_solver = PoseSolver(
        chain,
        method=method,
        solver=solver,
        position_tolerance=position_tolerance,
        rotation_tolerance=rotation_tolerance,
        max_iterations=max_iterations,
        reference=reference,
        gain=gain,
        keep_trace=keep_trace,
    )
    best = pose_solver.solve(target, q)
    iterations, counts, starts = best.iterations, best.counts, 1
    while not best.reached and best.status is not PoseStatus.UNREACHABLE and starts <= restarts:
        assert rng is not None
        candidate = pose_solver.solve(target, chain.random(rng, 1)[0])
        iterations, counts, starts = iterations + candidate.iterations, counts + candidate.counts, starts + 1
        if candidate.reached or _distance(chain, candidate) < _distance(chain, best):
            best = candidate
    return replace(best, iterations=iterations, counts=counts, starts=starts)


def _distance(chain: SerialChain, solution: PoseSolution) -> float:
    return math.hypot(solution.position_error / chain.characteristic_length, solution.rotation_error)
