"""The one way in which files are written: whole or not at all, together, and never over what is no file.

Files are written into a hidden folder beside the place where they go. One rename of that folder decides: before it they
vanish with whoever stops, after it they are moved in, if need be by whoever uses the folder next
(:func:`finish_interrupted`). So even a process that is killed leaves all files of one run or all of the other.

A hidden folder belongs to a process for as long as that holds a lock on it, which the system lets go however the
process ends. What nobody holds is left over, and cleared away.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import secrets
import shutil
import stat
import tempfile
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from qparm.errors import InvalidInput, OutputError
from qparm.stopping import at_stop

try:
    import fcntl
except ImportError:  # Windows: nothing is taken for left over there
    fcntl = None

__all__ = ["append", "finish_interrupted", "is_staging", "require_file", "require_writable", "staged", "staged_file"]

# How the hidden folder is called: while files are written into it, while they are moved in, and while they are moved
# out again because one could not be moved in.
_WRITING, _MOVING, _RETURNING = ".qparm-unfinished-", ".qparm-finished-", ".qparm-returning-"
# In it: what is to be done, and the files that are replaced.
_ORDERS, _REPLACED = ".orders.json", ".replaced"
_KINDS = (
    (stat.S_ISREG, "a file"),
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
)
# Moving files in takes milliseconds: others are waited for at most so long, and looked for so often (s).
_LONGEST, _PAUSE = 5.0, 0.01


# --- what may be written to -----------------------------------------------------------------------------


def require_writable(folder: str | Path, names: Iterable[str] = ()) -> Path:
    """Make a folder and return it, or raise OutputError if files of these names cannot be written there."""
    folder = Path(folder)
    _require_kind(folder, "a folder")
    with _told(folder):
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    for name in names:
        _require_file_in(folder, name)
    return folder


def require_file(file: str | Path) -> Path:
    """Return where a file goes, or raise OutputError if something else has its name, such as a folder or a device."""
    file = Path(file)
    _require_kind(file, "a file")
    return file


def _require_file_in(folder: Path, name: str) -> None:
    found = _kind(folder / name)
    if found not in (None, "a file"):
        raise OutputError(folder, f"{name!r} is {found} there, not a file")


def is_staging(path: Path) -> bool:
    """Return whether a path is a hidden folder of this module's."""
    return path.name.startswith((_WRITING, _MOVING, _RETURNING))


def _require_kind(path: Path, wanted: str) -> None:
    found = _kind(path)
    if found not in (None, wanted):
        raise OutputError(path, f"it is {found}, not {wanted}")


def _kind(path: Path) -> str | None:
    """Return what a path leads to, links followed; None for nothing."""
    try:
        mode = path.stat().st_mode
    except (FileNotFoundError, NotADirectoryError):
        return None
    except (OSError, ValueError) as error:  # a name too long, links in a circle; a NUL in the name
        raise OutputError(path, getattr(error, "strerror", None) or str(error)) from None
    return next((kind for is_kind, kind in _KINDS if is_kind(mode)), "a device")


@contextlib.contextmanager
def _told(place: Path) -> Iterator[None]:
    """Raise errors of the system as OutputError."""
    try:
        yield
    except OutputError:
        raise
    except OSError as error:
        raise OutputError(place, error.strerror or str(error)) from error


# --- writing ------------------------------------------------------------------------------------------------


@contextlib.contextmanager
def staged(folder: str | Path, *, obsolete: Iterable[str] = ()) -> Iterator[Path]:
    """Give a hidden folder to write in; its files are moved to ``folder`` at the end, or vanish on any error.

    Parameters
    ----------
    folder : str or Path
        Made if it does not exist. A file in it that is a link stays one: what it leads to is replaced.
    obsolete : iterable of str
        Names of files that are removed from the folder together with the others' moving in, unless they are written.

    Raises
    ------
    OutputError
        If something cannot be written; the folder is as before.
    """
    folder = require_writable(folder)
    finish_interrupted(folder)
    _clear(folder)
    area = _Area(folder)
    with at_stop(area.stop), _told(folder):
        try:
            area.make()
            yield area.path
            area.move_in(set(obsolete))
        finally:
            area.remove()


