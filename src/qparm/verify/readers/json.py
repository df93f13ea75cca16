"""A motion as a JointTrajectory in JSON, such as the ``trajectory.json`` of a plan."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

from qparm.errors import InvalidInput
from qparm.verify.readers.joint_trajectory import read_message
from qparm.verify.readers.table import read_text, value_rounding

if TYPE_CHECKING:
    from qparm.cell import Cell
    from qparm.verify.motion import MotionTable

__all__ = ["read_json"]


def read_json(file: Path, cell: Cell) -> MotionTable:
    """Return the motion in a JSON file."""
    try:
        message = json.loads(read_text(file))
    except (ValueError, RecursionError) as error:
        raise InvalidInput(f"{file.name} is not whole JSON, it may be cut short: {error}") from None
    return read_message(file, cell, message, format="json", rounding=value_rounding)
