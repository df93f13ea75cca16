"""Curves of poses: a spline through given ones, and the straight way between two."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["PoseSpline", "StraightWay", "turns_and_ways"]

# Gauss-Legendre points in each gap, and rounds after which the arc length of a spline with corners changes by less
# than a millionth of itself (without corners it has settled after the first).
_QUADRATURE, _ROUNDS = 6, 4


def turns_and_ways(poses: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return angle (rad) and distance (m) from each pose to the next, (P - 1,) each."""
    from scipy.spatial.transform import Rotation

    R, p = Rotation.from_matrix(poses[:, :3, :3]), poses[:, :3, 3]
    return (R[:-1].inv() * R[1:]).magnitude(), np.linalg.norm(np.diff(p, axis=0), axis=1)


class PoseSpline:
    """A cubic spline through positions and scipy's RotationSpline through rotations, C2, exact at the poses.

    Attributes
    ----------
    s : (P,) ndarray
        The poses' places: between two of them the curve's length, or the angle times the turning radius if that is
        more (m).
    """

    def __init__(self, poses: NDArray[np.float64], *, turning_radius: float) -> None:
        from scipy.interpolate import CubicSpline
        from scipy.spatial.transform import Rotation, RotationSpline

        turn, way = turns_and_ways(poses)
        nodes, weights = np.polynomial.legendre.leggauss(_QUADRATURE)
        # by chords at first; then by the lengths of the curve that they gave
        self.s = _summed(np.maximum(way, turning_radius * turn))
        self._position = CubicSpline(self.s, poses[:, :3, 3])
        for _ in range(_ROUNDS):
            half = 0.5 * np.diff(self.s)
            places = self.s[:-1, None] + half[:, None] * (1.0 + nodes)
            speed = np.linalg.norm(self._position(places.ravel(), 1), axis=1).reshape(places.shape)
            self.s = _summed(np.maximum(half * (speed @ weights), turning_radius * turn))
            self._position = CubicSpline(self.s, poses[:, :3, 3])
        self._rotation = RotationSpline(self.s, Rotation.from_matrix(poses[:, :3, :3]))

    def __call__(self, s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the (k, 4, 4) poses at places s; beyond the ends those of the ends."""
        s = np.clip(np.asarray(s, dtype=float), 0.0, self.s[-1])
        T = np.tile(np.eye(4), (len(s), 1, 1))
        if len(s):
            T[:, :3, :3] = self._rotation(s).as_matrix()
            T[:, :3, 3] = self._position(s)
        return T


class StraightWay:
    """From one pose to another: a straight line, turning evenly about one axis.

    Attributes
    ----------
    length : float
        Of the line, or the angle times the turning radius if that is more (m); may be zero.
    """

    def __init__(self, start: NDArray[np.float64], end: NDArray[np.float64], *, turning_radius: float) -> None:
        from scipy.spatial.transform import Rotation

        turn, way = turns_and_ways(np.stack([start, end]))
        self.length = float(max(way[0], turning_radius * turn[0]))
        self._start, self._way = start.copy(), end[:3, 3] - start[:3, 3]
        # in the start's own frame
        self._turn = Rotation.from_matrix(start[:3, :3].T @ end[:3, :3]).as_rotvec()

    def __call__(self, s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the (k, 4, 4) poses at places s."""
        from scipy.spatial.transform import Rotation

        share = np.atleast_1d(np.asarray(s, dtype=float)) / (self.length or 1.0)
        T = np.tile(np.eye(4), (len(share), 1, 1))
        if len(share):
            T[:, :3, :3] = self._start[:3, :3] @ Rotation.from_rotvec(share[:, None] * self._turn).as_matrix()
            T[:, :3, 3] = self._start[:3, 3] + share[:, None] * self._way
        return T


def _summed(steps: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.concatenate([[0.0], np.cumsum(steps)])
