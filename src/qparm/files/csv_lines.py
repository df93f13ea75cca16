"""Tables of text: the header and the lines below it, whoever wrote them."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

from qparm.errors import InvalidInput
from qparm.files.reading import guarded, number, shown

__all__ = ["INDEX_NAMES", "CsvLines", "csv_lines", "name_and_unit", "split_line"]

# What programs call a column that counts the lines.
INDEX_NAMES = ("", "index", "unnamed: 0", "#", "id")


@dataclass(frozen=True)
class CsvLines:
    """The lines of a table, their numbers as an editor counts them; empty lines and remarks (``#``) are passed over.

    Attributes
    ----------
    header : tuple of str or None
        The first line, stripped, if it is not all numbers. It may be a remark, as ``numpy.savetxt`` writes it, if it
        has as many names as the line below has numbers.
    header_line : int
    body : list of (int, str)
        The other lines; no value in them is in quotes.
    """

    header: tuple[str, ...] | None
    header_line: int
    body: list[tuple[int, str]]


def csv_lines(text: str, name: str | Path) -> CsvLines:
    """Return the lines of a table of comma-separated values.

    Parameters
    ----------
    text : str
    name : str or Path
        Named in errors.

    Raises
    ------
    InvalidInput
        If a value in quotes is not closed or has a comma, or the values are separated by something else.
    """
    remark: tuple[int, str] | None = None
    body: list[tuple[int, str]] = []
    for line, content in enumerate(text.splitlines(), 1):
        stripped = content.strip()
        if stripped.startswith("#"):
            # of several remarks above the numbers the last may be the header
            remark = (line, stripped.lstrip("#")) if not body else remark
        elif stripped:
            body.append((line, content))
    if '"' in text:
        body = [(line, _unquoted(content, line, name)) for line, content in body]
    if not body:
        return CsvLines(None, 0, [])
    first_line, first = body[0]
    fields = split_line(first)
    if not all(number(field) is not None for field in fields):
        if len(fields) == 1 and (";" in first or "\t" in first):
            separator = "semicolons" if ";" in first else "tabs"
            raise InvalidInput(f"{_name(name)} line {first_line} is separated by {separator}; commas are expected")
        return CsvLines(tuple(fields), first_line, body[1:])
    if remark is not None:
        names = split_line(_unquoted(remark[1], remark[0], name) if '"' in remark[1] else remark[1])
        if len(names) == len(fields) and not all(number(field) is not None for field in names):
            return CsvLines(tuple(names), remark[0], body)
    return CsvLines(None, first_line, body)


def split_line(line: str) -> list[str]:
    """Return the values of a line, stripped."""
    return [field.strip() for field in line.split(",")]


def name_and_unit(title: str) -> tuple[str, str | None]:
    """Return the parts of a column's title such as ``"t[s]"`` or ``"time (s)"``; None where no unit is given."""
    title = title.strip()
    for opening, closing in (("[", "]"), ("(", ")")):
        if title.endswith(closing) and opening in title:
            name, _, unit = title[:-1].partition(opening)
            return name.strip(), unit.strip()
    return title, None


def _unquoted(line: str, at: int, name: str | Path) -> str:
    if '"' not in line:
        return line
    with guarded(name):
        fields = next(csv.reader([line], strict=True), [])
    if any("," in field or "\n" in field for field in fields):
        bad = next(field for field in fields if "," in field or "\n" in field)
        raise InvalidInput(f"{_name(name)} line {at}: the value {shown(bad)!r} has a comma inside its quotes")
    return ",".join(fields)


def _name(name: str | Path) -> str:
    return name.name if isinstance(name, Path) else name
