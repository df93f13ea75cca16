"""The progress bar that commands draw on standard error."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

__all__ = ["Intervals", "at_stage", "progress_bar"]

# Where no bar can be drawn, as in a log, a line is written instead, so often (s).
_BETWEEN_LINES = 30.0


class Intervals:
    """Tell when so many seconds have passed since the last time."""

    def __init__(self, seconds: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._seconds, self._clock = seconds, clock
        self._begun = self._last = clock()

    @property
    def elapsed(self) -> float:
        """Seconds since the beginning."""
        return self._clock() - self._begun

    def due(self) -> bool:
        """Return whether it is time, and if so wait for as long again."""
        now = self._clock()
        if now - self._last < self._seconds:
            return False
        self._last = now
        return True


@contextmanager
def progress_bar(quiet: bool, *, last: str = "qparm.timing.speed_kernels") -> Iterator[Callable[..., None] | None]:
    """Give a callback ``(stage, done, total, best="")`` that draws a bar, and say when kernels are compiled.

    ``last`` names the last module of kernels that the command loads: of a plan by default.
    """
    if quiet:
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    from qparm.compilation_notice import compilation_notice

    console = Console(stderr=True)
    columns = (
        TextColumn("{task.description:<12}"),
        BarColumn(bar_width=24),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.fields[best]}"),
    )
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task, lines = bar.add_task("cell", total=1, best=""), Intervals(_BETWEEN_LINES)

        def show(stage: str, done: int, total: int, best: str = "") -> None:
            bar.update(task, description=stage, completed=done, total=max(total, done, 1), best=best)
            if not console.is_terminal and lines.due():
                told = f"{done} of {total} " if total > 1 else ""
                console.print(f"{stage}: {told}after {lines.elapsed:.0f} s{', ' + best if best else ''}")

        with compilation_notice(lambda sentence: console.print(sentence), last=last):
            yield show


def at_stage(stage: str, action: Callable[[], None], progress: Callable[..., None] | None) -> Callable[..., None]:
    """Return a callback that does something when a stage begins, and tells another one of all stages."""
    waiting = [action]

    def tell(now: str, done: int, total: int) -> None:
        if now == stage and waiting:
            waiting.pop()()
        if progress is not None:
            progress(now, done, total)

    return tell
