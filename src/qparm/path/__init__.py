"""The three things that travel through the program: tool path, joint path, trajectory."""

from qparm.path.curve import joint_curve
from qparm.path.joint_path import Deviations, JointPath, Segment, SegmentKind
from qparm.path.tool_path import Corner, Row, ToolPath, Transition
from qparm.path.trajectory import TimedSegment, Trajectory

__all__ = [
    "Corner",
    "Deviations",
    "JointPath",
    "Row",
    "Segment",
    "SegmentKind",
    "TimedSegment",
    "ToolPath",
    "Trajectory",
    "Transition",
    "joint_curve",
]


def __dir__() -> list[str]:
    return sorted(__all__)
