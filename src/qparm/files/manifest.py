"""The files that belong together: a plan's report holds a hash of every file that was written with it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

__all__ = ["REPORT_FILE", "changed_files", "hashes", "is_changed"]

REPORT_FILE = "report.json"
_KEY = "files"


def hashes(folder: Path, names: Iterable[str]) -> dict[str, dict[str, str]]:
    """Return what a report holds of its files: the SHA-256 of each that is there, by name."""
    return {_KEY: {name: _hash(folder / name) for name in names if name != REPORT_FILE and (folder / name).is_file()}}


def changed_files(folder: Path, report: Mapping[str, Any], names: Iterable[str]) -> list[str]:
    """Return which of some files are not those that a report was written with.

    A report that holds no hashes, as those of older versions, tells none.
    """
    known = report.get(_KEY)
    return [
        name for name in names if isinstance(known, Mapping) and known.get(name, "") not in ("", _hash(folder / name))
    ]


def is_changed(file: Path) -> bool:
    """Return whether a file lies beside the report of a plan that was written with another file of its name."""
    try:
        report = json.loads((file.parent / REPORT_FILE).read_text(encoding="utf-8"))
        return isinstance(report, dict) and bool(changed_files(file.parent, report, [file.name]))
    except (OSError, ValueError, RecursionError):  # no report of ours, or no file: whoever reads it says what is wrong
        return False


def _hash(file: Path) -> str:
    with file.open("rb") as opened:
        return hashlib.file_digest(opened, "sha256").hexdigest()
