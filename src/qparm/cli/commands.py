"""The commands: every one is a few lines over the library.

Exit codes
----------
0    done, nothing failed
1    an error inside qparm
2    the command, the cell or an option is not valid
3    done, with failures: whatever speaks against the trajectory (the report says what); a file that does not verify
4    the output folder, or standard output, cannot be written to
5    a solver or package that was asked for is not installed
130  interrupted; 143 terminated (:mod:`qparm.stopping`). Nothing half written is left behind.
"""

from __future__ import annotations

import gc
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click

from qparm.cli_design import design
from qparm.cli_export import export
from qparm.cli_options import period_seconds
from qparm.cli_progress import at_stage, progress_bar, told_of_compilation
from qparm.cli_streams import forgive_streams
from qparm.cli_verify import verify
from qparm.cli_workspace import workspace
from qparm.errors import InvalidInput, OutputError, PackageMissing, QparmError, SolverUnavailable
from qparm.output import require_file, require_writable, staged, staged_file
from qparm.stopping import wait_if_ending

if TYPE_CHECKING:
    from qparm.cell import Cell

__all__ = ["cli", "run"]

FAILED, INVALID, PLANNED_WITH_FAILURES, NOT_WRITABLE, NOT_INSTALLED, INTERRUPTED = 1, 2, 3, 4, 5, 130
# New objects before the garbage collector looks for cycles among them.
_OBJECTS = 50_000


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="qparm")
def cli() -> None:
    """Plan how a redundant arm covers a large curved surface.

    Start with `qparm new cell.toml`, check it with `qparm check cell.toml`, plan it with
    `qparm plan cell.toml`; `qparm design cell.toml` finds out how long the links must be. Exit codes: 0 done,
    2 invalid input, 3 done with failures, 4 cannot write, 5 something is not installed, 130 interrupted,
    143 terminated.
    """


@cli.command()
@click.argument("cell", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), default=Path("out"), show_default=True, help="Output folder.")
@click.option(
    "--strategy",
    type=click.Choice(["graph", "reverse", "general"]),
    default="graph",
    show_default=True,
    help="graph: search the whole path at once. reverse: the paper's improved strategy. general: its baseline.",
)
@click.option(
    "--method",
    type=click.Choice(["cwln", "wln", "gpm", "dls"]),
    default="cwln",
    show_default=True,
    help="IK step of reverse and general: clamping weighted least norm, weighted least norm, gradient projection,"
    " damped least norm.",
)
@click.option(
    "--solver",
    default="auto",
    show_default=True,
    help="auto: closed form, else a compiled active set. proxqp, osqp or any solver of qpsolvers solves every step.",
)
@click.option(
    "--timing",
    type=click.Choice(["quintic", "ruckig"]),
    default="quintic",
    show_default=True,
    help="Form of the trajectory: quintic polynomials, or jerk-limited profiles by Ruckig.",
)
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
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Random seed.")
@click.option("--period", default="20 ms", show_default=True, help="Sampling period of trajectory.csv.")
@click.option("--quiet", "-q", is_flag=True, help="Print nothing but errors.")
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
    _tell_wide_gaps(loaded)
    with progress_bar(quiet) as progress:
        from qparm.export import FILES, write
        from qparm.view import load_ahead

        require_writable(out, FILES)
        if not quiet:
            from qparm.early_reach import early_lines

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
        click.echo(f"\nwritten to {out}{_slash(out)}: {', '.join(FILES)}")
    return 0 if report.executable else PLANNED_WITH_FAILURES


@cli.command()
@click.argument("cell", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), default=Path("out"), show_default=True, help="Output folder.")
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="Random seed of the reach check.",
)
def check(cell: Path, out: Path, seed: int) -> int:
    """Show what CELL says, check which points the arm reaches, and draw the arm at zero and at home."""
    from qparm.cell import Cell
    from qparm.check import check_cell, check_text
    from qparm.view import draw_arm

    loaded = Cell.load(cell)
    require_writable(out, ["arm.png"])
    with progress_bar(False) as progress:
        checked = check_cell(loaded, seed=seed, progress=progress)
        with staged(out) as folder:
            draw_arm(loaded, folder / "arm.png")
    click.echo(check_text(checked))
    click.echo(f"\nwritten to {out}{_slash(out)}: arm.png")
    return 0 if checked.all_reached and checked.home_clear else PLANNED_WITH_FAILURES


