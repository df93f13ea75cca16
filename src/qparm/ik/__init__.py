"""Inverse kinematics: every step a bounded convex problem, in closed form, by an active set or by a solver."""

import importlib
from typing import TYPE_CHECKING, Any

from qparm.ik.active_set_step import active_set
from qparm.ik.batch import PoseBatch, solve_poses
from qparm.ik.closed_form_step import closed_form
from qparm.ik.kkt import STEP_TOLERANCE, Optimality, check_optimality
from qparm.ik.reach import Reach, ReachReason, check_reach
from qparm.ik.solve import PoseSolution, PoseSolver, PoseStatus, StepCounts, StepRule, solve_pose
from qparm.ik.solvers import SolvedStep, StepSolver, make_solver
from qparm.ik.step import METHODS, Method, StepProblem, step_bounds, step_problem
from qparm.ik.weights import chan_dubey_weights, clamping_weights

if TYPE_CHECKING:
    from qparm.ik.design_reach import DesignReach, reach_of_designs
    from qparm.ik.differential import DifferentialIK, DifferentialStep, StepStatus
    from qparm.ik.margin import AttainableMargin, attainable_margin

__all__ = [
    "METHODS",
    "STEP_TOLERANCE",
    "AttainableMargin",
    "DesignReach",
    "DifferentialIK",
    "DifferentialStep",
    "Method",
    "Optimality",
    "PoseBatch",
    "PoseSolution",
    "PoseSolver",
    "PoseStatus",
    "Reach",
    "ReachReason",
    "SolvedStep",
    "StepCounts",
    "StepProblem",
    "StepRule",
    "StepSolver",
    "StepStatus",
    "active_set",
    "attainable_margin",
    "chan_dubey_weights",
    "check_optimality",
    "check_reach",
    "clamping_weights",
    "closed_form",
    "make_solver",
    "reach_of_designs",
    "solve_pose",
    "solve_poses",
    "step_bounds",
    "step_problem",
]


_ON_DEMAND = {
    "AttainableMargin": "margin",
    "DesignReach": "design_reach",
    "DifferentialIK": "differential",
    "DifferentialStep": "differential",
    "StepStatus": "differential",
    "attainable_margin": "margin",
    "reach_of_designs": "design_reach",
}


def __getattr__(name: str) -> Any:
    # kernels that a plan does without are compiled when they are asked for
    home = _ON_DEMAND.get(name)
    if home is not None:
        return getattr(importlib.import_module(f"qparm.ik.{home}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
