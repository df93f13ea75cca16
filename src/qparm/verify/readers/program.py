"""The common part of readers of controller programs: lines, numbers, joints as axes in degrees and mm.

A program is read by a grammar of what is known: each line either moves nothing, or is a motion that is read, or the
program is refused with the line's number.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from qparm.errors import InvalidInput
from qparm.files.reading import read_text
from qparm.verify.readers.table import motion_table, value_rounding

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.cell import Cell
    from qparm.verify.motion import MotionTable

__all__ = ["ARM_AXES", "not_understood", "number", "program_lines", "program_table"]

ARM_AXES = 6
_NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
# No number of a program is longer, or larger: degrees, millimetres, seconds, per cent.
_LONGEST, _LARGEST = 40, 1e7
# No line is longer than that (characters); so much of one that is refused is shown.
_LONGEST_LINE, _SHOWN = 2000, 60


def program_lines(file: Path, *, comment: str) -> list[tuple[int, str]]:
    """Return the lines of a program that hold anything, with their numbers, without comments and outer blanks.

    Raises
    ------
    InvalidInput
        If the file cannot be read; if a line holds a control character (a line break that not every reader takes for
        one among them), or anything but ASCII outside its comment.
    """
    found = []
    for line, whole in enumerate(read_text(file).replace("\r\n", "\n").split("\n"), 1):
        strange = next((c for c in whole if c != "\t" and not (c.isprintable() or c == "\u00a0")), None)
        if strange is not None:
            raise InvalidInput(f"{file.name} line {line} holds the character U+{ord(strange):04X}; no program may")
        text = whole.partition(comment)[0].strip()
        if not text.isascii():
            strange = next(c for c in text if not c.isascii())
            raise InvalidInput(f"{file.name} line {line}: {strange!r} outside a comment; programs are ASCII")
        if len(text) > _LONGEST_LINE:
            raise InvalidInput(f"{file.name} line {line} has {len(text)} characters; no controller takes such a line")
        if text:
            found.append((line, text))
    return found


def not_understood(file: Path, line: int, text: str, why: str = "") -> InvalidInput:
    """Return the refusal of a line that is not known to move nothing."""
    short = text if len(text) <= _SHOWN else text[:_SHOWN] + "..."
    return InvalidInput(f"{file.name} line {line}: {short!r} is not read here{why}; what it moves is unknown")


def number(file: Path, line: int, text: str) -> float:
    """Return a number of a program's line, or raise InvalidInput."""
    text = text.strip()
    if len(text) > _LONGEST or not _NUMBER.fullmatch(text):
        raise InvalidInput(f"{file.name} line {line}: {text[:_LONGEST]!r} is not a number")
    value = float(text)
    if not abs(value) <= _LARGEST:
        raise InvalidInput(f"{file.name} line {line}: {text} is beyond what any program asks for ({_LARGEST:g})")
    return value


def program_table(
    file: Path,
    cell: Cell,
    *,
    format: str,
    axes: Sequence[Sequence[float]],
    t: Sequence[float],
    time_rounding: float,
    place: Callable[[int], str],
    stops: Sequence[int],
    not_told: Sequence[str],
) -> MotionTable:
    """Return the motion of a program.

    Parameters
    ----------
    file : Path
    cell : Cell
        Its revolute joints in their order are the six axes (deg), its prismatic joint, if it has one, the external axis
        (mm).
    format : str
    axes : sequence of sequence of float
        Six axes, then the external one if the program gives it.
    t : sequence of float
        s.
    time_rounding : float
    place : callable
        Where position k is in the file.
    stops : sequence of int
        Positions at which the program stops.
    not_told : sequence of str
        What the program leaves to the controller.
    """
    turning = [joint.name for joint in cell.arm.joints if joint.type == "revolute"]
    sliding = [joint.name for joint in cell.arm.joints if joint.type == "prismatic"]
    if len(turning) != ARM_AXES or len(sliding) > 1:
        raise InvalidInput(
            f"{file.name} is a program for six revolute axes and at most one external prismatic axis; the cell's arm"
            f" has {len(turning)} revolute joints and {len(sliding)} prismatic"
        )
    joints = (*turning, *sliding)
    for k, row in enumerate(axes):
        if len(row) != len(joints):
            raise InvalidInput(f"{file.name} {place(k)}: {len(row)} axes for the {len(joints)} joints of the cell")
    values = np.array(axes, dtype=np.float64).reshape(len(axes), len(joints))
    scale = np.array([np.pi / 180] * ARM_AXES + [1e-3] * len(sliding))
    return motion_table(
        file,
        cell,
        format=format,
        joints=joints,
        t=np.array(t, dtype=np.float64),
        derivatives=[values * scale],
        position_rounding=lambda: _rounding(values, scale),
        time_rounding=time_rounding,
        place=place,
        stops=np.array(stops, dtype=np.int64),
        not_told=tuple(not_told),
    )


def _rounding(values: NDArray[np.float64], scale: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what the digits leave open: degrees and millimetres have digits of their own."""
    kinds = [slice(0, ARM_AXES), slice(ARM_AXES, None)]
    return np.concatenate([value_rounding(values[:, kind], scale[kind]) for kind in kinds if values[:, kind].size])
