"""A motion as NPZ: numpy arrays, to the last bit."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from qparm.errors import InvalidInput
from qparm.verify.readers.columns import scale_of_unit
from qparm.verify.readers.table import motion_table, read_bytes

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.cell import Cell
    from qparm.verify.motion import MotionTable

__all__ = ["read_npz"]

_ORDERS = ("q", "qd", "qdd", "qddd")


def read_npz(file: Path, cell: Cell) -> MotionTable:
    """Return the motion in the arrays ``t``, ``joint_names``, ``q`` and, where they are, ``qd``, ``qdd``, ``qddd``."""
    try:
        with np.load(io.BytesIO(read_bytes(file)), allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except (ValueError, OSError, EOFError, zipfile.BadZipFile) as error:
        raise InvalidInput(f"{file.name} is not a whole NPZ file: {error}") from None
    missing = [name for name in ("t", "q", "joint_names") if name not in arrays]
    if missing:
        raise InvalidInput(f"{file.name} has no array {missing[0]!r}; it has {', '.join(arrays) or 'none'}")
    joints = [str(name) for name in arrays["joint_names"].ravel()]
    t = _floats(file, "t", arrays["t"], (len(arrays["t"].ravel()),))
    shape = (len(t), len(joints))
    derivatives = [_floats(file, name, arrays[name], shape) if name in arrays else None for name in _ORDERS]
    scale = np.ones(len(joints))
    if "units" in arrays:
        units = [str(unit) for unit in arrays["units"].ravel()]
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
        row=arrays["row"].astype(np.int64) if "row" in arrays else None,
        segment=arrays["segment"].astype(np.str_) if "segment" in arrays else None,
        executable=bool(np.all(arrays.get("executable", True))),
    )


def _floats(file: Path, name: str, array: NDArray[np.generic], shape: tuple[int, ...]) -> NDArray[np.float64]:
    if array.dtype.kind not in "fiu":
        raise InvalidInput(f"{file.name}: {name!r} must hold numbers, not {array.dtype}")
    if array.shape != shape:
        raise InvalidInput(f"{file.name}: {name!r} has the shape {array.shape}, not {shape} (samples, joints)")
    return array.astype(np.float64)


def _rounding(array: NDArray[np.generic]) -> float:
    """Return the relative rounding of an array's type: none for the double precision in which all is computed."""
    return {2: 2.0**-11, 4: 2.0**-24}.get(array.dtype.itemsize, 0.0) if array.dtype.kind == "f" else 0.0
