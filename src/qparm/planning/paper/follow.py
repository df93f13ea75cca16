"""Following poses in turn from one configuration, until one is not reached or a jump is met: steps 1 and 2.

The compiled form follows a whole row in one call; with a step or a solver of the caller's, Python does the same.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np

from qparm.compiled.kernels import b1, c1, c2, c3, f8, i8, kernel, kernel_helper, o1, o2, oi
from qparm.ik import METHODS, Method, PoseSolution, PoseSolver, StepCounts, StepRule, StepSolver
from qparm.ik.iterate import REACHED, iterate_kernel
from qparm.ik.step import reference_configuration, trust_region
from qparm.planning.paper.self_motion import draw_near, draw_near_kernel

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.robot import SerialChain

__all__ = ["Followed", "Follower", "Stop"]

# Answers of the kernel.
_ALL, _NOT_REACHED, _JUMP, _JOINED = range(4)

_MAX_ITERATIONS = 200


class Stop(StrEnum):
    """Why following ended."""

    ALL = "all"
    """Every pose was passed."""
    NOT_REACHED = "not reached"
    """The next pose was not reached."""
    JUMP = "jump"
    """The next pose was reached by a jump that self-motion did not repair."""
    JOINED = "joined"
    """The configurations that it was drawn towards go on from here without a jump."""


@dataclass(frozen=True, eq=False)
class Followed:
    """What following m poses gave.

    Attributes
    ----------
    stop : Stop
    q : (p, n) ndarray
        Configurations of the p poses that were passed.
    q_stop : (n,) ndarray
        Where it ended at the pose that stopped it (after self-motion), else the last of ``q``.
    met : (p + 1, n) ndarray
        Joint steps where a jump was met, before any self-motion; zero where none was. Row p is the stop's.
    errors : (p + 1, 2) ndarray
        Position and rotation errors (m, rad). Row p is the stop's, NaN if nothing stopped it.
    iterations : (p + 1,) ndarray of int
        Self-motion included.
    counts : StepCounts
    """

    stop: Stop
    q: NDArray[np.float64]
    q_stop: NDArray[np.float64]
    met: NDArray[np.float64]
    errors: NDArray[np.float64]
    iterations: NDArray[np.int64]
    counts: StepCounts


@kernel_helper
def beyond(a, b, criterion, share):
    """Return whether a step is over a share of its criterion."""
    over = False
    for i in range(a.shape[0]):
        over = over or abs(a[i] - b[i]) > share * criterion[i]
    return over


@kernel(i8(c3, b1, c1, c1, c1, f8, c1, c3, c2, i8, i8, i8, i8, c1, f8, f8, i8, c2, f8, o1, o2, o2, o2, oi, oi))
def follow_kernel(
    fixed, prismatic, lower, upper, scale, length, trust, targets, criteria, first, count, stride, method, reference,
    position_tolerance, rotation_tolerance, max_iterations, towards, share, q, q_out, met, errors_out, iterations,
    counts,
):  # fmt: skip
    """Follow ``count`` targets from ``first`` on, ``stride`` 1 or -1; return how many were passed, ``counts[4]`` why.

    ``criteria[k]`` is for the edge between targets k - 1 and k. ``q`` starts at the configuration before and ends
    where the last solve ended. With ``share > 0`` (downwards only) self-motion takes every point towards
    ``towards[k]``, no further from the point before than that share of the criterion.
    """
    n = q.shape[0]
    previous, step_counts, errors, trace = np.empty(n), np.zeros(4, dtype=np.int64), np.empty(2), np.empty((0, n))
    low, high = np.empty(n), np.empty(n)
    for m in range(count):
        k = first + stride * m
        for i in range(n):
            previous[i] = q[i]
            met[m, i] = 0.0
        step_counts[:] = 0
        end = iterate_kernel(
            fixed, prismatic, lower, upper, scale, length, trust, targets[k], method, reference, 0.1,
            position_tolerance, rotation_tolerance, max_iterations, q, errors, step_counts, trace,
        )  # fmt: skip
        counts[4] = _NOT_REACHED if end != REACHED else _ALL
        if end == REACHED:
            edge = k if stride > 0 else k + 1
            if beyond(q, previous, criteria[edge], 1.0):
                for i in range(n):
                    met[m, i] = abs(q[i] - previous[i])
                draw_near_kernel(
                    fixed, prismatic, lower, upper, scale, length, trust, targets[k], previous,
                    position_tolerance, rotation_tolerance, q, errors, step_counts,
                )  # fmt: skip
                if beyond(q, previous, criteria[edge], 1.0):
                    counts[4] = _JUMP
            if share > 0.0 and not beyond(q, previous, criteria[edge], share):
                for i in range(n):
                    low[i] = max(lower[i], previous[i] - share * criteria[edge, i])
                    high[i] = min(upper[i], previous[i] + share * criteria[edge, i])
                draw_near_kernel(
                    fixed, prismatic, low, high, scale, length, trust, targets[k], towards[k],
                    position_tolerance, rotation_tolerance, q, errors, step_counts,
                )  # fmt: skip
        for i in range(4):
            counts[i] += step_counts[i]
        errors_out[m, 0], errors_out[m, 1] = errors[0], errors[1]
        iterations[m] = step_counts[0]
        if counts[4] != _ALL:
            return m
        for i in range(n):
            q_out[m, i] = q[i]
        if share > 0.0 and m + 1 < count and not beyond(q, towards[k - 1], criteria[k], share):
            counts[4] = _JOINED
            return m + 1
    return count


class Follower:
    """Follows the poses of one tool path, with everything that does not change prepared.

    Parameters
    ----------
    chain : SerialChain
    poses : (P, 4, 4) ndarray
        Base frame.
    method, solver
        See :class:`qparm.ik.PoseSolver`.
    position_tolerance, rotation_tolerance : float
        m and rad.
    """

    def __init__(
        self,
        chain: SerialChain,
        poses: NDArray[np.float64],
        *,
        method: Method | StepRule,
        solver: str | StepSolver,
        position_tolerance: float,
        rotation_tolerance: float,
    ) -> None:
        self.chain, self.poses = chain, poses
        self._pose_solver, self._plain_solver = (
            PoseSolver(
                chain,
                method=one,
                solver=solver,
                position_tolerance=position_tolerance,
                rotation_tolerance=rotation_tolerance,
                max_iterations=_MAX_ITERATIONS,
            )
            for one in (method, "dls")
        )
        self._method = method
        self._compiled = solver == "auto" and not callable(method)
        self._tolerances = (position_tolerance, rotation_tolerance)
        self._trust = trust_region(chain)
        self._reference = reference_configuration(chain, None)

    def follow(
        self,
        q: NDArray[np.float64],
        first: int,
        last: int,
        criteria: NDArray[np.float64],
        *,
        towards: NDArray[np.float64] | None = None,
        share: float = 0.0,
    ) -> Followed:
        """Follow the points from ``first`` to ``last``, both included, upwards or downwards.

        Parameters
        ----------
        q : (n,) ndarray
            Configuration at the point before ``first``, which the first jump test is against.
        first, last : int
        criteria : (P, n) ndarray
            See :func:`qparm.planning.paper.jump.jump_criteria`; infinity where no test is made.
        towards : (P, n) ndarray, optional
            Configurations that self-motion draws every point near to, going downwards, until the path joins them.
        share : float
            How far a point may lie from the one before when drawn, over the criterion: over 0, up to 1.

        Returns
        -------
        Followed
        """
        count, stride = abs(last - first) + 1, 1 if last >= first else -1
        q, n = np.array(q), self.chain.n
        q_out, met = np.empty((count, n)), np.zeros((count + 1, n))
        errors, iterations = np.full((count + 1, 2), np.nan), np.zeros(count + 1, dtype=np.int64)
        if self._compiled:
            chain, counts = self.chain, np.zeros(5, dtype=np.int64)
            drawn_to = criteria if towards is None else towards
            passed = follow_kernel(
                chain.fixed, chain.prismatic, chain.lower, chain.upper, chain.scale, chain.characteristic_length,
                self._trust, self.poses, criteria, first, count, stride, METHODS[str(self._method)], self._reference,
                *self._tolerances, _MAX_ITERATIONS, drawn_to, share, q, q_out, met, errors, iterations, counts,
            )  # fmt: skip
            stop = (Stop.ALL, Stop.NOT_REACHED, Stop.JUMP, Stop.JOINED)[counts[4]]
            step_counts = StepCounts(closed_form=int(counts[1]), active_set=int(counts[2]), failed=int(counts[3]))
        else:
            stop, step_counts, passed = Stop.ALL, StepCounts(), count
            for m in range(count):
                k = first + stride * m
                criterion = criteria[k if stride > 0 else k + 1]
                before, solution = q, self._pose_solver.solve(self.poses[k], q)
                q, own_counts = solution.q, solution.counts
                if not solution.reached:
                    stop = Stop.NOT_REACHED
                elif (np.abs(q - before) > criterion).any():
                    met[m] = np.abs(q - before)
                    q, _, more = self.draw_near(k, q, before)
                    own_counts += more
                    if (np.abs(q - before) > criterion).any():
                        stop = Stop.JUMP
                if towards is not None and stop is Stop.ALL and (np.abs(q - before) <= share * criterion).all():
                    box = (before - share * criterion, before + share * criterion)
                    q, _, more = self.draw_near(k, q, towards[k], box)
                    own_counts += more
                E = self.chain.pose_error(self.chain.forward(q), self.poses[k])
                errors[m] = np.linalg.norm(E[:3]), np.linalg.norm(E[3:])
                iterations[m] = own_counts.total
                step_counts += own_counts
                if stop is not Stop.ALL:
                    passed = m
                    break
                q_out[m] = q
                if towards is not None and m + 1 < count and (np.abs(q - towards[k - 1]) <= share * criteria[k]).all():
                    stop, passed = Stop.JOINED, m + 1
                    break
        return Followed(
            stop=stop,
            q=q_out[:passed],
            q_stop=q,
            met=met[: passed + 1],
            errors=errors[: passed + 1],
            iterations=iterations[: passed + 1],
            counts=step_counts,
        )

    def draw_near(
        self,
        k: int,
        q: NDArray[np.float64],
        towards: NDArray[np.float64],
        box: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None,
    ) -> tuple[NDArray[np.float64], bool, StepCounts]:
        """Return :func:`qparm.planning.paper.self_motion.draw_near` at point k."""
        position, rotation = self._tolerances
        return draw_near(
            self.chain, self.poses[k], q, towards, box=box,
            position_tolerance=position, rotation_tolerance=rotation, solver=self._pose_solver.solver,
        )  # fmt: skip

    def solve(self, k: int, q_start: NDArray[np.float64], *, plain: bool = False) -> PoseSolution:
        """Return what one start makes of point k, by the method or by plain damped least norm."""
        return (self._plain_solver if plain else self._pose_solver).solve(self.poses[k], q_start)