@contextlib.contextmanager
def staged_file(file: str | Path, *, new: bool = False) -> Iterator[Path]:
    """Give a hidden path to write one file at; it is moved to its place at the end, or vanishes on any error.

    With ``new`` the file must not exist: else InvalidInput.
    """
    file = Path(file)
    if new and os.path.lexists(file):
        raise InvalidInput(f"{str(file)!r} exists already; name another file")
    require_file(file)
    if not file.name:
        raise OutputError(file, "it names no file")
    if new and not file.parent.is_dir():
        raise OutputError(file, "there is no such folder")
    with staged(file.parent) as folder:
        yield folder / file.name
        if new and os.path.lexists(file):
            raise InvalidInput(f"{str(file)!r} exists already; name another file")


def append(file: Path, data: bytes) -> None:
    """Add to a file that grows; when this returns the data is on the disk, and after an error nothing of it.

    Raises
    ------
    OutputError
    """
    require_file(file)
    file = Path(os.path.realpath(file))
    existed = file.exists()
    with _told(file):
        before = file.stat().st_size if existed else 0
        try:
            with file.open("ab", buffering=0) as out:
                while data:
                    data = data[out.write(data) :]
                os.fsync(out.fileno())
        except BaseException:
            with contextlib.suppress(OSError):
                if existed:
                    os.truncate(file, before)
                else:
                    file.unlink(missing_ok=True)
            raise


