"""Changes that make a valid input a broken or a hostile one; each is drawn from a seeded generator."""

from __future__ import annotations

import io
import os
import random
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

__all__ = ["mutated", "mutated_arguments", "replaced_file"]

_NUMBER = re.compile(rb"(?<![\w.])-?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?")
_VALUE = re.compile(rb'"[^"\n]*"|(?<![\w.])-?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?|\btrue\b|\bfalse\b|\[[^\[\]]*\]|\{[^{}]*\}')
_WORD = re.compile(rb"[A-Za-z_]\w*")
NUMBERS = (
    b"0", b"-1", b"1", b"2", b"-0.0", b"1e308", b"-1e308", b"1e200", b"1e-300", b"1e-320", b"1e9", b"1e15", b"1e7",
    b"20000",
    b"NaN", b"nan", b".nan", b"Infinity", b"-inf", b".inf", b"1" + b"0" * 400, b"1" * 5000, b"0x" + b"f" * 4000, b"1_0",
    "\u0663".encode(), "\u00b2".encode(), b"--5", b"99999999999999999999", b"1e400", b"0.1.2", b"1,5", b"9E9", b"",
)  # fmt: skip
VALUES = (
    b"null", b"~", b"true", b"false", b'""', b'"text"', b"[]", b"{}", b"[[]]", b'{"a": 1}', b"[1, 2, 3]", b"[null]",
    b"!!int ''",
    b"!!float ''", b"!!binary abc", b"!!python/object:os.system {}", b"2001-13-45", b"1979-05-27T07:32:00Z", b"*a",
    b"&a [*a]",
    b'"\\u0000"', b'"x\\nLIN {X 1000}"', b'"' + b"n" * 300 + b'"', b"'/dev/zero'", b'"../../etc/passwd"', b'"."',
)  # fmt: skip
LOOSE = (
    b"\x00", b"\xff", b"\xef\xbb\xbf", b"\xe9", b"\r", b"\n", b"\n\n", b"---\n", b"...\n", b"#", b";", b"!", b'"',
    b"'", b"[", b"]",
    b"{", b"}", b",", b",,", b"=", b"\\", b"\t", b" ", b"\x1a", "\u2028".encode(), b"<!DOCTYPE a [<!ENTITY b 'c'>]>",
    b"&b;", b"<a>",
    b"</robot>", b"<![CDATA[", b"WAIT SEC 5\r\n", b"HALT\n", b"LIN {X 1000}\n", b"GOTO x\n",
)  # fmt: skip
OPENINGS = (b"[", b"{a: ", b'{"a":', b"- ", b"? ", b"<a>", b"(", b"a.", b"{", b"[[")


def mutated(data: bytes, rng: random.Random, *, binary: bool, suffix: str) -> bytes:
    """Return a changed file: one change mostly, sometimes a few."""
    if suffix == ".npz" and rng.random() < 0.5:
        return _other_arrays(data, rng)
    if suffix == ".parquet" and rng.random() < 0.5:
        return _other_columns(data, rng)
    changes = _OF_BYTES if binary else _OF_TEXT
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        data = rng.choice(changes)(data, rng)
    return data


def replaced_file(file: Path, rng: random.Random) -> str:
    """Put something that is no regular file, or another one, in the place of a file and return what."""
    file.unlink()
    what = rng.choice(("folder", "pipe", "device", "nothing", "dangling link", "itself", "empty", "noise"))
    if what == "folder":
        file.mkdir()
    elif what == "pipe":
        os.mkfifo(file)
    elif what == "device":
        file.symlink_to("/dev/zero")
    elif what == "dangling link":
        file.symlink_to("nowhere")
    elif what == "itself":
        file.symlink_to(file.name)
    elif what == "empty":
        file.write_bytes(b"")
    elif what == "noise":
        file.write_bytes(rng.randbytes(2000))
    return what


# --- bytes and text ---------------------------------------------------------------------------------


def _flip(data: bytes, rng: random.Random) -> bytes:
    changed = bytearray(data)
    for _ in range(rng.choice((1, 1, 3, 20))):
        if changed:
            changed[rng.randrange(len(changed))] ^= 1 << rng.randrange(8)
    return bytes(changed)


def _cut(data: bytes, rng: random.Random) -> bytes:
    return data[: rng.randrange(len(data) + 1)]


def _cut_out(data: bytes, rng: random.Random) -> bytes:
    at = rng.randrange(len(data) + 1)
    return data[:at] + data[at + rng.choice((1, 1, 4, 50, 1000)) :]


def _repeat_part(data: bytes, rng: random.Random) -> bytes:
    at = rng.randrange(len(data) + 1)
    part = data[at : at + rng.choice((1, 8, 100))]
    return data[:at] + part * rng.choice((2, 2, 100)) + data[at:]


