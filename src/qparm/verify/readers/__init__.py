"""Readers: one file per format, ours or not, into one table."""

from __future__ import annotations

import os
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from qparm.errors import InvalidInput
from qparm.files.reading import guarded, require_regular, shown

if TYPE_CHECKING:
    from qparm.cell import Cell
    from qparm.verify.motion import MotionTable

__all__ = ["read_motion"]

# How a file begins that is no text.
_MAGIC = ((b"PK\x03\x04", "npz"), (b"PAR1", "parquet"), (b"\x89MCAP0\r\n", "mcap"))
_ARRAY = b"\x93NUMPY"
_EXTENSIONS = {
    ".csv": "csv",
    ".txt": "csv",
    ".npz": "npz",
    ".parquet": "parquet",
    ".json": "json",
    ".yaml": "yaml",
    ".yml": "yaml",
    ".mcap": "mcap",
    ".src": "krl",
    ".dat": "krl",
    ".mod": "rapid",
    ".prg": "rapid",
}
_BAG = "metadata.yaml"


def read_motion(file: str | Path, cell: Cell) -> MotionTable:
    """Return what a trajectory file holds; its format is found from how it begins, else from its name.

    Parameters
    ----------
    file : str or Path
    cell : Cell
        Whose joints the file must have, in any order.

    Raises
    ------
    InvalidInput
        If the format is not known, or the file is broken: with its line or point, column and joint.
    PackageMissing
        If the format needs a package that is not installed.
    """
    from qparm.cell import Cell

    if not isinstance(file, (str, os.PathLike)):
        raise InvalidInput(f"a motion is read from a file, not from {type(file).__name__}")
    if not isinstance(cell, Cell):
        raise InvalidInput(f"read_motion takes a Cell beside the file, not {type(cell).__name__}; see Cell.load")
    file = Path(file)
    with guarded(file):
        return _reader(_format(file))(file, cell)


def _reader(name: str) -> Callable[[Path, Cell], MotionTable]:
    return getattr(import_module(f"qparm.verify.readers.{name}"), f"read_{name}")


def _format(file: Path) -> str:
    if file.is_dir():
        if (file / _BAG).exists():
            return "rosbag2"
        raise InvalidInput(f"{str(file)!r} is a folder, and no rosbag2: it holds no {_BAG}; name a file in it")
    require_regular(file)
    with file.open("rb") as opened:
        start = opened.read(16)
    for magic, name in _MAGIC:
        if start.startswith(magic):
            return name
    if file.suffix.lower() == ".db3" and (file.parent / _BAG).exists():
        raise InvalidInput(f"{file.name} is a part of a rosbag2; name its folder")
    if start.startswith(_ARRAY):
        raise InvalidInput(f"{file.name} is a single array of numpy (.npy); a motion is an .npz with t, joint_names, q")
    known = _EXTENSIONS.get(file.suffix.lower())
    if known is None:
        raise InvalidInput(f"{shown(file.name)}: no format is known by this name; known are {', '.join(_EXTENSIONS)}")
    return known


def __dir__() -> list[str]:
    return sorted(__all__)