class _Area:
    """The hidden folder of one writer, and what becomes of it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.path = folder / (_WRITING + secrets.token_hex(4))
        self._lock: int | None = None
        self._under_way = False

    def make(self) -> None:
        while True:
            self.path.mkdir(mode=0o700)
            self._lock = _hold(self.path, seconds=_LONGEST)
            if self.path.exists():  # else another took it for left over before the lock was held
                return
            _let_go(self._lock)

    def move_in(self, obsolete: set[str]) -> None:
        names = sorted(entry.name for entry in self.path.iterdir() if entry.is_file())
        for name in names:
            _require_file_in(self.folder, name)
        with _folder_to_oneself(self.folder):
            _finish_all(self.folder)
            gone = sorted(name for name in obsolete - set(names) if (self.folder / name).is_file())
            if len(names) == 1 and not gone:
                _place(self.path / names[0], self.folder / names[0])
                return
            self._keep_replaced([*names, *gone])
            added = [name for name in names if not (self.folder / name).exists()]
            orders = {"files": names, "obsolete": gone, "added": added}
            (self.path / _ORDERS).write_text(json.dumps(orders), encoding="utf-8")
            self._rename(_MOVING)
            self._under_way = True
            try:
                _move_in(self.path, self.folder)
            except BaseException:
                self._rename(_RETURNING)
                _move_back(self.path, self.folder)
                self._under_way = False
                raise
            self._under_way = False

    def _keep_replaced(self, names: list[str]) -> None:
        kept = self.path / _REPLACED
        kept.mkdir()
        for name in names:
            old = Path(os.path.realpath(self.folder / name))
            if old.exists():
                try:
                    os.link(old, kept / name)
                except OSError:  # on another disk, or where there are no links
                    shutil.copy2(old, kept / name)

    def _rename(self, stage: str) -> None:
        path = self.path.with_name(stage + self.path.name.rpartition("-")[2])
        self.path.rename(path)
        self.path = path

    def stop(self) -> None:
        """Clear up at the end of the process: what is decided is done."""
        for path in self.folder.glob(f".qparm-*-{self.path.name.rpartition('-')[2]}"):
            _settle(path, self.folder)

    def remove(self) -> None:
        if not self._under_way:  # else whoever uses the folder next finishes it
            shutil.rmtree(self.path, ignore_errors=True)
        _let_go(self._lock)


def _place(source: Path, target: Path) -> None:
    """Move a file in one step; where the target is a link, to where that leads."""
    target = Path(os.path.realpath(target))
    try:
        source.replace(target)
    except OSError:
        if source.stat().st_dev == target.parent.stat().st_dev:
            raise
        copy = target.with_name(f"{_WRITING}{secrets.token_hex(4)}")  # on the other disk
        try:
            shutil.copyfile(source, copy)
            copy.replace(target)
        finally:
            copy.unlink(missing_ok=True)
        source.unlink()


def _orders(path: Path) -> dict[str, Any]:
    try:
        return json.loads((path / _ORDERS).read_text(encoding="utf-8"))
    except FileNotFoundError:  # all is done, but that the folder is still there
        return {"files": [], "obsolete": [], "added": []}


def _move_in(path: Path, folder: Path) -> None:
    """Move the files of a hidden folder in, as far as that is not done."""
    orders = _orders(path)
    for name in orders["files"]:
        if (path / name).exists():
            _place(path / name, folder / name)
    for name in orders["obsolete"]:
        (folder / name).unlink(missing_ok=True)


def _move_back(path: Path, folder: Path) -> None:
    """Put back the files that were replaced, as far as that is not done."""
    for name in _orders(path)["added"]:
        (folder / name).unlink(missing_ok=True)
    for old in sorted((path / _REPLACED).iterdir()):
        _place(old, folder / old.name)


# --- what others left ---------------------------------------------------------------------------------------


def finish_interrupted(folder: str | Path) -> None:
    """Move in the files of a run that was killed after it had written all of them.

    Raises
    ------
    OutputError
        If they cannot be moved.
    """
    folder = Path(folder)
    try:
        found = any(entry.name.startswith((_MOVING, _RETURNING)) for entry in folder.iterdir())
    except OSError:  # whoever uses it says what is wrong with it
        return
    if found:
        with _told(folder), _folder_to_oneself(folder):
            _finish_all(folder)


def _finish_all(folder: Path) -> None:
    for stage in (_MOVING, _RETURNING):
        for path in sorted(folder.glob(stage + "*")):
            with _left_over(path) as nobodys:
                if nobodys:
                    _settle(path, folder)


def _clear(folder: Path) -> None:
    """Remove what others left half written."""
    for path in folder.glob(_WRITING + "*"):
        with _left_over(path) as nobodys:
            if nobodys:
                shutil.rmtree(path, ignore_errors=True)


def _settle(path: Path, folder: Path) -> None:
    if path.name.startswith(_MOVING):
        _move_in(path, folder)
    elif path.name.startswith(_RETURNING):
        _move_back(path, folder)
    shutil.rmtree(path, ignore_errors=True)


# --- locks --------------------------------------------------------------------------------------------------


def _hold(path: Path, *, seconds: float = 0.0) -> int | None:
    """Return a lock on a folder, or None if another holds it for so long, or folders cannot be locked here."""
    if fcntl is None:
        return None
    try:
        opened = os.open(path, os.O_RDONLY)
    except OSError:
        return None
    until = time.monotonic() + seconds
    while True:
        try:
            fcntl.flock(opened, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return opened
        except OSError as error:
            if error.errno not in (errno.EAGAIN, errno.EACCES) or time.monotonic() >= until:
                os.close(opened)
                return None
        time.sleep(_PAUSE)


def _let_go(lock: int | None) -> None:
    if lock is not None:
        os.close(lock)


@contextlib.contextmanager
def _left_over(path: Path) -> Iterator[bool]:
    """Tell whether nobody holds a hidden folder any more, and hold it meanwhile."""
    lock = _hold(path)
    try:
        yield lock is not None
    finally:
        _let_go(lock)


@contextlib.contextmanager
def _folder_to_oneself(folder: Path) -> Iterator[None]:
    """Keep others from moving files into a folder meanwhile; a lock that is held for long is no other writer's."""
    lock = _hold(folder, seconds=_LONGEST)
    try:
        yield
    finally:
        _let_go(lock)
