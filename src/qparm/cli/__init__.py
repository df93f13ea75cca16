"""The command line.

This module loads nothing but what ends a command when it is told to: whatever takes longer to load comes after, and
may be interrupted.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any, NoReturn

from qparm.stopping import end_on_signals

if TYPE_CHECKING:
    from qparm.cli.commands import cli

__all__ = ["cli", "main"]


def main(arguments: list[str] | None = None) -> NoReturn:
    """Run the command line and exit with its code."""
    end_on_signals()
    for name in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        # matrices are small here; threads that wait for a share of them take the cores from those that have work
        os.environ.setdefault(name, "1")
    from qparm.cli.commands import run

    run(arguments)


def __dir__() -> list[str]:
    return sorted(__all__)


def __getattr__(name: str) -> Any:
    if name != "cli":
        raise AttributeError(f"module 'qparm.cli' has no attribute {name!r}")
    from qparm.cli.commands import cli

    return cli
