"""The progress bar that commands draw on standard error."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import click

from qparm.compilation_notice import compilation_notice
from qparm.stopping import at_stop

__all__ = ["at_stage", "progress_bar", "told_of_compilation"]


@contextmanager
def progress_bar(quiet: bool) -> Iterator[Callable[..., None] | None]:
    """Give a callback ``(stage, done, total, best="")`` that draws a bar, and say when kernels are compiled."""
    if quiet:
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
    with (
        at_stop(show_cursor),
        Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar,
    ):
        task = bar.add_task("cell", total=1, best="")

        def show(stage: str, done: int, total: int, best: str = "") -> None:
            bar.update(task, description=stage, completed=done, total=max(total, done, 1), best=best)

        def compiled(done: int, kernel: str) -> None:
            bar.update(task, description="compiling", completed=done, total=None, best=kernel)

        with compilation_notice(lambda sentence: console.print(sentence), progress=compiled):
            yield show


@contextmanager
def told_of_compilation(quiet: bool) -> Iterator[None]:
    """Say when kernels are compiled inside, by a command that draws no bar."""
    with compilation_notice(lambda sentence: None if quiet else click.echo(sentence, err=True)):
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
