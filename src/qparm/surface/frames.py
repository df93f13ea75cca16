"""The interface of surfaces that a raster needs, and the tool's frames on them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

__all__ = ["ParametricSurface", "tool_frames"]


class ParametricSurface(Protocol):
    """What the raster asks of a surface with coordinates u (along rows) and v (across them) in [0, 1].

    Rows at constant v, and the lines at constant u, are run through at a speed proportional to u and v.
    """

    def point(self, u: ArrayLike, v: ArrayLike) -> NDArray[np.float64]:
        """Return surface points (m)."""
        ...

    def normal(self, u: ArrayLike, v: ArrayLike) -> NDArray[np.float64]:
        """Return outward unit normals."""
        ...

    def along(self, u: ArrayLike, v: ArrayLike) -> NDArray[np.float64]:
        """Return unit tangents in the direction of growing u."""
        ...

    def row_length(self, v: float) -> float:
        """Return the arc length of a row (m)."""
        ...

    def column_length(self, v0: float, v1: float) -> float:
        """Return the arc length between two rows at constant u (m)."""
        ...

    def distance(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return signed distances (m), positive outside the workpiece."""
        ...


def tool_frames(
    surface: ParametricSurface, u: ArrayLike, v: ArrayLike, *, stand_off: ArrayLike = 0.0
) -> NDArray[np.float64]:
    """Return tool poses on a surface: z into the surface, x along growing u.

    Parameters
    ----------
    surface : ParametricSurface
    u, v : (k,) array_like
    stand_off : float or (k,) array_like
        Height of the tool's origin over the surface (m).

    Returns
    -------
    (k, 4, 4) ndarray
        In the workpiece frame.
    """
    u, v = np.broadcast_arrays(np.asarray(u, dtype=float), np.asarray(v, dtype=float))
    normal, x = surface.normal(u, v), surface.along(u, v)
    poses = np.zeros((*u.shape, 4, 4))
    poses[..., :3, 0] = x
    poses[..., :3, 1] = np.cross(-normal, x)  # y = z x x
    poses[..., :3, 2] = -normal
    poses[..., :3, 3] = surface.point(u, v) + np.asarray(stand_off, dtype=float)[..., None] * normal
    poses[..., 3, 3] = 1.0
    return poses
