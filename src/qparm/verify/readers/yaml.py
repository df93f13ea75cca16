"""A motion as a JointTrajectory in YAML."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from qparm.errors import InvalidInput
from qparm.extras import load_extra
from qparm.verify.readers.joint_trajectory import read_message
from qparm.verify.readers.table import read_text, value_rounding

if TYPE_CHECKING:
    from qparm.cell import Cell
    from qparm.verify.motion import MotionTable

__all__ = ["read_yaml"]


def read_yaml(file: Path, cell: Cell) -> MotionTable:
    """Return the motion in a YAML file of one document."""
    yaml = load_extra("yaml", instead="json")
    try:
        message = yaml.load(read_text(file), Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader))
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise InvalidInput(f"{file.name} is not whole YAML, it may be cut short: {error}") from None
    return read_message(file, cell, message, format="yaml", rounding=value_rounding)
