"""A motion as CSV: ours (``csv``, ``stream``), or any table whose columns name the time and the joints."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from qparm.errors import InvalidInput
from qparm.files.csv_lines import csv_lines
from qparm.files.reading import guarded, number, read_text, shown, whole_number
from qparm.verify.readers.columns import WORDS, Columns, find_columns
from qparm.verify.readers.table import converted_rounding, motion_table, time_rounding

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.cell import Cell
    from qparm.verify.motion import MotionTable

__all__ = ["read_csv"]


def read_csv(file: Path, cell: Cell) -> MotionTable:
    """Return the motion in a CSV file with a header; ``format`` is ``"stream"`` if it has periodic positions only."""
    text = read_text(file)
    if not text.endswith(("\n", "\r")):
        raise InvalidInput(
            f"{file.name} line {len(text.splitlines())} does not end; the file is cut short, or else lacks a line break"
            " after its last value"
        )
    read = csv_lines(text, file)
    body, header = read.body, read.header
    if header is None:
        if not body:
            raise InvalidInput(f"{file.name} has no header")
        raise InvalidInput(
            f"{file.name} line {body[0][0]} holds numbers; it must name the columns: t, then joints of the cell"
        )
    columns = find_columns(file, header, cell)
    if not body:
        raise InvalidInput(f"{file.name} has no line below its header; it may be cut short")
    for number_, line in body:
        if line.count(",") != len(header) - 1:
            raise InvalidInput(f"{file.name} line {number_} has {line.count(',') + 1} values, the header {len(header)}")
    lines = [line for _, line in body]
    with guarded(file):
        table = _numbers(file, header, columns, body)
    t, derivatives = table[:, 0], []
    at = 1
    for order in columns.orders:
        derivatives.append(None if order is None else table[:, at : at + len(order)])
        at += 0 if order is None else len(order)
    words = {name: _words(lines, column) for name, column in columns.words.items()}
    exact_times = time_rounding(t)
    periodic = exact_times == 0.0 and len(t) > 2
    alone = all(order is None for order in columns.orders[1:]) and not words
    return motion_table(
        file,
        cell,
        format="stream" if alone and periodic else "csv",
        joints=columns.joints,
        t=t - t[0],
        derivatives=[None if values is None else values * columns.scale for values in derivatives],
        position_rounding=lambda: converted_rounding(table[:, 1 : 1 + len(columns.joints)], columns.scale),
        time_rounding=exact_times,
        place=lambda k: f"line {body[k][0]}",
        row=_rows(file, words.get(WORDS[0]), body),
        segment=words.get(WORDS[1]),
    )


def _numbers(file: Path, header: Sequence[str], columns: Columns, body: list[tuple[int, str]]) -> NDArray[np.float64]:
    try:
        return np.loadtxt((line for _, line in body), delimiter=",", usecols=columns.numbers, ndmin=2, comments=None)
    except (ValueError, OverflowError):
        for line, text in body:
            row = text.split(",")
            for column in columns.numbers:
                if number(row[column]) is None:
                    raise InvalidInput(
                        f"{file.name} line {line}, column {column + 1} ({shown(header[column])}):"
                        f" {shown(row[column].strip())!r} is not a number"
                    ) from None
        raise


def _words(lines: list[str], column: int) -> NDArray[np.str_]:
    # not by the longest: numpy keeps that much room for every one
    return np.array([shown(line.split(",")[column].strip()) for line in lines], dtype=np.str_)


def _rows(file: Path, words: NDArray[np.str_] | None, body: list[tuple[int, str]]) -> NDArray[np.int64] | None:
    if words is None:
        return None
    numbers = [whole_number(word) for word in words.tolist()]
    if None in numbers:
        k = numbers.index(None)
        raise InvalidInput(f"{file.name} line {body[k][0]}: the row {str(words[k])!r} is not an integer")
    return np.array(numbers, dtype=np.int64)
