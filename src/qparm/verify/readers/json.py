"""A motion as a JointTrajectory in JSON, such as the ``trajectory.json`` of a plan."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from qparm.files.reading import TEXT_BYTES, parse_json, read_text
from qparm.verify.readers.joint_trajectory import read_message
from qparm.verify.readers.table import value_rounding

if TYPE_CHECKING:
    from qparm.cell import Cell
    from qparm.verify.motion import MotionTable

__all__ = ["read_json"]


def read_json(file: Path, cell: Cell) -> MotionTable:
    """Return the motion in a JSON file."""
    message = parse_json(read_text(file, largest=TEXT_BYTES), file)
    return read_message(file, cell, message, format="json", rounding=value_rounding)
