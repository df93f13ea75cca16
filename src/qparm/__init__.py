"""qparm: trajectories of redundant arms over large curved surfaces, with convex optimisation at every stage.

    import qparm

    plan = qparm.plan("examples/dome.toml")
    print(qparm.report(plan).text())
    qparm.write(plan, "out")

Names are loaded when they are used, so that importing the package stays quick.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from qparm.cell import Cell
    from qparm.errors import CellError, InvalidInput, OutputError, PackageMissing, QparmError, SolverUnavailable
    from qparm.export import write
    from qparm.ik import check_reach, reach_of_designs, solve_pose, solve_poses, step_problem
    from qparm.path import JointPath, ToolPath, Trajectory
    from qparm.pipeline import Options, Plan, plan
    from qparm.plan_report import Report, report
    from qparm.robot import JointLimits, SerialChain, chain_from_dh, chain_from_urdf

__version__ = "0.1.0"

_HOME = {
    "Cell": "cell",
    "CellError": "errors",
    "InvalidInput": "errors",
    "JointLimits": "robot",
    "JointPath": "path",
    "Options": "pipeline",
    "OutputError": "errors",
    "PackageMissing": "errors",
    "Plan": "pipeline",
    "QparmError": "errors",
    "Report": "plan_report",
    "SerialChain": "robot",
    "SolverUnavailable": "errors",
    "ToolPath": "path",
    "Trajectory": "path",
    "chain_from_dh": "robot",
    "chain_from_urdf": "robot",
    "check_reach": "ik",
    "plan": "pipeline",
    "reach_of_designs": "ik",
    "report": "plan_report",
    "solve_pose": "ik",
    "solve_poses": "ik",
    "step_problem": "ik",
    "write": "export",
}

__all__ = [
    "Cell",
    "CellError",
    "InvalidInput",
    "JointLimits",
    "JointPath",
    "Options",
    "OutputError",
    "PackageMissing",
    "Plan",
    "QparmError",
    "Report",
    "SerialChain",
    "SolverUnavailable",
    "ToolPath",
    "Trajectory",
    "chain_from_dh",
    "chain_from_urdf",
    "check_reach",
    "plan",
    "reach_of_designs",
    "report",
    "solve_pose",
    "solve_poses",
    "step_problem",
    "write",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'qparm' has no attribute {name!r}")
    value = getattr(importlib.import_module(f"qparm.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
