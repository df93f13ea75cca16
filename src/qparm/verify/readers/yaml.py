"""A motion as a JointTrajectory in YAML."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from qparm.files.reading import TEXT_BYTES, parse_yaml, read_text
from qparm.verify.readers.joint_trajectory import read_message
from qparm.verify.readers.table import value_rounding

if TYPE_CHECKING:
    from qparm.cell import Cell
    from qparm.verify.motion import MotionTable

__all__ = ["read_yaml"]


def read_yaml(file: Path, cell: Cell) -> MotionTable:
    """Return the motion in a YAML file of one message."""
    message = parse_yaml(read_text(file, largest=TEXT_BYTES), file)
    return read_message(file, cell, message, format="yaml", rounding=value_rounding)
