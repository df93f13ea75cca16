"""Plans of cells by the command, one at a time: seconds, memory, exit code, and what it printed last."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

__all__ = ["plan"]

# Seconds by the clock after which a plan is ended.
_LIMIT = 180
# The command, on as many cores as are said.
_COMMAND = (
    "import os, sys; all_cores = os.cpu_count; os.cpu_count = lambda: {cores} or all_cores();"
    " from qparm.cli import main; sys.exit(main())"
)


def plan(
    cell: Path, out: Path, options: Mapping[str, Any], *, extra: Sequence[str] = (), cores: int | None = None
) -> dict[str, Any]:
    """Plan a cell into a folder and return how that went.

    Parameters
    ----------
    cell, out : Path
    options : mapping
        Of :func:`comparisons.soak.cells.generate`.
    extra : sequence of str
        Further arguments.
    cores : int, optional
        How many threads are offered; all by default.
    """
    command = [
        sys.executable, "-c", _COMMAND.format(cores=cores), "plan", str(cell), "--out", str(out),
        "--seed", str(options["seed"]), "--strategy", options["strategy"],
        "--timing", options["timing"], "--period", f"{options['period_ms']} ms",
        *(["--for-linear"] if options["for_linear"] else []), *extra,
    ]  # fmt: skip
    log, start, late = Path(f"{out}.log"), time.time(), False
    with log.open("w", encoding="utf-8") as text:
        child = subprocess.Popen(command, stdout=text, stderr=subprocess.STDOUT, start_new_session=True)
        while True:
            pid, status, usage = os.wait4(child.pid, os.WNOHANG)
            if pid:
                break
            if time.time() - start > _LIMIT:
                late = True
                os.killpg(child.pid, signal.SIGKILL)
                _, status, usage = os.wait4(child.pid, 0)
                break
            time.sleep(0.1)
    child.returncode = os.waitstatus_to_exitcode(status)
    return {
        "seconds": round(time.time() - start, 1),
        "cpu": round(usage.ru_utime + usage.ru_stime, 1),
        "mb": usage.ru_maxrss // 1024,
        "rc": "timeout" if late else child.returncode,
        "tail": log.read_text(encoding="utf-8", errors="replace")[-1500:],
    }
