"""When the tool passes the points of its path: in order, and how near."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from qparm.verify.in_order import passed_in_order
from qparm.verify.kinematics import joint_transforms, tool_rotation_error

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from scipy.spatial import KDTree

    from qparm.cell import Cell
    from qparm.path import ToolPath

__all__ = ["Looks", "Passing", "find_passing", "look_at_tool", "places"]

# Configurations (k, n) at times (k,).
Motion = Callable[["NDArray[np.float64]"], "NDArray[np.float64]"]

_CHUNK = 8192
# What a radian counts where poses are compared on a path that may turn on the spot (m).
_RADIAN = 0.1
# Rounds of the search for the nearest place.
_ROUNDS = 3


@dataclass(frozen=True, eq=False)
class Looks:
    """The tool at many times.

    Attributes
    ----------
    t : (L,) ndarray
        Ascending (s); every sample of the file is among them.
    sample : (L,) ndarray of bool
        Which are samples of the file.
    position : (L, 3), rotation : (L, 3, 3) ndarray
        Of the tool in the base frame (m).
    levers : (n,) ndarray
        How far the tool moves at most when a joint moves by 1 (m, or 1 for a prismatic joint).
    """

    t: NDArray[np.float64]
    sample: NDArray[np.bool_]
    position: NDArray[np.float64]
    rotation: NDArray[np.float64]
    levers: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Passing:
    """When each point is passed.

    Attributes
    ----------
    t : (P,) ndarray
        s; NaN for a point that is not passed.
    position, rotation : (P,) ndarray
        By how much the tool misses the point (m, rad): where it passes, else where it comes nearest.
    nearest : (P,) ndarray
        When that is (s).
    """

    t: NDArray[np.float64]
    position: NDArray[np.float64]
    rotation: NDArray[np.float64]
    nearest: NDArray[np.float64]


def look_at_tool(cell: Cell, t: NDArray[np.float64], sample: NDArray[np.bool_], joints: Motion) -> Looks:
    """Return the tool at given times of a motion."""
    position, rotation = np.empty((len(t), 3)), np.empty((len(t), 3, 3))
    turning = np.array([joint.type == "revolute" for joint in cell.arm.joints])
    levers = np.where(turning, 0.0, 1.0)
    for start in range(0, len(t), _CHUNK):
        part = slice(start, start + _CHUNK)
        poses, axes = joint_transforms(cell, joints(t[part]))
        position[part], rotation[part] = poses[:, :3, 3], poses[:, :3, :3]
        few = slice(None, None, 64)
        arms = np.cross(axes[few, :, :3, 2], poses[few, None, :3, 3] - axes[few, :, :3, 3])
        levers = np.where(turning, np.maximum(levers, np.linalg.norm(arms, axis=2).max(axis=0)), 1.0)
    return Looks(t, sample, position, rotation, levers)


def places(cell: Cell, position: NDArray[np.float64], rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return poses as points (N, d), m: the position, and on a pose list that may turn on the spot the axes too."""
    parts = [position]
    if cell.workpiece.turns_on_the_spot and cell.process.tool_tilt == 0:
        parts.append(_RADIAN * rotation[:, :, 2])
        if cell.process.tool_spin == "fixed":
            parts.append(_RADIAN * rotation[:, :, 0])
    return np.concatenate(parts, axis=1)


