"""Standard output and error that print whatever there is, on any terminal, for as long as somebody reads."""

from __future__ import annotations

import io
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from qparm.errors import OutputError

if TYPE_CHECKING:
    from typing_extensions import Buffer

__all__ = ["forgive_streams"]


def forgive_streams() -> None:
    """Let characters that a terminal cannot show be printed by number, and what nobody reads any more be dropped.

    Whoever reads only the first lines, as in ``qparm plan cell.toml | head``, is no failure of the command: its exit
    code tells how its work ended.
    """
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        # what tests and embedding programs have put there is theirs
        if stream is None or stream is not getattr(sys, f"__{name}__") or not isinstance(stream, io.TextIOWrapper):
            continue
        stream.flush()
        raw = _Forgiving(stream.fileno(), "w", closefd=False)
        raw.told = name == "stdout"
        buffer = io.BufferedWriter(raw)
        forgiving = io.TextIOWrapper(
            buffer,
            encoding=stream.encoding,
            errors="backslashreplace",
            newline=None,
            line_buffering=stream.line_buffering,
            write_through=stream.write_through,
        )
        setattr(sys, name, forgiving)


class _Forgiving(io.FileIO):
    """A file that takes what nobody reads, and after an error whatever comes.

    Attributes
    ----------
    told : bool
        Whether the first error, such as a full disk, is raised as OutputError.
    """

    told = False

    def write(self, data: Buffer, /) -> int:
        try:
            return super().write(data)
        except BrokenPipeError:
            pass
        except OSError as error:
            if self.told:
                self.told = False
                raise OutputError(Path("standard output"), error.strerror or str(error)) from None
        return len(memoryview(data).cast("B"))
