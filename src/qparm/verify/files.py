"""The written files, read back as plain tables; nothing of the planner is needed for it."""

from __future__ import annotations

import csv
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from qparm.errors import InvalidInput
from qparm.files.reading import TEXT_BYTES, guarded, parse_json, read_bytes, read_text

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["KnotTable", "SampleTable", "WaypointTable", "read_knots", "read_samples", "read_waypoints"]

_WAYPOINT_COLUMNS = ("index", "row", "kind", "status", "s[m]")
# No header is longer (bytes), and no value larger (SI).
_LONGEST_LINE, _LARGEST = 1 << 20, 1e15
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
    text = read_bytes(path)
    first, _, rest = text.partition(b"\n")
    if len(first) > _LONGEST_LINE:
        raise InvalidInput(f"{path.name}: its first line is no header: it has {len(first):,} bytes")
    with guarded(path):
        header = next(csv.reader([first.decode("utf-8-sig")]), [])
    if not rest.strip():
        raise InvalidInput(f"{path.name} has no line below its header; it may be cut short")
    if not rest.endswith(b"\n"):
        raise InvalidInput(f"{path.name} does not end with a whole line; it is cut short")
    return header


def _numbers(path: Path, columns: list[int], count: int) -> NDArray[np.float64]:
    with guarded(path, what="a whole table, it may be cut short"), warnings.catch_warnings():
        warnings.simplefilter("error")  # numpy warns of tables without a number
        table = np.loadtxt(path, delimiter=",", skiprows=1, usecols=columns, ndmin=2, comments=None, encoding="utf-8")
    if table.size and not (np.abs(table) <= _LARGEST).all():
        line = int(np.flatnonzero(~(np.abs(table) <= _LARGEST).all(axis=1))[0]) + 2
        raise InvalidInput(f"{path.name} line {line} has a value that is not finite, or beyond {_LARGEST:g}")
    return table.reshape(-1, count)


def _words(path: Path, columns: list[int]) -> NDArray[np.str_]:
    with guarded(path, what="a whole table, it may be cut short"):
        return np.loadtxt(
            path, delimiter=",", skiprows=1, usecols=columns, ndmin=2, dtype=str, comments=None, encoding="utf-8"
        )


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
    message = parse_json(read_text(path, largest=TEXT_BYTES), path)
    # whatever is not where it should be, or not of its kind
    with guarded(path, what="a whole JointTrajectory", foreign=True):
        points = message["points"]
        t = np.array(
            [float(p["time_from_start"]["sec"]) + 1e-9 * float(p["time_from_start"]["nanosec"]) for p in points]
        )
        derivatives = np.array(
            [[p[key] for p in points] for key in ("positions", "velocities", "accelerations")], float
        )
        joints = tuple(message["joint_names"])
        if derivatives.ndim != 3 or derivatives.shape[1:] != (len(t), len(joints)) or not len(t):
            raise ValueError("its points are not of its joints")
        if not all(isinstance(name, str) for name in joints):
            raise ValueError("its joints have no names")
    if not ((np.abs(t) <= _LARGEST).all() and (np.abs(derivatives) <= _LARGEST).all()):
        raise InvalidInput(f"{path.name} has a value that is not finite, or beyond {_LARGEST:g}")
    return KnotTable(joints=joints, t=t, derivatives=derivatives)
