"""Files are written whole or not at all, all of a run together, and never over what is no file."""

from __future__ import annotations

import errno
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from qparm.errors import InvalidInput, OutputError
from qparm.files.output import append, finish_interrupted, require_file, require_writable, staged, staged_file

OLD = {"a": b"old a", "b": b"old b", "c": b"old c", "mine": b"mine"}
NEW = {"a": b"new a", "b": b"new b", "d": b"new d", "mine": b"mine"}


def fill(folder: Path, content: dict[str, bytes]) -> Path:
    folder.mkdir(exist_ok=True)
    for name, data in content.items():
        (folder / name).write_bytes(data)
    return folder


def contents(folder: Path) -> dict[str, bytes]:
    return {entry.name: entry.read_bytes() for entry in folder.iterdir()}


def renew(folder: Path) -> None:
    with staged(folder, obsolete=("a", "c")) as staging:
        for name in ("a", "b", "d"):
            (staging / name).write_bytes(NEW[name])


def test_all_files_of_a_run_replace_those_of_another(tmp_path: Path) -> None:
    folder = fill(tmp_path / "out", OLD)
    renew(folder)
    assert contents(folder) == NEW


@pytest.mark.parametrize(
    "error", [OSError(errno.ENOSPC, "No space left on device"), ValueError("no"), KeyboardInterrupt()]
)
def test_an_error_while_files_are_written_changes_nothing(error: BaseException, tmp_path: Path) -> None:
    folder = fill(tmp_path / "out", OLD)
    expected = OutputError if isinstance(error, OSError) else type(error)
    with pytest.raises(expected), staged(folder) as staging:
        (staging / "a").write_bytes(b"new a")
        raise error
    assert contents(folder) == OLD


# A process that is killed at its k-th rename, or just after it.
KILLED = """
import os, pathlib, signal, sys
from qparm.files.output import staged
left = int(sys.argv[2])
def slain(rename):
    def renamed(self, target):
        global left
        if left == 0:
            os.kill(os.getpid(), signal.SIGKILL)
        left -= 1
        return rename(self, target)
    return renamed
pathlib.Path.replace, pathlib.Path.rename = slain(pathlib.Path.replace), slain(pathlib.Path.rename)
with staged(sys.argv[1], obsolete=("a", "c")) as staging:
    for name in "abd":
        (staging / name).write_bytes(b"new " + name.encode())
"""


@pytest.mark.parametrize("renames", range(6))
def test_a_process_killed_while_it_moves_files_leaves_all_of_one_run(renames: int, tmp_path: Path) -> None:
    folder = fill(tmp_path / "out", OLD)
    done = subprocess.run([sys.executable, "-c", KILLED, str(folder), str(renames)], check=False, timeout=60)
    assert done.returncode == (0 if renames > 3 else -signal.SIGKILL)
    finish_interrupted(folder)
    assert files_of(folder) == (OLD if renames == 0 else NEW)
    renew(folder)  # whoever writes next clears away what is left
    assert contents(folder) == NEW


def files_of(folder: Path) -> dict[str, bytes]:
    return {entry.name: entry.read_bytes() for entry in folder.iterdir() if entry.is_file()}


