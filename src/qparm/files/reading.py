"""The border at which files come in: one way to open them, one guard around whatever reads them, one idea of a number.

A reader says ``with guarded(file):`` around its parsing. Whatever a broken or hostile file makes a parser raise becomes
an InvalidInput with the file's name; the size of a file is looked at before it is read, and nesting, digits and
repetition are bounded before they cost time or memory.
"""

from __future__ import annotations

import contextlib
import math
import re
import stat
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from qparm.errors import InvalidInput, QparmError

__all__ = [
    "DATA_BYTES",
    "SETTINGS_BYTES",
    "TEXT_BYTES",
    "MissingFile",
    "guarded",
    "number",
    "parse_json",
    "parse_toml",
    "parse_yaml",
    "read_bytes",
    "read_text",
    "require_regular",
    "shown",
    "shown_value",
    "whole_number",
]

# The largest files that are read: tables and bags; texts that become objects of Python, which are some ten times
# larger; what a person writes.
DATA_BYTES, TEXT_BYTES, SETTINGS_BYTES = 1 << 30, 1 << 28, 1 << 24
# Values that the aliases of a YAML file may stand for in all, and parts of a dotted key.
_MOST_ALIASED, _MOST_PARTS = 1_000_000, 64
_ALIAS = re.compile(r"(?:^|[\s\[{,:?-])\*[^\s*]", re.MULTILINE)
_DOTTED = re.compile(rf"^[ \t\[]*(?:(?:[\w-]+|\"[^\"\n]*\"|'[^'\n]*')[ \t]*\.[ \t]*){{{_MOST_PARTS}}}", re.MULTILINE)
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?|[+-]?(?:nan|inf(?:inity)?)", re.ASCII | re.IGNORECASE)
_WHOLE = re.compile(r"[+-]?\d{1,18}", re.ASCII)
# No number of a file has more digits.
_LONGEST_NUMBER = 400
_LONGEST_SHOWN = 60
_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
    (stat.S_ISSOCK, "a socket"),
)


class MissingFile(InvalidInput):
    """There is no file of the name."""


@contextlib.contextmanager
def guarded(file: str | Path, *, what: str = "", foreign: bool = False) -> Iterator[None]:
    """Turn whatever reading a file raises into an InvalidInput that names it.

    Parameters
    ----------
    file : str or Path
    what : str
        What the file should be, such as ``"a whole NPZ file"``; named where it is not.
    foreign : bool
        Whether the reading is done by a library that may raise anything on a broken file.
    """
    name = _name(file)
    is_not = f"{name} is not {what}" if what else f"{name} cannot be read"
    try:
        yield
    except QparmError:
        raise
    except FileNotFoundError:
        raise MissingFile(f"{name}: there is no such file") from None
    except UnicodeDecodeError as error:
        raise InvalidInput(f"{name} is not text, or not UTF-8: byte {error.start} cannot be read") from None
    except RecursionError:
        raise InvalidInput(f"{is_not}: its lists or tables are nested too deeply") from None
    except MemoryError:
        raise InvalidInput(f"{is_not}: it asks for more memory than there is") from None
    except OSError as error:
        raise InvalidInput(f"{is_not}: {error.strerror or error}") from None
    except Exception as error:
        if not (foreign or isinstance(error, _broken_errors())):
            raise
        raise InvalidInput(f"{is_not}: {_told(error)}") from None


def _broken_errors() -> tuple[type[Exception], ...]:
    """Return what parsers raise on what they cannot parse."""
    import csv
    import struct
    import zipfile
    import zlib

    # errors of JSON, TOML and of text that is not a number are ValueErrors
    return (ValueError, OverflowError, EOFError, csv.Error, struct.error, zipfile.BadZipFile, zlib.error)


def _told(error: Exception) -> str:
    """Return an error of a parser in one line."""
    text = re.sub(r" at 0x[0-9a-f]+", "", " ".join(str(error).split()))
    # of a key or an index that is not there, the text alone is no sentence
    kind = "" if text and isinstance(error, (ValueError, SyntaxError)) else f"{type(error).__name__} "
    return shown(f"{kind}{text}".strip(), longest=200)


def _name(file: str | Path) -> str:
    return shown(Path(file).name or str(file))


def shown(text: str, *, longest: int = _LONGEST_SHOWN) -> str:
    """Return a text as it can stand in a sentence, shortened if it is long."""
    return text if len(text) <= longest else f"{text[:longest]}..."


def shown_value(value: object) -> str:
    """Return a value from a file as it can stand in a sentence: a list or a table by its kind, it may be large."""
    if isinstance(value, (Mapping, set)):
        return "a table"
    if isinstance(value, (list, tuple)):
        return "a list"
    if isinstance(value, bool):
        return str(value).lower()
    try:
        return shown(repr(value))
    except ValueError:  # Python writes out no whole number of thousands of digits
        return "a number of thousands of digits"


# --- opening ----------------------------------------------------------------------------------------


