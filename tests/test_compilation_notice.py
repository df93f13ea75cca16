"""What is compiled is told, and kept for the next run."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import numba
import pytest
from numba import types

import qparm
from qparm.compiled import beside, notice
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


def modules_with_kernels() -> set[str]:
    """Return the modules that the decorator stands in, from their sources."""
    source = Path(qparm.__file__).parent
    files = [file for file in source.rglob("*.py") if re.search(r"^@kernel\(", file.read_text("utf-8"), re.MULTILINE)]
    return {".".join(("qparm", *file.relative_to(source).with_suffix("").parts)) for file in files}


def test_every_kernel_is_compiled_ahead() -> None:
    code = f"import sys; import {', '.join((*beside.BESIDE, *beside.REST))}; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=240)
    assert modules_with_kernels() <= set(loaded.stdout.split())


def test_what_is_compiled_beside_needs_nothing_of_the_rest() -> None:
    code = f"import sys; import {', '.join(beside.BESIDE)}; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=240)
    assert modules_with_kernels() & set(loaded.stdout.split()) == set(beside.BESIDE)


@pytest.mark.slow
def test_a_command_waits_for_what_is_compiled_beside_it(tmp_path: Path) -> None:
    """None of the kernels that the other process compiles is compiled here, too."""
    code = (
        "import os; os.cpu_count = lambda: 2\n"
        "from qparm.compiled.beside import compiled_beside\n"
        "from qparm.compiled.notice import compilation_notice\n"
        "told = []\n"
        "with compiled_beside(), compilation_notice(print, progress=lambda done, name: told.append(name)):\n"
        "    import qparm.export.decimal_text, qparm.timing.kernels\n"
        "print(*told)"
    )
    told = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=240,
        env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)},
    ).stdout.splitlines()[-1]  # fmt: skip
    assert "write_lines" in told
    assert "quintic_peaks" not in told
    assert any("quintic_peaks" in file.name for file in tmp_path.rglob("*.nbi"))
