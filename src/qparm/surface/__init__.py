"""The workpiece: surfaces and the raster of tool poses over them, or poses from elsewhere."""

from qparm.surface.pose_list import PoseTable, pose_list_tool_path, read_pose_list
from qparm.surface.raster import ParametricSurface, serpentine_raster, tool_frames
from qparm.surface.sphere import SphericalZone

__all__ = [
    "ParametricSurface",
    "PoseTable",
    "SphericalZone",
    "pose_list_tool_path",
    "read_pose_list",
    "serpentine_raster",
    "tool_frames",
]
