"""The exceptions of qparm: one base, and each subclass carries its evidence.

A pose that cannot be reached is not an exception but data: a status with a reason.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

__all__ = [
    "CellError",
    "InvalidInput",
    "KernelError",
    "OutputError",
    "PackageMissing",
    "QparmError",
    "SolverUnavailable",
]


class QparmError(Exception):
    """Base of every error that qparm raises on purpose."""


class InvalidInput(QparmError, ValueError):
    """An argument is not usable: wrong shape, not finite, limits reversed, unknown name."""


class CellError(QparmError, ValueError):
    """A cell is not valid; all that is wrong with it at once.

    Attributes
    ----------
    source : str
        The file, or ``"cell"`` for a cell that came as a dictionary.
    problems : tuple of (str, str)
        Key path and sentence, one pair for each problem.
    """

    def __init__(self, source: str, problems: Sequence[tuple[str, str]]) -> None:
        self.source = source
        self.problems = tuple(problems)
        lines = [f"{key}: {sentence}" if key else sentence for key, sentence in self.problems]
        count = "1 problem" if len(lines) == 1 else f"{len(lines)} problems"
        super().__init__(f"{source} has {count}\n" + "\n".join(f"  {line}" for line in lines))


class OutputError(QparmError, OSError):
    """A result cannot be written.

    Attributes
    ----------
    folder : pathlib.Path
        Where it should have gone.
    """

    def __init__(self, folder: Path, reason: str) -> None:
        self.folder = folder
        super().__init__(f"cannot write to {str(folder)!r}: {reason}")

    def __str__(self) -> str:
        return str(self.args[0])


class SolverUnavailable(QparmError, ImportError):
    """A QP solver was asked for that is not installed or not known.

    Attributes
    ----------
    solver : str
        The name asked for.
    available : tuple of str
        The names that would work.
    """

    def __init__(self, solver: str, available: Sequence[str]) -> None:
        self.solver = solver
        self.available = tuple(available)
        super().__init__(f"no QP solver named {solver!r} here; available: {', '.join(self.available)}")


class PackageMissing(QparmError, ImportError):
    """An optional package was asked for that is not installed.

    Attributes
    ----------
    package : str
        The package.
    instead : str
        What works without it, such as ``"--timing quintic"``.
    extra : str or None
        The extra of qparm that brings the package, such as ``"parquet"``.
    """

    def __init__(self, package: str, instead: str, *, extra: str | None = None) -> None:
        self.package = package
        self.instead = instead
        self.extra = extra
        how = "it" if extra is None else f"it: pip install 'qparm[{extra}]'"
        super().__init__(f"the package {package!r} is not installed; use {instead}, or install {how}")


class KernelError(QparmError, RuntimeError):
    """A compiled kernel met what it cannot handle; always a defect of qparm."""
