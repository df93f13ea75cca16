"""Corners of pose lists: places at which a smooth curve would swing, and where the tool therefore rests.

At a corner the way changes its direction in one step by more than the steps beside it explain. A circle of ten
poses turns by 40 degrees at each of them and has none; a straight line that turns by 20 degrees at one pose has one.
The same is asked of the tool's rotation, and of where it begins and ends to turn on the spot.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from qparm.surface.pose_curve import turns_and_ways

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["Bend", "corners_of", "turns_on_the_spot"]

# A tool that goes less than this per radian (m) turns on the spot.
_ON_THE_SPOT = 5e-5
# A change of direction up to the first is never a corner, beyond the last always; in between if it is more than so many
# times what the steps beside it make likely. Where no other change is beside it, the middle one counts.
_SLIGHT, _ALONE, _SHARP = math.radians(15), math.radians(30), math.radians(75)
_EXPLAINED = 2.5
# Changes of direction within this angle (its cosine) of each other turn alike.
_ALIKE = 0.5


@dataclass(frozen=True)
class Bend:
    """A pose at which a row is parted.

    Attributes
    ----------
    index : int
        Of the pose in its row.
    angle : float
        By which the way, or the tool's turning, changes its direction (rad); 0 where the tool begins or ends to turn
        on the spot.
    what : str
        In words.
    """

    index: int
    angle: float
    what: str


def turns_on_the_spot(poses: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return in which gaps between poses the tool turns without a way of its own, (P - 1,)."""
    turn, way = turns_and_ways(poses)
    return way < _ON_THE_SPOT * turn


def corners_of(poses: NDArray[np.float64]) -> tuple[Bend, ...]:
    """Return the corners of one row of poses (P, 4, 4), in order."""
    from scipy.spatial.transform import Rotation

    if len(poses) < 3:
        return ()
    on_the_spot = turns_on_the_spot(poses)
    R = Rotation.from_matrix(poses[:, :3, :3])
    turns = (R[1:] * R[:-1].inv()).as_rotvec()
    ways = np.diff(poses[:, :3, 3], axis=0)
    found: dict[int, Bend] = {}
    borders = [0, *(np.flatnonzero(np.diff(on_the_spot)) + 1).tolist(), len(ways)]
    for border in borders[1:-1]:
        what = "begins to turn on the spot" if on_the_spot[border] else "goes on after turning on the spot"
        found[border] = Bend(border, 0.0, f"the tool {what}")
    for first, last in pairwise(borders):
        own = slice(first, last)
        steps = turns[own] if on_the_spot[first] else ways[own]
        size = np.linalg.norm(steps, axis=1)
        angle, axis = _changes(steps / size[:, None])
        what = "the tool's turning changes its axis by" if on_the_spot[first] else "the way turns by"
        for k in _corners(angle, axis, size).tolist():
            found[first + k + 1] = Bend(first + k + 1, float(angle[k]), f"{what} {math.degrees(angle[k]):.0f} deg")
        if not on_the_spot[first]:
            # how much the rate of turning changes, over the way of half a gap at either side
            rate = turns[own] / size[:, None]
            change = np.diff(rate, axis=0) * (0.5 * (size[1:] + size[:-1]))[:, None]
            angle = np.linalg.norm(change, axis=1)
            axis = change / np.maximum(angle, 1e-12)[:, None]
            for k in _corners(angle, axis, size).tolist():
                what = f"the tool's turning changes by {math.degrees(angle[k]):.0f} deg from step to step"
                found.setdefault(first + k + 1, Bend(first + k + 1, float(angle[k]), what))
    return tuple(found[index] for index in sorted(found))


def _changes(directions: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the angles between neighbouring unit vectors (k,), and the axes they turn about (k, 3)."""
    before, after = directions[:-1], directions[1:]
    across = np.cross(before, after)
    size = np.linalg.norm(across, axis=1)
    return np.arctan2(size, (before * after).sum(axis=1)), across / np.maximum(size, 1e-12)[:, None]


def _corners(angle: NDArray[np.float64], axis: NDArray[np.float64], size: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return which changes of direction (k,) between steps of given sizes (k + 1,) are corners."""
    if not len(angle):
        return np.empty(0, dtype=np.int64)
    span = 0.5 * (size[1:] + size[:-1])
    likely = np.zeros(len(angle))
    if len(angle) > 1:
        alike = (axis[1:] * axis[:-1]).sum(axis=1) > _ALIKE
        for here, beside in ((slice(1, None), slice(None, -1)), (slice(None, -1), slice(1, None))):
            # what a curve bent like that makes here, where the steps are longer or shorter
            told = angle[beside] * np.maximum(1.0, span[here] / span[beside])
            likely[here] = np.maximum(likely[here], np.where(alike, told, 0.0))
        least = _SLIGHT
    else:
        least = _ALONE
    corner = (angle > _SHARP) | ((angle > least) & (angle > _EXPLAINED * likely))
    return np.flatnonzero(corner)
