"""A motion as NPZ: numpy arrays, to the last bit."""

from __future__ import annotations

import io
import math
import zipfile
from pathlib import Path
from typing import IO, TYPE_CHECKING

import numpy as np

from qparm.errors import InvalidInput
from qparm.files.reading import DATA_BYTES, guarded, read_bytes, shown, whole_number
from qparm.verify.readers.columns import scale_of_unit
from qparm.verify.readers.table import motion_table

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.cell import Cell
    from qparm.verify.motion import MotionTable

__all__ = ["read_npz"]

_ORDERS = ("q", "qd", "qdd", "qddd")
_NEEDED = ("t", "q", "joint_names")
_WANTED = ("t", *_ORDERS, "joint_names", "units", "row", "segment", "executable")
_MEMBER = ".npy"
_MOST_JOINTS = 1000


def read_npz(file: Path, cell: Cell) -> MotionTable:
    """Return the motion in the arrays ``t``, ``joint_names``, ``q`` and, where they are, ``qd``, ``qdd``, ``qddd``."""
    arrays = _arrays(file)
    for name in ("joint_names", "units"):
        if name in arrays and arrays[name].size > _MOST_JOINTS:
            raise InvalidInput(f"{file.name}: {name!r} has {arrays[name].size:,} values, more than any arm has joints")
    joints = [str(name) for name in arrays["joint_names"].ravel().tolist()]
    t = _floats(file, "t", arrays["t"], (arrays["t"].size,))
    shape = (len(t), len(joints))
    derivatives = [_floats(file, name, arrays[name], shape) if name in arrays else None for name in _ORDERS]
    scale = np.ones(len(joints))
    if "units" in arrays:
        units = [str(unit) for unit in arrays["units"].ravel().tolist()]
        if len(units) != len(joints):
            raise InvalidInput(f"{file.name}: units are {len(units)}, joints {len(joints)}")
        scale = np.array([scale_of_unit(file, name, unit) for name, unit in zip(joints, units, strict=True)])
    for name in ("row", "segment"):
        if name in arrays and arrays[name].shape != (len(t),):
            raise InvalidInput(f"{file.name}: {name!r} has the shape {arrays[name].shape}, the times {(len(t),)}")
    q = derivatives[0]
    assert q is not None
    return motion_table(
        file,
        cell,
        format="npz",
        joints=joints,
        t=t - t[:1],
        derivatives=[None if values is None else values * scale for values in derivatives],
        position_rounding=lambda: _rounding(arrays["q"]) * np.abs(q).max(axis=0, initial=0.0) * scale,
        time_rounding=_rounding(arrays["t"]) * float(np.abs(t[-1:]).sum()),
        place=lambda k: f"sample {k}",
        row=_rows(file, arrays["row"]) if "row" in arrays else None,
        segment=_words(file, arrays["segment"]) if "segment" in arrays else None,
        executable=_executable(arrays["executable"]) if "executable" in arrays else True,
    )


def _arrays(file: Path) -> dict[str, NDArray[np.generic]]:
    """Return the arrays that are asked for, and no other; their sizes are looked at before they are unpacked."""
    data = read_bytes(file)
    arrays: dict[str, NDArray[np.generic]] = {}
    # numpy and zipfile raise almost anything where a header or a flag is broken
    with guarded(file, what="a whole NPZ file", foreign=True), zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = {member.filename: member for member in archive.infolist()}
        missing = [name for name in _NEEDED if name + _MEMBER not in members]
        if missing:
            there = ", ".join(shown(name.removesuffix(_MEMBER)) for name in list(members)[:20]) or "none"
            raise InvalidInput(f"{file.name} has no array {missing[0]!r}; it has {there}")
        left = DATA_BYTES
        for name in _WANTED:
            member = members.get(name + _MEMBER)
            if member is None:
                continue
            left -= member.file_size
            if left < 0:
                raise InvalidInput(
                    f"{file.name}: {name!r} unpacks to {member.file_size / 2**20:.0f} MiB; all together may have"
                    f" {DATA_BYTES / 2**20:.0f}"
                )
            with archive.open(member) as opened:
                _require_size(file, name, opened, member.file_size)
            with archive.open(member) as opened:
                arrays[name] = np.lib.format.read_array(opened, allow_pickle=False)
    return arrays


def _require_size(file: Path, name: str, opened: IO[bytes], size: int) -> None:
    """Refuse an array whose header promises another size than the archive: room would be made for it."""
    version = np.lib.format.read_magic(opened)
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, dtype = read(opened)
    if dtype.hasobject:
        raise InvalidInput(f"{file.name}: {name!r} holds objects of Python, which are not read")
    promised = math.prod(shape) * dtype.itemsize
    if promised != size - opened.tell():
        raise InvalidInput(
            f"{file.name}: {name!r} is of shape {shown(str(shape))} by its header, which is not what the file holds; it"
            " may be cut short"
        )


def _floats(file: Path, name: str, array: NDArray[np.generic], shape: tuple[int, ...]) -> NDArray[np.float64]:
    if array.dtype.kind not in "fiu":
        raise InvalidInput(f"{file.name}: {name!r} must hold numbers, not {shown(str(array.dtype))}")
    if array.shape != shape:
        raise InvalidInput(f"{file.name}: {name!r} has the shape {array.shape}, not {shape} (samples, joints)")
    with np.errstate(over="ignore"):  # of more than double precision; infinity is refused with its place
        return array.astype(np.float64)


def _rows(file: Path, array: NDArray[np.generic]) -> NDArray[np.int64]:
    if array.dtype.kind not in "fiu":
        raise InvalidInput(f"{file.name}: 'row' must hold whole numbers, not {shown(str(array.dtype))}")
    rows = [whole_number(value) for value in array.tolist()]
    if None in rows:
        k = rows.index(None)
        raise InvalidInput(f"{file.name} sample {k}: the row {array[k]} is not an integer")
    return np.array(rows, dtype=np.int64)


def _words(file: Path, array: NDArray[np.generic]) -> NDArray[np.str_]:
    if array.dtype.kind != "U":
        raise InvalidInput(f"{file.name}: 'segment' must hold text, not {shown(str(array.dtype))}")
    return array.astype(np.str_)


def _executable(array: NDArray[np.generic]) -> bool:
    """Return whether an array says yes: one or several values, all of them true, or the number 1."""
    return bool(array.size and array.dtype.kind in "biu" and (array == 1).all())


def _rounding(array: NDArray[np.generic]) -> float:
    """Return the relative rounding of an array's type: none for the double precision in which all is computed."""
    return {2: 2.0**-11, 4: 2.0**-24}.get(array.dtype.itemsize, 0.0) if array.dtype.kind == "f" else 0.0
