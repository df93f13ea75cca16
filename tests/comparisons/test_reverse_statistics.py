"""The comparison of the reverse strategy counts by itself, and its verdict can fail."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

import qparm
from comparisons import reverse_statistics
from conftest import DOME


def test_edges_are_counted_inside_rows_and_across_gaps(dome: qparm.Cell) -> None:
    tool_path = dome.tool_path()
    q, reached, criteria = np.zeros((915, 8)), np.ones(915, dtype=bool), np.ones((915, 8))
    q[61:] += 2.0  # at a row end
    q[70:] += 2.0
    q[80:] += 2.0  # the point before is missing
    reached[79] = False
    assert reverse_statistics.in_row_jumps(tool_path, q, reached, criteria) == (1, 1)


@pytest.mark.slow
def test_the_verdict_holds_for_the_strategy_and_fails_without_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["x", "--cell", str(DOME), "--seeds", "1", "--out", str(tmp_path)])
    assert reverse_statistics.main() == 0
    assert "free of jumps inside rows: 1 of 1 seeds (general method: 0)" in capsys.readouterr().out
    assert {file.name for file in tmp_path.iterdir()} == {
        "reverse_statistics.md", "reverse_statistics.csv", "reverse_letter.md", "reverse_letter.csv",
    }  # fmt: skip
    right = reverse_statistics.reverse
    monkeypatch.setattr(reverse_statistics, "reverse", lambda *a, **k: right(*a, **k | {"join": False}))
    assert reverse_statistics.main() == 1
