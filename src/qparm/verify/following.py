"""The stretches on which the tool follows its path, how far it is off there, and where it leaves it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from qparm.verify.kinematics import tool_rotation_error
from qparm.verify.passing import places

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.cell import Cell
    from qparm.path import ToolPath
    from qparm.verify.passing import Looks, Passing

__all__ = ["Following", "Piece", "Stretch", "follow", "nearest_on_curve"]

Curve = Callable[["NDArray[np.float64]"], "NDArray[np.float64]"]

_ROUNDS, _STEP = 5, 1e-5
# A tangent is good for so much of the curve about its place.
_NEAR = 2e-3
# A parameter that changes by less (m) moves the nearest distance by far less than a nanometre.
_SETTLED = 1e-7
# Places of a curve among which a first guess is made.
_GUESSES = 400


@dataclass(frozen=True, eq=False)
class Piece:
    """A stretch on which the tool follows a row or a transition.

    Attributes
    ----------
    kind : str
        ``"row"`` or ``"transition"``.
    row : int
        The row, or that which the transition leaves.
    looks : slice
    s : (k,) ndarray
        Where on the curve the tool is nearest (m).
    position, rotation : (k,) ndarray
        How far it is off (m, rad).
    """

    kind: str
    row: int
    looks: slice
    s: NDArray[np.float64]
    position: NDArray[np.float64]
    rotation: NDArray[np.float64]


@dataclass(frozen=True)
class Stretch:
    """A stretch that is no row: the tool travels, or goes from row to row on the surface.

    Attributes
    ----------
    kind : str
        ``"approach"``, ``"transition"``, ``"break"``, ``"retract"``.
    name : str
        The same with the row.
    looks : slice
    """

    kind: str
    name: str
    looks: slice


@dataclass(frozen=True, eq=False)
class Following:
    """How the tool goes along its path.

    Attributes
    ----------
    pieces : tuple of Piece
        Rows and transitions, where they are followed or meant to be.
    stretches : tuple of Stretch
        All that is no row.
    """

    pieces: tuple[Piece, ...]
    stretches: tuple[Stretch, ...]


def follow(
    cell: Cell, tool_path: ToolPath, looks: Looks, passing: Passing, *, position: float, rotation: float
) -> Following:
    """Return the stretches of a motion between the points that it passes.

    Between neighbouring points of a row, and from row to row, the tool follows the path, or leaves it for good: a
    break, on which it gets at least as far away as the cell's clearance. Whatever does neither counts as followed,
    as far off as it is.

    Parameters
    ----------
    cell : Cell
    tool_path : ToolPath
    looks : Looks
    passing : Passing
    position, rotation : float
        Within what the path counts as followed (m, rad).
    """
    pieces: list[Piece] = []
    stretches: list[Stretch] = []
    passed = np.flatnonzero(~np.isnan(passing.t))
    if not len(passed):
        return Following((), (Stretch("approach", "approach", slice(0, len(looks.t))),))

    def between(start: float, end: float) -> slice:
        return slice(int(np.searchsorted(looks.t, start)), int(np.searchsorted(looks.t, end, side="right")))

    def travel(kind: str, name: str, start: float, end: float) -> None:
        # the looks at either side, too: the tool is on the surface there
        inner = between(start, end)
        stretches.append(Stretch(kind, name, slice(max(inner.start - 1, 0), min(inner.stop + 1, len(looks.t)))))

    travel("approach", "approach", 0.0, float(passing.t[passed[0]]))
    row_of, base = tool_path.row_of_point, tool_path.pose_base_workpiece
    for row, one in enumerate(tool_path.rows):
        own = passed[row_of[passed] == row]
        if not len(own):
            continue
        t = passing.t[own]
        inner = between(float(t[0]), float(t[-1]))
        if len(own) > 1 and inner.stop > inner.start:
            guess = np.interp(looks.t[inner], t, tool_path.s[own])
            s, off, turned = _deviation(cell, looks, inner, _placed(base, one.curve), one.length, guess)
            # which gap between points each look is in
            gap = np.clip(np.searchsorted(t, looks.t[inner], side="right") - 1, 0, len(own) - 2)
            followed = (off <= position) & (turned <= rotation)
            missed = np.bincount(gap[~followed], minlength=len(own) - 1) > 0
            first = 0
            for k in [*np.flatnonzero(missed), len(own) - 1]:
                broken = k < len(own) - 1 and _leaves(cell, looks, inner, gap == k, off)
                if k < len(own) - 1 and not broken:
                    continue
                among = (gap >= first) & (gap < k)
                if among.any():
                    at = np.flatnonzero(among)
                    part = slice(inner.start + int(at[0]), inner.start + int(at[-1]) + 1)
                    pieces.append(Piece("row", row, part, s[among], off[among], turned[among]))
                if broken:
                    travel("break", f"break in row {row}", float(t[k]), float(t[k + 1]))
                    first = int(k) + 1
        after = passed[passed > own[-1]]
        if not len(after):
            continue
        start, end, name = float(t[-1]), float(passing.t[after[0]]), f"after row {row}"
        inner = between(start, end)
        if row_of[after[0]] == row + 1 and inner.stop > inner.start and tool_path.transitions[row].length > 0:
            way = tool_path.transitions[row]
            curve = _placed(base, way.curve)
            s, off, turned = _deviation(cell, looks, inner, curve, way.length, None)
            followed = bool(((off <= position) & (turned <= rotation)).all())
            if followed or not _leaves(cell, looks, inner, np.ones(len(off), dtype=bool), off):
                pieces.append(Piece("transition", row, inner, s, off, turned))
                if not way.lifted:
                    travel("transition", f"transition {name}", start, end)
                continue
        travel("break", f"break {name}", start, end)
    travel("retract", "retract", float(passing.t[passed[-1]]), float(looks.t[-1]))
    return Following(tuple(pieces), tuple(stretches))


def nearest_on_curve(
    place: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    points: NDArray[np.float64],
    length: float,
    guess: NDArray[np.float64] | None = None,
) -> NDArray[np.float64]:
    """Return the parameters (N,) at which a curve is nearest to points (N, d).

    Parameters
    ----------
    place : callable
        Points (k, d) of the curve at parameters (k,) from 0 to ``length``.
    points : (N, d) ndarray
    length : float
    guess : (N,) ndarray, optional
        Near the answer; without it the nearest of 400 places of the curve.
    """
    if guess is None:
        from scipy.spatial import KDTree

        at = np.linspace(0.0, length, _GUESSES)
        guess = at[np.asarray(KDTree(place(at)).query(points)[1])]
    step, near = _STEP * length, _NEAR * length
    s = np.clip(guess, 0.0, length - step)
    here = place(s)
    tangent = square = None
    for _ in range(_ROUNDS):
        if tangent is None:
            tangent = (place(s + step) - here) / step
            square = np.maximum((tangent**2).sum(axis=1), 1e-300)
        moved = np.clip(s + ((points - here) * tangent).sum(axis=1) / square, 0.0, length)
        way = float(np.abs(moved - s).max(initial=0.0))
        if way > near:
            # the tangent was that of another place
            moved, tangent = np.clip(moved, 0.0, length - step), None
        s = moved
        if way <= _SETTLED:
            break
        here = place(s)
    return s


def _placed(base: NDArray[np.float64], curve: Curve) -> Curve:
    return lambda s: base @ curve(s)


def _deviation(
    cell: Cell, looks: Looks, part: slice, curve: Curve, length: float, guess: NDArray[np.float64] | None
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return where on a curve the tool is, and how far off (m, rad)."""

    def place(s: NDArray[np.float64]) -> NDArray[np.float64]:
        poses = curve(s)
        return places(cell, poses[:, :3, 3], poses[:, :3, :3])

    count = part.stop - part.start
    s, off, turned = np.empty(count), np.empty(count), np.empty(count)
    for start in range(0, count, 8192):
        own = slice(start, min(start + 8192, count))
        at = slice(part.start + own.start, part.start + own.stop)
        points = places(cell, looks.position[at], looks.rotation[at])
        s[own] = nearest_on_curve(place, points, length, None if guess is None else guess[own])
        poses = curve(s[own])
        off[own] = np.linalg.norm(looks.position[at] - poses[:, :3, 3], axis=1)
        turned[own] = tool_rotation_error(cell, looks.rotation[at], poses[:, :3, :3])
    return s, off, turned


def _leaves(cell: Cell, looks: Looks, part: slice, among: NDArray[np.bool_], off: NDArray[np.float64]) -> bool:
    """Return whether the tool gets away from its path by the clearance, above the surface where there is one."""
    if not among.any():
        return False
    away = off[among]
    distance = cell.distance()
    if distance is not None:
        away = np.asarray(distance(looks.position[part][among]), dtype=float)
    return bool(away.max() >= cell.process.clearance - 1e-6)
