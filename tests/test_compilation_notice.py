"""What is compiled is told, and kept for the next run."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numba
import pytest
from numba import types

from qparm.compiled import notice
from qparm.compiled.kernels import kernel, kernel_helper


def test_kernels_are_told_as_they_are_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(numba.core.caching.CacheImpl, "_locator_classes", [])
    monkeypatch.setattr(notice, "_SECONDS", 0.0)
    said: list[str] = []
    told: list[tuple[int, str]] = []
    with notice.compilation_notice(said.append, progress=lambda done, name: told.append((done, name))):

        @kernel_helper
        def half(x: float) -> float:
            return 0.5 * x

        @kernel(types.float64(types.float64))
        def quarter(x: float) -> float:
            return 0.5 * half(x)

        @kernel(types.float64(types.float64))
        def third(x: float) -> float:
            return x / 3

    assert told == [(0, "quarter"), (1, "third")]  # what they call is compiled with them
    assert quarter(1.0) == 0.25
    assert len(said) == 1
    assert said[0].startswith("compiling the numeric kernels")
    assert "every time" in said[0]


@pytest.mark.slow
def test_what_is_compiled_is_kept_for_the_next_run(tmp_path: Path) -> None:
    code = (
        "from qparm.compiled.notice import compilation_notice\n"
        "told = []\n"
        "with compilation_notice(print, progress=lambda done, name: told.append(name)):\n"
        "    import qparm.export.decimal_text\n"
        "print(len(told))"
    )
    runs = [
        subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=240,
            env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)},
        ).stdout.splitlines()[-1]
        for _ in range(2)
    ]  # fmt: skip
    assert int(runs[0]) > 0
    assert runs[1] == "0"
