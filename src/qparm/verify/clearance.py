"""The clearance of the tool point from the workpiece, wherever it is not on a row."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from qparm.verify.interpolate import positions_at
from qparm.verify.kinematics import joint_transforms

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.cell import Cell
    from qparm.cell.work import Process
    from qparm.verify.files import KnotTable, WaypointTable

__all__ = ["LINKS_NOT_CHECKED", "ClearanceFault", "ClearanceFigures", "deepest", "judge_stretch", "measure_clearance"]

# No verdict covers the arm itself: every text that gives one says so, in these words.
LINKS_NOT_CHECKED = "links not checked: the arm itself may touch the workpiece or its surroundings"

# The tool point moves no farther than this between two places that are looked at (m).
_STEP = 2e-3
# Seconds between the places from which the finer ones are counted, and how many there are at least in a piece.
_COARSE, _FEWEST = 0.02, 16
# How deep the tool may be found (m), unless the cell allows it to be farther off its path between points, and how far
# its distance may fall while it leaves.
_DIP = 5e-6
# What a distance loses in a file (m).
_ROUNDING = 1e-6


@dataclass(frozen=True)
class ClearanceFault:
    """A place where the tool point is nearer to the workpiece than it may be.

    Attributes
    ----------
    segment : str
        ``"approach"``, ``"transition"``, ``"break"`` or ``"retract"``, with the row after which it comes.
    time : float
        s.
    distance : float
        Of the tool point from the workpiece (m), negative inside.
    what : str
        ``"inside"``, ``"too near"`` (within the clearance while it travels) or ``"turns back"`` (approaches the
        workpiece while it leaves, or leaves while it returns).
    """

    segment: str
    time: float
    distance: float
    what: str


@dataclass(frozen=True)
class ClearanceFigures:
    """Distances of the tool point from the workpiece off the rows.

    Attributes
    ----------
    least_distance : float
        Anywhere off the rows, transitions on the surface included (m), negative inside; NaN if there is nothing.
    least_clearance : float
        On approach, breaks and retract, without the ways off the surface and back to it (m); NaN if there are none.
    required : float
        The clearance that the cell asks for (m).
    faults : tuple of ClearanceFault
        The worst of each kind on each stretch; if the tool is inside the workpiece there, nothing else.
    """

    least_distance: float
    least_clearance: float
    required: float
    faults: tuple[ClearanceFault, ...]


def measure_clearance(
    cell: Cell, waypoints: WaypointTable, knots: KnotTable, times: NDArray[np.float64]
) -> ClearanceFigures:
    """Return how near the tool point comes to the workpiece between the rows, and before and after them.

    A stretch that travels (approach, break, retract) must leave the surface with a distance that only grows until
    it is clear, keep the clearance, and come back with a distance that only falls. A transition must not dip.

    Parameters
    ----------
    cell : Cell
    waypoints, knots
        As :mod:`qparm.verify.files` reads them.
    times : (N,) ndarray
        When each waypoint is passed (s).
    """
    distance = cell.distance()
    least, clear = float("nan"), float("nan")
    if distance is None:
        return ClearanceFigures(least, clear, cell.process.clearance, ())
    faults: list[ClearanceFault] = []
    for kind, first, last in _stretches(waypoints):
        t, p = _places(cell, knots, times[first : last + 1])
        d = np.asarray(distance(p), dtype=float)
        row = waypoints.row[first]
        name = kind if kind in ("approach", "retract") else f"{kind} after row {row}"
        if kind == "break" and waypoints.row[last] == row:
            name = f"break in row {row}"
        nearest, near, found = judge_stretch(kind, name, t, d, cell.process)
        least, clear = float(np.fmin(least, nearest)), float(np.fmin(clear, near))
        faults += found
    return ClearanceFigures(least, clear, cell.process.clearance, tuple(faults))


def deepest(process: Process) -> float:
    """Return how deep in the workpiece the tool point may be found off the rows (m)."""
    return max(_DIP, process.position_between)


def judge_stretch(
    kind: str, name: str, t: NDArray[np.float64], d: NDArray[np.float64], process: Process, *, blur: float = 0.0
) -> tuple[float, float, list[ClearanceFault]]:
    """Return the least distance on a stretch, that where the tool travels (NaN on a transition), and what is wrong.

    Parameters
    ----------
    kind : str
        ``"approach"``, ``"transition"``, ``"break"`` or ``"retract"``.
    name : str
        What a fault calls the stretch.
    t, d : (k,) ndarray
        Times, and the distances of the tool point from the workpiece there (s, m).
    process : Process
        The cell's: its clearance, and how far the tool may be off its path.
    blur : float
        By how much a distance may be wrong (m).
    """
    clearance, depth = process.clearance - blur, deepest(process) + blur
    worst = int(d.argmin())
    inside = [ClearanceFault(name, float(t[worst]), float(d[worst]), "inside")] if d[worst] < -depth else []
    if kind == "transition":
        return float(d[worst]), float("nan"), inside
    travels = _travelling(d, clearance, leaves=kind != "approach", returns=kind != "retract")
    near = travels.start + int(d[travels].argmin())
    if inside:
        return float(d[worst]), float(d[near]), inside
    faults = []
    if d[near] < clearance - _ROUNDING:
        faults.append(ClearanceFault(name, float(t[near]), float(d[near]), "too near"))
    off, back = np.arange(travels.start + 1), np.arange(len(d) - 1, travels.stop - 2, -1)
    for way in (off, back):
        fall = np.maximum.accumulate(d[way]) - d[way]
        k = int(fall.argmax())
        if fall[k] > _DIP + 2 * blur:
            faults.append(ClearanceFault(name, float(t[way[k]]), float(d[way[k]]), "turns back"))
    return float(d[worst]), float(d[near]), faults


def _stretches(waypoints: WaypointTable) -> list[tuple[str, int, int]]:
    """Return kind, first and last waypoint of all that is no row, in order."""
    on_row, via = waypoints.kind == "row", waypoints.kind == "transition"
    reached = waypoints.status[1:] == "reached"
    rows = on_row[1:] & on_row[:-1] & (np.diff(waypoints.row) == 0) & reached
    follows = (via[1:] & (via | on_row)[:-1]) | (via[:-1] & (via | on_row)[1:])
    kinds = np.where(rows, "row", np.where(follows & reached, "transition", "break"))
    at = np.flatnonzero(on_row)
    if len(at):
        kinds[: at[0]] = "approach"
        kinds[at[-1] :] = "retract"
    stretches: list[tuple[str, int, int]] = []
    for k, kind in enumerate(kinds.tolist()):
        # a row between two breaks may be a single point: the tool is on the surface there
        joins = stretches and stretches[-1][2] == k and stretches[-1][0] == kind and not on_row[k]
        if kind == "row":
            continue
        if joins:
            stretches[-1] = (kind, stretches[-1][1], k + 1)
        else:
            stretches.append((kind, k, k + 1))
    return stretches


def _places(
    cell: Cell, knots: KnotTable, times: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return times and tool points (k, 3), base frame, between which the tool point moves no more than 2 mm."""
    parts = [
        np.linspace(a, b, max(_FEWEST, int(np.ceil((b - a) / _COARSE))), endpoint=False) for a, b in pairwise(times)
    ]
    t = np.append(np.concatenate(parts), times[-1])
    way = np.linalg.norm(np.diff(_tool(cell, knots, t), axis=0), axis=1)
    # chords are shorter than the way: half as many again
    finer = np.maximum(1, np.ceil(1.5 * way / _STEP)).astype(np.int64)
    share = np.arange(finer.sum()) - np.repeat(np.cumsum(finer) - finer, finer)
    t = np.append(np.repeat(t[:-1], finer) + share * np.repeat(np.diff(t) / finer, finer), t[-1])
    return t, _tool(cell, knots, t)


def _tool(cell: Cell, knots: KnotTable, t: NDArray[np.float64]) -> NDArray[np.float64]:
    poses, _ = joint_transforms(cell, positions_at(knots, t))
    return poses[:, :3, 3]


def _travelling(d: NDArray[np.float64], clearance: float, *, leaves: bool, returns: bool) -> slice:
    """Return the places from the first to the last at which the tool is clear; an end that is no surface counts."""
    clear = np.flatnonzero(d >= clearance - _ROUNDING)
    if not len(clear):
        # never clear: the way off ends where it is farthest out
        top = int(d.argmax())
        return slice(top if leaves else 0, top + 1 if returns else len(d))
    return slice(int(clear[0]) if leaves else 0, int(clear[-1]) + 1 if returns else len(d))