def _insert(data: bytes, rng: random.Random) -> bytes:
    at = rng.randrange(len(data) + 1)
    return data[:at] + rng.choice(LOOSE) + data[at:]


def _noise(data: bytes, rng: random.Random) -> bytes:
    at, count = rng.randrange(len(data) + 1), rng.choice((1, 4, 8, 64))
    return data[:at] + rng.randbytes(count) + data[at + count :]


def _swapped(pattern: re.Pattern[bytes], choices: tuple[bytes, ...]) -> Callable[[bytes, random.Random], bytes]:
    def change(data: bytes, rng: random.Random) -> bytes:
        found = list(pattern.finditer(data))
        if not found:
            return _flip(data, rng)
        for match in sorted(rng.sample(found, min(len(found), rng.choice((1, 1, 2, 10)))), key=lambda m: -m.start()):
            data = data[: match.start()] + rng.choice(choices) + data[match.end() :]
        return data

    return change


def _other_word(data: bytes, rng: random.Random) -> bytes:
    found = list(_WORD.finditer(data))
    if len(found) < 2:
        return _flip(data, rng)
    one, other = rng.sample(found, 2)
    return data[: one.start()] + other.group() + data[one.end() :]


def _scaled(data: bytes, rng: random.Random) -> bytes:
    found = list(_NUMBER.finditer(data))
    if not found:
        return _flip(data, rng)
    match = rng.choice(found)
    value = float(match.group()) * 10.0 ** rng.choice((-12, -3, 3, 6, 12))
    return data[: match.start()] + repr(value).encode() + data[match.end() :]


def _nested(data: bytes, rng: random.Random) -> bytes:
    found = list(_VALUE.finditer(data)) or [re.match(rb"", data)]
    match = rng.choice(found)
    assert match is not None
    return data[: match.start()] + rng.choice(OPENINGS) * rng.choice((2, 500, 5000, 100_000)) + data[match.end() :]


def _lines(data: bytes, rng: random.Random) -> bytes:
    lines = data.splitlines(keepends=True) or [b""]
    at = rng.randrange(len(lines))
    what = rng.randrange(5)
    if what == 0:
        del lines[at]
    elif what == 1:
        lines.insert(at, lines[at])
    elif what == 2:
        lines[at] = lines[at].rstrip() + lines[(at + 1) % len(lines)]
    elif what == 3:
        other = rng.randrange(len(lines))
        lines[at], lines[other] = lines[other], lines[at]
    else:
        lines[at] *= rng.choice((50, 2000))
    return b"".join(lines)


def _aliases(data: bytes, rng: random.Random) -> bytes:
    return b"a0: &a0 [0,0]\n" + b"".join(b"a%d: &a%d [%s]\n" % (k, k, b",".join([b"*a%d" % (k - 1)] * 9))
                                         for k in range(1, 10)) + data  # fmt: skip


def _mark(data: bytes, rng: random.Random) -> bytes:
    return rng.choice((b"\xef\xbb\xbf", b"\xff\xfe", b"# remark\n", b"\n", b"---\n", b"\x1f\x8b\x08")) + data


_OF_BYTES = (_flip, _flip, _cut, _cut_out, _repeat_part, _noise, _swapped(_NUMBER, NUMBERS), _insert)
_OF_TEXT = (
    _flip, _cut, _cut_out, _repeat_part, _insert, _swapped(_NUMBER, NUMBERS), _swapped(_NUMBER, NUMBERS), _other_word,
    _swapped(_VALUE, VALUES), _swapped(_VALUE, VALUES), _nested, _lines, _lines, _scaled, _scaled, _aliases, _mark,
)  # fmt: skip


# --- archives and tables ----------------------------------------------------------------------------


def _other_array(array: np.ndarray, rng: random.Random) -> np.ndarray:
    changes: tuple[Callable[[], Any], ...] = (
        lambda: array.astype(str),
        lambda: array.astype("S8"),
        lambda: array.ravel()[:0],
        lambda: array[..., None],
        lambda: array.ravel(),
        lambda: np.array(rng.choice(("False", "", 0, 1, 2, np.nan, 1e308, "2001-01-01", True))),
        lambda: np.zeros(array.shape, dtype=complex),
        lambda: np.full(array.shape, np.datetime64("2001-01-01")),
        lambda: np.full(array.shape, rng.choice((np.nan, np.inf, 1e308, 1e200, 1e-300, 1e7))),
        lambda: np.zeros(array.shape, dtype=[("a", "f8"), ("b", "f8")]),
        lambda: np.zeros(array.shape, dtype=np.float16),
        lambda: np.arange(array.size, dtype=np.longdouble).reshape(array.shape) * np.longdouble("1e400"),
        lambda: np.atleast_1d(array)[::-1],
    )
    return rng.choice(changes)()


