"""The progress bar that commands draw on standard error."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import click

from qparm.compiled.beside import compiled_beside
from qparm.compiled.notice import compilation_notice
from qparm.stopping import at_stop

__all__ = ["LogLines", "at_stage", "progress_bar", "told_of_compilation"]

# Where no bar can be drawn, as in a log, a line is written instead, so often (s).
_BETWEEN_LINES = 30.0


class LogLines:
    """Lines of progress for a log: what is being done, and for how long, every so often.

    Parameters
    ----------
    write : callable
        Takes a line.
    clock : callable
        Seconds.
    """

    def __init__(self, write: Callable[[str], None], clock: Callable[[], float] = time.monotonic) -> None:
        self._write, self._clock, self._begun = write, clock, clock()
        self.now: tuple[str, int, int, str] | None = None
        """The stage, how much of it is done, of how much, and the best so far."""

    def run(self, wait: Callable[[float], bool]) -> None:
        """Write a line after every wait, until one of them returns true."""
        while not wait(_BETWEEN_LINES):
            if self.now is not None:
                stage, done, total, best = self.now
                share = f"{done} of {total}, " if total > 1 else ""
                after = f"{self._clock() - self._begun:.0f} s since the start"
                self._write(f"{stage}: {share}{after}{', ' + best if best else ''}")


@contextmanager
def _logged(write: Callable[[str], None] | None) -> Iterator[LogLines]:
    """Give lines that are written from a thread of their own while the work goes on; none if there is no writer."""
    lines = LogLines(write or (lambda _: None))
    if write is None:
        yield lines
        return
    done = threading.Event()
    thread = threading.Thread(target=lines.run, args=(done.wait,), daemon=True)
    thread.start()
    try:
        yield lines
    finally:
        done.set()
        thread.join()


@contextmanager
def progress_bar(quiet: bool) -> Iterator[Callable[..., None] | None]:
    """Give a callback ``(stage, done, total, best="")`` that draws a bar, and say when kernels are compiled."""
    if quiet:
        with compiled_beside():
            yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)

    def show_cursor() -> None:
        if console.is_terminal:  # the bar has hidden it, and stands in the line
            os.write(2, b"\x1b[?25h\r\x1b[2K")

    columns = (
        TextColumn("{task.description:<12}"),
        BarColumn(bar_width=24),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.fields[best]}"),
    )
    write = None if console.is_terminal else lambda line: console.print(line, markup=False, highlight=False)
    with (
        at_stop(show_cursor),
        _logged(write) as lines,
        Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar,
    ):
        task = bar.add_task("cell", total=1, best="")

        def show(stage: str, done: int, total: int, best: str = "") -> None:
            lines.now = (stage, done, total, best)
            bar.update(task, description=stage, completed=done, total=max(total, done, 1), best=best)

        def compiled(done: int, kernel: str) -> None:
            bar.update(task, description="compiling", completed=done, total=None, best=kernel)

        with compiled_beside(), compilation_notice(lambda sentence: console.print(sentence), progress=compiled):
            yield show


@contextmanager
def told_of_compilation(quiet: bool) -> Iterator[None]:
    """Say when kernels are compiled inside, by a command that draws no bar."""
    with compiled_beside(), compilation_notice(lambda sentence: None if quiet else click.echo(sentence, err=True)):
        yield


def at_stage(stage: str, action: Callable[[], None], progress: Callable[..., None] | None) -> Callable[..., None]:
    """Return a callback that does something when a stage begins, and tells another one of all stages."""
    waiting = [action]

    def tell(now: str, done: int, total: int) -> None:
        if now == stage and waiting:
            waiting.pop()()
        if progress is not None:
            progress(now, done, total)

    return tell
