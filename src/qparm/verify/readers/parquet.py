"""A motion as Parquet, with the column names of the CSV."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from qparm.errors import InvalidInput
from qparm.extras import load_extra
from qparm.files.reading import DATA_BYTES, guarded, parse_json, read_bytes, shown, shown_value, whole_number
from qparm.verify.readers.columns import Columns, find_columns
from qparm.verify.readers.table import motion_table

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.cell import Cell
    from qparm.verify.motion import MotionTable

__all__ = ["read_parquet"]

_SINGLE = 2.0**-24
_WHOLE = ("int8", "int16", "int32", "int64", "uint8", "uint16", "uint32", "uint64")
_NUMBERS = ("halffloat", "float", "double", *_WHOLE)
# How the types of text begin, as such or by a dictionary.
_TEXT = ("string", "large_string", "dictionary<values=string", "dictionary<values=large_string")
_WORDS = {"row": (*_WHOLE, "float", "double"), "segment": _TEXT}


def read_parquet(file: Path, cell: Cell) -> MotionTable:
    """Return the motion in a Parquet file; columns in single precision leave open what its rounding does."""
    parquet = load_extra("pyarrow.parquet", instead="a file of the format npz")
    data = read_bytes(file)
    with guarded(file, what="a whole Parquet file", foreign=True):
        opened = parquet.ParquetFile(io.BytesIO(data), memory_map=False)
        names = list(opened.schema_arrow.names)
    if not names:
        raise InvalidInput(f"{file.name} has no column")
    columns = find_columns(file, names, cell)
    table = _table(file, opened, names, columns)
    t = _floats(file, table, names[columns.time])
    derivatives: list[NDArray[np.float64] | None] = []
    for order in columns.orders:
        derivatives.append(None if order is None else np.column_stack([_floats(file, table, names[k]) for k in order]))
    single = any(str(table.schema.field(names[k]).type) == "float" for k in columns.orders[0] or ())
    q = derivatives[0]
    assert q is not None
    words = {name: table.column(names[k]).to_pylist() for name, k in columns.words.items() if name != "process_on"}
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
        row=_rows(file, words["row"]) if "row" in words else None,
        segment=_words(file, words["segment"]) if "segment" in words else None,
        executable=_executable((table.schema.metadata or {}).get(b"qparm")),
    )


def _table(file: Path, opened: Any, names: list[str], columns: Columns) -> Any:
    """Return the columns that are asked for, once their types and their sizes are known to be usable."""
    types = opened.schema_arrow
    for k in columns.numbers:
        kind = str(types.field(k).type)
        if kind not in _NUMBERS and not kind.startswith("decimal"):
            raise InvalidInput(f"{file.name} column {shown(names[k])!r} must hold numbers, not {shown(kind)}")
    for word, k in columns.words.items():
        kind = str(types.field(k).type)
        if word in _WORDS and not kind.startswith(_WORDS[word]):
            raise InvalidInput(f"{file.name} column {word!r} cannot hold {shown(kind)}")
    # what a column unpacks to is told by the file; what it takes as numbers follows from how many there are
    rows = opened.metadata.num_rows
    unpacked = sum(
        opened.metadata.row_group(group).column(column).total_uncompressed_size
        for group in range(opened.metadata.num_row_groups)
        for column in range(opened.metadata.num_columns)
    )
    if max(rows * 8 * len(columns.numbers), unpacked) > DATA_BYTES:
        raise InvalidInput(f"{file.name} has {rows:,} rows; they would take more than {DATA_BYTES / 2**20:.0f} MiB")
    wanted = [names[k] for k in (*columns.numbers, *columns.words.values())]
    with guarded(file, what="a whole Parquet file", foreign=True):
        return opened.read(columns=wanted)


def _executable(said: bytes | None) -> bool:
    """Return what the metadata of our own files say; others have none. What cannot be read is no yes."""
    if said is None:
        return True
    try:
        found = parse_json(said, "metadata")
    except InvalidInput:
        return False
    return isinstance(found, dict) and found.get("executable", True) is True


def _floats(file: Path, table: Any, name: str) -> NDArray[np.float64]:
    with guarded(file, what="a whole Parquet file", foreign=True):
        # an absent value becomes NaN, and is refused with its row
        return np.asarray(table.column(name).to_numpy(), dtype=np.float64)


def _rows(file: Path, values: list[Any]) -> NDArray[np.int64]:
    rows = [whole_number(value) for value in values]
    if None in rows:
        k = rows.index(None)
        raise InvalidInput(f"{file.name} row {k}: the row {shown_value(values[k])} is not an integer")
    return np.array(rows, dtype=np.int64)


def _words(file: Path, values: list[Any]) -> NDArray[np.str_]:
    if None in values:
        raise InvalidInput(f"{file.name} row {values.index(None)} has no segment")
    return np.array([shown(value) for value in values], dtype=np.str_)
