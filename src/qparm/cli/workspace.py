"""``qparm workspace``: the reachable region, the share of it that the work takes, and the points that are missed."""

from __future__ import annotations

from pathlib import Path

import click

from qparm.cli import options
from qparm.cli.exit_codes import DONE_WITH_FAILURES
from qparm.cli.options import slash
from qparm.cli.progress import progress_bar
from qparm.errors import InvalidInput

__all__ = ["workspace"]

# Lengths between which a lattice makes sense (m).
_LEAST, _MOST = 1e-5, 100.0


@click.command()
@click.argument("cell", type=click.Path(path_type=Path))
@click.option("--against", type=click.Path(path_type=Path), help="Another cell whose arm is drawn for comparison.")
@options.out_folder
@click.option("--spacing", default="50 mm", show_default=True, help="Grid spacing of the reachable region.")
@click.option("--depth", default="100 mm", show_default=True, help="Depth of the working space above the tool path.")
@options.seed
@options.quiet
def workspace(cell: Path, against: Path | None, out: Path, spacing: str, depth: str, seed: int, quiet: bool) -> int:
    """Draw the region that the arm of CELL reaches, and which points of the surface it misses and why."""
    from qparm.cell import Cell
    from qparm.files.output import require_writable, staged

    step, deep = _length("--spacing", spacing), _length("--depth", depth)
    cells = [Cell.load(file) for file in (cell, against) if file is not None]
    require_writable(out)
    with progress_bar(quiet) as progress:
        from qparm.export.workspace_folder import WORKSPACE_FILES, write_workspace
        from qparm.reach.workspace import find_workspace
        from qparm.reports.workspace import workspace_text

        require_writable(out, WORKSPACE_FILES)
        found = [find_workspace(loaded, spacing=step, depth=deep, seed=seed, progress=progress) for loaded in cells]
        with staged(out) as folder:
            names = write_workspace(found, folder)
    if not quiet:
        click.echo(workspace_text(found))
        click.echo(f"\nwritten to {out}{slash(out)}: {', '.join(names)}")
    return 0 if found[0].all_reached else DONE_WITH_FAILURES


def _length(option: str, text: str) -> float:
    from qparm.units import parse_quantity

    try:
        metres = parse_quantity(text, "length")
    except ValueError as error:
        raise InvalidInput(f"{option}: {error}") from None
    if not _LEAST <= metres <= _MOST:
        raise InvalidInput(f"{option}: must lie between 0.01 mm and 100 m, not {text!r}")
    return metres
