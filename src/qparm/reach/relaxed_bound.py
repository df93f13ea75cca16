"""Reach bounds for a tool that may spin or tilt: a proof that no way of turning it brings it within reach.

While the tool turns about its tip, the arm's last point (:mod:`qparm.robot.reach`) moves on a band of a sphere: all
points whose direction from the tip makes an angle between two bounds with an axis. Where the spin is free that is the
tool's axis, and the band is exact. Without it, the band is the cap around the nominal direction as far as the tilt
leads, which holds all that the tilt can do.

*Too far* is proved by a plane: for any unit vector u, travel and band are no nearer than

    min u.s  -  max u.w         (s on the travel, w in the band)

and both are known in closed form. u comes from alternating between the nearest points of the two.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from qparm.robot.reach import reach_excess

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.path.relaxation import Relaxation
    from qparm.robot import SerialChain

__all__ = ["relaxed_excess"]

# Alternations between travel and band; any number gives a valid bound.
_ALTERNATIONS = 8
# Left for rounding (m), as for the fixed tool.
_ROUNDING = 1e-6


@dataclass(frozen=True, eq=False)
class _Band:
    """Where the arm's last point may be: on spheres of one radius (m) about ``center`` (N, 3), near ``axis`` (N, 3)."""

    center: NDArray[np.float64]
    axis: NDArray[np.float64]
    radius: float
    least: float
    most: float

    def angle(self, v: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the angles of vectors (N, 3) with the axes."""
        return np.arctan2(np.linalg.norm(np.cross(self.axis, v), axis=1), (self.axis * v).sum(axis=1))

    def distance(self, v: NDArray[np.float64], angle: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how far points at ``center + v`` are from those of the sphere that are seen under an angle to v."""
        size = np.linalg.norm(v, axis=1)
        # sin^2 of the half angle, for the squares cancel
        return np.sqrt((size - self.radius) ** 2 + 4 * size * self.radius * np.sin(0.5 * angle) ** 2)

    def nearest(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the band's points nearest to (N, 3)."""
        v = point - self.center
        angle = np.clip(self.angle(v), self.least, self.most)
        across = v - (v * self.axis).sum(axis=1, keepdims=True) * self.axis
        size = np.linalg.norm(across, axis=1, keepdims=True)
        other = np.where(np.abs(self.axis[:, :1]) < 0.6, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
        side = np.cross(self.axis, other)
        side /= np.linalg.norm(side, axis=1, keepdims=True)
        across = np.where(size > 1e-12, across / np.maximum(size, 1e-300), side)
        return self.center + self.radius * (np.cos(angle)[:, None] * self.axis + np.sin(angle)[:, None] * across)

    def support(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the largest u.w over the band, (N,), for unit vectors (N, 3)."""
        angle = self.angle(u)
        off = np.maximum(np.maximum(self.least - angle, angle - self.most), 0.0)
        return (u * self.center).sum(axis=1) + self.radius * np.cos(off)

    def farthest(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the largest distance of the band's points from one point, (N,)."""
        v = point - self.center
        angle = self.angle(v)
        opposite = np.minimum(angle + self.most, np.pi)
        return self.distance(v, np.where(angle + self.least > np.pi, 2 * np.pi - angle - self.least, opposite))


def _band(wrist: NDArray[np.float64], targets: NDArray[np.float64], relaxation: Relaxation) -> _Band:
    radius = float(np.linalg.norm(wrist))
    if relaxation.spin:
        axis = np.array([0.0, 0.0, 1.0])
        angle = float(np.arctan2(np.hypot(wrist[0], wrist[1]), wrist[2]))
    else:
        axis, angle = wrist / radius, 0.0
    return _Band(
        center=targets[:, :3, 3],
        axis=targets[:, :3, :3] @ axis,
        radius=radius,
        least=max(angle - relaxation.tilt, 0.0),
        most=min(angle + relaxation.tilt, np.pi),
    )


def relaxed_excess(
    chain: SerialChain, targets: NDArray[np.float64], relaxation: Relaxation
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return by how much poses lie beyond the greatest reach, and short of the least, however the tool is turned.

    Parameters
    ----------
    chain : SerialChain
    targets : (N, 4, 4) ndarray
    relaxation : Relaxation

    Returns
    -------
    too_far, too_near : (N,) ndarray
        In m, positive proves it; -inf where nothing is known.
    """
    bound = chain.reach_bound
    if bound is None or not relaxation.free or np.linalg.norm(bound.wrist) < _ROUNDING:
        return reach_excess(chain, targets)
    band = _band(bound.wrist, targets, relaxation)
    shoulder, wrist = bound.nearest_shoulder(band.center), band.center
    for _ in range(_ALTERNATIONS):
        wrist = band.nearest(shoulder)
        shoulder = bound.nearest_shoulder(wrist)
    u = shoulder - wrist
    u /= np.maximum(np.linalg.norm(u, axis=1, keepdims=True), 1e-300)
    along = u @ bound.travel_axes
    nearest = u @ bound.shoulder + np.minimum(along * bound.travel[:, 0], along * bound.travel[:, 1]).sum(axis=1)
    farthest = np.zeros(len(targets))
    for t in itertools.product(*bound.travel):
        farthest = np.maximum(farthest, band.farthest(bound.shoulder + bound.travel_axes @ np.array(t)))
    return nearest - band.support(u) - bound.reach - _ROUNDING, bound.least_reach - farthest - _ROUNDING
