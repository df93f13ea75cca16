"""Workspace of an arm and the share that its work takes: the region, slices of it, coverage of the surface.

The paper argues for its arm with two pictures of workspaces (figures 2 and 3) and the share of them that a large curved
surface uses. Here both are numbers.

- *Reachable region*: points that the tool's origin gets to in some orientation within the position limits, found on a
  cubic lattice (:mod:`qparm.reach.region`). Its volume is the number of lattice points reached times the cell of one.
- *Working space*: points not farther than a depth from the tool path, on the tool's side of it: where the tool is while
  it works, approaches and lifts off. The *share used* is the volume of it that is reached over that of the region.
- *Coverage*: each point of the path with its verdict, and the singularity margin that the arm can attain there.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from qparm.errors import InvalidInput
from qparm.reach import Reach, ReachReason
from qparm.reach.coverage import coverage
from qparm.reach.many_arms import reach_of_designs
from qparm.reach.margin import attainable_margin
from qparm.reach.region import lattice, reach_box, reaches_points

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.cell import Cell
    from qparm.path.relaxation import Relaxation
    from qparm.robot import SerialChain

__all__ = ["Slice", "Workspace", "find_workspace"]

# A slice is this much finer than the region, the working space too.
_FINER = 3.0
# More lattice points than this take minutes.
_MOST_POINTS = 3_000_000


@dataclass(frozen=True, eq=False)
class Slice:
    """A plane section of the reachable region.

    Attributes
    ----------
    name : str
        ``"vertical"`` or ``"horizontal"``.
    origin : (3,) ndarray
        A point of the plane, base frame (m).
    across, up : (3,) ndarray
        Unit vectors in the plane.
    x, y : (nx,), (ny,) ndarray
        Coordinates along them, of the base frame's origin as zero (m).
    reached : (nx, ny) ndarray of bool
    """

    name: str
    origin: NDArray[np.float64]
    across: NDArray[np.float64]
    up: NDArray[np.float64]
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    reached: NDArray[np.bool_]

    def flat(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the coordinates (N, 2) of points (N, 3) projected onto the plane."""
        return np.column_stack([points @ self.across, points @ self.up])

    def distance(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how far points (N, 3) are from the plane (m)."""
        return np.abs((points - self.origin) @ np.cross(self.across, self.up))


@dataclass(frozen=True, eq=False)
class Workspace:
    """What the arm of a cell reaches.

    Attributes
    ----------
    cell : Cell
    spacing : float
        Of the lattice (m).
    points : (M, 3) ndarray
        Lattice points that are reached, base frame.
    rim : (M,) ndarray of bool
        Which of them have a neighbour on the lattice that is not reached.
    volume : float
        Of the region (m^3).
    depth : float
        Of the working space (m).
    used_volume : float
        Of the part of the working space that is reached (m^3).
    slices : tuple of Slice
    reach : tuple of Reach
        One verdict for each point of the path.
    margin : (P,) ndarray
        Largest smallest singular value of the scaled Jacobian found at each point, NaN where it is not reached. Where
        the tool has to turn to reach the point, with the tool as it was found.
    """

    cell: Cell
    spacing: float
    points: NDArray[np.float64]
    rim: NDArray[np.bool_]
    volume: float
    depth: float
    used_volume: float
    slices: tuple[Slice, ...]
    reach: tuple[Reach, ...]
    margin: NDArray[np.float64]

    @property
    def share_used(self) -> float:
        """The working space that is reached, as a share of the region."""
        return self.used_volume / self.volume if self.volume > 0 else 0.0

    @property
    def extent(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Corners of the box around the region, lower and upper, (3,) each (m)."""
        if not len(self.points):
            return np.full(3, np.nan), np.full(3, np.nan)
        half = 0.5 * self.spacing
        return self.points.min(axis=0) - half, self.points.max(axis=0) + half

    @property
    def reasons(self) -> Counter[ReachReason]:
        """How many points of the path have which verdict."""
        return Counter(verdict.reason for verdict in self.reach)

    @property
    def all_reached(self) -> bool:
        """Whether the arm reaches every point of the path."""
        return all(verdict.reason is ReachReason.WITHIN_REACH for verdict in self.reach)

    def numbers(self) -> dict[str, Any]:
        """Return the figures, for JSON."""
        low, high = self.extent
        margin = self.margin[np.isfinite(self.margin)]
        return {
            "cell": self.cell.name,
            "arm": self.cell.arm.name,
            "joints": self.cell.chain().n,
            "region_volume_m3": self.volume,
            "region_extent_m": [_numbers(low), _numbers(high)],
            "working_space_reached_m3": self.used_volume,
            "share_used": self.share_used,
            "points": len(self.reach),
            "points_by_verdict": {reason.value: count for reason, count in sorted(self.reasons.items())},
            "attainable_margin_least": float(margin.min()) if len(margin) else None,
            "attainable_margin_median": float(np.median(margin)) if len(margin) else None,
        }


def find_workspace(
    cell: Cell,
    *,
    spacing: float = 0.05,
    depth: float = 0.1,
    seed: int = 0,
    threads: int | None = None,
    progress: Callable[[str, int, int], None] | None = None,
) -> Workspace:
    """Return what the arm of a cell reaches, and how much of that its work takes.

    Parameters
    ----------
    cell : Cell
    spacing : float
        Of the lattice (m); slices and working space are three times finer.
    depth : float
        How far the working space extends from the tool path (m).
    seed : int
        Of the starts of the searches.
    threads : int, optional
        All cores by default; the answer does not depend on it.
    progress : callable, optional
        ``progress(stage, done, total)``.

    Raises
    ------
    InvalidInput
        If spacing or depth is not positive, or the lattice would have more than three million points.
    """
    for name, value in (("spacing", spacing), ("depth", depth)):
        if not (np.isfinite(value) and value > 0):
            raise InvalidInput(f"{name} must be finite and positive, not {value}")
    chain, poses = cell.chain(), cell.tool_path().poses
    low, high = reach_box(chain)
    _require_few(low, high, spacing)
    _require_few(*_around(poses, depth), spacing / _FINER)
    options: dict[str, Any] = {"seed": seed, "threads": threads}

    def show(done: int) -> None:
        if progress is not None:
            progress("workspace", done, 4)

    show(0)
    points, shape = lattice(low, high, spacing)
    reached = reaches_points(chain, points, **options)
    show(1)
    slices = tuple(_slice(cell, name, spacing / _FINER, options) for name in ("vertical", "horizontal"))
    show(2)
    used = _used_volume(cell, depth, spacing / _FINER, options)
    show(3)
    process = cell.process
    tolerances = {
        "position_tolerance": process.position_tolerance,
        "rotation_tolerance": process.rotation_tolerance,
    }
    relaxation = cell.relaxation()
    verdicts = coverage(chain, poses, relaxation=relaxation, **tolerances, **options)
    margin = np.full(len(poses), np.nan)
    within = np.array([verdict.reason is ReachReason.WITHIN_REACH for verdict in verdicts], dtype=bool)
    stands = _turned_into_reach(chain, poses, relaxation, tolerances | options) if relaxation.free else poses
    margin[within] = attainable_margin(chain, stands[within], **tolerances, **options).margin
    show(4)
    return Workspace(
        cell=cell,
        spacing=spacing,
        points=points[reached],
        rim=_rim(reached.reshape(shape)).ravel()[reached],
        volume=float(reached.sum()) * spacing**3,
        depth=depth,
        used_volume=used,
        slices=slices,
        reach=tuple(verdicts),
        margin=margin,
    )


def _turned_into_reach(
    chain: SerialChain, poses: NDArray[np.float64], relaxation: Relaxation, options: dict[str, Any]
) -> NDArray[np.float64]:
    """Return the poses, where they are within reach with a turned tool only turned as it was found."""
    found = reach_of_designs([chain], poses, relaxation=relaxation, keep_q=True, **options)
    assert found.q is not None
    turn = found.reached[0] & ~reach_of_designs([chain], poses, **options).reached[0]
    turned = poses.copy()
    turned[turn, :3, :3] = chain.forward(found.q[0, turn])[:, :3, :3]
    return turned


def _require_few(low: NDArray[np.float64], high: NDArray[np.float64], spacing: float) -> None:
    count = float(np.prod(np.ceil((high - low) / spacing)))
    if count > _MOST_POINTS:
        raise InvalidInput(f"spacing {spacing * 1e3:.3g} mm makes a lattice of {count:.2g} points; make it wider")


def _around(poses: NDArray[np.float64], depth: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    return poses[:, :3, 3].min(axis=0) - depth, poses[:, :3, 3].max(axis=0) + depth


def _used_volume(cell: Cell, depth: float, spacing: float, options: dict[str, Any]) -> float:
    """Return how much of the working space is reached (m^3)."""
    from scipy.spatial import KDTree

    poses = cell.tool_path().poses
    points, _ = lattice(*_around(poses, depth), spacing)
    distance, nearest = KDTree(poses[:, :3, 3]).query(points, distance_upper_bound=depth)
    near = np.isfinite(distance)
    points, nearest = points[near], np.asarray(nearest)[near]
    # the tool looks along +z into the surface, so it stands at negative z
    outside = ((points - poses[nearest, :3, 3]) * poses[nearest, :3, 2]).sum(axis=1) <= 0
    return float(reaches_points(cell.chain(), points[outside], **options).sum()) * spacing**3


def _slice(cell: Cell, name: str, spacing: float, options: dict[str, Any]) -> Slice:
    """Return the section through the middle of the path: upright and towards it, or level."""
    chain, places = cell.chain(), cell.tool_path().poses[:, :3, 3]
    middle = places[np.linalg.norm(places - places.mean(axis=0), axis=1).argmin()]
    low, high = reach_box(chain)
    if name == "vertical":
        towards = middle - 0.5 * (low + high)
        towards[2] = 0.0
        size = np.linalg.norm(towards)
        across, up = (towards / size if size > 1e-6 else np.array([1.0, 0, 0])), np.array([0, 0, 1.0])
    else:
        across, up = np.array([1.0, 0, 0]), np.array([0, 1.0, 0])
    corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
    flat = np.column_stack([corners @ across, corners @ up])
    axes = [np.arange(a, b + spacing, spacing) for a, b in zip(flat.min(axis=0), flat.max(axis=0), strict=True)]
    normal = np.cross(across, up)
    x, y = np.meshgrid(*axes, indexing="ij")
    points = x[..., None] * across + y[..., None] * up + (middle @ normal) * normal
    reached = reaches_points(chain, points.reshape(-1, 3), **options)
    return Slice(name, middle, across, up, axes[0], axes[1], reached.reshape(x.shape))


def _rim(reached: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which points of a lattice are reached and have one of six neighbours that is not."""
    padded = np.pad(reached, 1)
    inner = np.ones_like(reached)
    for axis in range(3):
        for shift in (-1, 1):
            inner &= np.roll(padded, shift, axis=axis)[1:-1, 1:-1, 1:-1]
    return reached & ~inner


def _numbers(values: NDArray[np.float64]) -> list[float] | None:
    return values.tolist() if np.isfinite(values).all() else None
