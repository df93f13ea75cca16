"""Proof: figures recomputed from the written files and the cell, with a kinematics of its own.

Nothing here imports the inverse kinematics, the planner or the timing.
"""

from qparm.verify.between import BetweenFigures
from qparm.verify.clearance import ClearanceFault, ClearanceFigures
from qparm.verify.figures import Figures, JointFigures, Jump, Unreached
from qparm.verify.files import KnotTable, SampleTable, WaypointTable, read_knots, read_samples, read_waypoints
from qparm.verify.finding import Check, Finding, grouped
from qparm.verify.motion import MotionTable
from qparm.verify.motion_check import verify_motion
from qparm.verify.motion_report import MotionReport
from qparm.verify.plan_figures import measure
from qparm.verify.readers import read_motion
from qparm.verify.verdict import Verdict

__all__ = [
    "BetweenFigures",
    "Check",
    "ClearanceFault",
    "ClearanceFigures",
    "Figures",
    "Finding",
    "JointFigures",
    "Jump",
    "KnotTable",
    "MotionReport",
    "MotionTable",
    "SampleTable",
    "Unreached",
    "Verdict",
    "WaypointTable",
    "grouped",
    "measure",
    "read_knots",
    "read_motion",
    "read_samples",
    "read_waypoints",
    "verify_motion",
]


def __dir__() -> list[str]:
    return sorted(__all__)
