"""The serpentine raster: rows across a parametric surface, their tool frames, the self-motion areas."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np

from qparm.errors import InvalidInput
from qparm.path import Row, ToolPath, Transition
from qparm.robot import check_pose
from qparm.surface.arc_length import ArcLength, chebyshev_speed
from qparm.surface.frames import ParametricSurface, tool_frames
from qparm.surface.turn import TurnCurve

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from qparm.path.tool_path import PoseCurve

__all__ = ["serpentine_raster"]


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
    row_end: Literal["stop", "flow"] = "stop",
    overrun: float = 0.01,
) -> ToolPath:
    """Return the s-shaped path over a surface (section 3.2.1 of the paper).

    Parameters
    ----------
    surface : ParametricSurface
    rows, points : int
        r rows of c points, evenly spaced along the tool's way; the rows run back and forth in turn.
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
    row_end : {"stop", "flow"}
        ``stop``: the shortest way from row to row, with a corner at either end. ``flow``: a turn beyond the rows' ends
        (:class:`qparm.surface.TurnCurve`) that can be passed without a stop; the surface must go on there.
    overrun : float
        How far turns lead beyond the rows' ends (m); at most half of the rows' distance.

    Returns
    -------
    ToolPath
    """
    if rows < 1 or points < 2:
        raise InvalidInput(f"a raster needs at least one row of two points, not {rows} of {points}")
    if transition not in ("follow", "lift"):
        raise InvalidInput(f"transition must be 'follow' or 'lift', not {transition!r}")
    if row_end not in ("stop", "flow"):
        raise InvalidInput(f"row_end must be 'stop' or 'flow', not {row_end!r}")
    if not (np.isfinite(overrun) and overrun > 0):
        raise InvalidInput(f"overrun must be finite and positive, not {overrun}")
    pose_base_workpiece = check_pose(pose_base_workpiece, what="pose_base_workpiece")
    if not 0 <= self_motion_points <= points // 2:
        raise InvalidInput(f"self_motion_points must be between 0 and {points // 2}, not {self_motion_points}")
    if not (np.isfinite(stand_off) and np.isfinite(lift) and lift >= 0):
        raise InvalidInput(f"stand_off and lift must be finite, and lift not negative: {stand_off}, {lift}")
    v_of_row = np.linspace(0.0, 1.0, rows) if rows > 1 else np.array([0.5])
    for i, v in enumerate(v_of_row):
        if surface.row_length(v) < 1e-9:
            raise InvalidInput(f"row {i} has no length: it lies at a pole of the surface")
    curves = [_RowCurve(surface, float(v), i % 2 == 0, stand_off) for i, v in enumerate(v_of_row)]
    spacing = max(curve.length for curve in curves) / (points - 1)
    rises = lift if transition == "lift" else 0.0
    all_rows, transitions = [], []
    for i, (v, curve) in enumerate(zip(v_of_row, curves, strict=True)):
        forwards = i % 2 == 0
        s = np.linspace(0.0, curve.length, points)
        all_rows.append(Row(s=s, poses=curve(s), curve=curve))
        if i + 1 < rows:
            ends = (1.0 if forwards else 0.0, float(v), float(v_of_row[i + 1]))
            if row_end == "flow":
                edge = TurnCurve(surface, *ends, overrun=overrun, stand_off=stand_off, lift=rises)
                via = edge.via(spacing)
            else:
                edge = _TransitionCurve(surface, *ends, stand_off, rises)
                gaps = max(
                    2, int(np.ceil(edge.length / spacing))
                )  # one via pose at least, none farther apart than points
                via = np.linspace(0.0, edge.length, gaps + 1)[1:-1]
            transitions.append(Transition(edge.length, via, edge(via), edge, lifted=rises > 0, flows=row_end == "flow"))
    return ToolPath(
        rows=tuple(all_rows),
        transitions=tuple(transitions),
        pose_base_workpiece=pose_base_workpiece.copy(),
        self_motion_points=self_motion_points,
    )


class _RowCurve:
    """Poses along one row by the tool's arc length. A class, not a closure: paths must pickle."""

    def __init__(self, surface: ParametricSurface, v: float, forwards: bool, stand_off: float) -> None:
        self._surface, self._v = surface, v
        self._forwards, self._stand_off = forwards, stand_off
        # the surface's own line is passed evenly; the tool's way at a height over it is another one, and is measured
        self._arc = _measured(self._poses) if stand_off else None
        self.length = self._arc.length if self._arc is not None else surface.row_length(v)

    def __call__(self, s: NDArray[np.float64]) -> NDArray[np.float64]:
        s = np.asarray(s, dtype=float)
        return self._poses(s / self.length if self._arc is None else self._arc.place(s))

    def _poses(self, fraction: NDArray[np.float64]) -> NDArray[np.float64]:
        u = fraction if self._forwards else 1.0 - fraction
        return tool_frames(self._surface, u, self._v, stand_off=self._stand_off)


class _TransitionCurve:
    """Poses from one row to the next at constant u by the tool's arc length, raised by half a cosine wave."""

    def __init__(
        self,
        surface: ParametricSurface,
        u: float,
        v0: float,
        v1: float,
        stand_off: float,
        rise: float,
    ) -> None:
        self._surface, self._u, self._v0, self._v1 = surface, u, v0, v1
        self._stand_off, self._rise = stand_off, rise
        self._arc = _measured(self._poses) if stand_off or rise else None
        self.length = self._arc.length if self._arc is not None else surface.column_length(v0, v1)

    def __call__(self, s: NDArray[np.float64]) -> NDArray[np.float64]:
        s = np.asarray(s, dtype=float)
        return self._poses(s / self.length if self._arc is None else self._arc.place(s))

    def _poses(self, fraction: NDArray[np.float64]) -> NDArray[np.float64]:
        v = self._v0 + fraction * (self._v1 - self._v0)
        height = self._stand_off + self._rise * 0.5 * (1.0 - np.cos(2 * np.pi * fraction))
        return tool_frames(self._surface, self._u, v, stand_off=height)


def _measured(poses: PoseCurve) -> ArcLength:
    """Return the tool's way along a curve of poses over 0 to 1."""
    return ArcLength(chebyshev_speed(lambda x: poses(x)[:, :3, 3], 0.0, 1.0), np.array([0.0, 1.0]))
