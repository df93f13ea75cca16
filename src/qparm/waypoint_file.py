"""Joint waypoints and limits from elsewhere, as files: a CSV table, and JSON or TOML."""

from __future__ import annotations

import csv
import json
import re
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from qparm.errors import InvalidInput
from qparm.robot import MotionLimits

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["read_limits", "read_waypoint_table"]

_ORDERS = ("velocity", "acceleration", "jerk")
# A column of times: its name, and its unit in brackets, if it has one.
_TIME = re.compile(r"(?:t|time)\s*(?:\[(?P<square>.*)\]|\((?P<round>.*)\))?", re.IGNORECASE)
_TIME_UNITS = ("s", "ms", "us", "\u00b5s", "\u03bcs", "ns", "min")


def read_waypoint_table(file: Path) -> tuple[tuple[str, ...], NDArray[np.float64]]:
    """Return joint names and waypoints (N, n) of a CSV file, one waypoint a line.

    A first line that is not all numbers names the joints. A first column named ``t`` or ``time``, with or without a
    unit as in ``Time (ms)``, is left out, but must not run backwards.

    Raises
    ------
    InvalidInput
        If the file cannot be read, a line has another number of values, or a value is not a finite number; with
        its line. If times have a unit of something else.
    """
    try:
        text = file.read_text(encoding="utf-8-sig")
        lines = [(k, row) for k, row in enumerate(csv.reader(text.splitlines()), 1) if any(x.strip() for x in row)]
    except OSError as error:
        raise InvalidInput(f"{file.name}: {error.strerror or error}") from None
    except (UnicodeDecodeError, csv.Error):
        raise InvalidInput(f"{file.name} is not a table of text") from None
    if not lines:
        raise InvalidInput(f"{file.name} is empty")
    head = [cell.strip() for cell in lines[0][1]]
    named = not all(_is_number(cell) for cell in head)
    if named:
        lines = lines[1:]
    table = np.empty((len(lines), len(head)))
    for at, (number, row) in enumerate(lines):
        if len(row) != len(head):
            raise InvalidInput(f"{file.name} line {number} has {len(row)} values, the first line {len(head)}")
        for column, cell in enumerate(row):
            if not _is_number(cell):
                raise InvalidInput(f"{file.name} line {number}, column {column + 1}: {cell.strip()!r} is no number")
            table[at, column] = float(cell)
            if not np.isfinite(table[at, column]):
                raise InvalidInput(f"{file.name} line {number}, column {column + 1}: {cell.strip()} is not finite")
    names = tuple(cell.partition("[")[0].strip() for cell in head) if named else ()
    if named and _is_time(head[0], file.name):
        backwards = np.flatnonzero(np.diff(table[:, 0]) < 0)
        if len(backwards):
            raise InvalidInput(f"{file.name} line {lines[backwards[0] + 1][0]}: time runs backwards")
        names, table = names[1:], np.ascontiguousarray(table[:, 1:])
    if len(set(names)) < len(names):
        raise InvalidInput(f"{file.name}: joint names must differ: {', '.join(names)}")
    return names, table


def read_limits(file: Path) -> MotionLimits:
    """Return the limits in a JSON or TOML file with the lists ``velocity``, ``acceleration`` and ``jerk``.

    Raises
    ------
    InvalidInput
        If the file cannot be read, a list is missing, or a limit is not finite and positive.
    """
    try:
        text = file.read_text(encoding="utf-8")
        data: Any = tomllib.loads(text) if file.suffix.lower() == ".toml" else json.loads(text)
    except OSError as error:
        raise InvalidInput(f"{file.name}: {error.strerror or error}") from None
    except ValueError as error:  # of JSON, TOML and of the encoding
        raise InvalidInput(f"{file.name} cannot be read: {error}") from None
    missing = [order for order in _ORDERS if not isinstance(data, dict) or order not in data]
    if missing:
        raise InvalidInput(f"{file.name} must have the lists {', '.join(_ORDERS)}; missing: {', '.join(missing)}")
    try:
        return MotionLimits(*(data[order] for order in _ORDERS))
    except InvalidInput as error:
        raise InvalidInput(f"{file.name}: {error}") from None


def _is_time(header: str, file: str) -> bool:
    """Return whether a column holds times."""
    match = _TIME.fullmatch(header)
    if match is None:
        return False
    unit = match["square"] if match["square"] is not None else match["round"]
    if unit is not None and unit.strip().lower() not in _TIME_UNITS:
        raise InvalidInput(
            f"{file}: the first column, {header!r}, has no unit of time (s, ms, us, ns, min); rename it if it is a"
            " joint"
        )
    return True


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