@cli.command()
@click.argument("waypoints", type=click.Path(path_type=Path))
@click.option("--limits", required=True, type=click.Path(path_type=Path), help="JSON, TOML or YAML file of limits.")
@click.option("--out", required=True, type=click.Path(path_type=Path), help="CSV file to write.")
@click.option(
    "--band",
    type=float,
    default=0.0,
    show_default=True,
    help="How far each joint may deviate from the waypoints, in their unit.",
)
@click.option(
    "--corners",
    type=click.Choice(["smooth", "stop"]),
    default="smooth",
    show_default=True,
    help="smooth: one curve through all waypoints. stop: straight lines with a stop at each waypoint.",
)
@click.option(
    "--timing",
    type=click.Choice(["quintic", "ruckig"]),
    default="quintic",
    show_default=True,
    help="Form of the trajectory: quintic polynomials, or jerk-limited profiles by Ruckig.",
)
@click.option("--period", default="4 ms", show_default=True, help="Sampling period.")
@click.option("--quiet", "-q", is_flag=True, help="Print nothing but errors.")
def time(
    waypoints: Path, limits: Path, out: Path, band: float, corners: Any, timing: str, period: str, quiet: bool
) -> int:
    """Time the joint WAYPOINTS of a CSV file within LIMITS, starting and ending at rest, and write samples to a file.

    LIMITS holds the lists velocity, acceleration and jerk, one number per joint, or is a joint_limits.yaml of ROS.
    """
    from qparm.export.trajectory_csv import write_samples_csv
    from qparm.waypoint_file import read_limits, read_waypoint_table

    seconds = period_seconds(period)
    names, q = read_waypoint_table(waypoints)
    allowed = read_limits(limits, names)
    require_file(out)
    with told_of_compilation(quiet):
        from qparm.timing import (
            largest_bulge,
            quintic_form,
            rounded_to,
            ruckig_form,
            same_distance,
            time_waypoints,
        )

        timed = time_waypoints(q, allowed, band=band, corners=corners, names=names)
    trajectory = {"quintic": quintic_form, "ruckig": ruckig_form}[timing](timed)
    verified = trajectory.verify(allowed, path=timed.path)
    problems = verified.problems()
    with staged_file(out) as file:
        write_samples_csv(trajectory, file, period=seconds)
    if not quiet:
        velocity, acceleration, jerk = verified.shares.max(axis=1)
        click.echo(
            f"{len(timed.path.q)} waypoints, {trajectory.duration:.6g} s, {trajectory.piece_count} polynomials;"
            f" largest shares of limits: velocity {velocity:.1%}, acceleration {acceleration:.1%}, jerk {jerk:.1%}"
        )
        dropped = len(q) - len(timed.path.q)
        if dropped:
            click.echo(
                f"left out, as nearer than {same_distance(q, band):.3g} (m or rad) to a neighbour:"
                f" {dropped} of {len(q)} waypoints"
            )
        rests = [segment.first for segment in timed.path.segments[1:]]
        if rests and corners == "smooth":
            click.echo(
                f"rests at {len(rests)} of the waypoints, where it turns back or a curve round them would be slower:"
                f" first at waypoint {rests[0]}{' of those kept' if dropped else ''}"
            )
        distance, after = largest_bulge(timed.path)
        if distance > 0:
            click.echo(
                f"the curve leaves the straight lines between waypoints by up to {distance:.3g} (m or rad), after"
                f" waypoint {after}{' of those kept' if dropped else ''}"
            )
        digits = rounded_to(q) if corners == "smooth" else None
        if digits is not None and 2 * band < 10.0**-digits:
            click.echo(
                f"the waypoints look rounded to 1e-{digits} (m or rad), and the curve bends with every rounding:"
                f" try --band 1e-{digits}, within which it may pass them"
            )
        for sentence in problems:
            click.echo(f"  - {sentence}")
        click.echo(f"written: {out}")
    return PLANNED_WITH_FAILURES if problems else 0


@cli.command()
@click.argument("file", type=click.Path(path_type=Path), default=Path("cell.toml"))
def new(file: Path) -> int:
    """Write a commented cell to start from to FILE (default cell.toml)."""
    from importlib.resources import files

    text = files("qparm").joinpath("new_cell.toml").read_text(encoding="utf-8")
    with staged_file(file, new=True) as staging:
        staging.write_text(text, encoding="utf-8")
    click.echo(f"written: {file}\nnext: qparm check {file}")
    return 0


cli.add_command(export)
cli.add_command(verify)
cli.add_command(workspace)
cli.add_command(design)


def run(arguments: list[str] | None = None) -> NoReturn:
    """Run a command and exit with its code."""
    forgive_streams()
    # what the modules make lives to the end: looking through it again and again, and once more at exit, costs half a
    # second
    gc.set_threshold(_OBJECTS, 20, 20)
    try:
        code = cli.main(args=arguments, prog_name="qparm", standalone_mode=False)
    except click.exceptions.Exit as exit_:
        code = exit_.exit_code
    except click.ClickException as error:
        error.show()
        code = error.exit_code
    except (KeyboardInterrupt, click.Abort):
        click.echo("qparm: interrupted; no file was left half written", err=True)
        code = INTERRUPTED
    except (SolverUnavailable, PackageMissing) as error:
        code = _told(error, NOT_INSTALLED)
    except OutputError as error:
        code = _told(error, NOT_WRITABLE)
    except InvalidInput as error:
        code = _told(error, INVALID)
    except QparmError as error:
        code = _told(error, INVALID if isinstance(error, ValueError) else FAILED)
    wait_if_ending()
    gc.freeze()
    sys.exit(code if isinstance(code, int) else 0)


def _told(error: Exception, code: int) -> int:
    wait_if_ending()
    click.echo(f"qparm: {error}", err=True)
    return code


def _tell_wide_gaps(cell: Cell) -> None:
    """Say before a plan where a list of poses has gaps that may be meant as the ends of rows."""
    from qparm.check import gap_lines

    for line in gap_lines(cell):
        click.echo(" ".join(line.split()), err=True)


def _slash(folder: Path) -> str:
    return "" if str(folder).endswith("/") else "/"
