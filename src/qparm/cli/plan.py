"""``qparm plan``: a cell into a folder with path, trajectory, report and pictures."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from qparm.choices import METHODS, STRATEGIES, in_words
from qparm.cli import options
from qparm.cli.exit_codes import DONE_WITH_FAILURES
from qparm.cli.options import period_seconds, slash
from qparm.cli.progress import at_stage, progress_bar
from qparm.files.output import require_writable

if TYPE_CHECKING:
    from qparm.cell import Cell

__all__ = ["plan"]


@click.command()
@click.argument("cell", type=click.Path(path_type=Path))
@options.out_folder
@click.option(
    "--strategy",
    type=click.Choice(list(STRATEGIES)),
    default="graph",
    show_default=True,
    help=in_words(STRATEGIES),
)
@click.option(
    "--method",
    type=click.Choice(list(METHODS)),
    default="cwln",
    show_default=True,
    help=f"IK step of reverse and general. {in_words(METHODS)}",
)
@click.option(
    "--solver",
    default="auto",
    show_default=True,
    help="auto: closed form, else a compiled active set. proxqp, osqp or any solver of qpsolvers solves every step.",
)
@options.timing_form
@click.option(
    "--smooth/--no-smooth",
    default=None,
    help="Smooth the whole path.  [default: smooth with graph and reverse]",
)
@click.option(
    "--for-linear",
    is_flag=True,
    help="Add waypoints until linear joint interpolation keeps the tolerances between the points too.",
)
@click.option("--feed", metavar="SPEED", help='Tool speed on rows, such as "50 mm/s"; overrides the cell.')
@click.option(
    "--tool-spin",
    type=click.Choice(["fixed", "free"]),
    help="Whether the tool may turn about its own axis; overrides the cell.",
)
@click.option(
    "--tool-tilt", metavar="ANGLE", help='How far the tool axis may tilt, such as "10 deg"; overrides the cell.'
)
@options.seed
@click.option("--period", default="20 ms", show_default=True, help="Sampling period of trajectory.csv.")
@options.quiet
def plan(
    cell: Path,
    out: Path,
    strategy: Any,
    method: Any,
    solver: str,
    timing: Any,
    smooth: bool | None,
    for_linear: bool,
    feed: str | None,
    tool_spin: str | None,
    tool_tilt: str | None,
    seed: int,
    period: str,
    quiet: bool,
) -> int:
    """Plan CELL and write path, trajectory, report and pictures to a folder."""
    from qparm.cell import Cell
    from qparm.pipeline import plan as plan_cell

    seconds = period_seconds(period)
    loaded = Cell.load(cell).with_process({"feed": feed, "tool_spin": tool_spin, "tool_tilt": tool_tilt})
    with progress_bar(quiet) as progress:
        _tell_wide_gaps(loaded)
        from qparm.export import FILES, write
        from qparm.view import load_ahead

        require_writable(out, FILES)
        if not quiet:
            from qparm.reports.early_reach import early_lines

            for line in early_lines(loaded, seed=seed):
                click.echo(line, err=True)
        planned = plan_cell(
            loaded,
            strategy=strategy,
            method=method,
            solver=solver,
            smooth=smooth,
            for_linear=for_linear,
            timing=timing,
            seed=seed,
            progress=at_stage("joint path", load_ahead, progress),
        )
        report = write(planned, out, period=seconds, progress=progress)
    if not quiet:
        click.echo(report.text())
        click.echo(f"\nwritten to {out}{slash(out)}: {', '.join(FILES)}")
    return 0 if report.executable else DONE_WITH_FAILURES


def _tell_wide_gaps(cell: Cell) -> None:
    """Say before a plan where a list of poses has gaps that may be meant as the ends of rows."""
    from qparm.reports.check import gap_lines

    for line in gap_lines(cell):
        click.echo(" ".join(line.split()), err=True)
