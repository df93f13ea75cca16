"""A motion as a KUKA program: spline blocks with the time that they are to take."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from qparm.errors import InvalidInput
from qparm.verify.readers.program import ARM_AXES, not_understood, number, program_lines, program_table

if TYPE_CHECKING:
    from qparm.cell import Cell
    from qparm.verify.motion import MotionTable

__all__ = ["read_krl"]

_NAME = r"[A-Z_]\w*"
_PLACE = rf"{_NAME}(?:\s*\[\s*\d+\s*\])?"
_PLAIN = "INT|REAL|BOOL|CHAR|AXIS|E6AXIS|POS|E6POS|FRAME|FDAT|PDAT|LDAT"


def _grammar(text: str) -> re.Pattern[str]:
    return re.compile(text, re.IGNORECASE | re.ASCII)


_ATTRIBUTE = _grammar(r"&\s*(?:ACCESS|REL|PARAM|COMMENT|USER)\b.*")
_DEF = _grammar(rf"(?:GLOBAL\s+)?DEF\s+({_NAME})\s*\(\s*\)")
_DEFDAT = _grammar(rf"DEFDAT\s+({_NAME})(?:\s+PUBLIC)?")
_POSITION = _grammar(rf"(?:(?:GLOBAL\s+)?(?:DECL\s+)?(?:GLOBAL\s+)?({_NAME})\s+)?({_PLACE})\s*=\s*(\{{[^{{}}]*\}})")
_POINT = _grammar(rf"(S?PTP)\s*(\{{[^{{}}]*\}}|(?<=\s){_PLACE})")
_TIME = _grammar(r"TIME_BLOCK\s+(?:(START)|(PART|END)\s*=\s*(\S+))")
_SPEED = _grammar(r"BAS\s*\(\s*#(VEL_PTP|ACC_PTP)\s*,\s*([^,()]+)\)")
# What moves nothing: declarations without a value, the controller's own settings, digital outputs.
_STILL = _grammar(
    rf"(?:DECL\s+)?(?:{_PLAIN})\s+{_PLACE}(?:\s*,\s*{_PLACE})*"
    r"|EXT\s+BAS\s*\(\s*BAS_COMMAND\s*:\s*IN\s*,\s*REAL\s*:\s*IN\s*\)"
    r"|BAS\s*\(\s*#INITMOV\s*,\s*0\s*\)"
    r"|BAS\s*\(\s*#(?:TOOL|BASE)\s*,\s*\d+\s*\)"
    r"|\$OUT\s*\[\s*\d+\s*\]\s*=\s*(?:TRUE|FALSE)"
)
# A constant of a data list that is no position.
_VALUE = _grammar(rf"(?:DECL\s+)?(?:INT|REAL|BOOL)\s+{_PLACE}\s*=\s*(?:[+-]?[\d.]+(?:E[+-]?\d+)?|TRUE|FALSE)")
# Of the end of a block, as programs write it (s), and of the shares of its time.
_TIME_ROUNDING, _SHARE_ROUNDING = 0.5e-6, 0.5e-11
_WHOLE = 100.0  # per cent
_TIMES = "whether the controller keeps the times that the program asks for"


def read_krl(file: Path, cell: Cell) -> MotionTable:
    """Return the motion of a .src, with the positions of the .dat beside it if there is one.

    The first ``PTP`` is the start, at time zero; then come ``PTP_SPLINE`` blocks of ``SPTP``, whose ``TIME_BLOCK``
    tells their time and the shares of it. Every other line must be known to move nothing.
    """
    source = file.with_suffix(".src") if file.suffix.lower() == ".dat" else file
    data = source.with_suffix(".dat")
    lines = program_lines(source, comment=";")
    program = _Program(source, data.name)
    owner = ""
    if data.exists():
        owner, program.positions = _positions(data)
    for line, text in lines:
        program.read(line, text)
    if not program.ended:
        raise InvalidInput(f"{source.name} does not end with END; it is cut short")
    if owner and owner != program.name:
        raise InvalidInput(f"{data.name} is the data list of {owner}, {source.name} is the program {program.name}")
    return program_table(
        source,
        cell,
        format="krl",
        axes=program.axes,
        t=program.times,
        time_rounding=round(_TIME_ROUNDING + _SHARE_ROUNDING * program.longest, 9),
        place=lambda k: f"line {program.places[k]}",
        stops=program.stops,
        not_told=(_TIMES, *program.not_told.values()),
    )


@dataclass
class _Block:
    """A spline block: the shares of its time that its moves take."""

    file: Path
    line: int
    started: bool = False
    shares: list[float | None] = field(default_factory=list)
    end: float | None = None

    def add_time(self, line: int, which: str, value: str) -> None:
        if which == "START":
            if self.shares or self.started:
                raise InvalidInput(f"{self.file.name} line {line}: the time of a block must start with its first move")
            self.started = True
            return
        amount = number(self.file, line, value)
        if not amount > 0:
            raise InvalidInput(f"{self.file.name} line {line}: the time must be greater than zero, not {value}")
        if which == "END":
            self.end = amount
        elif not self.shares or self.shares[-1] is not None:
            raise InvalidInput(f"{self.file.name} line {line}: TIME_BLOCK PART must come after one move")
        else:
            self.shares[-1] = amount

    def times(self, start: float) -> list[float]:
        """Return when each move of the block ends."""
        if self.end is None or any(share is None for share in self.shares):
            raise InvalidInput(
                f"{self.file.name} line {self.line}: the block has no TIME_BLOCK END, or a move of it no"
                " TIME_BLOCK PART; when its positions are passed is unknown"
            )
        if not self.shares:
            raise InvalidInput(f"{self.file.name} line {self.line}: the block has no move")
        done = np.cumsum([share for share in self.shares if share is not None])
        return (start + self.end * done / done[-1]).tolist()


class _Program:
    """A .src as it is read, line by line."""

    def __init__(self, file: Path, data: str) -> None:
        self.file, self.data, self.name = file, data, ""
        self.positions: dict[str, tuple[float, ...]] = {}
        self.axes: list[tuple[float, ...]] = []
        self.places: list[int] = []
        self.times: list[float] = []
        self.stops: list[int] = []
        self.longest = 0.0
        self.not_told: dict[str, str] = {}
        self.ended = False
        self._block: _Block | None = None
        self._slow: dict[str, tuple[float, int]] = {}

    def read(self, line: int, text: str) -> None:
        """Take a line in, or refuse it."""
        upper = text.upper()
        if self.ended:
            raise not_understood(self.file, line, text, " after END")
        if not self.name:
            self._head(line, text)
        elif self._block is not None:
            self._inside(self._block, line, text)
        elif upper == "PTP_SPLINE":
            self._begin(line)
        elif upper == "ENDSPLINE":
            raise InvalidInput(f"{self.file.name} line {line}: ENDSPLINE without PTP_SPLINE")
        elif upper == "END":
            self.ended = True
        elif _TIME.fullmatch(text):
            raise InvalidInput(
                f"{self.file.name} line {line}: a move outside a spline block has no time; TIME_BLOCK belongs in"
                " PTP_SPLINE"
            )
        elif point := _POINT.fullmatch(text):
            if point[1].upper() == "SPTP" or self.axes:
                raise InvalidInput(f"{self.file.name} line {line}: a move outside a spline block has no time")
            self.times.append(0.0)
            self.stops.append(0)
            self._move(line, point[2])
        elif speed := _SPEED.fullmatch(text):
            self._slow[speed[1].upper()] = (number(self.file, line, speed[2]), line)
        elif not _STILL.fullmatch(text):
            raise not_understood(self.file, line, text)

    def _head(self, line: int, text: str) -> None:
        start = _DEF.fullmatch(text)
        if start:
            self.name = start[1].upper()
        elif not _ATTRIBUTE.fullmatch(text):
            raise not_understood(self.file, line, text, " before DEF")

    def _begin(self, line: int) -> None:
        if not self.axes:
            raise InvalidInput(f"{self.file.name} line {line}: a block before the first PTP, its start unknown")
        for what, (share, where) in self._slow.items():
            if share != _WHOLE:
                told = f"whether {what} of {share:g} % (line {where}) leaves the axes fast enough"
                self.not_told.setdefault(what, told)
        self._block = _Block(self.file, line)

    def _inside(self, block: _Block, line: int, text: str) -> None:
        if text.upper() == "ENDSPLINE":
            start = self.times[-1]
            self.times.extend(block.times(start))
            self.longest = max(self.longest, self.times[-1] - start)
            self.stops.append(len(self.times) - 1)
            self._block = None
        elif text.upper() == "END":
            raise InvalidInput(f"{self.file.name} line {line}: END in the block of line {block.line}, which has no"
                               " ENDSPLINE")  # fmt: skip
        elif block.end is not None:
            raise not_understood(self.file, line, text, " between TIME_BLOCK END and ENDSPLINE")
        elif time := _TIME.fullmatch(text):
            block.add_time(line, (time[1] or time[2]).upper(), time[3] or "")
        elif (point := _POINT.fullmatch(text)) and point[1].upper() == "SPTP":
            block.shares.append(None)
            self._move(line, point[2])
        else:
            raise not_understood(self.file, line, text, " in a spline block")

    def _move(self, line: int, target: str) -> None:
        if target.startswith("{"):
            position = _axes(self.file, line, target)
        elif _key(target) in self.positions:
            position = self.positions[_key(target)]
        else:
            raise InvalidInput(f"{self.file.name} line {line}: the position {target} is not in {self.data}")
        self.axes.append(position)
        self.places.append(line)


def _positions(file: Path) -> tuple[str, dict[str, tuple[float, ...]]]:
    """Return the program that a data list belongs to, and its positions; every line must be a declaration."""
    owner, found = "", dict[str, tuple[float, ...]]()
    lines = program_lines(file, comment=";")
    if not lines or lines[-1][1].upper() != "ENDDAT":
        raise InvalidInput(f"{file.name} does not end with ENDDAT; it is cut short")
    for line, text in lines[:-1]:
        start = _DEFDAT.fullmatch(text)
        if not owner and start:
            owner = start[1].upper()
        elif not owner:
            if not _ATTRIBUTE.fullmatch(text):
                raise not_understood(file, line, text, " before DEFDAT")
        elif value := _POSITION.fullmatch(text):
            if (value[1] or "AXIS").upper() not in ("AXIS", "E6AXIS"):
                continue  # of another type: no move that is read can name it
            key = _key(value[2])
            if key in found:
                raise InvalidInput(f"{file.name} line {line}: the position {value[2]} is there twice")
            found[key] = _axes(file, line, value[3])
        elif not (_STILL.fullmatch(text) or _VALUE.fullmatch(text)):
            raise InvalidInput(f"{file.name} line {line}: {text[:60]!r} is no declaration that is read here")
    return owner, found


def _key(name: str) -> str:
    return re.sub(r"\s", "", name).upper()


def _axes(file: Path, line: int, text: str) -> tuple[float, ...]:
    """Return A1 to A6 and E1 of ``{A1 1.0,A2 2.0,...}``."""
    kind, colon, rest = text.strip("{} ").partition(":")
    if colon and kind.strip().upper() not in ("AXIS", "E6AXIS"):
        raise InvalidInput(f"{file.name} line {line}: a position of the type {kind.strip()!r} is not read, only axes")
    found: dict[str, float] = {}
    for part in (rest if colon else kind).split(","):
        name, _, value = part.strip().partition(" ")
        if name.upper() in found:
            raise InvalidInput(f"{file.name} line {line}: the position has {name} twice")
        found[name.upper()] = number(file, line, value)
    names = [f"A{k}" for k in range(1, ARM_AXES + 1)]
    missing = [name for name in names if name not in found]
    if missing:
        raise InvalidInput(f"{file.name} line {line}: the position has no {missing[0]}")
    other = [name for name, value in found.items() if name not in (*names, "E1") and value != 0]
    if other:
        raise InvalidInput(f"{file.name} line {line}: the axis {other[0]} is none of A1 to A6 and E1")
    return (*(found[name] for name in names), *([found["E1"]] if "E1" in found else []))