def find_passing(
    cell: Cell,
    tool_path: ToolPath,
    looks: Looks,
    joints: Motion,
    *,
    position: float,
    rotation: float,
) -> Passing:
    """Return when the tool passes the points of the path, one after the other.

    Each is passed at a time at which the tool comes nearest to it and is within what is allowed, not before the point
    before it. Poses may come more than once: of all ways to pass the most points in order, the one counts whose rows
    take the least time from their first point to their last (:func:`qparm.verify.in_order.passed_in_order`).

    Parameters
    ----------
    cell : Cell
    tool_path : ToolPath
        The cell's.
    looks : Looks
    joints : callable
        Configurations (k, n) at times (k,).
    position, rotation : float
        Allowed (m, rad).
    """
    from scipy.spatial import KDTree

    at_looks = places(cell, looks.position, looks.rotation)
    poses = tool_path.poses
    at_points = places(cell, poses[:, :3, 3], poses[:, :3, :3])
    step = np.linalg.norm(np.diff(at_looks, axis=0), axis=1).max(initial=0.0)
    tree = KDTree(at_looks)
    point, look = _approaches(tree, at_looks, at_points, 0.6 * step + 10 * position)
    _, closest = tree.query(at_points)
    # the nearest look of all as well: told where no approach is near enough
    P = len(poses)
    point, look = np.append(point, np.arange(P)), np.append(look, np.asarray(closest, dtype=np.int64))
    t = _refined(cell, looks, joints, look, at_points[point])
    reached, _ = joint_transforms(cell, joints(t))
    off = np.linalg.norm(reached[:, :3, 3] - poses[point, :3, 3], axis=1)
    turned = tool_rotation_error(cell, reached[:, :3, :3], poses[point, :3, :3])
    order = np.lexsort((t, point))
    first = np.searchsorted(point[order], np.arange(P + 1))
    good = (off <= position) & (turned <= rotation)
    groups = [order[first[k] : first[k + 1]] for k in range(P)]
    chosen = passed_in_order([own[good[own]] for own in groups], t, tool_path.row_of_point)
    passing = Passing(*(np.full(P, np.nan) for _ in range(4)))
    earliest = -np.inf
    for k, own in enumerate(groups):
        best = int(chosen[k])
        if best >= 0:
            passing.t[k] = earliest = t[best]
        else:
            later = own[t[own] >= earliest]
            among = later if len(later) else own
            best = int(among[(off[among] / position + turned[among] / rotation).argmin()])
        passing.position[k], passing.rotation[k], passing.nearest[k] = off[best], turned[best], t[best]
    return passing


def _approaches(
    tree: KDTree, at_looks: NDArray[np.float64], at_points: NDArray[np.float64], radius: float
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return pairs of point and look: wherever the looks that are near a point come nearest to it, and go on."""
    near = tree.query_ball_point(at_points, radius, return_sorted=True)
    pairs: list[tuple[int, int]] = []
    for k, found in enumerate(near):
        if not found:
            continue
        index = np.array(found)
        distance = np.linalg.norm(at_looks[index] - at_points[k], axis=1)
        apart = np.diff(index) > 1
        nearer = np.diff(distance) < 0
        # from the look before it comes nearer, or is the first; to the look after it does not
        least = np.concatenate([[True], nearer | apart]) & np.concatenate([~nearer | apart, [True]])
        pairs += [(k, look) for look in index[least].tolist()]
    table = np.array(pairs, dtype=np.int64).reshape(-1, 2)
    return table[:, 0], table[:, 1]


def _refined(
    cell: Cell,
    looks: Looks,
    joints: Motion,
    look: NDArray[np.int64],
    target: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the times near given looks at which the tool is nearest to its targets."""

    def at(t: NDArray[np.float64]) -> NDArray[np.float64]:
        poses, _ = joint_transforms(cell, joints(t))
        return places(cell, poses[:, :3, 3], poses[:, :3, :3])

    last = len(looks.t) - 1
    lower, upper = looks.t[np.maximum(look - 1, 0)], looks.t[np.minimum(look + 1, last)]
    t = looks.t[look]
    step = 1e-2 * (upper - lower)
    for _ in range(_ROUNDS):
        before, after = np.maximum(t - step, lower), np.minimum(t + step, upper)
        speed = (at(after) - at(before)) / np.maximum(after - before, 1e-12)[:, None]
        way = ((target - at(t)) * speed).sum(axis=1)
        square = (speed**2).sum(axis=1)
        # at rest every time is as good as another
        t = np.clip(t + np.where(square > 1e-12, way / np.maximum(square, 1e-12), 0.0), lower, upper)
    return t
