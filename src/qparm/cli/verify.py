"""`qparm verify`: a trajectory file against a cell."""

from __future__ import annotations

from pathlib import Path

import click

from qparm.cli.exit_codes import DONE, DONE_WITH_FAILURES

__all__ = ["verify"]


@click.command()
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--cell", required=True, type=click.Path(path_type=Path), help="The cell that the motion is for.")
@click.option("--quiet", "-q", is_flag=True, help="Print only what is wrong.")
def verify(file: Path, cell: Path, quiet: bool) -> int:
    """Check any trajectory FILE, ours or not, against a cell: every limit, every point, the path, feed, clearance.

    Exit code 0 only if all of it holds, else 3 with the first findings: joint or tool, time, amount, limit.
    """
    from qparm.cell import Cell
    from qparm.files.manifest import REPORT_FILE, is_changed
    from qparm.files.output import finish_interrupted
    from qparm.verify import verify_motion
    from qparm.verify.clearance import LINKS_NOT_CHECKED
    from qparm.verify.readers import read_motion

    loaded = Cell.load(cell)
    finish_interrupted(file.parent)
    report = verify_motion(read_motion(file, loaded), loaded)
    if not quiet:
        click.echo(report.text())
        click.echo(LINKS_NOT_CHECKED)
    else:
        for sentence in report.problems():
            click.echo(sentence)
    changed = is_changed(file)
    if changed:
        click.echo(f"{file.name} is not the file that {REPORT_FILE} beside it was written with")
    return DONE if report.kept and not changed else DONE_WITH_FAILURES
