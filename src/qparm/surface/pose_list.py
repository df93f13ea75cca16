"""Tool paths from elsewhere: a list of poses as CSV, read into rows with a smooth curve through them.

A row of the list is parted at its corners (:mod:`qparm.surface.corners`): there the tool rests. So what is between two
corners is smooth, and ``s`` is the arc length of the tool point wherever it moves. Where the tool turns on the spot
there is none: ``s`` is then the angle times a turning radius, and at a feed v the tool turns at v over that radius.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from qparm.errors import InvalidInput
from qparm.files.csv_lines import csv_lines, name_and_unit
from qparm.files.reading import TEXT_BYTES, MissingFile, number, read_text, shown
from qparm.path import Corner, Row, ToolPath, Transition
from qparm.robot import check_pose
from qparm.surface.corners import corners_of, turns_on_the_spot
from qparm.surface.pose_curve import PoseSpline, StraightWay, TurnOnTheSpot, turns_and_ways

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

__all__ = ["TURNING_RADIUS", "PoseTable", "pose_list_text", "pose_list_tool_path", "read_pose_list", "wide_gaps"]

# What a radian counts where the tool turns on the spot (m).
TURNING_RADIUS = 0.1
_POSITION, _QUATERNION = ("x", "y", "z"), ("qw", "qx", "qy", "qz")
_OPTIONAL = ("t", "row")
_LENGTHS = {"m": 1.0, "mm": 1e-3}
# No number of a list is larger (of a row: that is still told from the next), and no header longer.
_LARGEST, _LARGEST_ROW, _MOST_COLUMNS = 1e6, 1e15, 1000
# Lines that a sentence names.
_SHOWN = 10
# A gap is wide that is more than so many times the row's median; shorter rows tell nothing.
_WIDE, _FEWEST_GAPS = 8.0, 4
_UNIT_TOLERANCE = 1e-3
# A turn of nearly half a turn between neighbours goes either way round.
_LARGEST_TURN = math.radians(170)
# What differs by less is the same pose written twice (m, rad).
_SAME = 1e-9


@dataclass(frozen=True, eq=False)
class PoseTable:
    """What a pose list holds: at least two poses in each row, neighbours not the same and not half a turn apart.

    Attributes
    ----------
    poses : (P, 4, 4) ndarray
        Workpiece frame, m.
    row : (P,) ndarray of int
        The row of each pose, counted from 0 in the file's order.
    line : (P,) ndarray of int
        Where each pose stands in the file, the header being line 1.
    """

    poses: NDArray[np.float64]
    row: NDArray[np.int64]
    line: NDArray[np.int64]

    def __post_init__(self) -> None:
        for own in _runs(self.row):
            if own.stop - own.start < 2:
                raise InvalidInput(f"the row of line {self.line[own.start]} has one pose only; a row needs two")
        _neighbours_differ(self.poses, self.line, np.diff(self.row) == 0)


def pose_list_text(source: str | Path) -> str:
    """Return a pose list's text: of a file, or what was given if it is the text itself (it has several lines).

    Raises
    ------
    InvalidInput
        If there is no such file or it is not UTF-8 text.
    """
    if isinstance(source, str) and "\n" in source:
        return source
    try:
        return read_text(source, largest=TEXT_BYTES, empty=True)
    except MissingFile:
        raise InvalidInput(f"there is no pose list {str(source)!r}") from None


def read_pose_list(source: str | Path) -> PoseTable:
    """Return the poses of a CSV table.

    Parameters
    ----------
    source : str or Path
        A file, or the text itself. Its first line names the columns, in any order: ``x y z`` in metres,
        ``qw qx qy qz`` a unit quaternion, ``t`` if there is one (not looked at), ``row`` a whole number that
        changes where a new row begins. Lines that are empty or begin with ``#`` are passed over.

    Returns
    -------
    PoseTable

    Raises
    ------
    InvalidInput
        With the line: a column is missing, unknown or named twice; a value is missing, no number or not finite; a
        quaternion is not of unit length within 1e-3; a row comes back or has one pose only; neighbours of a row are
        the same pose or turned by more than 170 deg; the text does not end with a whole line.
    """
    text = pose_list_text(source).removeprefix("\ufeff")
    if not text.strip():
        raise InvalidInput("the pose list is empty")
    if not text.endswith(("\n", "\r")):
        raise InvalidInput(
            f"line {len(text.splitlines())} of the pose list does not end: the list is cut short, or else lacks a line"
            " break after its last value"
        )
    read = csv_lines(text, "the pose list")
    if read.header is None:
        raise InvalidInput(
            f"line {read.body[0][0] if read.body else 1} of the pose list holds numbers; its first line must name the"
            f" columns: {','.join((*_POSITION, *_QUATERNION))}"
        )
    header, scale = _columns(read.header, read.header_line)
    if not read.body:
        raise InvalidInput("the pose list has no line below its header; it may be cut short")
    table = np.array([_numbers(words.split(","), header, line) for line, words in read.body])
    table *= scale
    line = np.array([line for line, _ in read.body], dtype=np.int64)
    column = {name: table[:, k] for k, name in enumerate(header)}
    return PoseTable(_poses(column, line), _rows(column.get("row"), line), line)


def wide_gaps(table: PoseTable) -> list[tuple[int, int, float, float]]:
    """Return the gaps of rows that are many times wider than the others: a new row may be meant to begin there.

    Returns
    -------
    list of (int, int, float, float)
        The lines before and after the gap, its width (m), and how many times the row's median gap that is.
    """
    way = np.linalg.norm(np.diff(table.poses[:, :3, 3], axis=0), axis=1)
    same = np.diff(table.row) == 0
    found: list[tuple[int, int, float, float]] = []
    for own in _runs(table.row):
        inside = way[own.start : own.stop - 1]
        median = float(np.median(inside[inside > 0])) if (inside > 0).any() else 0.0
        if len(inside) < _FEWEST_GAPS or median == 0:
            continue
        for k in np.flatnonzero(inside > _WIDE * median) + own.start:
            assert same[k]
            found.append((int(table.line[k]), int(table.line[k + 1]), float(way[k]), float(way[k] / median)))
    return found


def pose_list_tool_path(
    table: PoseTable,
    *,
    pose_base_workpiece: ArrayLike,
    self_motion_points: int = 0,
    turning_radius: float = TURNING_RADIUS,
) -> ToolPath:
    """Return the tool path through the poses of a list: a spline through each row, straight ways between rows.

    Where a row of the list has a corner it is parted: one row of the path ends in that pose, and the next begins in it.
    A spline through a corner would swing out beside it.

    Parameters
    ----------
    table : PoseTable
    pose_base_workpiece : (4, 4) array_like
        The frame of the poses in the base frame.
    self_motion_points : int
        How many poses at either side of a row end belong to its self-motion area, besides the edge.
    turning_radius : float
        The way (m) that counts for a radian where the tool turns on the spot.

    Returns
    -------
    ToolPath
        Poses from row to row go straight, the tool turning evenly, with via poses no farther apart than the
        points of rows. ``corners`` tells where rows of the list were parted.

    Raises
    ------
    InvalidInput
        If the turning radius is not positive, or there are more self-motion points than half of the shortest row.
    """
    pose_base_workpiece = check_pose(pose_base_workpiece, what="pose_base_workpiece")
    if not (math.isfinite(turning_radius) and turning_radius > 0):
        raise InvalidInput(f"turning_radius must be finite and positive, not {turning_radius}")
    rows: list[Row] = []
    corners: list[Corner] = []
    fewest = len(table.row)
    for own in _runs(table.row):
        first, last = own.start, own.stop
        poses, fewest = np.ascontiguousarray(table.poses[first:last]), min(fewest, last - first)
        bends = corners_of(poses)
        corners += [
            Corner(len(rows) + k, int(table.line[first + bend.index]), poses[bend.index], bend.angle, bend.what)
            for k, bend in enumerate(bends, 1)
        ]
        ends = [0, *(bend.index for bend in bends), last - first - 1]
        rows += [_row(poses[start : end + 1], turning_radius) for start, end in pairwise(ends)]
    if not 0 <= self_motion_points <= fewest // 2:
        raise InvalidInput(
            f"self_motion_points must be between 0 and {fewest // 2} (half of the shortest row), not"
            f" {self_motion_points}"
        )
    spacing = max(float(np.diff(row.s).max()) for row in rows)
    transitions: list[Transition] = []
    for before, after in pairwise(rows):
        way = StraightWay(before.poses[-1], after.poses[0], turning_radius=turning_radius)
        gaps = max(2, math.ceil(way.length / spacing))
        via = np.linspace(0.0, way.length, gaps + 1)[1:-1]
        transitions.append(Transition(length=way.length, s=via, poses=way(via), curve=way, lifted=False))
    return ToolPath(
        rows=tuple(rows),
        transitions=tuple(transitions),
        pose_base_workpiece=pose_base_workpiece.copy(),
        self_motion_points=self_motion_points,
        corners=tuple(corners),
    )


def _runs(row: NDArray[np.int64]) -> list[slice]:
    """Return the poses of each row."""
    ends = np.append(np.flatnonzero(np.diff(row)) + 1, len(row)).tolist()
    return [slice(first, last) for first, last in pairwise([0, *ends])]


def _row(poses: NDArray[np.float64], turning_radius: float) -> Row:
    """Return a row without corners."""
    if turns_on_the_spot(poses)[0]:
        turning = TurnOnTheSpot(poses, turning_radius=turning_radius)
        return Row(s=turning.s, poses=poses, curve=turning, turning_radius=turning_radius)
    curve = PoseSpline(poses)
    return Row(s=curve.s, poses=poses, curve=curve)


def _columns(titles: Sequence[str], line: int) -> tuple[list[str], NDArray[np.float64]]:
    """Return the columns' names and what makes SI of their values."""
    known = (*_OPTIONAL, *_POSITION, *_QUATERNION)
    header: list[str] = []
    scale = np.ones(len(titles))
    for k, title in enumerate(titles):
        name, unit = name_and_unit(title)
        if name in _POSITION and unit:
            if unit not in _LENGTHS:
                raise InvalidInput(f"line {line} of the pose list: {shown(title)!r} must be in {' or '.join(_LENGTHS)}")
            scale[k] = _LENGTHS[unit]
        elif unit and name != "t":
            name = title
        header.append(name)
    repeated = sorted({name for name in header if header.count(name) > 1}) if len(header) < _MOST_COLUMNS else []
    if repeated:
        raise InvalidInput(f"line {line} of the pose list names the column {shown(repeated[0])!r} twice")
    unknown = [name for name in header if name not in known]
    if unknown:
        raise InvalidInput(
            f"line {line} of the pose list names a column {shown(unknown[0])!r}; known are {', '.join(known)}"
        )
    missing = [name for name in (*_POSITION, *_QUATERNION) if name not in header]
    if missing:
        raise InvalidInput(f"line {line} of the pose list must name the columns; missing: {', '.join(missing)}")
    if len(set(scale[[header.index(name) for name in _POSITION]].tolist())) > 1:
        raise InvalidInput(f"line {line} of the pose list: x, y and z must be in one unit")
    return header, scale


