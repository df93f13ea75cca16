"""How the pictures look: one palette, figures without a display."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["COLOURS", "GAP", "REACHED", "SELF_MOTION", "SURFACE", "new_figure", "plain", "save"]

# Eight joints that stay apart in print and for colour-blind eyes (Okabe and Ito, black first).
COLOURS = ("#000000", "#e69f00", "#56b4e9", "#009e73", "#f0e442", "#0072b2", "#d55e00", "#cc79a7")
REACHED, GAP, SELF_MOTION, SURFACE = "#0072b2", "#d62728", "#e69f00", "#c8d6df"


def new_figure(width: float, height: float) -> Figure:
    """Return a figure of a size in inches that needs no display."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def plain(text: str) -> str:
    """Return text in which no dollar sign opens a formula."""
    return text.replace("$", r"\$")


def save(figure: Figure, file: Path) -> None:
    """Write a figure as PNG."""
    figure.savefig(file, format="png")
