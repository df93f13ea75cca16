"""A motion as a KUKA program: spline blocks with the time that they are to take."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from qparm.errors import InvalidInput
from qparm.reading import read_text
from qparm.verify.readers.program import ARM_AXES, number, program_table

if TYPE_CHECKING:
    from qparm.cell import Cell
    from qparm.verify.motion import MotionTable

__all__ = ["read_krl"]

_POSITION = re.compile(r"(?:DECL\s+\w+\s+)?([A-Za-z_]\w*(?:\[\s*\d+\s*\])?)\s*=\s*(\{.*\})", re.IGNORECASE)
_MOVE = re.compile(r"(S?PTP)\s+(\{[^}]*\}|[A-Za-z_]\w*(?:\[\s*\d+\s*\])?)", re.IGNORECASE)
_TIME = re.compile(r"TIME_BLOCK\s+(START|PART|END)\s*(?:=\s*(\S+))?", re.IGNORECASE)
# Of the end of a block, as programs write it (s).
_TIME_ROUNDING = 0.5e-6


def read_krl(file: Path, cell: Cell) -> MotionTable:
    """Return the motion of a .src, with the positions of the .dat beside it if there is one.

    The first ``PTP`` is the start, at time zero; then come ``PTP_SPLINE`` blocks of ``SPTP``, whose ``TIME_BLOCK``
    tells their time and the shares of it.
    """
    source = file.with_suffix(".src") if file.suffix.lower() == ".dat" else file
    data = source.with_suffix(".dat")
    positions: dict[str, tuple[float, ...]] = {}
    if data.exists():
        lines = _lines(data)
        if not re.match(r"ENDDAT", lines[-1][1], re.IGNORECASE):
            raise InvalidInput(f"{data.name} does not end with ENDDAT; it is cut short")
        for line, text in lines:
            match = _POSITION.match(text)
            if match:
                positions[_key(match.group(1))] = _axes(data, line, match.group(2))
    axes: list[tuple[float, ...]] = []
    places: list[int] = []
    times: list[float] = []
    block: _Block | None = None
    ended = False
    for line, text in _lines(source):
        time = _TIME.match(text)
        move = _MOVE.match(text)
        if re.match(r"PTP_SPLINE\b", text, re.IGNORECASE):
            if not axes:
                raise InvalidInput(f"{source.name} line {line}: a block before the first PTP, its start unknown")
            block = _Block(line)
        elif re.match(r"ENDSPLINE\b", text, re.IGNORECASE):
            if block is None:
                raise InvalidInput(f"{source.name} line {line}: ENDSPLINE without PTP_SPLINE")
            times.extend(block.times(source, times[-1]))
            block = None
        elif re.match(r"END\b", text, re.IGNORECASE):
            ended = True
        elif time is not None and block is not None:
            block.add_time(source, line, time.group(1).upper(), time.group(2))
        elif move is not None:
            target = move.group(2)
            if target.startswith("{"):
                position = _axes(source, line, target)
            elif _key(target) in positions:
                position = positions[_key(target)]
            else:
                raise InvalidInput(f"{source.name} line {line}: the position {target} is not in {data.name}")
            if block is not None:
                block.shares.append(None)
            elif axes:
                raise InvalidInput(f"{source.name} line {line}: a move outside a spline block has no time")
            else:
                times.append(0.0)
            axes.append(position)
            places.append(line)
    if block is not None or not ended:
        raise InvalidInput(f"{source.name} does not end with END; it is cut short")
    return program_table(
        source,
        cell,
        format="krl",
        axes=axes,
        t=times,
        time_rounding=_TIME_ROUNDING,
        place=lambda k: f"line {places[k]}",
    )


class _Block:
    """A spline block: the shares of its time that its moves take."""

    def __init__(self, line: int) -> None:
        self.line = line
        self.shares: list[float | None] = []
        self.end: float | None = None

    def add_time(self, file: Path, line: int, which: str, value: str | None) -> None:
        if which == "START":
            if self.shares:
                raise InvalidInput(f"{file.name} line {line}: the time of a block must start with its first move")
            return
        seconds = number(file, line, value or "")
        if which == "END":
            self.end = seconds
        elif not self.shares or self.shares[-1] is not None:
            raise InvalidInput(f"{file.name} line {line}: TIME_BLOCK PART must come after one move")
        else:
            self.shares[-1] = seconds

    def times(self, file: Path, start: float) -> list[float]:
        if self.end is None or any(share is None for share in self.shares):
            raise InvalidInput(
                f"{file.name} line {self.line}: the block has no TIME_BLOCK END, or a move of it no TIME_BLOCK PART;"
                " when its positions are passed is unknown"
            )
        done = np.cumsum([share for share in self.shares if share is not None])
        return (start + self.end * done / done[-1]).tolist() if len(done) else []


def _lines(file: Path) -> list[tuple[int, str]]:
    lines = [(k, line.partition(";")[0].strip()) for k, line in enumerate(read_text(file).splitlines(), 1)]
    return [(k, line) for k, line in lines if line] or [(1, "")]


def _key(name: str) -> str:
    return re.sub(r"\s", "", name).upper()


def _axes(file: Path, line: int, text: str) -> tuple[float, ...]:
    """Return A1 to A6 and E1 of ``{A1 1.0,A2 2.0,...}``."""
    inner = text.strip("{} ").partition(":")
    found: dict[str, float] = {}
    for part in (inner[2] or inner[0]).split(","):
        name, _, value = part.strip().partition(" ")
        found[name.upper()] = number(file, line, value)
    names = [f"A{k}" for k in range(1, ARM_AXES + 1)]
    missing = [name for name in names if name not in found]
    if missing:
        raise InvalidInput(f"{file.name} line {line}: the position has no {missing[0]}")
    other = [name for name, value in found.items() if name not in (*names, "E1") and value != 0]
    if other:
        raise InvalidInput(f"{file.name} line {line}: the axis {other[0]} is none of A1 to A6 and E1")
    return (*(found[name] for name in names), *([found["E1"]] if "E1" in found else []))
