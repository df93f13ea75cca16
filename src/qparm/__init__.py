"""qparm: trajectories of redundant arms over large curved surfaces, with convex optimisation at every stage.

    import qparm

    plan = qparm.plan("examples/dome.toml")
    print(qparm.report(plan).text())
    qparm.write(plan, "out")

Names are loaded when they are used, so that importing the package stays quick.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from qparm.lazy_names import on_demand

if TYPE_CHECKING:
    from qparm.cell import Cell
    from qparm.errors import CellError, InvalidInput, OutputError, PackageMissing, QparmError, SolverUnavailable
    from qparm.export import write
    from qparm.ik import solve_pose, solve_poses, step_problem
    from qparm.path import JointPath, ToolPath, Trajectory
    from qparm.pipeline import Options, Plan, plan
    from qparm.reach import check_reach, reach_of_designs
    from qparm.reports.plan import Report, report
    from qparm.robot import JointLimits, SerialChain, chain_from_dh, chain_from_urdf
    from qparm.verify import MotionReport, read_motion, verify_motion

__version__ = "0.1.0"

_HOME = {
    "Cell": "cell",
    "CellError": "errors",
    "InvalidInput": "errors",
    "JointLimits": "robot",
    "JointPath": "path",
    "MotionReport": "verify",
    "Options": "pipeline",
    "OutputError": "errors",
    "PackageMissing": "errors",
    "Plan": "pipeline",
    "QparmError": "errors",
    "Report": "reports.plan",
    "SerialChain": "robot",
    "SolverUnavailable": "errors",
    "ToolPath": "path",
    "Trajectory": "path",
    "chain_from_dh": "robot",
    "chain_from_urdf": "robot",
    "check_reach": "reach",
    "plan": "pipeline",
    "read_motion": "verify",
    "reach_of_designs": "reach",
    "report": "reports.plan",
    "solve_pose": "ik",
    "solve_poses": "ik",
    "step_problem": "ik",
    "verify_motion": "verify",
    "write": "export",
}

__all__ = [
    "Cell",
    "CellError",
    "InvalidInput",
    "JointLimits",
    "JointPath",
    "MotionReport",
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
    "read_motion",
    "report",
    "solve_pose",
    "solve_poses",
    "step_problem",
    "verify_motion",
    "write",
]


__getattr__, __dir__ = on_demand(__name__, _HOME, __all__)
