"""An append-only journal of finished evaluations: whatever dies, what was finished is not done again.

One JSON object per line, written through to the disk before the study goes on. A line that is torn, because the
machine stopped while it was written, is passed over. The key of a line is a hash of what the evaluation depends on:
the cell without its ``[design]`` table, the variables' names, the seed, the version of qparm, and the design itself.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from qparm.design.evaluate import Evaluation
from qparm.errors import InvalidInput, OutputError
from qparm.files.output import append, require_file
from qparm.files.reading import read_bytes

if TYPE_CHECKING:
    from qparm.design.space import DesignSpace

__all__ = ["Journal", "problem_hash", "set_aside"]


# How every line begins: a torn one too.
_START = b'{"key":'


def set_aside(file: Path) -> list[Path]:
    """Return earlier journals beside one, ``journal.before-1.jsonl`` and so on, the oldest first."""
    found = {}
    for other in file.parent.glob(f"{file.stem}.before-*{file.suffix}"):
        number = other.name.removeprefix(f"{file.stem}.before-").removesuffix(file.suffix)
        if number.isdecimal():
            found[int(number)] = other
    return [found[number] for number in sorted(found)]


def _next_aside(file: Path) -> Path:
    number = 1 + len(set_aside(file))
    while (name := file.with_name(f"{file.stem}.before-{number}{file.suffix}")).exists():
        number += 1
    return name


def problem_hash(space: DesignSpace, seed: int) -> str:
    """Return the hash of all that an evaluation depends on but the design."""
    import qparm

    what = {"cell": space.data, "variables": list(space.keys), "seed": seed, "version": qparm.__version__}
    text = json.dumps(what, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


class Journal:
    """Finished evaluations, in memory and, with a file, on disk.

    Parameters
    ----------
    problem : str
        See :func:`problem_hash`.
    file : Path, optional
        Read first if it is there; lines of other problems are kept and not used.
    anew : bool
        Do not read it: before the first line is written it is renamed to the next free of :func:`set_aside`'s names.

    Attributes
    ----------
    known : dict of str to Evaluation
        Of this problem, by :meth:`key`.
    others, torn, written : int
        Designs of other problems and lines that could not be read, in the file; lines written since.

    Raises
    ------
    OutputError
        If the file can be neither read nor written.
    InvalidInput
        If it is not a journal.
    """

    def __init__(self, problem: str, file: Path | None = None, *, anew: bool = False) -> None:
        self.problem, self.file = problem, file
        self.known: dict[str, Evaluation] = {}
        self.others = self.torn = self.written = 0
        self._anew = anew
        if file is not None:
            require_file(file)
            if not file.parent.is_dir():
                raise OutputError(file, "there is no such folder")
        if file is None or anew:
            return
        try:
            text = read_bytes(file, empty=True) if file.exists() else b""
            self._read(text)
        except OSError as error:
            raise OutputError(file, error.strerror or str(error)) from None
        if text and not text.endswith(b"\n"):  # the next line starts on a line of its own
            append(file, b"\n")

    def key(self, x: Sequence[float]) -> str:
        """Return the key of a design."""
        text = self.problem + "".join(" " + float(value).hex() for value in x)
        return hashlib.sha256(text.encode()).hexdigest()

    def get(self, x: Sequence[float]) -> Evaluation | None:
        """Return what is known of a design."""
        return self.known.get(self.key(x))

    def add(self, evaluation: Evaluation) -> None:
        """Write an evaluation down; it is on the disk when this returns."""
        key = self.key(evaluation.x)
        self.known[key] = evaluation
        if self.file is None:
            return
        line = json.dumps({"key": key, **evaluation.to_dict()}, separators=(",", ":"), allow_nan=False) + "\n"
        try:
            if self._anew and not self.written and self.file.exists() and self.file.stat().st_size:
                self.file.rename(_next_aside(self.file))
        except OSError as error:
            raise OutputError(self.file, error.strerror or str(error)) from None
        append(self.file, line.encode())
        self.written += 1

    def digest(self) -> str:
        """Return a hash of what is known, times left out: equal for runs that found the same."""
        lines = []
        for key in sorted(self.known):
            data = self.known[key].to_dict()
            del data["seconds"]
            lines.append(json.dumps({"key": key, **data}, sort_keys=True))
        return hashlib.sha256("\n".join(lines).encode()).hexdigest()

    def _read(self, text: bytes) -> None:
        others: set[str] = set()
        foreign = 0
        for line in text.split(b"\n"):
            if not line.strip():
                continue
            try:
                data = json.loads(line)
                key, evaluation = str(data["key"]), Evaluation.from_dict(data)
            except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError):
                self.torn += 1
                foreign += not (line.startswith(_START) or _START.startswith(line) or not line.strip(b"\0"))
                continue
            if key == self.key(evaluation.x):
                self.known[key] = evaluation
            else:
                others.add(key)
        self.others = len(others)
        if foreign and not self.known and not self.others:
            raise InvalidInput(f"{str(self.file)!r} is not a journal of designs: no line of it can be read")
