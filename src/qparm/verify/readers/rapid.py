r"""A motion as an ABB RAPID module: ``MoveAbsJ`` with ``\T``, in the order of the lines."""

from __future__ import annotations

import re
from itertools import accumulate
from pathlib import Path
from typing import TYPE_CHECKING

from qparm.errors import InvalidInput
from qparm.reading import read_text
from qparm.verify.readers.program import ARM_AXES, number, program_table

if TYPE_CHECKING:
    from qparm.cell import Cell
    from qparm.verify.motion import MotionTable

__all__ = ["read_rapid"]

_TARGET = re.compile(r"\bjointtarget\s+(\w+)\s*:=\s*\[\s*\[([^\]]*)\]\s*,\s*\[([^\]]*)\]\s*\]", re.IGNORECASE)
_MOVE = re.compile(r"\s*MoveAbsJ\s+(?:\[\s*\[([^\]]*)\]\s*,\s*\[([^\]]*)\]\s*\]|(\w+))([^;]*)(;?)", re.IGNORECASE)
_TIME = re.compile(r"\\T\s*:=\s*([^,\\;]+)", re.IGNORECASE)
# What an axis that is not there has for a value.
_ABSENT = 9e8
# The steps are differences of times that are rounded so.
_TIME_ROUNDING = 0.5e-6


def read_rapid(file: Path, cell: Cell) -> MotionTable:
    """Return the motion of a module: the first move is the start, at time zero."""
    targets: dict[str, tuple[float, ...]] = {}
    axes: list[tuple[float, ...]] = []
    steps: list[float] = []
    places: list[int] = []
    ended = False
    for line, text in enumerate(read_text(file).splitlines(), 1):
        text = text.partition("!")[0]
        declared = _TARGET.search(text)
        move = _MOVE.match(text)
        if declared:
            targets[declared.group(1).upper()] = _axes(file, line, declared.group(2), declared.group(3))
        elif move:
            robot, external, name, options, end = move.groups()
            if not end:
                raise InvalidInput(f"{file.name} line {line} does not end with a semicolon; it may be cut short")
            if name is None:
                axes.append(_axes(file, line, robot, external))
            elif name.upper() in targets:
                axes.append(targets[name.upper()])
            else:
                raise InvalidInput(f"{file.name} line {line}: the position {name!r} is declared nowhere above")
            time = _TIME.search(options)
            if time is None and len(axes) > 1:
                raise InvalidInput(f"{file.name} line {line}: the move has no \\T; when it ends is unknown")
            steps.append(0.0 if time is None or len(axes) == 1 else number(file, line, time.group(1)))
            places.append(line)
        elif re.match(r"\s*ENDMODULE\b", text, re.IGNORECASE):
            ended = True
    if not ended:
        raise InvalidInput(f"{file.name} does not end with ENDMODULE; it is cut short")
    return program_table(
        file,
        cell,
        format="rapid",
        axes=axes,
        t=list(accumulate(steps)),
        time_rounding=_TIME_ROUNDING,
        place=lambda k: f"line {places[k]}",
    )


def _axes(file: Path, line: int, robot: str, external: str) -> tuple[float, ...]:
    arm = [number(file, line, value) for value in robot.split(",")]
    outside = [number(file, line, value) for value in external.split(",")]
    if len(arm) != ARM_AXES or len(outside) != ARM_AXES:
        raise InvalidInput(f"{file.name} line {line}: a jointtarget has six axes and six external ones")
    there = [value for value in outside if value < _ABSENT]
    if len(there) > 1 or (there and outside[0] >= _ABSENT):
        raise InvalidInput(f"{file.name} line {line}: eax_a is the only external axis that is read")
    return (*arm, *there)
