"""The readable summary of a plan's report."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

import numpy as np

from qparm.reports.warnings import NEAR_LIMIT_PRISMATIC, NEAR_LIMIT_REVOLUTE
from qparm.reports.words import (
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
from qparm.verify.clearance import LINKS_NOT_CHECKED
from qparm.verify.finding import AT_LIMIT
from qparm.verify.row_feed import GIVES_WAY

if TYPE_CHECKING:
    from qparm.pipeline import Plan
    from qparm.reports.plan import Report
    from qparm.verify.row_feed import RowFeed

__all__ = ["summary"]

# Rows are worked whole if no more than this share of them is left out: rounding.
_WHOLE = 1e-9
# What is said where distances are asked for.
_NO_SURFACE = "not known: a pose list has no surface"


def summary(report: Report) -> list[str]:
    """Return the summary line by line."""
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
        return "-" if report.plan.cell.workpiece.surface_known else _NO_SURFACE
    least, required = clearance.least_clearance * 1e3, clearance.required * 1e3
    return f"{least:.3g} mm at least where the tool travels ({required:.3g} mm asked)"


def _off_surface(report: Report) -> str:
    if not report.plan.cell.workpiece.surface_known:
        return _NO_SURFACE
    return f"off the surface by at most {micrometres(report.figures.surface_deviation)} between the points"
