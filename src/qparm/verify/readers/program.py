"""What the readers of controller programs share: the cell's joints as axes, degrees and millimetres."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from qparm.errors import InvalidInput
from qparm.verify.readers.table import motion_table, value_rounding

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.cell import Cell
    from qparm.verify.motion import MotionTable

__all__ = ["ARM_AXES", "number", "program_table"]

ARM_AXES = 6


def number(file: Path, line: int, text: str) -> float:
    """Return a number of a program's line, or raise InvalidInput."""
    try:
        return float(text)
    except ValueError:
        raise InvalidInput(f"{file.name} line {line}: {text.strip()!r} is no number") from None


def program_table(
    file: Path,
    cell: Cell,
    *,
    format: str,
    axes: Sequence[Sequence[float]],
    t: Sequence[float],
    time_rounding: float,
    place: Callable[[int], str],
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
    )


def _rounding(values: NDArray[np.float64], scale: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what the digits leave open: degrees and millimetres have digits of their own."""
    kinds = [slice(0, ARM_AXES), slice(ARM_AXES, None)]
    return np.concatenate([value_rounding(values[:, kind], scale[kind]) for kind in kinds if values[:, kind].size])
