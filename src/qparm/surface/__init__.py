"""The workpiece: surfaces and the raster of tool poses over them, or poses from elsewhere."""

from qparm.surface.frames import ParametricSurface, tool_frames
from qparm.surface.pose_list import PoseTable, pose_list_tool_path, read_pose_list, wide_gaps
from qparm.surface.raster import serpentine_raster
from qparm.surface.sphere import SphericalZone
from qparm.surface.turn import TurnCurve

__all__ = [
    "ParametricSurface",
    "PoseTable",
    "SphericalZone",
    "TurnCurve",
    "pose_list_tool_path",
    "read_pose_list",
    "serpentine_raster",
    "tool_frames",
    "wide_gaps",
]


def __dir__() -> list[str]:
    return sorted(__all__)