def require_regular(file: Path, *, largest: int = DATA_BYTES) -> int:
    """Return the size of a file, or raise InvalidInput if it is none, is no regular file or is too large to be read."""
    name = _name(file)
    try:
        found = file.stat()
    except FileNotFoundError:
        raise MissingFile(f"{name}: there is no such file") from None
    except (OSError, ValueError) as error:  # a name that no file can have
        raise InvalidInput(f"{name} cannot be read: {getattr(error, 'strerror', None) or error}") from None
    if not stat.S_ISREG(found.st_mode):
        kind = next((words for test, words in _KINDS if test(found.st_mode)), "no regular file")
        raise InvalidInput(f"{name} cannot be read: it is {kind}; name a regular file")
    if found.st_size > largest:
        raise InvalidInput(
            f"{name} has {found.st_size / 2**20:.0f} MiB; a file of this kind is read up to {largest / 2**20:.0f} MiB"
        )
    return found.st_size


def read_bytes(file: str | Path, *, largest: int = DATA_BYTES, empty: bool = False) -> bytes:
    """Return what a file holds, or raise InvalidInput: it is missing, too large, or (unless ``empty``) empty."""
    file = Path(file)
    require_regular(file, largest=largest)
    with guarded(file), file.open("rb") as opened:
        # one more than allowed: some files grow, and some do not tell their size
        data = opened.read(largest + 1)
    if len(data) > largest:
        raise InvalidInput(f"{_name(file)} is larger than {largest / 2**20:.0f} MiB; a file of this kind is not")
    if not (data or empty):
        raise InvalidInput(f"{_name(file)} is empty")
    return data


def read_text(file: str | Path, *, largest: int = DATA_BYTES, empty: bool = False) -> str:
    """Return the text of a regular file in UTF-8, without the mark that some programs put before it."""
    data = read_bytes(file, largest=largest, empty=empty)
    with guarded(file):
        return data.decode("utf-8-sig")


# --- parsing ----------------------------------------------------------------------------------------


def parse_json(text: str | bytes, file: str | Path) -> Any:
    """Return what a JSON text holds; ``file`` is named where it is broken."""
    import json

    with guarded(file, what="whole JSON, it may be cut short"):
        return json.loads(text)


def parse_toml(text: str, file: str | Path) -> dict[str, Any]:
    """Return what a TOML text holds; ``file`` is named where it is broken."""
    import tomllib

    if _DOTTED.search(text):
        raise InvalidInput(f"{_name(file)} has a key of more than {_MOST_PARTS} parts")
    with guarded(file, what="valid TOML"):
        return tomllib.loads(text)


def parse_yaml(text: str, file: str | Path) -> Any:
    """Return what a YAML text holds, of its first document if all others are empty.

    The tool ``ros2 topic echo`` ends every message with ``---``.

    Raises
    ------
    InvalidInput
        If it is broken, holds several documents, or repeats parts by aliases until they are very many.
    PackageMissing
        If PyYAML is not installed.
    """
    from qparm.extras import load_extra

    yaml = load_extra("yaml", instead="a file of the format json")
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    name = _name(file)
    with guarded(file, what="whole YAML, it may be cut short", foreign=True):
        if _ALIAS.search(text):
            _bound_aliases(yaml, loader, text, name)
        documents = list(yaml.load_all(text, Loader=loader))
    filled = [document for document in documents if document is not None]
    if len(filled) > 1:
        raise InvalidInput(f"{name} holds {len(filled)} documents (messages); it must hold one")
    return filled[0] if filled else None


def _bound_aliases(yaml: Any, loader: Any, text: str, name: str) -> None:
    """Refuse a text whose aliases stand for very many values, or for what they are part of."""
    sizes: dict[str, int] = {}
    open_nodes: list[tuple[str | None, int]] = []
    total = aliased = 0
    for event in yaml.parse(text, Loader=loader):
        if isinstance(event, yaml.AliasEvent):
            if event.anchor not in sizes:
                raise InvalidInput(f"{name} has an alias {shown(event.anchor)!r} for what it is part of")
            total += sizes[event.anchor]
            aliased += sizes[event.anchor]
            if aliased > _MOST_ALIASED:
                raise InvalidInput(f"{name} repeats values by aliases more than {_MOST_ALIASED:,} times")
        elif isinstance(event, yaml.ScalarEvent):
            total += 1
            if event.anchor is not None:
                sizes[event.anchor] = 1
        elif isinstance(event, (yaml.SequenceStartEvent, yaml.MappingStartEvent)):
            open_nodes.append((event.anchor, total))
        elif isinstance(event, (yaml.SequenceEndEvent, yaml.MappingEndEvent)):
            anchor, before = open_nodes.pop()
            total += 1
            if anchor is not None:
                sizes[anchor] = total - before


# --- numbers ----------------------------------------------------------------------------------------


def number(text: str) -> float | None:
    """Return the number that a text is, None if it is none; ``nan``, ``inf`` and what overflows are not finite.

    Only what every program takes for a number is one: digits of ASCII with a point and an exponent, no ``1_000``.
    """
    text = text.strip()
    if len(text) > _LONGEST_NUMBER or _NUMBER.fullmatch(text) is None:
        return None
    return float(text)


def whole_number(value: object, *, largest: int = 10**15) -> int | None:
    """Return the whole number that a value or a text is, None if it is none or larger than any index or count."""
    if isinstance(value, str):
        text = value.strip()
        value = int(text) if _WHOLE.fullmatch(text) else None
    elif isinstance(value, float):
        value = int(value) if math.isfinite(value) and value == int(value) else None
    if isinstance(value, bool) or not isinstance(value, int) or abs(value) > largest:
        return None
    return value
