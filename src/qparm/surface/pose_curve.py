"""Curves of poses: a spline through given ones by the tool's arc length, turning on the spot, a straight way."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from qparm.surface.arc_length import ArcLength

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["PoseSpline", "StraightWay", "TurnOnTheSpot", "turns_and_ways"]

# Rounds in which the spline's parameter becomes its own arc length; after that only the way is measured.
_ROUNDS = 2
# An end gap this many times the next one is not extrapolated into from there: the curve ends in it without a bend.
_LONG_END = 3.0


def turns_and_ways(poses: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return angle (rad) and distance (m) from each pose to the next, (P - 1,) each."""
    from scipy.spatial.transform import Rotation

    R, p = Rotation.from_matrix(poses[:, :3, :3]), poses[:, :3, 3]
    return (R[:-1].inv() * R[1:]).magnitude(), np.linalg.norm(np.diff(p, axis=0), axis=1)


class PoseSpline:
    """A cubic spline through positions and scipy's RotationSpline through rotations, exact at the poses.

    Both are passed by the arc length of the position, so that the tool moves by 1 m per metre of s everywhere. Between
    any two poses the tool has to move.

    Attributes
    ----------
    s : (P,) ndarray
        The poses' places: arc lengths from the first (m).
    """

    def __init__(self, poses: NDArray[np.float64]) -> None:
        from scipy.interpolate import CubicSpline
        from scipy.spatial.transform import Rotation, RotationSpline

        _, way = turns_and_ways(poses)
        # by chords at first; then by the lengths of the curve that they gave
        self.s = _summed(way)
        for last in (*[False] * _ROUNDS, True):
            ends: Any = _ends(self.s)
            position = CubicSpline(self.s, poses[:, :3, 3], bc_type=ends)
            arc = ArcLength(lambda x, one=position: np.linalg.norm(one(x, 1), axis=1), self.s)
            self.s = np.concatenate([[0.0], arc.way(self.s[1:])])
            if last:
                self._position, self._arc = position, arc
        self._rotation = RotationSpline(self.s, Rotation.from_matrix(poses[:, :3, :3]))

    def __call__(self, s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the (k, 4, 4) poses at places s; beyond the ends those of the ends."""
        s = np.clip(np.asarray(s, dtype=float), 0.0, self.s[-1])
        T = np.tile(np.eye(4), (len(s), 1, 1))
        if len(s):
            T[:, :3, :3] = self._rotation(s).as_matrix()
            T[:, :3, 3] = self._position(self._arc.place(s))
        return T


class TurnOnTheSpot:
    """Turning through given rotations without a way: scipy's RotationSpline by the angle times a radius.

    Attributes
    ----------
    s : (P,) ndarray
        The poses' places: angles from the first times the radius (m).
    """

    def __init__(self, poses: NDArray[np.float64], *, turning_radius: float) -> None:
        from scipy.spatial.transform import Rotation, RotationSpline

        turn, _ = turns_and_ways(poses)
        self.s = _summed(turning_radius * turn)
        self._positions = poses[:, :3, 3].copy()
        self._rotation = RotationSpline(self.s, Rotation.from_matrix(poses[:, :3, :3]))

    def __call__(self, s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the (k, 4, 4) poses at places s; beyond the ends those of the ends."""
        s = np.clip(np.asarray(s, dtype=float), 0.0, self.s[-1])
        T = np.tile(np.eye(4), (len(s), 1, 1))
        if len(s):
            T[:, :3, :3] = self._rotation(s).as_matrix()
            T[:, :3, 3] = np.stack([np.interp(s, self.s, axis) for axis in self._positions.T], axis=1)
        return T


class StraightWay:
    """From one pose to another: a straight line, turning evenly about one axis.

    Attributes
    ----------
    length : float
        Of the line (m); where the tool turns on the spot, the angle times the turning radius. May be zero.
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


def _ends(s: NDArray[np.float64]) -> tuple[str, str]:
    """Return the conditions at both ends of a spline: usually that of the cubic through the first four poses."""
    gaps = np.diff(s)
    if len(gaps) < 2:
        return "natural", "natural"
    first, last = gaps[0] > _LONG_END * gaps[1], gaps[-1] > _LONG_END * gaps[-2]
    return "natural" if first else "not-a-knot", "natural" if last else "not-a-knot"


def _summed(steps: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.concatenate([[0.0], np.cumsum(steps)])
