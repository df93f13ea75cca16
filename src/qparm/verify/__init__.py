"""Proof: figures recomputed from the written files and the cell, with a kinematics of its own.

Nothing here imports the inverse kinematics, the planner or the timing.
"""

from qparm.verify.between import BetweenFigures
from qparm.verify.clearance import ClearanceFault, ClearanceFigures
from qparm.verify.files import KnotTable, SampleTable, WaypointTable, read_knots, read_samples, read_waypoints
from qparm.verify.measure import Figures, JointFigures, Jump, Unreached, measure

__all__ = [
    "BetweenFigures",
    "ClearanceFault",
    "ClearanceFigures",
    "Figures",
    "JointFigures",
    "Jump",
    "KnotTable",
    "SampleTable",
    "Unreached",
    "WaypointTable",
    "measure",
    "read_knots",
    "read_samples",
    "read_waypoints",
]
