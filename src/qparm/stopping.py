"""The end of a command that is told to stop: at once, in one line, with nothing half written.

A signal may come at any moment: while a module is imported, while a kernel runs for seconds, while files are moved
into place. An exception raised by a signal handler would unwind through whatever runs just then, and not all of it
bears that: importlib's locks do not. So nothing is unwound. The handler runs the actions that were asked for with
:func:`at_stop`, prints one line and ends the process; what a killed process would leave on the disk is whole anyway
(:mod:`qparm.files.output`).
"""

from __future__ import annotations

import contextlib
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator

__all__ = ["at_stop", "end_on_signals", "wait_if_ending"]

# What the line says of each signal. A terminal that is closed sends SIGHUP, which Windows does not have.
_WORDS = {"SIGINT": "interrupted", "SIGTERM": "terminated", "SIGHUP": "terminated"}
# Python handles signals between its own instructions. Where the main thread does not get to one for so long (s), as
# inside a kernel, another thread ends the process; and where ending itself takes longer than this, it is cut short.
_GRACE, _LONGEST = 0.5, 5.0

_actions: list[Callable[[], str | None]] = []
_ending = threading.Lock()


@contextlib.contextmanager
def at_stop(action: Callable[[], str | None]) -> Iterator[None]:
    """Run an action if a signal ends the process inside; what it returns is said at the end of the line.

    The action may meet the main thread at any place inside: it must neither wait for a lock nor import anything.
    """
    _actions.append(action)
    try:
        yield
    finally:
        _actions.remove(action)


def end_on_signals() -> None:
    """From now on end at SIGINT, SIGTERM and SIGHUP with exit code 128 + signal; those that are ignored stay so."""
    if threading.current_thread() is not threading.main_thread():
        return  # only the main thread may handle signals
    handled = set()
    for name in _WORDS:
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _handle)
            if signal.getsignal(number) is _handle:
                handled.add(int(number))
    if not handled:
        return
    read, write = os.pipe()
    os.set_blocking(write, False)
    # written by the interpreter itself as soon as a signal comes, whatever the main thread does
    signal.set_wakeup_fd(write, warn_on_full_buffer=False)
    if hasattr(os, "register_at_fork"):
        _leave_children_out(handled)
    threading.Thread(target=_watch, args=(read, handled), daemon=True, name="signals").start()


def wait_if_ending() -> None:
    """Wait for the end if a signal has begun it: nothing more is to be printed or decided."""
    if _ending.locked():
        time.sleep(2 * _LONGEST)


def _leave_children_out(handled: set[int]) -> None:
    """Let no forked child write into its parent's pipe: signals wait until it has forgotten that."""

    def forget() -> None:
        with contextlib.suppress(ValueError):  # not its main thread
            signal.set_wakeup_fd(-1)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, handled)

    os.register_at_fork(
        before=lambda: signal.pthread_sigmask(signal.SIG_BLOCK, handled),
        after_in_parent=lambda: signal.pthread_sigmask(signal.SIG_UNBLOCK, handled),
        after_in_child=forget,
    )


def _handle(number: int, _frame: object) -> None:
    _end(number)


def _watch(read: int, handled: set[int]) -> None:
    begun = False
    while True:
        for number in os.read(read, 64):
            if number not in handled:
                continue
            if begun:  # told twice
                os._exit(128 + number)
            begun = True
            threading.Thread(target=_end_later, args=(number,), daemon=True).start()


def _end_later(number: int) -> None:
    time.sleep(_GRACE)
    if not _ending.locked():
        _end(number)
    time.sleep(_LONGEST)
    os._exit(128 + number)


def _end(number: int) -> None:
    """End the process; where that has begun, at once."""
    if not _ending.acquire(blocking=False):
        os._exit(128 + number)
    said = [f"qparm: {_WORDS[signal.Signals(number).name]}; no file was left half written"]
    for action in reversed(_actions):
        # whatever goes wrong now, the process ends
        with contextlib.suppress(Exception):
            said.append(action() or "")
    with contextlib.suppress(OSError):
        os.write(2, ("; ".join(filter(None, said)) + "\n").encode(errors="backslashreplace"))
    os._exit(128 + number)