@pytest.mark.parametrize("fails", range(4))
def test_a_file_that_cannot_be_moved_brings_all_the_old_ones_back(
    fails: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = fill(tmp_path / "out", OLD)
    left = [fails]

    def refusing(move: Callable[..., Any]) -> Callable[..., Any]:
        def moved(*arguments: Any, **options: Any) -> Any:
            left[0] -= 1
            if left[0] == -1:
                raise OSError(errno.EIO, "Input/output error")
            return move(*arguments, **options)

        return moved

    monkeypatch.setattr(Path, "replace", refusing(Path.replace))
    monkeypatch.setattr(Path, "unlink", refusing(Path.unlink))
    with pytest.raises(OutputError, match="Input/output error"):
        renew(folder)
    monkeypatch.undo()
    finish_interrupted(folder)
    assert contents(folder) == OLD


def test_the_hidden_folder_of_a_running_process_is_left_alone(tmp_path: Path) -> None:
    with staged(tmp_path) as mine:
        (mine / "mine").write_bytes(b"1")
        with staged(tmp_path) as others:
            (others / "others").write_bytes(b"2")
        assert (mine / "mine").exists()
    assert contents(tmp_path) == {"mine": b"1", "others": b"2"}


@pytest.fixture(params=["folder", "pipe", "socket", "device"])
def no_file(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Yield what has a name but is no regular file, through a link for the device."""
    place = tmp_path / "place"
    if request.param == "folder":
        place.mkdir()
    elif request.param == "pipe":
        os.mkfifo(place)
    elif request.param == "device":
        place.symlink_to(os.devnull)
    else:
        monkeypatch.chdir(tmp_path)  # names of sockets are short
        with socket.socket(socket.AF_UNIX) as server:
            server.bind("place")
            yield place
        return
    yield place


def test_what_is_no_file_is_never_replaced(no_file: Path) -> None:
    before, writers = no_file.stat(), (require_file, lambda file: append(file, b"x"))
    for write in writers:
        with pytest.raises(OutputError, match="not a file"):
            write(no_file)
    with pytest.raises(OutputError, match="not a file"), staged_file(no_file):
        raise AssertionError
    with pytest.raises(OutputError, match=r"'place' is .* not a file"), staged(no_file.parent) as staging:
        (staging / no_file.name).write_bytes(b"x")
    with pytest.raises(OutputError, match=r"'place' is .* not a file"):
        require_writable(no_file.parent, [no_file.name])
    assert (no_file.stat().st_mode, no_file.stat().st_ino) == (before.st_mode, before.st_ino)
    assert [entry.name for entry in no_file.parent.iterdir()] == ["place"]


def test_a_folder_is_not_made_of_a_device() -> None:
    with pytest.raises(OutputError, match="it is a device, not a folder"):
        require_writable(os.devnull)


@pytest.mark.parametrize("exists", [True, False])
def test_a_link_is_written_through(exists: bool, tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    real = tmp_path / "elsewhere" / "real.csv"
    if exists:
        real.write_bytes(b"old")
    link = tmp_path / "link.csv"
    link.symlink_to(real)
    with staged_file(link) as file:
        assert file.name == "link.csv"
        file.write_bytes(b"new")
    assert link.is_symlink()
    assert real.read_bytes() == b"new"
    with staged(tmp_path) as staging:
        (staging / "link.csv").write_bytes(b"newer")
        (staging / "other").write_bytes(b"")
    assert link.is_symlink()
    assert real.read_bytes() == b"newer"
    append(link, b"+")
    assert real.read_bytes() == b"newer+"


def test_a_new_file_replaces_nothing(tmp_path: Path) -> None:
    file = tmp_path / "cell.toml"
    with staged_file(file, new=True) as staging:
        staging.write_bytes(b"1")
    with pytest.raises(InvalidInput, match="exists already"), staged_file(file, new=True):
        raise AssertionError
    link = tmp_path / "link"
    link.symlink_to(tmp_path / "nowhere")
    with pytest.raises(InvalidInput, match="exists already"), staged_file(link, new=True):
        raise AssertionError
    assert file.read_bytes() == b"1"


@pytest.mark.parametrize("before", [None, b"", b"one\n"])
def test_nothing_is_left_of_what_could_not_be_appended(
    before: bytes | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "journal"
    if before is not None:
        file.write_bytes(before)

    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OutputError, match="No space left"):
        append(file, b"two\n")
    monkeypatch.undo()
    assert (file.read_bytes() if file.exists() else None) == before
    append(file, b"two\n")
    assert file.read_bytes() == (before or b"") + b"two\n"


def full_after(size: int) -> Callable[[], None]:
    import resource

    return lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))


def test_new_on_a_full_disk_leaves_nothing(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "qparm.cli", "new", "cell.toml"]
    done = subprocess.run(
        command, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=60, preexec_fn=full_after(100)
    )
    assert done.returncode == 4
    (line,) = done.stderr.splitlines()
    assert line.startswith("qparm: cannot write to '.': ")
    assert list(tmp_path.iterdir()) == []
    assert subprocess.run(command, cwd=tmp_path, check=False, timeout=60, capture_output=True).returncode == 0
