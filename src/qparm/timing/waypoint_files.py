"""Joint waypoints and limits from elsewhere, as files: a CSV table, and JSON, TOML or YAML."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from qparm.errors import InvalidInput
from qparm.files.csv_lines import INDEX_NAMES, CsvLines, csv_lines, name_and_unit
from qparm.files.reading import (
    SETTINGS_BYTES,
    guarded,
    number,
    parse_json,
    parse_toml,
    parse_yaml,
    read_text,
    shown,
    shown_value,
)
from qparm.robot import MotionLimits

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["read_limits", "read_waypoint_table"]

_ORDERS = ("velocity", "acceleration", "jerk")
# A column of times: its name, and its unit, if it has one.
_TIME_NAMES = ("t", "time", "__time", "timestamp")
_TIME_UNITS = ("s", "ms", "us", "\u00b5s", "\u03bcs", "ns", "min", "")
# Units of joints that are not those of the limits.
_OTHER_UNITS = (
    "deg",
    "degree",
    "degrees",
    "\u00b0",
    "mrad",
    "grad",
    "mm",
    "cm",
    "um",
    "\u00b5m",
    "\u03bcm",
    "in",
    "inch",
)
# What ROS calls the limits of its joint_limits.yaml.
_BY_JOINT = "joint_limits"


def read_waypoint_table(file: Path) -> tuple[tuple[str, ...], NDArray[np.float64]]:
    """Return joint names and waypoints (N, n) of a CSV file, one waypoint a line.

    A first line that is not all numbers names the joints; it may be a remark (``# a1,a2``). A first column named ``t``
    or ``time``, with or without a unit as in ``Time (ms)``, is left out, but must not run backwards; so is a first
    column that counts the lines (``index``, or without a name).

    Raises
    ------
    InvalidInput
        If the file cannot be read, a line has another number of values, or a value is not a finite number; with
        its line. If times have a unit of something else, or a joint one that is not rad or m.
    """
    read = csv_lines(read_text(file), file)
    names = list(read.header or ())
    columns = len(names) or (len(read.body[0][1].split(",")) if read.body else 0)
    if not columns:
        raise InvalidInput(f"{file.name} is empty")
    first = 0
    while first < len(names) - 1 and _left_out(names[first], file):
        first += 1
    table = _numbers(file, read, columns)
    if first and name_and_unit(names[first - 1])[0].lower() in _TIME_NAMES:
        backwards = np.flatnonzero(np.diff(table[:, first - 1]) < 0)
        if len(backwards):
            raise InvalidInput(f"{file.name} line {read.body[backwards[0] + 1][0]}: time runs backwards")
    joints = tuple(_joint(title, file) for title in names[first:])
    if len(set(joints)) < len(joints):
        raise InvalidInput(f"{file.name}: joint names must differ: {shown(', '.join(joints), longest=200)}")
    return joints, np.ascontiguousarray(table[:, first:])


def read_limits(file: Path, names: Sequence[str] = ()) -> MotionLimits:
    """Return the limits in a JSON, TOML or YAML file with the lists ``velocity``, ``acceleration`` and ``jerk``.

    A YAML file may be a ``joint_limits.yaml`` of ROS instead: a table ``joint_limits`` with ``max_velocity``,
    ``max_acceleration`` and ``max_jerk`` of each joint by its name.

    Parameters
    ----------
    file : Path
    names : sequence of str
        Of the waypoints' joints, for limits by name.

    Raises
    ------
    InvalidInput
        If the file cannot be read, a list is missing, or a limit is not finite and positive.
    """
    text = read_text(file, largest=SETTINGS_BYTES)
    suffix = file.suffix.lower()
    data: Any
    if suffix == ".toml":
        data = parse_toml(text, file)
    elif suffix in (".yaml", ".yml"):
        data = parse_yaml(text, file)
    else:
        data = parse_json(text, file)
    with guarded(file):
        if isinstance(data, Mapping) and isinstance(data.get(_BY_JOINT), Mapping):
            data = _by_joint(file, data[_BY_JOINT], names)
        missing = [order for order in _ORDERS if not isinstance(data, Mapping) or order not in data]
        if missing:
            raise InvalidInput(f"{file.name} must have the lists {', '.join(_ORDERS)}; missing: {', '.join(missing)}")
        for order in _ORDERS:
            _require_numbers(file, order, data[order])
        try:
            return MotionLimits(*(data[order] for order in _ORDERS))
        except InvalidInput as error:
            raise InvalidInput(f"{file.name}: {error}") from None


def _numbers(file: Path, read: CsvLines, columns: int) -> NDArray[np.float64]:
    table = np.empty((len(read.body), columns))
    for at, (line, text) in enumerate(read.body):
        row = text.split(",")
        if len(row) != columns:
            raise InvalidInput(f"{file.name} line {line} has {len(row)} values, the first line {columns}")
        for column, cell in enumerate(row):
            value = number(cell)
            where = f"{file.name} line {line}, column {column + 1}"
            if value is None:
                raise InvalidInput(f"{where}: {shown(cell.strip())!r} is not a number")
            if not np.isfinite(value):
                raise InvalidInput(f"{where}: {shown(cell.strip())} is not finite")
            table[at, column] = value
    return table


def _left_out(header: str, file: Path) -> bool:
    """Return whether a column holds times, or counts the lines."""
    name, unit = name_and_unit(header)
    if name.lower() in INDEX_NAMES and not unit:
        return True
    if name.lower() not in _TIME_NAMES:
        return False
    if unit is not None and unit.lower() not in _TIME_UNITS:
        raise InvalidInput(
            f"{file.name}: the first column, {shown(header)!r}, has no unit of time (s, ms, us, ns, min); rename it if"
            " it is a joint"
        )
    return True


def _joint(title: str, file: Path) -> str:
    """Return a joint's name without its unit, which must be one that needs no conversion."""
    name, unit = name_and_unit(title)
    if (unit or "").lower() in _OTHER_UNITS:
        raise InvalidInput(
            f"{file.name}: the column {shown(title)!r} is in {shown(unit or '')}; write waypoints in rad and m and"
            " their limits in rad/s and m/s, or leave the units out of the names: then waypoints and limits are in"
            " units of your own"
        )
    return name


def _require_numbers(file: Path, order: str, values: object) -> None:
    if not isinstance(values, (list, tuple)):
        raise InvalidInput(f"{file.name}: the {order} limits must be a list of numbers, not {shown_value(values)}")
    for joint, value in enumerate(values):
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise InvalidInput(
                f"{file.name}: the {order} limit of joint {joint} must be a number, not {shown_value(value)}"
            )


def _by_joint(file: Path, table: Mapping[str, Any], names: Sequence[str]) -> dict[str, list[Any]]:
    """Return the lists that limits by joint stand for."""
    if not names:
        raise InvalidInput(
            f"{file.name} has limits by the names of joints; the waypoints need a first line with these names"
        )
    found: dict[str, list[Any]] = {order: [] for order in _ORDERS}
    for name in names:
        limits = table.get(name)
        if not isinstance(limits, Mapping):
            there = shown(", ".join(map(str, table)), longest=200)
            raise InvalidInput(f"{file.name} has no limits of joint {name!r}; it has those of {there or 'none'}")
        for order in _ORDERS:
            if limits.get(f"has_{order}_limits", True) is False or f"max_{order}" not in limits:
                raise InvalidInput(
                    f"{file.name} has no max_{order} of joint {name!r}; all of max_velocity, max_acceleration, max_jerk"
                    " are needed"
                )
            found[order].append(limits[f"max_{order}"])
    return found
