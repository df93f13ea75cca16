"""``qparm time``: waypoints from elsewhere into samples of a trajectory."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from qparm.cli import options
from qparm.cli.exit_codes import DONE_WITH_FAILURES
from qparm.cli.options import period_seconds
from qparm.cli.progress import told_of_compilation
from qparm.files.output import require_file, staged_file

__all__ = ["time"]


@click.command()
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
@options.timing_form
@click.option("--period", default="4 ms", show_default=True, help="Sampling period.")
@options.quiet
def time(
    waypoints: Path, limits: Path, out: Path, band: float, corners: Any, timing: str, period: str, quiet: bool
) -> int:
    """Time the joint WAYPOINTS of a CSV file within LIMITS, starting and ending at rest, and write samples to a file.

    LIMITS holds the lists velocity, acceleration and jerk, one number per joint, or is a joint_limits.yaml of ROS.
    """
    from qparm.export.trajectory_csv import write_samples_csv
    from qparm.timing.waypoint_files import read_limits, read_waypoint_table

    seconds = period_seconds(period)
    names, q = read_waypoint_table(waypoints)
    allowed = read_limits(limits, names)
    require_file(out)
    with told_of_compilation(quiet):
        from qparm.timing import (
            FORMS,
            largest_bulge,
            rounded_to,
            same_distance,
            time_waypoints,
        )

        timed = time_waypoints(q, allowed, band=band, corners=corners, names=names)
    trajectory = FORMS[timing].of_timing(timed)
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
    return DONE_WITH_FAILURES if problems else 0
