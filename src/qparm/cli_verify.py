"""`qparm verify`: a trajectory file against a cell."""

from __future__ import annotations

from pathlib import Path

import click

__all__ = ["verify"]

_KEPT, _NOT_KEPT = 0, 3


@click.command()
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--cell", required=True, type=click.Path(path_type=Path), help="The cell that the motion is for.")
@click.option("--quiet", "-q", is_flag=True, help="Print only what is wrong.")
def verify(file: Path, cell: Path, quiet: bool) -> int:
    """Check any trajectory FILE, ours or not, against a cell: every limit, every point, the path, feed, clearance.

    Exit code 0 only if all of it holds, else 3 with the first findings: joint or tool, time, amount, limit.
    """
    from qparm.cell import Cell
    from qparm.verify import verify_motion
    from qparm.verify.readers import read_motion

    loaded = Cell.load(cell)
    report = verify_motion(read_motion(file, loaded), loaded)
    if not quiet:
        click.echo(report.text())
    else:
        for sentence in report.problems():
            click.echo(sentence)
    return _KEPT if report.kept else _NOT_KEPT
