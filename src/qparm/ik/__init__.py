"""Inverse kinematics: every step a bounded convex problem, in closed form, by an active set or by a solver."""

from typing import TYPE_CHECKING

from qparm.ik.active_set_step import active_set
from qparm.ik.batch import PoseBatch, solve_poses
from qparm.ik.closed_form_step import closed_form
from qparm.ik.kkt import STEP_TOLERANCE, Optimality, check_optimality
from qparm.ik.solve import PoseSolution, PoseSolver, PoseStatus, StepCounts, StepRule, solve_pose
from qparm.ik.solvers import SolvedStep, StepSolver, make_solver
from qparm.ik.step import METHODS, Method, StepProblem, step_bounds, step_problem
from qparm.ik.weights import chan_dubey_weights, clamping_weights
from qparm.lazy_names import on_demand

if TYPE_CHECKING:
    from qparm.ik.differential import DifferentialIK, DifferentialStep, StepStatus

__all__ = [
    "METHODS",
    "STEP_TOLERANCE",
    "DifferentialIK",
    "DifferentialStep",
    "Method",
    "Optimality",
    "PoseBatch",
    "PoseSolution",
    "PoseSolver",
    "PoseStatus",
    "SolvedStep",
    "StepCounts",
    "StepProblem",
    "StepRule",
    "StepSolver",
    "StepStatus",
    "active_set",
    "chan_dubey_weights",
    "check_optimality",
    "clamping_weights",
    "closed_form",
    "make_solver",
    "solve_pose",
    "solve_poses",
    "step_bounds",
    "step_problem",
]


__getattr__, __dir__ = on_demand(
    __name__,
    {"DifferentialIK": "differential", "DifferentialStep": "differential", "StepStatus": "differential"},
    __all__,
)