def _other_arrays(data: bytes, rng: random.Random) -> bytes:
    with np.load(io.BytesIO(data)) as archive:
        arrays = {name: archive[name] for name in archive.files}
    name = rng.choice(list(arrays))
    what = rng.randrange(6)
    if what == 0:
        del arrays[name]
    elif what == 1:
        arrays[rng.choice(("other", "executable", "row", "units"))] = np.zeros(rng.choice((0, 3, 40_000_000)), np.int8)
    else:
        try:
            arrays[name] = _other_array(arrays[name], rng)
        except (ValueError, TypeError):
            arrays[name] = arrays[name][:0]
    out = io.BytesIO()
    np.savez_compressed(out, **arrays)
    return out.getvalue()


def _other_columns(data: bytes, rng: random.Random) -> bytes:
    import pyarrow as pa
    from pyarrow import parquet

    table = parquet.read_table(io.BytesIO(data), use_threads=False)
    at = rng.randrange(table.num_columns)
    count = table.num_rows
    columns: tuple[Callable[[], Any], ...] = (
        lambda: pa.nulls(count),
        lambda: pa.array([None] * count, pa.float64()),
        lambda: pa.array(["text"] * count),
        lambda: pa.array([float("nan")] * count),
        lambda: pa.array([1e308] * count),
        lambda: pa.array([{"a": 1}] * count),
        lambda: pa.array([[1.0]] * count),
        lambda: pa.array(range(count), pa.timestamp("ns")),
        lambda: pa.array([True] * count),
        lambda: pa.array([b"x"] * count),
    )
    what = rng.randrange(4)
    if what == 0:
        table = table.remove_column(at)
    elif what == 1:
        said = rng.choice(
            (b"", b"{", b"[" * 100_000, b'{"executable": "yes"}', b"[]", b"null", b'{"executable": NaN}', b"\xff")
        )
        table = table.replace_schema_metadata({b"qparm": said})
    elif what == 2:
        table = table.rename_columns([n if k != at else "t" for k, n in enumerate(table.column_names)])
    else:
        table = table.set_column(at, table.column_names[at], rng.choice(columns)())
    out = io.BytesIO()
    parquet.write_table(table, out)
    return out.getvalue()


# --- options ----------------------------------------------------------------------------------------

_TEXTS = (
    "", " ", "0", "-1", "1e308", "nan", "inf", "20", "20 ms", "0 ms", "1e-300 s", "1e308 min", "20 mm", "1,5 mm",
    "360,5 mm", "\u0663 mm",
    "1_0 mm", "x", "=", ":", "a=b:c", "arm.lengths.upper=1 mm:2 mm", "arm.lengths.upper=2 m:1 m",
    "arm.joints[0]=1 mm:2 mm",
    "process.feed=1 mm/s:2 mm/s", "arm.lengths.upper=600 mm:800 mm", "/dev/zero", "/dev/null/x", ".", "/", "n" * 300,
    "\u65e5\u672c",
    "1 um", "1000 km", "-5 deg", "100 deg", "10 deg", "0.001 mm/s", "100 m/s", "50 mm/s", "9" * 400, "(" * 5000,
    "\n", "a\tb",
)  # fmt: skip
_COMMANDS: tuple[tuple[tuple[str, ...], tuple[str, ...]], ...] = (
    (("plan", "cell.toml", "--out", "{out}"), ("--feed", "--tool-tilt", "--period", "--seed", "--solver", "--timing")),
    (("check", "cell.toml", "--out", "{out}"), ("--seed", "--out")),
    (("time", "waypoints.csv", "--limits", "limits.json", "--out", "{out}/t.csv"), ("--band", "--period", "--limits")),
    (("export", "trajectory", "plan", "--to", "csv", "--out", "{out}/x.csv"), ("--period", "--to")),
    (("verify", "motion.csv", "--cell", "cell.toml"), ("--cell",)),
    (("workspace", "cell.toml", "--out", "{out}", "--spacing", "500 mm"), ("--spacing", "--depth", "--seed",
    "--against")),
    (("design", "design.toml", "--out", "{out}", "--budget", "1", "--level", "reach", "--plans", "0", "--workers", "1"),
     ("--vary", "--seed", "--method", "--budget")),
    (("new",), ()),
)  # fmt: skip


def mutated_arguments(rng: random.Random) -> list[str]:
    """Return a command with a value of an option, or a file, that may be anything."""
    command, options = rng.choice(_COMMANDS)
    arguments = list(command)
    if not options or rng.random() < 0.15:
        at = 1 if len(arguments) > 1 else len(arguments)
        text = rng.choice(_TEXTS)
        arguments[at : at + 1] = [text if text not in ("", ".", "/") else "{out}/" + text]
        return arguments
    option = rng.choice(options)
    value = rng.choice(_TEXTS)
    if option == "--budget":  # a large one is work
        value = rng.choice(("0", "-1", "x", "1.5", "9" * 30 + "x", ""))
    if option == "--out":
        value = "{out}/" + value.strip("/")
    return [*arguments, option, value]