def _numbers(words: list[str], header: list[str], line: int) -> list[float]:
    if len(words) != len(header):
        raise InvalidInput(
            f"line {line} of the pose list has {len(words)} values, its header names {len(header)}; it may be cut short"
        )
    values = []
    for word, name in zip(words, header, strict=True):
        value = 0.0 if name == "t" else number(word)
        if value is None:
            raise InvalidInput(f"line {line} of the pose list: {name} is not a number: {shown(word.strip())!r}")
        if not math.isfinite(value):
            raise InvalidInput(f"line {line} of the pose list: {name} is not finite: {shown(word.strip())!r}")
        largest = _LARGEST_ROW if name == "row" else _LARGEST
        if abs(value) > largest:
            raise InvalidInput(f"line {line} of the pose list: {name} is beyond {largest:g}: {shown(word.strip())!r}")
        values.append(value)
    return values


def _poses(column: dict[str, NDArray[np.float64]], line: NDArray[np.int64]) -> NDArray[np.float64]:
    from scipy.spatial.transform import Rotation

    quaternions = np.column_stack([column[name] for name in ("qx", "qy", "qz", "qw")])
    norm = np.linalg.norm(quaternions, axis=1)
    wrong = np.flatnonzero(np.abs(norm - 1.0) > _UNIT_TOLERANCE)
    if len(wrong):
        raise InvalidInput(
            f"line {line[wrong[0]]} of the pose list: its quaternion has length {norm[wrong[0]]:.6g}, not 1"
        )
    poses = np.tile(np.eye(4), (len(line), 1, 1))
    poses[:, :3, :3] = Rotation.from_quat(quaternions / norm[:, None]).as_matrix()
    poses[:, :3, 3] = np.column_stack([column[name] for name in _POSITION])
    return poses


