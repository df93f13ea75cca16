"""The checks of the joints of a motion file: their limits, columns that belong together, home and rest at the ends."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from qparm.verify.columns import NAMES, column_ratios, silent_columns
from qparm.verify.differences import mean_shares
from qparm.verify.finding import AT_LIMIT, LIMIT_SLACK, Findings
from qparm.verify.interpolate import derivative_peaks, position_extremes, positions_at
from qparm.verify.single_values import single_values
from qparm.verify.states import least_jerk_shares

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.cell import Cell
    from qparm.verify.clock import Clock
    from qparm.verify.motion import MotionTable
    from qparm.verify.motion_states import MotionStates

__all__ = ["check_columns", "check_derivatives", "check_ends", "check_positions"]

# Rest: shares of the limits of velocity and acceleration.
_REST = (1e-6, 1e-4)
# A column grows as the next one says, to this share.
_RATIO = 5e-3
_PER = ("/s", "/s^2", "/s^3")


def check_positions(table: MotionTable, cell: Cell, clock: Clock, states: MotionStates, findings: Findings) -> None:
    """Check the position limits at the samples, and on the quintics between points at times of their own."""
    nearest: tuple[float, str, str] | None = None
    between = position_extremes(states.knots) if states.given and not clock.sampled else None
    for k, joint in enumerate(cell.arm.joints):
        lower, upper = joint.position
        inside = np.minimum(table.q[:, k] - lower, upper - table.q[:, k])
        at, unit = int(inside.argmin()), _units(cell)[k]
        if np.isfinite(inside[at]) and (nearest is None or inside[at] < nearest[0]):
            nearest = float(inside[at]), unit, f"joint {joint.name!r} at {table.t[at]:.4f} s"
        beyond = inside < -AT_LIMIT - states.rounding[0, k]
        if beyond.any():
            limit = lower if table.q[at, k] < lower else upper
            first = table.t[int(beyond.argmax())]
            findings.wrong(
                "position", f"joint {joint.name!r}", "position", first, table.q[at, k], limit, unit, beyond.sum()
            )
        elif between is not None:
            for value, limit, outside in (
                (between[0, k], lower, lower - between[0, k]), (between[1, k], upper, between[1, k] - upper)
            ):  # fmt: skip
                if outside > AT_LIMIT + states.rounding[0, k]:
                    findings.wrong("position", f"joint {joint.name!r}", "position of the quintics",
                                   _first_beyond(states, k, limit), value, limit, unit)  # fmt: skip
    if nearest is not None:
        findings.check(
            "least distance from position limits",
            0.0 if -AT_LIMIT <= nearest[0] < 0.0 else nearest[0],
            0.0,
            *nearest[1:],
        )


def _first_beyond(states: MotionStates, joint: int, limit: float) -> float:
    """Return the point after which the quintics first leave a limit."""
    knots, sign = states.knots, 1.0 if states.knots.derivatives[0, 0, joint] <= limit else -1.0
    fine = (knots.t[:-1, None] + np.diff(knots.t)[:, None] * np.linspace(0.0, 1.0, 33)).ravel()
    beyond = sign * (positions_at(knots, fine)[:, joint] - limit) > 0
    return float(fine[int(beyond.argmax())])


def check_derivatives(
    table: MotionTable, cell: Cell, clock: Clock, states: MotionStates, limits: NDArray[np.float64], findings: Findings
) -> None:
    """Check the limits of velocity, acceleration and jerk in every way that the file allows."""
    names, units = table.joints, _units(cell)
    means = mean_shares(clock, table.q, states.rounding[0], limits, slack=LIMIT_SLACK)
    for order in range(3):
        name = NAMES[order + 1]
        joint = int(means.share[order].argmax())
        findings.check(f"{name}, positions differentiated", means.share[order, joint], 1.0, "share",
                       f"joint {names[joint]!r} at {means.time[order, joint]:.4f} s")  # fmt: skip
        for k in np.flatnonzero(means.count[order]).tolist():
            findings.wrong(name, f"joint {names[k]!r}", f"{name} by differences of positions", means.first[order, k],
                           means.share[order, k] * limits[order, k], limits[order, k], units[k] + _PER[order],
                           means.count[order, k])  # fmt: skip
        column = (table.velocity, table.acceleration, table.jerk)[order]
        if column is None:
            continue
        size = (np.abs(column) - states.rounding[order + 1]) / limits[order]
        at, joint = divmod(int(size.argmax()), len(names))
        findings.check(f"{name}, the file's column", size[at, joint], 1.0, "share",
                       f"joint {names[joint]!r} at {table.t[at]:.4f} s")  # fmt: skip
        for k in np.flatnonzero((size > 1 + LIMIT_SLACK).any(axis=0)).tolist():
            beyond = size[:, k] > 1 + LIMIT_SLACK
            findings.wrong(name, f"joint {names[k]!r}", f"{name} in the file", table.t[int(beyond.argmax())],
                           np.abs(column[:, k]).max(), limits[order, k], units[k] + _PER[order],
                           beyond.sum())  # fmt: skip
    if states.given:
        _least_jerk(clock, states, limits, units, findings)
        if not clock.sampled:
            _quintics(states, limits, units, findings)


def _least_jerk(
    clock: Clock, states: MotionStates, limits: NDArray[np.float64], units: list[str], findings: Findings
) -> None:
    names = states.knots.joints
    least = least_jerk_shares(clock, states.knots.derivatives, states.rounding, limits[0], limits[2], slack=LIMIT_SLACK)
    joint = int(least.share.argmax())
    findings.check("jerk that any motion through the states takes", least.share[joint], 1.0, "share",
                   f"joint {names[joint]!r} at {least.time[joint]:.4f} s")  # fmt: skip
    for k in np.flatnonzero(least.count).tolist():
        findings.wrong("jerk", f"joint {names[k]!r}", "position, velocity and acceleration take a jerk of at least",
                       least.first[k], least.share[k] * limits[2, k], limits[2, k], units[k] + _PER[2],
                       least.count[k])  # fmt: skip


def _quintics(states: MotionStates, limits: NDArray[np.float64], units: list[str], findings: Findings) -> None:
    """Check what a controller makes of points at times of their own."""
    names, peaks = states.knots.joints, derivative_peaks(states.knots) / limits
    for order in range(3):
        name, joint = NAMES[order + 1], int(peaks[order].argmax())
        findings.check(f"{name}, peaks of the quintics", peaks[order, joint], 1.0, "share", f"joint {names[joint]!r}")
        for k in np.flatnonzero(peaks[order] > 1 + LIMIT_SLACK).tolist():
            time = _peak_time(states, k, order, limits[order, k])
            findings.wrong(name, f"joint {names[k]!r}", f"{name} of the quintics", time,
                           peaks[order, k] * limits[order, k], limits[order, k], units[k] + _PER[order])  # fmt: skip


def _peak_time(states: MotionStates, joint: int, order: int, limit: float) -> float:
    """Return where the quintics first exceed a limit, to an interval."""
    knots = states.knots
    one = replace(knots, joints=(knots.joints[joint],), derivatives=knots.derivatives[:, :, [joint]])
    first, last = 0, len(knots.t) - 1
    while last - first > 1:
        middle = (first + last) // 2
        part = replace(one, t=one.t[first : middle + 1], derivatives=one.derivatives[:, first : middle + 1])
        if derivative_peaks(part)[order, 0] > limit * (1 + LIMIT_SLACK):
            last = middle
        else:
            first = middle
    return float(knots.t[first])


def check_columns(table: MotionTable, cell: Cell, clock: Clock, states: MotionStates, findings: Findings) -> None:
    """Check that no column, nor the time, is off by a factor, and no single value beside the others."""
    columns = [table.q, table.velocity, table.acceleration, table.jerk]
    if all(column is None for column in columns[1:]):
        return
    if states.given and clock.sampled and not clock.findings:
        # without the last, which may be off the grid
        given = [column[:-1] for column in columns if column is not None]
        for k, joint, order, right in single_values(clock.period, given, states.rounding):
            unit = _units(cell)[joint] + ("", *_PER)[order]
            findings.wrong("columns", f"joint {table.joints[joint]!r}", f"{NAMES[order]} that does not fit its sample",
                           table.t[k], given[order][k, joint], right, unit)  # fmt: skip
    for order, joint, k, change in silent_columns(columns, states.rounding):
        what = f"{NAMES[order + 1]} is zero while the {NAMES[order]} changes by"
        unit = _units(cell)[joint] + ("", *_PER)[order]
        findings.wrong("columns", f"joint {table.joints[joint]!r}", what, table.t[k], change, 0.0, unit)
    ratios = column_ratios(clock.t, columns, states.rounding)
    if np.isnan(ratios).all():
        return
    order, joint = divmod(int(np.nanargmax(np.abs(ratios - 1))), ratios.shape[1])
    findings.check("columns that are each other's integrals, off by", abs(ratios[order, joint] - 1), _RATIO, "share",
                   f"{NAMES[order]} and {NAMES[order + 1]} of joint {table.joints[joint]!r}")  # fmt: skip
    for order, joint in np.argwhere(np.abs(ratios - 1) > _RATIO).tolist():
        what = f"growth of the {NAMES[order]} over what the {NAMES[order + 1]} says"
        findings.wrong("columns", f"joint {table.joints[joint]!r}", what, table.t[0], ratios[order, joint], 1.0, "")


def check_ends(
    table: MotionTable, cell: Cell, states: MotionStates, limits: NDArray[np.float64], findings: Findings
) -> None:
    """Check that the motion starts and ends at home, at rest."""
    home, units = cell.home(), _units(cell)
    worst, where, worst_unit = 0.0, "", units[0]
    for at, name, next_to in ((0, "start", 1), (-1, "end", -2)):
        off = np.abs(table.q[at] - home)
        for k in np.flatnonzero(off > AT_LIMIT + states.rounding[0]):
            findings.wrong("ends", f"joint {table.joints[k]!r}", f"distance from home at the {name}", table.t[at],
                           off[k], 0.0, units[k])  # fmt: skip
        k = int(off.argmax())
        if off[k] >= worst:
            worst, where, worst_unit = float(off[k]), f"joint {table.joints[k]!r} at the {name}", units[k]
        if states.given:
            for order, (what, per) in enumerate((("velocity", "/s"), ("acceleration", "/s^2"))):
                speed = np.abs(states.knots.derivatives[order + 1, at])
                allowed = _REST[order] * limits[order] + states.rounding[order + 1]
                for k in np.flatnonzero(speed > allowed):
                    findings.wrong("ends", f"joint {table.joints[k]!r}", f"{what} at the {name}", table.t[at],
                                   speed[k], allowed[k], units[k] + per)  # fmt: skip
        else:
            # from rest a joint gets no farther than this
            h = abs(float(table.t[next_to] - table.t[at]))
            way, allowed = np.abs(table.q[next_to] - table.q[at]), limits[2] * h**3 / 6 + 2 * states.rounding[0]
            for k in np.flatnonzero(way > allowed * (1 + LIMIT_SLACK) + AT_LIMIT):
                findings.wrong("ends", f"joint {table.joints[k]!r}",
                               f"at rest at the {name}, it moves within a sample by",
                               table.t[at], way[k], allowed[k], units[k])  # fmt: skip
    findings.check("distance from home at the ends", worst, 0.0, worst_unit, where)


def _units(cell: Cell) -> list[str]:
    return ["rad" if joint.type == "revolute" else "m" for joint in cell.arm.joints]
