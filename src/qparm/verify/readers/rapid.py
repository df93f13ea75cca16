r"""A motion as an ABB RAPID module: ``MoveAbsJ`` with ``\T``, as its procedures call each other."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from itertools import accumulate
from pathlib import Path
from typing import TYPE_CHECKING

from qparm.errors import InvalidInput
from qparm.verify.readers.program import ARM_AXES, not_understood, number, program_lines, program_table

if TYPE_CHECKING:
    from qparm.cell import Cell
    from qparm.verify.motion import MotionTable

__all__ = ["read_rapid"]

_NAME = r"[A-Z]\w*"


def _grammar(text: str) -> re.Pattern[str]:
    return re.compile(text, re.IGNORECASE | re.ASCII)


_MODULE = _grammar(rf"MODULE\s+({_NAME})")
_PROC = _grammar(rf"PROC\s+({_NAME})\s*\(\s*\)")
_TARGET = r"\[\s*\[([^\[\]]*)\]\s*,\s*\[([^\[\]]*)\]\s*\]"
_DECLARED = _grammar(rf"(?:LOCAL\s+)?(CONST|PERS|VAR)\s+({_NAME})\s+({_NAME})\s*(?::=\s*(.*?)\s*)?")
_AXES = _grammar(_TARGET)
_LITERAL = _grammar(r"(?:[\[\],\s\d.+\-E]|TRUE|FALSE)*")
# Position, its options, speed, zone, tool.
_MOVE = _grammar(rf"MoveAbsJ\s*(?:{_TARGET}|(?<=\s)({_NAME}))\s*((?:\\[^,]*)?),([^,]*),([^,]*),([^,]*)")
_OPTION = _grammar(rf"({_NAME})\s*(?::=(.*))?")
_CALL = _grammar(_NAME)
# What moves nothing: digital outputs.
_STILL = _grammar(rf"SetDO\s+{_NAME}\s*,\s*[01]|(?:Set|Reset)\s+{_NAME}")
# Data that the language or the controller has: a module that declares one anew makes a move another.
_PREDEFINED = _grammar(r"fine|z\d+|v\d+|vmax|tool0|wobj0|load0|MoveAbsJ|SetDO|Set|Reset")
# What an axis that is not there has for a value.
_ABSENT = 9e9
# No program of a plan has more moves and calls.
_MOST_STEPS = 5_000_000
# The steps are differences of times that are rounded so.
_TIME_ROUNDING = 0.5e-6
_TIMES = "whether the controller keeps the times that the program asks for"


@dataclass(frozen=True)
class _Move:
    line: int
    axes: tuple[float, ...]
    time: float | None
    zone: str


@dataclass(frozen=True)
class _Call:
    line: int
    name: str


@dataclass
class _Procedure:
    name: str
    line: int
    steps: list[_Move | _Call] = field(default_factory=list)


def read_rapid(file: Path, cell: Cell) -> MotionTable:
    """Return the motion of a module: that of the one procedure which no other calls, and of those that it calls.

    Its first move is the start, at time zero. Every other line must be known to move nothing.
    """
    module = _Module(file)
    for line, text in program_lines(file, comment="!"):
        module.read(line, text)
    if not module.ended:
        raise InvalidInput(f"{file.name} does not end with ENDMODULE; it is cut short")
    moves = module.moves()
    steps = [0.0]
    for move in moves[1:]:
        if move.time is None:
            raise InvalidInput(f"{file.name} line {move.line}: the move has no \\T; when it ends is unknown")
        steps.append(move.time)
    zones = sorted({move.zone for move in moves} - {"fine"})
    near = (f"how near the points are passed (zone {', '.join(zones)})",) if zones else ()
    return program_table(
        file,
        cell,
        format="rapid",
        axes=[move.axes for move in moves],
        t=list(accumulate(steps[: len(moves)])),
        time_rounding=_TIME_ROUNDING,
        place=lambda k: f"line {moves[k].line}",
        stops=[k for k, move in enumerate(moves) if move.zone == "fine"],
        not_told=(_TIMES, *near),
    )


class _Module:
    """A module as it is read, line by line; a line is one statement."""

    def __init__(self, file: Path) -> None:
        self.file, self.name = file, ""
        self.ended = False
        self._targets: dict[str, tuple[float, ...]] = {}
        self._declared: set[str] = set()
        self._procedures: dict[str, _Procedure] = {}
        self._open: _Procedure | None = None

    def read(self, line: int, text: str) -> None:
        """Take a line in, or refuse it."""
        if self.ended:
            raise not_understood(self.file, line, text, " after ENDMODULE")
        upper = text.upper()
        if not self.name:
            start = _MODULE.fullmatch(text)
            if start is None:
                raise not_understood(self.file, line, text, " before MODULE")
            self.name = start[1]
        elif upper in ("ENDPROC", "ENDMODULE"):
            if (self._open is not None) != (upper == "ENDPROC"):
                where = f"in the procedure {self._open.name}" if self._open else "outside a procedure"
                raise InvalidInput(f"{self.file.name} line {line}: {upper} {where}")
            self.ended, self._open = upper == "ENDMODULE", None
        elif self._open is None and (start := _PROC.fullmatch(text)):
            self._declare(line, start[1])
            self._open = self._procedures[start[1].upper()] = _Procedure(start[1], line)
        elif not text.endswith(";"):
            raise InvalidInput(
                f"{self.file.name} line {line} does not end with a semicolon; it may be cut short, and a statement over"
                f" several lines is not read here: {text[:60]!r}"
            )
        elif self._open is None:
            self._data(line, text[:-1].strip())
        else:
            self._statement(self._open, line, text[:-1].strip())

    def moves(self) -> list[_Move]:
        """Return the moves in the order in which they are made."""
        called = {step.name for one in self._procedures.values() for step in one.steps if isinstance(step, _Call)}
        starts = [one for key, one in self._procedures.items() if key not in called]
        if len(starts) != 1:
            names = ", ".join(f"{one.name} (line {one.line})" for one in starts)
            what = f"several procedures are called by no other: {names}" if starts else "every procedure is called"
            raise InvalidInput(f"{self.file.name}: {what}; which one is run is not told")
        found: list[_Move] = []
        # procedures that are being run, and how far
        running = [(starts[0], iter(starts[0].steps))]
        count = 0
        while running:
            count += 1
            if count > _MOST_STEPS:
                raise InvalidInput(f"{self.file.name}: the calls make more than {_MOST_STEPS:,} moves")
            step = next(running[-1][1], None)
            if step is None:
                running.pop()
            elif isinstance(step, _Move):
                found.append(step)
            else:
                callee = self._procedures.get(step.name)
                if callee is None:
                    raise InvalidInput(
                        f"{self.file.name} line {step.line}: {step.name} is no procedure of the module; what it moves"
                        " is unknown"
                    )
                if any(callee is one for one, _ in running):
                    raise InvalidInput(f"{self.file.name} line {step.line}: {callee.name} calls itself, without end")
                running.append((callee, iter(callee.steps)))
        return found

    def _declare(self, line: int, name: str) -> None:
        if name.upper() in self._declared or _PREDEFINED.fullmatch(name):
            raise InvalidInput(f"{self.file.name} line {line}: {name} is declared already")
        self._declared.add(name.upper())

    def _data(self, line: int, text: str) -> None:
        declared = _DECLARED.fullmatch(text)
        if declared is None:
            raise not_understood(self.file, line, text)
        _, kind, name, value = declared.groups()
        self._declare(line, name)
        axes = _AXES.fullmatch(value or "") if kind.upper() == "JOINTTARGET" else None
        if axes:
            self._targets[name.upper()] = _axes(self.file, line, axes[1], axes[2])
        elif not _LITERAL.fullmatch(value or ""):
            raise not_understood(self.file, line, text)

    def _statement(self, procedure: _Procedure, line: int, text: str) -> None:
        if move := _MOVE.fullmatch(text):
            procedure.steps.append(self._move(line, move))
        elif _CALL.fullmatch(text):
            procedure.steps.append(_Call(line, text.upper()))
        elif not _STILL.fullmatch(text):
            raise not_understood(self.file, line, text)

    def _move(self, line: int, move: re.Match[str]) -> _Move:
        robot, external, name, options, speed, zone, tool = move.groups()
        (speed, _, timing), (tool, _, frame), zone = speed.partition("\\"), tool.partition("\\"), zone.strip().lower()
        for what, text in (("speed", speed), ("zone", zone), ("tool", tool)):
            if not _CALL.fullmatch(text.strip()):
                raise InvalidInput(f"{self.file.name} line {line}: the {what} {text.strip()!r} is no name")
        self._options(line, options, "NOEOFFS")
        self._options(line, frame, "WOBJ")
        time = self._options(line, timing, "T")
        if name is None:
            axes = _axes(self.file, line, robot, external)
        elif name.upper() in self._targets:
            axes = self._targets[name.upper()]
        else:
            raise InvalidInput(f"{self.file.name} line {line}: the position {name!r} is declared nowhere above")
        seconds = None if time is None else number(self.file, line, time)
        if seconds is not None and not seconds > 0:
            raise InvalidInput(f"{self.file.name} line {line}: the time must be greater than zero, not {time}")
        return _Move(line, axes, seconds, zone)

    def _options(self, line: int, text: str, known: str) -> str | None:
        """Return the value of an argument's only option that is read, None where it is not there."""
        value = None
        for part in filter(None, map(str.strip, text.split("\\"))):
            option = _OPTION.fullmatch(part)
            if option is None or option[1].upper() != known or value is not None:
                missing = "the move has no \\T; " if known == "T" and value is None else ""
                raise InvalidInput(f"{self.file.name} line {line}: {missing}the option \\{part[:40]} is not read here")
            value = option[2] or ""
        return value


def _axes(file: Path, line: int, robot: str, external: str) -> tuple[float, ...]:
    arm = [number(file, line, value) for value in robot.split(",")]
    outside = [_external(file, line, value) for value in external.split(",")]
    if len(arm) != ARM_AXES or len(outside) != ARM_AXES:
        raise InvalidInput(f"{file.name} line {line}: a jointtarget has six axes and six external ones")
    there = [value for value in outside if value is not None]
    if len(there) > 1 or (there and outside[0] is None):
        raise InvalidInput(f"{file.name} line {line}: eax_a is the only external axis that is read")
    return (*arm, *there)


def _external(file: Path, line: int, text: str) -> float | None:
    """Return the value of an external axis, None where there is no axis."""
    try:
        if float(text) == _ABSENT:
            return None
    except ValueError:
        pass
    return number(file, line, text)
