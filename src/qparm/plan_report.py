"""The report: quality figures of a plan, recomputed from what is handed over."""

from __future__ import annotations

import platform
from collections import Counter
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from qparm.plan_warnings import NEAR_LIMIT_PRISMATIC, NEAR_LIMIT_REVOLUTE, limit_warnings
from qparm.report_words import (
    corner_lines,
    counted,
    many,
    micrometres,
    microradians,
    reach_words,
    shown,
    spans,
    speed_words,
)
from qparm.verify import Figures, KnotTable, SampleTable, Verdict, WaypointTable, measure, verify_motion
from qparm.verify.clearance import LINKS_NOT_CHECKED
from qparm.verify.files import read_knots, read_samples, read_waypoints
from qparm.verify.finding import AT_LIMIT
from qparm.verify.motion import motion_of_knots, motion_of_trajectory, same_motion
from qparm.verify.row_feed import GIVES_WAY

if TYPE_CHECKING:
    from qparm.path import Corner
    from qparm.pipeline import Plan
    from qparm.planning import GraphRecord, ReverseStatistics
    from qparm.verify.row_feed import RowFeed

__all__ = ["JOINT_PATH_FILE", "KNOTS_FILE", "SAMPLES_FILE", "Report", "judge_files", "report"]

JOINT_PATH_FILE, SAMPLES_FILE, KNOTS_FILE = "joint_path.csv", "trajectory.csv", "trajectory.json"
# Rows are worked whole if no more than this share of them is left out: rounding.
_WHOLE = 1e-9
_PACKAGES = (
    "qparm",
    "numpy",
    "scipy",
    "numba",
    "proxsuite",
    "osqp",
    "qpsolvers",
    "ruckig",
    "pydantic",
    "matplotlib",
)


