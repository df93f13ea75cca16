"""Tables as Markdown and CSV, and the figures that stand in them."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np

__all__ = ["microseconds", "save_table", "shifted_geometric_mean", "table"]


def table(header: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """Return rows as a Markdown table."""
    cells = [[str(cell) for cell in row] for row in (header, *rows)]
    widths = [max(len(row[k]) for row in cells) for k in range(len(header))]
    lines = [
        "| " + " | ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) + " |" for row in cells
    ]
    return "\n".join([lines[0], "|" + "|".join("-" * (width + 2) for width in widths) + "|", *lines[1:]])


def save_table(folder: Path, name: str, title: str, header: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """Write a table as Markdown and CSV into a folder and return its Markdown with the title."""
    folder.mkdir(parents=True, exist_ok=True)
    text = f"**{title}**\n\n{table(header, rows)}\n"
    (folder / f"{name}.md").write_text(text, encoding="utf-8")
    with (folder / f"{name}.csv").open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([header, *rows])
    return text


def microseconds(seconds: Sequence[float] | np.ndarray) -> tuple[str, str]:
    """Return median and 99th percentile in microseconds."""
    if not len(seconds):
        return "-", "-"
    return f"{np.median(seconds) * 1e6:.1f}", f"{np.quantile(seconds, 0.99) * 1e6:.1f}"


def shifted_geometric_mean(values: Sequence[float] | np.ndarray, shift: float) -> float:
    """Return exp(mean(log(v + shift))) - shift."""
    return float(np.exp(np.mean(np.log(np.asarray(values) + shift))) - shift)
