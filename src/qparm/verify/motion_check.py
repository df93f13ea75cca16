"""The check of a motion from any file against every limit and tolerance of a cell: `verify_motion`."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from qparm.errors import InvalidInput
from qparm.verify.clock import read_clock
from qparm.verify.finding import Findings
from qparm.verify.joint_check import check_columns, check_derivatives, check_ends, check_positions
from qparm.verify.motion import unusable_numbers
from qparm.verify.motion_report import MotionReport
from qparm.verify.motion_states import motion_states
from qparm.verify.passing import look_at_tool
from qparm.verify.tool_check import check_tool, look_times

if TYPE_CHECKING:
    from qparm.cell import Cell
    from qparm.verify.motion import MotionTable

__all__ = ["verify_motion"]


def verify_motion(table: MotionTable, cell: Cell) -> MotionReport:
    """Return whether a motion keeps every limit and tolerance of a cell, and where not.

    Joints: position limits; velocity, acceleration and jerk by differentiating the positions anew, by the file's own
    columns, and by what any motion needs that passes through its states; columns that belong together; start and end
    at home, at rest. Tool: every point of the path passed, in order, within tolerance; the path followed between
    them on rows and transitions; the feed; the clearance elsewhere. What the file leaves open (the digits of its
    numbers, what happens between samples) is allowed for, as far as it goes and no farther.

    Parameters
    ----------
    table : MotionTable
        As :func:`qparm.verify.readers.read_motion` reads it.
    cell : Cell

    Returns
    -------
    MotionReport

    Raises
    ------
    InvalidInput
        If the joints are not those of the cell, there are fewer than two samples, values are not finite, times do
        not ascend, or the samples are too far apart to tell anything.
    """
    table = _checked(table, cell)
    findings = Findings()
    if not table.executable:
        findings.wrong("file", "file", "marked executable", 0.0, 0.0, 1.0, "bool")
    clock = read_clock(table)
    findings.found += clock.findings
    joints = cell.arm.joints
    limits = np.array([[getattr(joint, order) for joint in joints] for order in ("velocity", "acceleration", "jerk")])
    states = motion_states(table, clock, limits)
    check_positions(table, cell, clock, states, findings)
    check_derivatives(table, cell, clock, states, limits, findings)
    check_columns(table, cell, clock, states, findings)
    check_ends(table, cell, states, limits, findings)
    t, sample = look_times(clock.t)
    looks = look_at_tool(cell, t, sample, states)
    check_tool(table, cell, clock, states, looks, limits, findings)
    return MotionReport(
        format=table.format,
        samples=len(table.t),
        duration=float(table.t[-1] - table.t[0]),
        period=clock.period,
        checks=tuple(findings.checks),
        findings=tuple(sorted(findings.found, key=lambda one: one.time)),
        known=tuple(findings.known),
        not_told=table.not_told,
    )


def _checked(table: MotionTable, cell: Cell) -> MotionTable:
    """Return the table with its joints in the cell's order."""
    names = [joint.name for joint in cell.arm.joints]
    if sorted(table.joints) != sorted(names):
        raise InvalidInput(f"the motion is of the joints {', '.join(table.joints)}, the cell of {', '.join(names)}")
    if len(table.t) < 2:
        raise InvalidInput("the motion has a single sample; it may be cut short")
    columns = (table.q, table.velocity, table.acceleration, table.jerk)
    wrong = unusable_numbers(table.t, columns, table.joints, lambda k: f"sample {k}")
    if wrong:
        raise InvalidInput(f"the motion, {wrong}")
    order = [table.joints.index(name) for name in names]
    if order == list(range(len(names))):
        return table
    columns = {
        key: None if (values := getattr(table, key)) is None else np.ascontiguousarray(values[:, order])
        for key in ("q", "velocity", "acceleration", "jerk")
    }
    return replace(table, joints=tuple(names), position_rounding=table.position_rounding[order], **columns)
