"""Options that several commands read alike."""

from __future__ import annotations

from pathlib import Path

import click

from qparm.choices import TIMING_FORMS, in_words
from qparm.errors import InvalidInput

__all__ = ["out_folder", "period_seconds", "quiet", "seed", "slash", "timing_form"]

out_folder = click.option(
    "--out", type=click.Path(path_type=Path), default=Path("out"), show_default=True, help="Output folder."
)
quiet = click.option("--quiet", "-q", is_flag=True, help="Print nothing but errors.")
seed = click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Random seed.")
timing_form = click.option(
    "--timing",
    type=click.Choice(list(TIMING_FORMS)),
    default="quintic",
    show_default=True,
    help=f"Form of the trajectory. {in_words(TIMING_FORMS)}",
)


def period_seconds(text: str) -> float:
    """Return a time such as ``"4 ms"`` in seconds, or raise InvalidInput if no samples can be that far apart."""
    from qparm.units import parse_quantity

    try:
        seconds = parse_quantity(text, "time")
    except ValueError as error:
        raise InvalidInput(f"--period: {error}") from None
    if not 1e-4 <= seconds <= 10.0:
        raise InvalidInput(f"--period: must lie between 0.1 ms and 10 s, not {text!r}")
    return seconds


def slash(folder: Path) -> str:
    """Return what is written after a folder's name."""
    return "" if str(folder).endswith("/") else "/"
