"""``qparm export``: convert the trajectory of a plan's folder to other formats."""

from __future__ import annotations

from pathlib import Path

import click

from qparm.choices import TRAJECTORY_FORMATS
from qparm.cli import options
from qparm.cli.options import period_seconds
from qparm.cli.progress import told_of_compilation

__all__ = ["export"]


@click.group()
def export() -> None:
    """Convert what `qparm plan` wrote to other formats."""


@export.command()
@click.argument("source", type=click.Path(path_type=Path))
@click.option("--to", required=True, type=click.Choice(list(TRAJECTORY_FORMATS)), help="Format.")
@click.option("--out", required=True, type=click.Path(path_type=Path), help="File to write; rosbag2: a folder.")
@click.option(
    "--period",
    help="Sampling period.  [default: csv, npz, parquet, stream 4 ms; krl, rapid at most 50 ms; json, yaml, mcap,"
    " rosbag2 the knots, between which a quintic gives the trajectory back]",
)
@click.option("--allow-failures", is_flag=True, help="Write a trajectory that is not executable, marked as such.")
@options.quiet
def trajectory(source: Path, to: str, out: Path, period: str | None, allow_failures: bool, quiet: bool) -> int:
    """Write the trajectory in the folder SOURCE, which `qparm plan` wrote, to a file.

    \b
    csv, npz, parquet          positions, velocities, accelerations, jerks, segments
    stream                     positions at every tick of a servo interface
    json, yaml, mcap, rosbag2  a ROS 2 trajectory_msgs/JointTrajectory
    krl, rapid                 programs for six revolute joints and a rail (A1-A6, E1)
    """  # noqa: D301
    seconds = None if period is None else period_seconds(period)
    with told_of_compilation(quiet):
        from qparm.export import export_trajectory, load_trajectory

        saved = load_trajectory(source)
        done = export_trajectory(
            saved.trajectory, out, to=to, units=saved.units, period=seconds, allow_failures=allow_failures
        )
    if not quiet:
        marked = "" if saved.trajectory.executable else "; marked: must not be executed"
        click.echo(f"{done.samples} samples, {done.duration:.6g} s{marked}")
        click.echo(f"written: {', '.join(str(file) for file in done.files)}")
    return 0
