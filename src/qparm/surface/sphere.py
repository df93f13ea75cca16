"""A zone of a sphere: the paper's working surface, with everything about it in closed form.

Workpiece frame: centre at the origin, pole along +z, azimuth 0 towards -y and growing towards +x.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from qparm.errors import InvalidInput

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

__all__ = ["SphericalZone"]


@dataclass(frozen=True)
class SphericalZone:
    """The outside of a sphere between two elevations and two azimuths.

    Attributes
    ----------
    radius : float
        m.
    elevation : tuple of float
        From, to (rad), within +-pi/2.
    azimuth : tuple of float
        From, to (rad).
    """

    radius: float
    elevation: tuple[float, float]
    azimuth: tuple[float, float]

    def __post_init__(self) -> None:
        if not (np.isfinite(self.radius) and self.radius > 0):
            raise InvalidInput(f"radius must be finite and positive, not {self.radius}")
        low, high = self.elevation
        if not -np.pi / 2 <= low < high <= np.pi / 2:
            raise InvalidInput(f"elevation must ascend within +-90 deg, not {np.degrees(self.elevation).tolist()} deg")
        left, right = self.azimuth
        if not (np.isfinite(left) and np.isfinite(right) and 0 < right - left <= 2 * np.pi):
            raise InvalidInput(f"azimuth must ascend by at most 360 deg, not {np.degrees(self.azimuth).tolist()} deg")

    # u runs along a row (azimuth), v across the rows (elevation), both from 0 to 1

    def normal(self, u: ArrayLike, v: ArrayLike) -> NDArray[np.float64]:
        """Return the outward unit normals at surface coordinates, (..., 3)."""
        azimuth, elevation = self._angles(u, v)
        return np.stack(
            [
                np.cos(elevation) * np.sin(azimuth),
                -np.cos(elevation) * np.cos(azimuth),
                np.sin(elevation) + 0 * azimuth,
            ],
            axis=-1,
        )

    def point(self, u: ArrayLike, v: ArrayLike) -> NDArray[np.float64]:
        """Return surface points, (..., 3), m."""
        return self.radius * self.normal(u, v)

    def along(self, u: ArrayLike, v: ArrayLike) -> NDArray[np.float64]:
        """Return the unit tangents in the direction of growing u, (..., 3). Defined at the pole too."""
        azimuth, elevation = self._angles(u, v)
        return np.stack([np.cos(azimuth), np.sin(azimuth), 0 * azimuth + 0 * elevation], axis=-1)

    def row_length(self, v: float) -> float:
        """Return the arc length of the row at v from u = 0 to 1 (m)."""
        _, elevation = self._angles(0.0, v)
        return float(self.radius * np.cos(elevation) * (self.azimuth[1] - self.azimuth[0]))

    def column_length(self, v0: float, v1: float) -> float:
        """Return the arc length between two rows at constant u (m)."""
        return self.radius * abs(v1 - v0) * (self.elevation[1] - self.elevation[0])

    def distance(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the signed distance of points (..., 3) from the surface (m), positive outside the workpiece."""
        return np.linalg.norm(np.asarray(points, dtype=float), axis=-1) - self.radius

    @property
    def area(self) -> float:
        """Area of the zone (m^2)."""
        low, high = self.elevation
        return float(self.radius**2 * (self.azimuth[1] - self.azimuth[0]) * (np.sin(high) - np.sin(low)))

    def _angles(self, u: ArrayLike, v: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        azimuth = self.azimuth[0] + np.asarray(u, dtype=float) * (self.azimuth[1] - self.azimuth[0])
        elevation = self.elevation[0] + np.asarray(v, dtype=float) * (self.elevation[1] - self.elevation[0])
        return np.broadcast_arrays(azimuth, elevation)  # type: ignore[return-value]
