"""A solver of somebody else's: its answers are proved here, not taken on its word."""

from __future__ import annotations

from copy import deepcopy
from typing import TYPE_CHECKING

import numpy as np

from qparm.errors import InvalidInput
from qparm.ik.kkt import check_optimality
from qparm.ik.solvers.slack_form import SolvedStep, StepSolver

if TYPE_CHECKING:
    from qparm.ik.step import StepProblem

__all__ = ["CheckedSolver"]


class CheckedSolver:
    """Steps of a caller's solver, each held against the KKT conditions once more.

    Parameters
    ----------
    solver : StepSolver

    Raises
    ------
    InvalidInput
        If it has no ``name`` or no ``solve``.
    """

    def __init__(self, solver: StepSolver) -> None:
        name = getattr(solver, "name", None)
        if not isinstance(name, str) or not callable(getattr(solver, "solve", None)):
            raise InvalidInput(
                f'solver must be "auto", the name of a solver, or an object with name and solve, not {solver!r}'
            )
        self.name = name
        self._solver = solver

    def solve(self, step: StepProblem) -> SolvedStep:
        """Solve one step; accepted only if the solver accepts it and the KKT conditions hold.

        Raises
        ------
        InvalidInput
            If the answer is no SolvedStep, or its d and z are not of the step's size.
        """
        # the answer is held against this step, so the solver gets its own copy to write in
        answer = self._solver.solve(deepcopy(step))
        if not isinstance(answer, SolvedStep):
            raise InvalidInput(f"solver {self.name!r} must answer with a SolvedStep, not {type(answer).__name__}")
        shapes = np.shape(answer.d), np.shape(answer.z)
        if shapes != ((step.n,), step.e.shape):
            raise InvalidInput(
                f"solver {self.name!r} must answer with d ({step.n},) and z (6,), not {shapes[0]} and {shapes[1]}"
            )
        d, z = np.array(answer.d, dtype=float), np.array(answer.z, dtype=float)
        optimality = check_optimality(step, d, z)
        accepted = bool(answer.claimed and answer.accepted and np.isfinite(d).all() and optimality.holds())
        return SolvedStep(d, z, bool(answer.claimed), optimality, accepted)
