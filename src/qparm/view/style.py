"""Style of the pictures: one palette, figures without a display."""

from __future__ import annotations

import contextlib
import warnings
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = [
    "COLOURS",
    "GAP",
    "REACHED",
    "SELF_MOTION",
    "SURFACE",
    "load_ahead",
    "margins",
    "new_figure",
    "plain",
    "save",
]

# Eight joints that stay apart in print and for colour-blind eyes (Okabe and Ito, black first).
COLOURS = ("#000000", "#e69f00", "#56b4e9", "#009e73", "#f0e442", "#0072b2", "#d55e00", "#cc79a7")
# Threads that load the drawing library.
_loading: list[Thread] = []
REACHED, GAP, SELF_MOTION, SURFACE = "#0072b2", "#d62728", "#e69f00", "#c8d6df"


def new_figure(width: float, height: float, *, laid_out: bool = True) -> Figure:
    """Return a figure of a size in inches that needs no display; its panels find their room, or are given it."""
    while _loading:
        _loading.pop().join()
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=110, layout="constrained" if laid_out else None)
    FigureCanvasAgg(figure)
    return figure


def plain(text: str) -> str:
    """Return text in which no dollar sign opens a formula."""
    return text.replace("$", r"\$")


def margins(figure: Figure, *, left: float, right: float, bottom: float, top: float, between: float = 0.15) -> None:
    """Leave room around the panels (inches): a layout engine measures every tick for it, longer than drawing takes."""
    width, height = figure.get_size_inches()
    panels = len({round(float(axis.get_position().y0), 6) for axis in figure.axes})
    panel = (height - bottom - top - (panels - 1) * between) / max(panels, 1)
    figure.subplots_adjust(
        left=left / width, right=1 - right / width, bottom=bottom / height, top=1 - top / height, hspace=between / panel
    )


def load_ahead() -> None:
    """Load the drawing library in a thread of its own: half a second, on a core that planning leaves idle.

    :func:`new_figure` waits for it: no two threads load parts of one library side by side.
    """
    thread = Thread(target=_load)
    _loading.append(thread)
    thread.start()


def _load() -> None:
    with contextlib.suppress(ImportError):  # whoever draws is told
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        FigureCanvasAgg(Figure(figsize=(1.0, 1.0), layout="constrained"))


def save(figure: Figure, file: Path) -> None:
    """Write a figure as PNG."""
    with warnings.catch_warnings():
        # a name in characters that the font lacks is drawn with boxes
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        # harder compression takes longer than drawing, and saves little
        figure.savefig(file, format="png", pil_kwargs={"compress_level": 2})
