"""Says that kernels are being compiled, on the first run after an installation."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Timer

__all__ = ["compilation_notice"]

# Loading numba and all kernels from the cache takes a second or two, compiling them many times that.
_SECONDS = 4.0


def _compiled_before(module: str) -> bool:
    """Return whether a module's kernels lie compiled beside it: then a busy machine is loading them slowly."""
    folder = Path(__file__).parent.joinpath(*module.split(".")[1:-1], "__pycache__")
    return any(folder.glob(f"{module.rpartition('.')[2]}.*.nbi"))


@contextmanager
def compilation_notice(say: Callable[[str], None], *, last: str = "qparm.timing.speed_kernels") -> Iterator[None]:
    """Call ``say`` with a sentence if kernels are still being loaded after some seconds.

    ``last`` names the last module of kernels that the command loads: of a plan by default.
    """

    def tell() -> None:
        # once the last module of kernels is there, whatever takes long is not compilation
        if last not in sys.modules and not _compiled_before(last):
            say("compiling the numeric kernels (first run only, under a minute)")

    timer = Timer(_SECONDS, tell)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
