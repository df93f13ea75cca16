"""A motion as Parquet, with the column names of the CSV."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from qparm.errors import InvalidInput
from qparm.extras import load_extra
from qparm.verify.readers.columns import find_columns
from qparm.verify.readers.table import motion_table, read_bytes

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.cell import Cell
    from qparm.verify.motion import MotionTable

__all__ = ["read_parquet"]

_SINGLE = 2.0**-24


def read_parquet(file: Path, cell: Cell) -> MotionTable:
    """Return the motion in a Parquet file; columns in single precision leave open what its rounding does."""
    parquet = load_extra("pyarrow.parquet", instead="a file of the format npz")
    try:
        table = parquet.read_table(io.BytesIO(read_bytes(file)))
    except (OSError, ValueError) as error:  # those of pyarrow are of these kinds
        raise InvalidInput(f"{file.name} is not a whole Parquet file: {error}") from None
    if not table.column_names:
        raise InvalidInput(f"{file.name} has no column")
    columns = find_columns(file, table.column_names, cell)
    t = _floats(file, table, columns.time)
    derivatives: list[NDArray[np.float64] | None] = []
    for order in columns.orders:
        derivatives.append(None if order is None else np.column_stack([_floats(file, table, k) for k in order]))
    single = any(str(table.schema.field(k).type) == "float" for k in columns.orders[0] or ())
    q = derivatives[0]
    assert q is not None
    words = {name: table.column(k).to_pylist() for name, k in columns.words.items()}
    return motion_table(
        file,
        cell,
        format="parquet",
        joints=columns.joints,
        t=t - t[:1],
        derivatives=[None if values is None else values * columns.scale for values in derivatives],
        position_rounding=lambda: (_SINGLE if single else 0.0) * np.abs(q).max(axis=0, initial=0.0) * columns.scale,
        time_rounding=0.0,
        place=lambda k: f"row {k}",
        row=np.array(words["row"], dtype=np.int64) if "row" in words else None,
        segment=np.array(words["segment"], dtype=np.str_) if "segment" in words else None,
        executable=_executable((table.schema.metadata or {}).get(b"qparm", b"{}")),
    )


def _executable(said: bytes) -> bool:
    """Return what the metadata of our own files say; there are none in others'."""
    try:
        return json.loads(said).get("executable", True) is True
    except (ValueError, AttributeError):
        return True


def _floats(file: Path, table: Any, column: int) -> NDArray[np.float64]:
    name = table.column_names[column]
    try:
        # an absent value becomes NaN, and is refused with its row
        return np.asarray(table.column(column).to_numpy(), dtype=np.float64)
    except (TypeError, ValueError):
        raise InvalidInput(
            f"{file.name} column {name!r} must hold numbers, not {table.schema.field(column).type}"
        ) from None
