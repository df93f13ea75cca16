"""The notice that kernels are being compiled: on the first use of each, after an installation or a change.

It is told by :mod:`qparm.compiled` of every kernel that is not found in the cache, whichever command loads it, and
imports nothing itself: whoever wants to be told is there before the kernels are.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

__all__ = ["compilation_begins", "compilation_ends", "compilation_notice", "not_kept"]

# What takes less than this is not worth a word (s).
_SECONDS = 1.0


class _Watcher:
    """One command's view of what is compiled."""

    def __init__(self, say: Callable[[str], None], progress: Callable[[int, str], None] | None) -> None:
        self.say, self.progress = say, progress
        self.count, self.depth = 0, 0
        self.seconds, self.since = 0.0, 0.0
        self.kept, self.said = True, False

    def begins(self, kernel: str) -> None:
        self.depth += 1
        if self.depth > 1:  # what a kernel calls is compiled with it
            return
        self.since = time.monotonic()
        if self.progress is not None:
            self.progress(self.count, kernel)

    def ends(self) -> None:
        self.depth -= 1
        if self.depth:
            return
        self.count += 1
        self.seconds += time.monotonic() - self.since
        if self.seconds > _SECONDS and not self.said:
            self.said = True
            kept = "once after an installation" if self.kept else "every time: there is no folder to keep them in"
            self.say(f"compiling the numeric kernels ({kept}; under a minute)")


_watchers: list[_Watcher] = []


@contextmanager
def compilation_notice(
    say: Callable[[str], None], *, progress: Callable[[int, str], None] | None = None
) -> Iterator[None]:
    """Call ``say`` with a sentence once kernels have been compiled for a second.

    ``progress(done, kernel)`` is told of each one.
    """
    watcher = _Watcher(say, progress)
    _watchers.append(watcher)
    try:
        yield
    finally:
        _watchers.remove(watcher)


def compilation_begins(kernel: str) -> None:
    """Tell that a kernel was not in the cache and is being compiled."""
    for watcher in _watchers[-1:]:
        watcher.begins(kernel)


def compilation_ends() -> None:
    """Tell that it is compiled."""
    for watcher in _watchers[-1:]:
        watcher.ends()


def not_kept() -> None:
    """Tell that what is compiled cannot be kept for the next run."""
    for watcher in _watchers[-1:]:
        watcher.kept = False
