"""Planning: from the tool's path to a joint path. One file a strategy."""

from qparm.planning.assemble import assemble
from qparm.planning.breaks import Motion, MotionFailure, plan_motion
from qparm.planning.general import PointRecord, TrackRecord, track
from qparm.planning.own import Planner, plan_by

__all__ = [
    "Motion",
    "MotionFailure",
    "Planner",
    "PointRecord",
    "TrackRecord",
    "assemble",
    "plan_by",
    "plan_motion",
    "track",
]
