"""Compilation on several cores: some modules' kernels are compiled by another process beside this one.

numba compiles one kernel after another in a process. On a first run a command lets another process compile what needs
nothing of the rest, and waits for it where it comes to those kernels: by then they are in the cache.

    with compiled_beside():
        ...

Everything is compiled ahead of the first run, on all cores, by ``python -m qparm.compiled``.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence

from qparm.stopping import at_stop

__all__ = ["BESIDE", "REST", "begin", "compile_all", "compiled_beside", "wait_for"]

# Kernels that call none of the others', the slowest first.
BESIDE = (
    "qparm.banded.qp",
    "qparm.timing.speed_kernels",
    "qparm.timing.kernels",
    "qparm.planning.smoothing.linearise",
)
# All other modules that have kernels.
REST = (
    "qparm.robot.kernels",
    "qparm.robot.compliance",
    "qparm.ik",
    "qparm.ik.differential",
    "qparm.ik.solvers.normal_form",
    "qparm.ik.solvers.slack_form",
    "qparm.planning.search.projection",
    "qparm.planning.search.sampling",
    "qparm.planning.search.layered",
    "qparm.planning.paper.follow",
    "qparm.planning.paper.self_motion",
    "qparm.reach.many_arms",
    "qparm.reach.margin",
    "qparm.export.decimal_text",
)


class _Beside:
    """The process that compiles beside this one, if there may be one."""

    def __init__(self) -> None:
        self.process: subprocess.Popen[bytes] | None = None

    def begin(self) -> None:
        if self.process is None:
            with contextlib.suppress(OSError):  # then all is compiled here
                self.process = _importing(BESIDE)

    def wait(self) -> None:
        if self.process is not None:
            self.process.wait()

    def stop(self) -> None:
        if self.process is not None:
            self.process.kill()


_open: list[_Beside] = []


@contextlib.contextmanager
def compiled_beside() -> Iterator[None]:
    """Let another process compile a share of the kernels inside, if any have to be compiled and there is a core."""
    if _open or not sys.executable or (os.cpu_count() or 1) < 2:
        yield
        return
    beside = _Beside()
    _open.append(beside)
    try:
        with at_stop(beside.stop):
            yield
    finally:
        _open.remove(beside)
        # what it has begun is kept for the next run
        beside.wait()


def begin() -> None:
    """Tell that a kernel was not in the cache: others will not be either."""
    for beside in _open:
        beside.begin()


def wait_for(module: str) -> None:
    """Wait until the kernels of a module are compiled, if another process does that."""
    if module in BESIDE:
        for beside in _open:
            beside.wait()


def compile_all() -> bool:
    """Compile every kernel that is not in the cache, on two cores, and return whether that went well."""
    codes = [process.wait() for process in [_importing(modules) for modules in (BESIDE, REST)]]
    return not any(codes)


def _importing(modules: Sequence[str]) -> subprocess.Popen[bytes]:
    """Start a process that imports modules, found as they are found here."""
    code = f"import sys; sys.path[:] = {sys.path!r}; import {', '.join(modules)}"
    return subprocess.Popen(
        [sys.executable, "-c", code], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
