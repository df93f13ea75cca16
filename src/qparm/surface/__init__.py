"""The workpiece: surfaces and the raster of tool poses over them."""

from qparm.surface.raster import ParametricSurface, serpentine_raster, tool_frames
from qparm.surface.sphere import SphericalZone

__all__ = ["ParametricSurface", "SphericalZone", "serpentine_raster", "tool_frames"]
