"""The command line: every command is a few lines over the library.

Exit codes
----------
0    done, nothing failed
1    an error inside qparm
2    the command, the cell or an option is not valid
3    done, with failures: points not reached, jumps, limits (the report says which); a file that does not verify
4    the output folder, or standard output, cannot be written to
5    a solver or package that was asked for is not installed
130  interrupted; 143 terminated. Nothing half written is left behind.
"""

from __future__ import annotations

import gc
import os
import signal
import sys
import traceback
from pathlib import Path
from typing import Any, NoReturn

import click

from qparm.cli_design import design
from qparm.cli_export import export
from qparm.cli_options import period_seconds
from qparm.cli_progress import at_stage, progress_bar
from qparm.cli_verify import verify
from qparm.cli_workspace import workspace
from qparm.errors import InvalidInput, OutputError, PackageMissing, QparmError, SolverUnavailable

__all__ = ["cli", "main"]

FAILED, INVALID, PLANNED_WITH_FAILURES, NOT_WRITABLE, NOT_INSTALLED, INTERRUPTED = 1, 2, 3, 4, 5, 130
TERMINATED = 128 + signal.SIGTERM
# New objects before the garbage collector looks for cycles among them.
_OBJECTS = 50_000


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="qparm")
def cli() -> None:
    """Plan how a redundant arm covers a large curved surface.

    Start with `qparm new cell.toml`, check it with `qparm check cell.toml`, plan it with
    `qparm plan cell.toml`; `qparm design cell.toml` finds out how long the links must be. Exit codes: 0 done,
    2 invalid input, 3 done with failures, 4 cannot write, 5 something is not installed, 130 interrupted.
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
    with progress_bar(quiet) as progress:
        from qparm.export import FILES, require_writable, write
        from qparm.view import load_ahead

        require_writable(out)
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
    from qparm.export import require_writable
    from qparm.export.folder import staged
    from qparm.view import draw_arm

    loaded = Cell.load(cell)
    require_writable(out)
    with progress_bar(False) as progress:
        checked = check_cell(loaded, seed=seed, progress=progress)
        with staged(out) as folder:
            draw_arm(loaded, folder / "arm.png")
    click.echo(check_text(checked))
    click.echo(f"\nwritten to {out}{_slash(out)}: arm.png")
    return 0 if checked.all_reached and checked.home_clear else PLANNED_WITH_FAILURES


@cli.command()
@click.argument("waypoints", type=click.Path(path_type=Path))
@click.option("--limits", required=True, type=click.Path(path_type=Path), help="JSON or TOML file of joint limits.")
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

    LIMITS holds the lists velocity, acceleration and jerk, one number per joint.
    """
    from qparm.compilation_notice import compilation_notice
    from qparm.export.folder import staged
    from qparm.export.trajectory_csv import write_samples_csv
    from qparm.waypoint_file import read_limits, read_waypoint_table

    seconds = period_seconds(period)
    names, q = read_waypoint_table(waypoints)
    allowed = read_limits(limits)
    with compilation_notice(lambda sentence: None if quiet else click.echo(sentence, err=True)):
        from qparm.timing import largest_bulge, quintic_form, ruckig_form, same_distance, time_waypoints

        timed = time_waypoints(q, allowed, band=band, corners=corners, names=names)
    trajectory = {"quintic": quintic_form, "ruckig": ruckig_form}[timing](timed)
    verified = trajectory.verify(allowed, path=timed.path)
    problems = verified.problems()
    with staged(out.parent) as folder:
        write_samples_csv(trajectory, folder / out.name, period=seconds)
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
                f"rests at {len(rests)} of the waypoints, where a curve round them would be slower: first at waypoint"
                f" {rests[0]}{' of those kept' if dropped else ''}"
            )
        distance, after = largest_bulge(timed.path)
        if distance > 0:
            click.echo(
                f"the curve leaves the straight lines between waypoints by up to {distance:.3g} (m or rad), after"
                f" waypoint {after}{' of those kept' if dropped else ''}"
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
    try:
        with file.open("x", encoding="utf-8") as out:
            out.write(text)
    except FileExistsError:
        raise InvalidInput(f"{str(file)!r} exists already; name another file") from None
    except OSError as error:
        raise OutputError(file, error.strerror or str(error)) from None
    click.echo(f"written: {file}\nnext: qparm check {file}")
    return 0


cli.add_command(export)
cli.add_command(verify)
cli.add_command(workspace)
cli.add_command(design)


def main(arguments: list[str] | None = None) -> NoReturn:
    """Run the command line and exit with its code."""

    def terminate(_signal: int, _frame: object) -> NoReturn:
        click.echo("qparm: terminated; no file was left half written", err=True)
        raise SystemExit(TERMINATED)

    signal.signal(signal.SIGTERM, terminate)
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
    except OSError as error:
        if not _from_echo(error):
            raise
        code = _told(OutputError(Path("standard output"), error.strerror or str(error)), NOT_WRITABLE)
        _drop_standard_output()
    gc.freeze()
    sys.exit(code if isinstance(code, int) else 0)


def _told(error: Exception, code: int) -> int:
    click.echo(f"qparm: {error}", err=True)
    return code


def _from_echo(error: OSError) -> bool:
    """Return whether click failed to print, as on a full disk: then nothing is wrong with qparm."""
    *_, (frame, _) = traceback.walk_tb(error.__traceback__)
    return frame.f_code is click.echo.__code__


def _drop_standard_output() -> None:
    # what is still in the buffer would be written at exit, and fail there with a traceback
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _slash(folder: Path) -> str:
    return "" if str(folder).endswith("/") else "/"


if __name__ == "__main__":
    main()
