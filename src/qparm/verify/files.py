"""The written files, read back as plain tables; nothing of the planner is needed for it."""

from __future__ import annotations

import csv
import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from qparm.errors import InvalidInput

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["KnotTable", "SampleTable", "WaypointTable", "read_knots", "read_samples", "read_waypoints"]

_WAYPOINT_COLUMNS = ("index", "row", "kind", "status", "s[m]")
_SAMPLE_COLUMNS = ("row", "segment", "process_on")


@dataclass(frozen=True, eq=False)
class WaypointTable:
    """What ``joint_path.csv`` holds.

    Attributes
    ----------
    joints : tuple of str
    index, row : (N,) ndarray of int
        Point of the raster and row, -1 where none.
    kind, status : (N,) ndarray of str
    s : (N,) ndarray
        The tool's arc length within its row or transition (m); elsewhere a parameter of the motion.
    q : (N, n) ndarray
        m and rad.
    """

    joints: tuple[str, ...]
    index: NDArray[np.int64]
    row: NDArray[np.int64]
    kind: NDArray[np.str_]
    status: NDArray[np.str_]
    s: NDArray[np.float64]
    q: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SampleTable:
    """What ``trajectory.csv`` holds.

    Attributes
    ----------
    joints : tuple of str
    t : (T,) ndarray
        s.
    derivatives : (4, T, n) ndarray
        Position, velocity, acceleration, jerk.
    row : (T,) ndarray of int
    segment : (T,) ndarray of str
    process_on : (T,) ndarray of bool
    """

    joints: tuple[str, ...]
    t: NDArray[np.float64]
    derivatives: NDArray[np.float64]
    row: NDArray[np.int64]
    segment: NDArray[np.str_]
    process_on: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class KnotTable:
    """What ``trajectory.json`` holds: times (K,) and position, velocity, acceleration (3, K, n)."""

    joints: tuple[str, ...]
    t: NDArray[np.float64]
    derivatives: NDArray[np.float64]


def _header(path: Path) -> list[str]:
    """Return the columns' names of a table that has at least one whole line below them."""
    try:
        with path.open("rb") as file:
            first, second = file.readline(), file.readline()
            file.seek(-1, 2)
            last = file.read(1)
        header = next(csv.reader([first.decode("utf-8")]), [])
    except FileNotFoundError:
        raise InvalidInput(f"{path.name}: there is no such file") from None
    except OSError:
        raise InvalidInput(f"{path.name} is empty") from None
    except (UnicodeDecodeError, csv.Error):
        raise InvalidInput(f"{path.name} is not a table of text") from None
    if not second:
        raise InvalidInput(f"{path.name} has no line below its header; it may be cut short")
    if last != b"\n":
        raise InvalidInput(f"{path.name} does not end with a whole line; it is cut short")
    return header


def _numbers(path: Path, columns: list[int], count: int) -> NDArray[np.float64]:
    try:
        table = np.loadtxt(path, delimiter=",", skiprows=1, usecols=columns, ndmin=2)
    except (ValueError, IndexError) as error:  # a UnicodeDecodeError is a ValueError
        raise InvalidInput(f"{path.name} cannot be read, it may be cut short: {error}") from None
    if table.size and not np.isfinite(table).all():
        line = int(np.flatnonzero(~np.isfinite(table).all(axis=1))[0]) + 2
        raise InvalidInput(f"{path.name} line {line} has a value that is not finite")
    return table.reshape(-1, count)


def _words(path: Path, columns: list[int]) -> NDArray[np.str_]:
    return np.loadtxt(path, delimiter=",", skiprows=1, usecols=columns, ndmin=2, dtype=str)


def _name(column: str) -> str:
    return column.partition("[")[0]


def read_waypoints(path: Path) -> WaypointTable:
    """Return the table of a ``joint_path.csv``."""
    header = _header(path)
    if tuple(header[:5]) != _WAYPOINT_COLUMNS:
        raise InvalidInput(f"{path.name} must begin with the columns {', '.join(_WAYPOINT_COLUMNS)}, not {header[:5]}")
    columns = [0, 1, *range(4, len(header))]
    numbers = _numbers(path, columns, len(columns))
    words = _words(path, [2, 3]).reshape(-1, 2)
    return WaypointTable(
        joints=tuple(_name(column) for column in header[5:]),
        index=numbers[:, 0].astype(np.int64),
        row=numbers[:, 1].astype(np.int64),
        kind=words[:, 0],
        status=words[:, 1],
        s=numbers[:, 2],
        q=np.ascontiguousarray(numbers[:, 3:]),
    )


def read_samples(path: Path) -> SampleTable:
    """Return the table of a ``trajectory.csv``."""
    header = _header(path)
    n, rest = divmod(len(header) - 4, 4)
    if rest or n < 1 or _name(header[0]) != "t" or tuple(header[-3:]) != _SAMPLE_COLUMNS:
        raise InvalidInput(
            f"{path.name} must have the columns t, four for each joint, {', '.join(_SAMPLE_COLUMNS)};"
            f" it has {len(header)}"
        )
    columns = [*range(4 * n + 2), 4 * n + 3]
    numbers = _numbers(path, columns, len(columns))
    return SampleTable(
        joints=tuple(_name(column).removeprefix("q_") for column in header[1 : n + 1]),
        t=numbers[:, 0],
        derivatives=np.ascontiguousarray(numbers[:, 1 : 4 * n + 1].reshape(-1, 4, n).transpose(1, 0, 2)),
        row=numbers[:, -2].astype(np.int64),
        segment=_words(path, [4 * n + 2])[:, 0],
        process_on=numbers[:, -1] != 0,
    )


def read_knots(path: Path) -> KnotTable:
    """Return the table of a ``trajectory.json``."""
    try:
        message = json.loads(path.read_text(encoding="utf-8"))
        points = message["points"]
        t = np.array([p["time_from_start"]["sec"] + 1e-9 * p["time_from_start"]["nanosec"] for p in points])
        derivatives = np.array(
            [[p[key] for p in points] for key in ("positions", "velocities", "accelerations")], float
        )
        joints = tuple(message["joint_names"])
    except FileNotFoundError:
        raise InvalidInput(f"{path.name}: there is no such file") from None
    except (json.JSONDecodeError, KeyError, TypeError, ValueError) as error:
        raise InvalidInput(f"{path.name} is not a whole JointTrajectory: {error}") from None
    if not (np.isfinite(t).all() and np.isfinite(derivatives).all()):
        raise InvalidInput(f"{path.name} has a value that is not finite")
    return KnotTable(joints=joints, t=t, derivatives=derivatives)