@dataclass(frozen=True, eq=False)
class Report:
    """A plan's figures, and what the planner says of its work.

    Attributes
    ----------
    figures : Figures
        Measured on the files or tables, with a kinematics of their own.
    verdict : Verdict
        What speaks against executing the trajectory, judged on the same files or tables.
    plan : Plan
        Cell, options, and what only the planner can know: how steps were answered, where iterations ended.
    stages : dict of str to float
        Seconds spent in each stage, writing included.
    period : float
        Seconds between the samples that were measured.
    """

    figures: Figures
    verdict: Verdict
    plan: Plan
    stages: dict[str, float]
    period: float

    def __repr__(self) -> str:
        figures = self.figures
        return (
            f"Report({self.plan.cell.name!r}: {figures.reached} of {figures.points} points reached,"
            f" {figures.duration:.6g} s)"
        )

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why the trajectory must not be executed; empty if it may."""
        return self.verdict.reasons

    @property
    def executable(self) -> bool:
        """Whether nothing speaks against execution."""
        return self.verdict.executable

    @property
    def off_path(self) -> tuple[float, float]:
        """How far the tool is off its path on rows and transitions (m, rad); NaN where it follows none."""
        motion = self.verdict.motion
        return (float("nan"), float("nan")) if motion is None else motion.off_path

    @property
    def warnings(self) -> tuple[str, ...]:
        """What does not speak against execution here, but may stop the program in another setup."""
        return limit_warnings(self.figures, self.plan)

    def to_dict(self) -> dict[str, Any]:
        """Return the report as plain data for JSON; SI units, None for what does not exist."""
        plan, figures = self.plan, self.figures
        measured = asdict(figures)
        unreached = measured.pop("unreached")
        joints = measured.pop("joints")
        for point in unreached:
            index = point["index"]
            record = plan.record.points[index]
            reach = plan.reach.get(index)
            point["place_in_row"] = int(index - np.searchsorted(plan.tool_path.row_of_point, point["row"]))
            point["status"] = record.status.value
            point["active_limits"] = list(record.active_limits)
            point["position_error"] = record.position_error
            point["rotation_error"] = record.rotation_error
            point["reach"] = None if reach is None else str(reach)
        data = {
            "executable": self.executable,
            "reasons": list(self.reasons),
            "findings": [asdict(finding) for finding in self.verdict.findings],
            "warnings": list(self.warnings),
            "not_checked": [LINKS_NOT_CHECKED],
            "measured": measured,
            "joints": joints,
            "unreached": unreached,
            "corners": [_corner(plan, corner) for corner in plan.tool_path.corners],
            "jump_criterion": dict(zip(plan.chain.names, plan.cell.jump().tolist(), strict=True)),
            "search": None if plan.search is None else _search(plan.search),
            "smoothing": None if plan.smoothing is None else asdict(plan.smoothing),
            "row_length": plan.row_length,
            "row_length_not_worked": plan.row_length_not_worked,
            "motions": [asdict(motion) | {"kind": motion.kind.value} for motion in plan.breaks],
            "timing": self._timing(),
            "steps": asdict(plan.record.counts),
            "start_solutions": plan.record.start_solutions,
            "segments": [
                {"name": s.name, "kind": s.kind.value, "row": s.row, "start": s.start, "end": s.end}
                for s in plan.trajectory.segments
            ],
            "stages": self.stages,
            "options": asdict(plan.options) | {"period": self.period},
            "cell": plan.cell.to_dict(),
            "versions": versions(),
        }
        return _json_ready(data)

    def _timing(self) -> dict[str, Any]:
        trajectory = self.plan.trajectory
        position, rotation = self.off_path
        return {
            "form": trajectory.timing,
            "waypoints": len(self.plan.joint_path.q),
            "intervals": len(trajectory.boundaries) - 1,
            "polynomials": trajectory.piece_count,
            "tool_deviation": position,
            "tool_rotation": rotation,
            "feed_lost": self.plan.feed_lost,
        }

    def text(self) -> str:
        """Return the readable summary."""
        return "\n".join(_summary(self))


def report(plan: Plan, *, period: float = 0.02) -> Report:
    """Return the report of a plan, measured on the tables that would be written; no files.

    Parameters
    ----------
    plan : Plan
    period : float
        Seconds between the samples of the trajectory.
    """
    path, trajectory = plan.joint_path, plan.trajectory
    waypoints = WaypointTable(
        joints=path.joint_names,
        index=path.point,
        row=path.row,
        kind=np.array([kind.value for kind in path.kind]),
        status=np.array(path.status),
        s=path.s,
        q=path.q,
    )
    t = trajectory.sample_times(period)
    at = trajectory.segment_at(t)
    segments = trajectory.segments
    samples = SampleTable(
        joints=path.joint_names,
        t=t,
        derivatives=np.stack([trajectory(t, order) for order in range(4)]),
        row=np.array([segment.row for segment in segments])[at],
        segment=np.array([segment.kind.value for segment in segments])[at],
        process_on=np.array([segment.process_on for segment in segments])[at],
    )
    knots = KnotTable(
        joints=path.joint_names,
        t=trajectory.boundaries,
        derivatives=np.stack([trajectory(trajectory.boundaries, order) for order in range(3)]),
    )
    figures = measure(plan.cell, waypoints, samples, knots)
    motion = plan.verdict.motion
    verdict = Verdict((*plan.verdict.own, *figures.findings(motion, plan.cell.process)), motion)
    return Report(figures, verdict, plan, dict(plan.stages), period)


def judge_files(plan: Plan, folder: Path) -> tuple[Figures, Verdict]:
    """Return the figures of the files in a folder and the verdict on them.

    Nothing is taken from the plan but its cell, and motions for which no safe way was found.
    """
    knots = read_knots(folder / KNOTS_FILE)
    figures = measure(plan.cell, read_waypoints(folder / JOINT_PATH_FILE), read_samples(folder / SAMPLES_FILE), knots)
    written, planned = motion_of_knots(knots), motion_of_trajectory(plan.trajectory)
    motion = plan.verdict.motion
    # what was judged when it was planned is in the file to the last bit, or the file is judged anew
    if len(knots.t) > 1 and not same_motion(written, planned):
        motion = verify_motion(written, plan.cell)
    return figures, Verdict((*plan.verdict.own, *figures.findings(motion, plan.cell.process)), motion)


def versions() -> dict[str, str]:
    """Return the versions of Python and of the packages a plan depends on."""
    found = {"python": platform.python_version()}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not installed"
    return found


def _json_ready(data: Any) -> Any:
    if isinstance(data, dict):
        return {key: _json_ready(value) for key, value in data.items()}
    if isinstance(data, (list, tuple)):
        return [_json_ready(value) for value in data]
    if isinstance(data, float) and not np.isfinite(data):
        return None
    return data


# --- the readable summary ---------------------------------------------------------------------------


def _corner(plan: Plan, corner: Corner) -> dict[str, Any]:
    position = (plan.tool_path.pose_base_workpiece @ corner.pose)[:3, 3]
    point = int(np.searchsorted(plan.tool_path.row_of_point, corner.row))
    return {"row": corner.row, "point": point, "line": corner.line, "position": position.tolist(),
            "angle": corner.angle, "what": corner.what}  # fmt: skip


def _search(search: GraphRecord | ReverseStatistics) -> dict[str, Any]:
    """Return what a strategy says of its work as plain data."""
    return asdict(search)


def _summary(report: Report) -> list[str]:
    plan, f = report.plan, report.figures
    options = plan.options
    lines = [
        f"{plan.cell.name}: {len(plan.tool_path.rows)} rows, {f.points} points; strategy {options.strategy},"
        f" step {options.method}, solver {options.solver}, timing {options.timing}, seed {options.seed}",
        "",
        *corner_lines(plan.tool_path, width=20),
        f"points reached      {f.reached} of {f.points}",
    ]
    by_row: dict[int, list[int]] = {}
    first_of_row = np.searchsorted(plan.tool_path.row_of_point, np.arange(len(plan.tool_path.rows)))
    for point in f.unreached:
        by_row.setdefault(point.row, []).append(int(point.index - first_of_row[point.row]))
    for row, places in by_row.items():
        indices = [int(first_of_row[row] + place) for place in places]
        statuses = Counter(str(plan.record.points[index].status) for index in indices)
        reasons = reach_words(plan.reach.get(index) for index in indices)
        lines.append(f"  row {row:<3} points {spans(places)}: {counted(statuses)}; {reasons}")
    if f.reached:
        lines.append(
            f"pose error          max {f.position_error_max * 1e6:.3g} um, {f.rotation_error_max * 1e6:.3g} urad;"
            f" mean {f.position_error_mean * 1e6:.3g} um, {f.rotation_error_mean * 1e6:.3g} urad (at the points)"
        )
    lines += _strategy_lines(plan)
    places = Counter(jump.place for jump in f.reconfigurations)
    lines.append(
        f"reconfigurations    {places['row']} inside rows, {places['row end']} at row ends,"
        f" {places['gap']} across points not reached"
    )
    for motion in plan.breaks:
        if motion.kind.value == "break":
            how = f"{motion.escape}, {motion.time:.2f} s" if not motion.failure else f"no motion: {motion.failure}"
            lines.append(f"  {motion.name}: {how}{'; ' + motion.why if motion.why else ''}")
    if not_worked := _not_worked(plan):
        lines.append(f"not worked          {not_worked}")
    lines.append(f"jumps               {len(f.jumps)} over {_criterion(plan)}")
    for jump in f.jumps:
        unit = "rad" if plan.cell.arm.joints[plan.chain.index(jump.joint)].type == "revolute" else "m"
        where = f"row {jump.row}" if jump.row == jump.row_last else f"rows {jump.row} to {jump.row_last}"
        missing = {
            "gap": f", {jump.last - jump.first - 1} points missing between",
            "row end": ", at the row end",
        }
        lines.append(
            f"  points {jump.first} to {jump.last} ({where}): {jump.joint} by {shown(jump.step, unit)}"
            f"{missing.get(jump.place, '')}"
        )
    prismatic = plan.chain.prismatic
    largest = [f"{np.degrees(f.largest_step_revolute):.2f} deg"] if not prismatic.all() else []
    largest += [f"{f.largest_step_prismatic * 1e3:.1f} mm"] if prismatic.any() else []
    lines.append(f"too fast for feed   {f.faster_than_feed} steps between neighbouring points of a row")
    lines += [
        f"largest joint step  {', '.join(largest)} (neighbouring points of a row)",
        f"singular value      least {f.singular_value_min:.4f} (scaled), at point {f.singular_value_index}",
        f"between points      {_between(report)}",
        f"on transitions      {_transitions(report)}",
        f"tool on rows        {_off_surface(report)}",
        f"clear of workpiece  {_clearance(report)}",
        f"tool speed          {speed_words(f.tool_speed_mean)} mean, {speed_words(f.tool_speed_max)} at most"
        f" (feed {speed_words(plan.cell.process.feed)})",
        f"feed                {_feed(f.feed)}",
        f"duration            {f.duration:.2f} s, {len(plan.trajectory.segments)} segments,"
        f" {len(plan.joint_path.breaks)} of them of breaks",
        f"timing              {_timing(report)}",
        "",
        "joint       largest step   from limit   velocity   acceleration   jerk   (shares of the limits)",
    ]
    for joint, endless in zip(f.joints, plan.chain.continuous, strict=True):
        distance = min(joint.limit_distance_waypoints, joint.limit_distance_trajectory)
        distance = 0.0 if -AT_LIMIT <= distance < 0.0 else distance
        room = "-" if endless else shown(distance, joint.unit)
        lines.append(
            f"{joint.name:<10}{shown(joint.largest_step, joint.unit):>14}{room:>13}"
            f"{joint.velocity_share:>11.1%}{joint.acceleration_share:>15.1%}{joint.jerk_share:>7.1%}"
        )
    c = plan.record.counts
    lines.append("")
    if c.closed_form + c.active_set + c.solver + c.fallback + c.failed:
        lines.append(
            f"IK steps            {c.closed_form} closed form, {c.active_set} active set, {c.solver} solver,"
            f" {c.fallback} solver failed (active set instead), {c.failed} unsolved"
        )
    lines += [
        "stages              " + ", ".join(f"{name} {seconds:.2f} s" for name, seconds in report.stages.items()),
        "",
    ]
    if report.warnings:
        lines.append(
            f"warning: {many(len(report.warnings), 'joint')} within {shown(NEAR_LIMIT_REVOLUTE, 'rad')} or"
            f" {shown(NEAR_LIMIT_PRISMATIC, 'm')} of a position limit, where a soft limit of the controller or a"
            " small calibration offset may stop the program"
        )
        lines += [f"  - {sentence}" for sentence in report.warnings]
    if report.executable:
        lines.append(
            "verdict: executable: every joint limit holds and every point is within tolerance"
            " (between the points the tool is as far off as said above)"
            + (f"; {not_worked}" if not_worked else "")
            + f"; {LINKS_NOT_CHECKED}"
        )
    else:
        lines.append(f"verdict: NOT executable ({LINKS_NOT_CHECKED})")
        lines += [f"  - {reason}" for reason in report.reasons]
    return lines


def _not_worked(plan: Plan) -> str:
    """Return in words how much of the rows the tool does not work, empty if it works all."""
    left = plan.row_length_not_worked
    if left <= _WHOLE * plan.row_length:
        return ""
    return f"{left:.3g} m of {plan.row_length:.3g} m of rows not worked"


def _timing(report: Report) -> str:
    """Return how the trajectory is made up, and where the feed is not kept."""
    plan, trajectory = report.plan, report.plan.trajectory
    position, rotation = report.off_path
    text = f"{trajectory.timing}, {len(trajectory.boundaries) - 1:,} intervals for {len(plan.joint_path.q):,} waypoints"
    if position == position:
        text += f"; tool off its path by up to {position * 1e6:.3g} um, {rotation * 1e6:.3g} urad"
        text += f"; {plan.feed_lost:.2f} s lost on rows against the feed from end to end"
    return text


def _feed(feed: RowFeed) -> str:
    """Return on how much of the way the feed is kept, where it gives way most, and what feed every row could keep."""
    if not feed.rows:
        return "-"
    text = f"kept on {feed.kept:.{0 if feed.kept < 0.99 else 1}%} of the way"
    slowed = [row for row in feed.rows if row.joint and row.slowest < feed.feed * GIVES_WAY]
    if slowed:
        worst = min(slowed, key=lambda row: row.slowest)
        text += f"; row {worst.row}: joint {worst.joint}, {speed_words(worst.slowest)} at worst ({worst.limit})"
    never = [row for row in feed.rows if row.largest < feed.feed * GIVES_WAY]
    if never:
        text += f"; {many(len(never), 'row')} never at it, {speed_words(max(row.largest for row in never))} at most"
    bound = min(feed.rows, key=lambda row: row.highest_feed if row.highest_feed == row.highest_feed else np.inf)
    if np.isfinite(bound.highest_feed):
        text += (
            f"; highest feed that every row keeps {speed_words(bound.highest_feed)} (row {bound.row}:"
            f" {bound.highest_joint}, {bound.highest_limit})"
        )
    return text


def _criterion(plan: Plan) -> str:
    parts = [f"{np.degrees(plan.cell.process.jump):.3g} deg"]
    rail = {float(x) for x, prismatic in zip(plan.cell.jump(), plan.chain.prismatic, strict=True) if prismatic}
    parts += [f"{x * 1e3:.3g} mm" for x in sorted(rail)]
    return " or ".join(parts)


def _strategy_lines(plan: Plan) -> list[str]:
    """Return what the strategy and the smoothing did."""
    from qparm.planning import GraphRecord, ReverseStatistics

    lines = []
    search = plan.search
    if isinstance(search, GraphRecord):
        last = search.counts[-1]
        for count in search.counts:
            # of the last it is told what came of it in the end
            inside, at_ends = (search.inside, search.row_ends) if count is last else (count.inside, count.row_ends)
            lines.append(
                f"search              {count.samples:,} solutions of {search.knots} poses:"
                f" {many(inside, 'reconfiguration')} inside rows, {at_ends} at row ends"
            )
        if search.proven:
            lines[-1] += " (none is the least)"
    elif isinstance(search, ReverseStatistics):
        repaired = Counter(str(jump.repair) for jump in search.jumps)
        what = ", ".join(f"{count} {name}" for name, count in repaired.most_common())
        lines.append(f"jumps met           {len(search.jumps)}{': ' + what if what else ''}")
    if (
        plan.smoothing is not None
        and plan.smoothing.iterations
        and np.isfinite(plan.smoothing.second_differences).all()
    ):
        before, after = plan.smoothing.second_differences
        step = plan.smoothing.largest_scaled_step
        lines.append(
            f"smoothing           second differences {np.degrees(before[0]):.3f} to {np.degrees(after[0]):.3f} deg rms,"
            f" {np.degrees(before[1]):.2f} to {np.degrees(after[1]):.2f} deg peak;"
            f" largest velocity-scaled step {np.degrees(step[0]):.2f} to {np.degrees(step[1]):.2f} deg (inside rows and"
            " across row ends)"
        )
    return lines


def _between(report: Report) -> str:
    between = report.figures.between
    if not between.gaps:
        return "-"
    return (
        f"{micrometres(between.position)}, {microradians(between.rotation)} on the curve;"
        f" {micrometres(between.linear_position)}, {microradians(between.linear_rotation)} with linear joint"
        f" interpolation ({between.gaps} gaps, {between.off_gaps} beyond tolerance)"
    )


def _transitions(report: Report) -> str:
    between = report.figures.between
    if not between.transition_gaps:
        return "-"
    return (
        f"{micrometres(between.transition_position)}, {microradians(between.transition_rotation)} on the curve"
        f" ({between.transition_gaps} gaps, {between.transition_off_gaps} beyond tolerance)"
    )


def _clearance(report: Report) -> str:
    clearance = report.figures.clearance
    if np.isnan(clearance.least_clearance):
        return "not known: a pose list has no surface" if report.plan.cell.workpiece.surface() is None else "-"
    least, required = clearance.least_clearance * 1e3, clearance.required * 1e3
    return f"{least:.3g} mm at least where the tool travels ({required:.3g} mm asked)"


def _off_surface(report: Report) -> str:
    if report.plan.cell.workpiece.surface() is None:
        return "not known: a pose list has no surface"
    return f"off the surface by at most {micrometres(report.figures.surface_deviation)} between the points"