def _rows(label: NDArray[np.float64] | None, line: NDArray[np.int64]) -> NDArray[np.int64]:
    if label is None:
        return np.zeros(len(line), dtype=np.int64)
    broken = np.flatnonzero(label != np.round(label))
    if len(broken):
        raise InvalidInput(f"line {line[broken[0]]} of the pose list: row must be a whole number")
    begins = np.flatnonzero(np.diff(label, prepend=label[0] - 1.0) != 0)
    seen: set[float] = set()
    for k in begins:
        if label[k] in seen:
            raise InvalidInput(
                f"line {line[k]} of the pose list comes back to row {label[k]:.0f}; a row's poses stand together"
            )
        seen.add(float(label[k]))
    return np.cumsum(np.isin(np.arange(len(line)), begins)) - 1


def _neighbours_differ(poses: NDArray[np.float64], line: NDArray[np.int64], same_row: NDArray[np.bool_]) -> None:
    turn, way = turns_and_ways(poses)
    same = np.flatnonzero(same_row & (turn < _SAME) & (way < _SAME))
    if len(same):
        k = int(same[0])
        if len(same) == 1:
            raise InvalidInput(f"line {line[k + 1]} of the pose list repeats the pose of line {line[k]}; leave one out")
        raise InvalidInput(
            f"line {line[k + 1]} of the pose list repeats the pose of line {line[k]}; {len(same)} lines repeat the one"
            f" before them, leave them out: {', '.join(map(str, line[same[:_SHOWN] + 1].tolist()))}"
            f"{', ...' if len(same) > _SHOWN else ''}"
        )
    wide = np.flatnonzero(same_row & (turn > _LARGEST_TURN))
    if len(wide):
        k = int(wide[0])
        raise InvalidInput(
            f"lines {line[k]} and {line[k + 1]} of the pose list are turned by {math.degrees(turn[k]):.0f} deg against"
            " each other; up to 170 deg it is plain which way round the tool turns"
        )
