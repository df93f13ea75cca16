"""A motion as CSV: ours (``csv``, ``stream``), or any table whose columns name the time and the joints."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from qparm.errors import InvalidInput
from qparm.verify.readers.columns import WORDS, Columns, find_columns
from qparm.verify.readers.table import motion_table, read_text, time_rounding, value_rounding

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.cell import Cell
    from qparm.verify.motion import MotionTable

__all__ = ["read_csv"]


def read_csv(file: Path, cell: Cell) -> MotionTable:
    """Return the motion in a CSV file with a header; ``format`` is ``"stream"`` if it has periodic positions only."""
    text = read_text(file)
    lines = text.splitlines()
    if not text.endswith("\n"):
        raise InvalidInput(f"{file.name} line {len(lines)} does not end; the file is cut short")
    # numbers of the lines as an editor counts them; empty lines are passed over
    numbered = [(number, line) for number, line in enumerate(lines, 1) if line.strip()]
    try:
        header = [title.strip() for title in next(csv.reader([numbered[0][1]]))]
    except (IndexError, StopIteration, csv.Error):
        raise InvalidInput(f"{file.name} has no header") from None
    if all(_is_number(title) for title in header):
        raise InvalidInput(f"{file.name} line 1 holds numbers; it must name the columns: t, then joints of the cell")
    columns = find_columns(file, header, cell)
    body = numbered[1:]
    if not body:
        raise InvalidInput(f"{file.name} has no line below its header; it may be cut short")
    for number, line in body:
        if line.count(",") != len(header) - 1:
            raise InvalidInput(f"{file.name} line {number} has {line.count(',') + 1} values, the header {len(header)}")
    lines = [line for _, line in body]
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
        position_rounding=lambda: value_rounding(table[:, 1 : 1 + len(columns.joints)], columns.scale),
        time_rounding=exact_times,
        place=lambda k: f"line {body[k][0]}",
        row=_rows(file, words.get(WORDS[0]), body),
        segment=words.get(WORDS[1]),
    )


def _numbers(file: Path, header: list[str], columns: Columns, body: list[tuple[int, str]]) -> NDArray[np.float64]:
    try:
        return np.loadtxt((line for _, line in body), delimiter=",", usecols=columns.numbers, ndmin=2, comments=None)
    except ValueError:
        for number, line in body:
            row = line.split(",")
            for column in columns.numbers:
                if not _is_number(row[column]):
                    raise InvalidInput(
                        f"{file.name} line {number}, column {column + 1} ({header[column]}): {row[column].strip()!r}"
                        " is no number"
                    ) from None
        raise


def _words(lines: list[str], column: int) -> NDArray[np.str_]:
    words = np.loadtxt(lines, delimiter=",", usecols=[column], ndmin=1, comments=None, dtype=np.str_)
    return np.char.strip(words)


def _rows(file: Path, words: NDArray[np.str_] | None, body: list[tuple[int, str]]) -> NDArray[np.int64] | None:
    if words is None:
        return None
    try:
        return words.astype(np.int64)
    except ValueError:
        k = next(k for k, word in enumerate(words) if not word.lstrip("-").isdigit())
        raise InvalidInput(f"{file.name} line {body[k][0]}: the row {str(words[k])!r} is no whole number") from None


def _is_number(text: str) -> bool:
    # not Python's own 1_000
    try:
        float(text)
    except ValueError:
        return False
    return "_" not in text
