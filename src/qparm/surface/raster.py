"""The serpentine raster: rows across a parametric surface, their tool frames, the self-motion areas."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, Protocol

import numpy as np

from qparm.errors import InvalidInput
from qparm.path import Row, ToolPath, Transition
from qparm.robot import check_pose

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

__all__ = ["ParametricSurface", "serpentine_raster", "tool_frames"]


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


def serpentine_raster(
    surface: ParametricSurface,
    *,
    rows: int,
    points: int,
    pose_base_workpiece: ArrayLike,
    stand_off: float = 0.0,
    self_motion_points: int = 0,
    transition: Literal["follow", "lift"] = "follow",
    lift: float = 0.0,
) -> ToolPath:
    """Return the s-shaped path over a surface (section 3.2.1 of the paper).

    Parameters
    ----------
    surface : ParametricSurface
    rows, points : int
        r rows of c points, evenly spaced; the rows run back and forth in turn.
    pose_base_workpiece : (4, 4) array_like
        The workpiece in the base frame.
    stand_off : float
        Height of the tool's origin over the surface (m).
    self_motion_points : int
        How many poses at either side of a row end belong to its self-motion area, besides the edge.
    transition : {"follow", "lift"}
        Whether the tool follows the surface from row to row or rises by ``lift`` on the way. Straight
        chords would dip into a convex workpiece, so there are via poses, spaced like the points.
    lift : float
        m.

    Returns
    -------
    ToolPath
    """
    if rows < 1 or points < 2:
        raise InvalidInput(f"a raster needs at least one row of two points, not {rows} of {points}")
    if transition not in ("follow", "lift"):
        raise InvalidInput(f"transition must be 'follow' or 'lift', not {transition!r}")
    pose_base_workpiece = check_pose(pose_base_workpiece, what="pose_base_workpiece")
    if not 0 <= self_motion_points <= points // 2:
        raise InvalidInput(f"self_motion_points must be between 0 and {points // 2}, not {self_motion_points}")
    if not (np.isfinite(stand_off) and np.isfinite(lift) and lift >= 0):
        raise InvalidInput(f"stand_off and lift must be finite, and lift not negative: {stand_off}, {lift}")
    v_of_row = np.linspace(0.0, 1.0, rows) if rows > 1 else np.array([0.5])
    spacing = max(surface.row_length(v) for v in v_of_row) / (points - 1)
    rises = lift if transition == "lift" else 0.0
    all_rows, transitions = [], []
    for i, v in enumerate(v_of_row):
        forwards = i % 2 == 0
        length = surface.row_length(v)
        if length < 1e-9:
            raise InvalidInput(f"row {i} has no length: it lies at a pole of the surface")
        curve = _RowCurve(surface, float(v), length, forwards, stand_off)
        s = np.linspace(0.0, length, points)
        all_rows.append(Row(s=s, poses=curve(s), curve=curve))
        if i + 1 < rows:
            across = surface.column_length(v, v_of_row[i + 1])
            edge = _TransitionCurve(
                surface, 1.0 if forwards else 0.0, float(v), float(v_of_row[i + 1]), across, stand_off, rises
            )
            gaps = max(2, int(np.ceil(edge.length / spacing)))  # at least one via pose, none farther apart than points
            via = np.linspace(0.0, edge.length, gaps + 1)[1:-1]
            transitions.append(Transition(length=edge.length, s=via, poses=edge(via), curve=edge, lifted=rises > 0))
    return ToolPath(
        rows=tuple(all_rows),
        transitions=tuple(transitions),
        pose_base_workpiece=pose_base_workpiece.copy(),
        self_motion_points=self_motion_points,
    )


class _RowCurve:
    """Poses along one row by arc length. A class, not a closure: paths must pickle."""

    def __init__(self, surface: ParametricSurface, v: float, length: float, forwards: bool, stand_off: float) -> None:
        self._surface, self._v, self._length = surface, v, length
        self._forwards, self._stand_off = forwards, stand_off

    def __call__(self, s: NDArray[np.float64]) -> NDArray[np.float64]:
        fraction = np.asarray(s, dtype=float) / self._length
        u = fraction if self._forwards else 1.0 - fraction
        return tool_frames(self._surface, u, self._v, stand_off=self._stand_off)


class _TransitionCurve:
    """Poses from one row to the next at constant u, raised by half a cosine wave."""

    def __init__(
        self,
        surface: ParametricSurface,
        u: float,
        v0: float,
        v1: float,
        length: float,
        stand_off: float,
        rise: float,
    ) -> None:
        self._surface, self._u, self._v0, self._v1 = surface, u, v0, v1
        self._stand_off, self._rise = stand_off, rise
        self.length = length
        # the tool's way is longer than the surface's where it is lifted: measured, and read backwards below
        self._fraction = np.linspace(0.0, 1.0, 2001 if rise > 0 else 2)
        self._way = np.array([0.0, length])
        if rise > 0:
            steps = np.diff(self._poses(self._fraction)[:, :3, 3], axis=0)
            self._way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(steps, axis=1))])
            self.length = float(self._way[-1])

    def __call__(self, s: NDArray[np.float64]) -> NDArray[np.float64]:
        return self._poses(np.interp(np.asarray(s, dtype=float), self._way, self._fraction))

    def _poses(self, fraction: NDArray[np.float64]) -> NDArray[np.float64]:
        v = self._v0 + fraction * (self._v1 - self._v0)
        height = self._stand_off + self._rise * 0.5 * (1.0 - np.cos(2 * np.pi * fraction))
        return tool_frames(self._surface, self._u, v, stand_off=height)
