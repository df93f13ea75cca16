"""The step as it is given to a solver: identity Hessian, the task as slack rows, in units of the task.

    min  1/2 |y|^2 + 1/2 |w|^2     s.t.   J S y + lambda w = e - J c,    lb - c <= S y <= ub - c

with y, w and the right-hand sides divided by |e - J c|, kept between a typical step of 5e-3 and 0.3: absolute
tolerances then mean the same for every step, also where the task cannot be met within the bounds and w grows
to |e| / lambda. The normal form, with Hessian J^T J + lambda^2 R, has the same optimum, but a first-order solver
accepts wrong answers to it: its curvature in the null space is below any residual tolerance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from qparm.compiled.kernels import c1, c2, f8, kernel, kernel_helper, o1, o2, void
from qparm.errors import InvalidInput
from qparm.ik.active_set_step import y_bounds
from qparm.ik.closed_form_step import M

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.ik.kkt import Optimality
    from qparm.ik.step import StepProblem

__all__ = ["SolvedStep", "StepSolver"]

TYPICAL_STEP, LARGEST_STEP = 5e-3, 0.3


@dataclass(frozen=True)
class SolvedStep:
    """What a solver answered, and what the KKT check makes of it.

    Attributes
    ----------
    d : (n,) ndarray
        The step (scaled joints); whatever the solver left there if it failed.
    z : (6,) ndarray
        Multiplier of the task rows.
    claimed : bool
        Whether the solver calls its problem solved.
    optimality : Optimality
        The KKT residuals and the error bound.
    accepted : bool
        Claimed, finite, and within tolerance by the KKT check.
    """

    d: NDArray
    z: NDArray
    claimed: bool
    optimality: Optimality
    accepted: bool


class StepSolver(Protocol):
    """A QP solver with a persistent workspace for steps of one size."""

    name: str

    def solve(self, step: StepProblem) -> SolvedStep:
        """Solve one step, warm-started from the last where the solver can."""
        ...


def check_size(step: StepProblem, n: int) -> None:
    """Raise if a step is not of the size that a workspace was made for: the solvers would write past its end."""
    if step.n != n:
        raise InvalidInput(f"this solver was made for steps of {n} joints, not {step.n}")


@kernel_helper
def unit_of_task(r):
    """Return |r|, kept between the typical step and the largest."""
    size = 0.0
    for k in range(M):
        size += r[k] * r[k]
    return min(max(math.sqrt(size), TYPICAL_STEP), LARGEST_STEP)


@kernel(f8(c2, c1, c1, c1, f8, c1, c1, f8, o2, o1, o1, o1))
def slack_form_kernel(JT, S, c, e, lam, lb, ub, infinity, A, b, lo, hi):
    """Write the rows ``A = [J S, lambda I]``, ``b`` and the bounds of (y, w); return the unit they are in."""
    n = S.shape[0]
    for k in range(M):
        b[k] = e[k]
    for i in range(n):
        for k in range(M):
            A[k, i] = JT[i, k] * S[i]
            b[k] -= JT[i, k] * c[i]
    unit = unit_of_task(b)
    for k in range(M):
        b[k] /= unit
        A[k, n + k] = lam
        lo[n + k] = -infinity
        hi[n + k] = infinity
    y_bounds(S, c, lb, ub, lo[:n], hi[:n])
    for i in range(n):
        lo[i] = min(max(lo[i] / unit, -infinity), infinity)
        hi[i] = min(max(hi[i] / unit, -infinity), infinity)
    return unit


@kernel(void(c1, c1, c1, c1, f8, o1, o1))
def step_from_slack_kernel(S, c, x, multipliers, unit, d, z):
    """Write the step d = c + S y and the task's multiplier z from a solver's primal and dual answer.

    The solvers' Lagrangian is 1/2 |x|^2 + multipliers^T (A x - b), so y = clip(-(J S)^T multipliers).
    """
    for i in range(S.shape[0]):
        d[i] = c[i] + S[i] * x[i] * unit
    for k in range(M):
        z[k] = -multipliers[k] * unit
