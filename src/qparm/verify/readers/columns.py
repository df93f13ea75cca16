"""A motion as named columns: what tables of every kind (CSV, NPZ, Parquet) call their values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from qparm.errors import InvalidInput
from qparm.files.csv_lines import INDEX_NAMES, name_and_unit
from qparm.files.reading import shown

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.cell import Cell

__all__ = ["TIME_NAMES", "WORDS", "Columns", "find_columns", "scale_of_unit"]

TIME_NAMES = ("t", "time", "time_s", "timestamp", "time_from_start", "__time")
# Columns that are no numbers of joints: row, kind of segment, whether the tool works.
WORDS = ("row", "segment", "process_on")
_PREFIXES = (
    ("q_", "pos_", "position_"),
    ("qd_", "vel_", "velocity_"),
    ("qdd_", "acc_", "acceleration_"),
    ("qddd_", "jerk_"),
)
_SYMBOLS = ("q", "qd", "qdd", "qddd")
_SCALES = {"m": 1.0, "rad": 1.0, "mm": 1e-3, "deg": np.pi / 180}


@dataclass(frozen=True)
class Columns:
    """Where in a table the values are.

    Attributes
    ----------
    time : int
        Column of the time.
    joints : tuple of str
        In the order of the positions' columns.
    orders : tuple of (tuple of int or None)
        For position, velocity, acceleration and jerk the columns of the joints.
    scale : (n,) ndarray
        What makes SI of the file's unit of each joint.
    words : dict of str to int
        Columns of row, segment and process_on.
    """

    time: int
    joints: tuple[str, ...]
    orders: tuple[tuple[int, ...] | None, ...]
    scale: NDArray[np.float64]
    words: dict[str, int]

    @property
    def numbers(self) -> list[int]:
        """The columns that hold times and joints' values."""
        return [self.time, *(column for order in self.orders if order for column in order)]


def scale_of_unit(file: Path, name: str, unit: str, per: str = "") -> float:
    """Return what makes SI of a unit, such as 1e-3 of ``"mm"``, or raise InvalidInput that names the column."""
    base = unit.removesuffix(per) if per else unit
    if base not in _SCALES or (per and base == unit):
        known = ", ".join(f"{known}{per}" for known in _SCALES)
        raise InvalidInput(f"{file.name} column {shown(name)!r}: the unit must be one of {known}, not {shown(unit)!r}")
    return _SCALES[base]


def find_columns(file: Path, header: Sequence[str], cell: Cell) -> Columns:
    """Return where the values are by the columns' names.

    A name is ``t`` or ``time``, in seconds; or a joint's, alone or after ``q_``, ``qd_``, ``qdd_``, ``qddd_`` (or
    ``pos_``, ``vel_``, ``acc_``, ``jerk_``), with or without a unit in brackets, SI without; or ``row``, ``segment``,
    ``process_on``. A first column that counts the lines (``index``, or without a name) is passed over.

    Raises
    ------
    InvalidInput
        If a name is none of these or stands twice, the time or a joint's position is missing, an order is there for
        some joints only, or a unit does not fit its joint.
    """
    kinds = {joint.name: joint.type for joint in cell.arm.joints}
    time = _time_column(file, header, kinds)
    words: dict[str, int] = {}
    found: list[dict[str, int]] = [{}, {}, {}, {}]
    scales: dict[str, float] = {}
    titles = [name_and_unit(title) for title in header]
    prefixed = {f"{prefix}{joint}": joint for joint in kinds for prefix in _PREFIXES[0]}
    own_position = {prefixed[name] for name, _ in titles if name in prefixed}
    for column, (title, (name, unit)) in enumerate(zip(header, titles, strict=True)):
        if column == time or (column == 0 and name.lower() in INDEX_NAMES and name not in kinds):
            continue
        # a joint may be called like one of these columns: then its positions have a prefix
        if name in WORDS and unit is None and (name not in kinds or name in own_position):
            words[name] = column
        else:
            order, joint = _order_and_joint(name, kinds)
            if not joint:
                raise InvalidInput(
                    f"{file.name} column {column + 1} is {shown(title)!r}, which is no joint of the cell: its joints"
                    f" are {', '.join(kinds)}"
                )
            if joint in found[order]:
                raise InvalidInput(f"{file.name} has two columns {shown(title)!r}")
            found[order][joint] = column
            if unit:
                scale = _scale(file, title, unit, order, kinds[joint])
                if scales.setdefault(joint, scale) != scale:
                    raise InvalidInput(
                        f"{file.name} column {shown(title)!r} is not in the unit of the joint's other columns"
                    )
    if time is None:
        raise InvalidInput(f"{file.name} has no column of time, such as t[s]; its first is {shown(header[0])!r}")
    missing = [joint for joint in kinds if joint not in found[0]]
    if missing:
        raise InvalidInput(f"{file.name} has no column of the position of joint {missing[0]!r}, such as q_{missing[0]}")
    joints = tuple(found[0])
    for order, columns in enumerate(found[1:], 1):
        lacking = [joint for joint in joints if joint not in columns]
        if columns and lacking:
            raise InvalidInput(
                f"{file.name} has no column {_SYMBOLS[order]}_{lacking[0]}, though it has those of other joints"
            )
    return Columns(
        time=time,
        joints=joints,
        orders=tuple(tuple(columns[joint] for joint in joints) if columns else None for columns in found),
        scale=np.array([scales.get(joint, 1.0) for joint in joints]),
        words=words,
    )


def _time_column(file: Path, header: Sequence[str], kinds: dict[str, str]) -> int | None:
    """Return the column of the time; of a joint that is called like it, the column that tells seconds."""
    named = [(column, *name_and_unit(title)) for column, title in enumerate(header)]
    named = [(column, name, unit) for column, name, unit in named if name.lower() in TIME_NAMES]
    times = [one for one in named if one[1] not in kinds] or [one for one in named if one[2] == "s"]
    if not times and len(named) == 1 and any(f"{prefix}{named[0][1]}" in _bare(header) for prefix in _PREFIXES[0]):
        times = named
    if len(times) > 1:
        first, second = (shown(header[one[0]]) for one in times[:2])
        raise InvalidInput(f"{file.name} has two columns of time, {first!r} and {second!r}")
    if not times:
        return None
    column, _, unit = times[0]
    if unit not in (None, "", "s"):
        raise InvalidInput(
            f"{file.name} column {shown(header[column])!r}: the time must be in s, not {shown(unit or '')}"
        )
    return column


def _bare(header: Sequence[str]) -> set[str]:
    return {name_and_unit(title)[0] for title in header}


def _order_and_joint(name: str, kinds: dict[str, str]) -> tuple[int, str]:
    if name in kinds:
        return 0, name
    for order, prefixes in enumerate(_PREFIXES):
        for prefix in prefixes:
            if name.startswith(prefix) and name.removeprefix(prefix) in kinds:
                return order, name.removeprefix(prefix)
    return 0, ""


def _scale(file: Path, title: str, unit: str, order: int, kind: str) -> float:
    per = ("", "/s", "/s^2", "/s^3")[order]
    scale = scale_of_unit(file, title, unit, per)
    length = unit.startswith("m")
    if length != (kind == "prismatic"):
        raise InvalidInput(f"{file.name} column {shown(title)!r}: a {kind} joint cannot be in {unit}")
    return scale
