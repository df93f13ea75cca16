"""``qparm check``: what a cell says, and which points the arm reaches."""

from __future__ import annotations

from pathlib import Path

import click

from qparm.cli import options
from qparm.cli.exit_codes import DONE_WITH_FAILURES
from qparm.cli.options import slash
from qparm.cli.progress import progress_bar
from qparm.files.output import require_writable, staged

__all__ = ["check"]


@click.command()
@click.argument("cell", type=click.Path(path_type=Path))
@options.out_folder
@options.seed
def check(cell: Path, out: Path, seed: int) -> int:
    """Show what CELL says, check which points the arm reaches, and draw the arm at zero and at home."""
    from qparm.cell import Cell
    from qparm.reports.check import check_cell, check_text
    from qparm.view import draw_arm

    loaded = Cell.load(cell)
    require_writable(out, ["arm.png"])
    with progress_bar(False) as progress:
        checked = check_cell(loaded, seed=seed, progress=progress)
        with staged(out) as folder:
            draw_arm(loaded, folder / "arm.png")
    click.echo(check_text(checked))
    click.echo(f"\nwritten to {out}{slash(out)}: arm.png")
    return 0 if checked.all_reached and checked.home_clear else DONE_WITH_FAILURES
