"""The checks of the tool of a motion file: points passed, the path followed, the feed, the clearance."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from qparm.errors import InvalidInput
from qparm.verify.clearance import deepest, judge_stretch
from qparm.verify.differences import shares_along
from qparm.verify.feed import FEED_KEPT, judge_feed
from qparm.verify.finding import Findings
from qparm.verify.following import Following, Piece, follow
from qparm.verify.kinematics import tool_rotation_error
from qparm.verify.motion_report import OFF_PATH, TURNED_OFF_PATH
from qparm.verify.passing import Looks, Passing, find_passing
from qparm.verify.tool_speed import shares_of_knots, shares_of_samples, speeds_of_knots, speeds_of_places
from qparm.verify.worked import check_rows_worked

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.cell import Cell
    from qparm.cell.work import Process
    from qparm.path import ToolPath
    from qparm.verify.clock import Clock
    from qparm.verify.feed import LimitShares, SpeedTrace
    from qparm.verify.motion import MotionTable
    from qparm.verify.motion_states import MotionStates

__all__ = ["check_tool", "look_times"]

# The tool is looked at at least this often (s).
_LOOK = 4e-3
# What samples may hide of the tool's way (m): beyond it they prove nothing.
_MOST_HIDDEN = 1e-3


def look_times(t: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return times no farther apart than 4 ms, the samples among them, and which are samples."""
    h = np.diff(t)
    finer = np.maximum(1, np.ceil(h / _LOOK - 1e-6)).astype(np.int64)
    first = np.cumsum(finer) - finer
    share = np.arange(finer.sum()) - np.repeat(first, finer)
    times = np.append(np.repeat(t[:-1], finer) + share * np.repeat(h / finer, finer), t[-1])
    sample = np.zeros(len(times), dtype=bool)
    sample[np.append(first, len(times) - 1)] = True
    return times, sample


def check_tool(
    table: MotionTable, cell: Cell, clock: Clock, states: MotionStates, looks: Looks, limits: NDArray[np.float64],
    findings: Findings,
) -> None:  # fmt: skip
    """Check the tool: points, path, feed, clearance, and the rows that the file says.

    Raises
    ------
    InvalidInput
        If the samples are too far apart to tell where the tool is.
    """
    process, tool_path = cell.process, cell.tool_path()
    turning = np.array([joint.type == "revolute" for joint in cell.arm.joints])
    hidden, hidden_turn = float(looks.levers @ states.hidden), float(states.hidden[turning].sum())
    if hidden > _MOST_HIDDEN:
        raise InvalidInput(
            f"between these samples the tool may be {hidden * 1e3:.2g} mm from where they say; take a shorter period,"
            " or a format with velocities and accelerations"
        )
    rounding = states.rounding[0] + float(clock.rounding.max(initial=0.0)) * limits[0]
    rounded, rounded_turn = float(looks.levers @ rounding), float(rounding[turning].sum())
    _points_known(process, hidden, hidden_turn, findings)
    passing = find_passing(
        cell, tool_path, looks, states,
        position=process.position_tolerance + hidden, rotation=process.rotation_tolerance + hidden_turn,
    )  # fmt: skip
    allowed = (process.position_tolerance + hidden, process.rotation_tolerance + hidden_turn)
    _points(tool_path, passing, allowed, findings)
    followed = (process.position_between + hidden, process.rotation_between + hidden_turn)
    following = follow(cell, tool_path, looks, passing, position=followed[0], rotation=followed[1])
    _path(cell, looks, following, (rounded, rounded_turn), (hidden, hidden_turn), findings)
    _feed(cell, clock, looks, following, states, limits, (rounded, hidden), findings)
    _clearance(cell, looks, following, hidden, findings)
    check_rows_worked(tool_path, following, findings)
    _rows(table, cell, tool_path, looks, following, followed, findings)


def _points_known(process: Process, hidden: float, hidden_turn: float, findings: Findings) -> None:
    """Say how far the file tells where the tool is, where that is less than the cell asks for."""
    if hidden > process.position_tolerance:
        amount, unit = (hidden * 1e3, "mm") if hidden >= 1e-4 else (hidden * 1e6, "um")
        findings.known.append(f"points known to {amount:.2g} {unit}")
    if hidden_turn > process.rotation_tolerance:
        findings.known.append(f"turns known to {np.degrees(hidden_turn):.2g} deg")


def _points(tool_path: ToolPath, passing: Passing, allowed: tuple[float, float], findings: Findings) -> None:
    position, rotation = allowed
    missed = np.isnan(passing.t)
    for k in np.flatnonzero(missed):
        subject = f"point {k} of row {tool_path.row_of_point[k]}"
        if passing.position[k] > position:
            findings.wrong("point", subject, "the tool misses it by", passing.nearest[k], passing.position[k], position,
                           "m")  # fmt: skip
        elif passing.rotation[k] > rotation:
            findings.wrong("point", subject, "the tool is turned there by", passing.nearest[k], passing.rotation[k],
                           rotation, "rad")  # fmt: skip
        else:
            findings.wrong("point", subject, "passed before the point before it; nearest afterwards",
                           passing.nearest[k], passing.position[k], position, "m")  # fmt: skip
    findings.check("points of the path passed in order", len(missed) - missed.sum(), len(missed), "")
    for what, values, limit, unit in (
        ("tool at points", passing.position, position, "m"),
        ("tool turned at points", passing.rotation, rotation, "rad"),
    ):
        at = int(values.argmax())
        where = f"point {at} of row {tool_path.row_of_point[at]} at {passing.nearest[at]:.4f} s"
        findings.check(what, values[at], limit, unit, where)


def _path(
    cell: Cell, looks: Looks, following: Following, rounded: tuple[float, float], hidden: tuple[float, float],
    findings: Findings,
) -> None:  # fmt: skip
    """Judge the samples, which are exact but for rounding, apart from the places between them."""
    between = (cell.process.position_between, cell.process.rotation_between)
    for kind in ("row", "transition"):
        pieces = [piece for piece in following.pieces if piece.kind == kind]
        for which, unit, what in ((0, "m", OFF_PATH), (1, "rad", TURNED_OFF_PATH)):
            worst, where = float("nan"), ""
            for piece in pieces:
                off = (piece.position, piece.rotation)[which]
                t, exact = looks.t[piece.looks], looks.sample[piece.looks]
                allowed = between[which] + np.where(exact, rounded[which], hidden[which])
                name = f"row {piece.row}" if kind == "row" else f"transition after row {piece.row}"
                at = int(off.argmax())
                if not off[at] <= worst:
                    worst, where = float(off[at]), f"{name} at {t[at]:.4f} s"
                beyond = off > allowed
                if beyond.any():
                    most = int((off - allowed).argmax())
                    findings.wrong("path", "tool", what, t[beyond.argmax()], off[most], allowed[most], unit,
                                   beyond.sum(), place=f"on {name}")  # fmt: skip
            if pieces:
                findings.check(f"tool {what} on {kind}s", worst, between[which] + hidden[which], unit, where)


def _feed(
    cell: Cell, clock: Clock, looks: Looks, following: Following, states: MotionStates, limits: NDArray[np.float64],
    blur: tuple[float, float], findings: Findings,
) -> None:  # fmt: skip
    feed, tool_path = cell.process.feed, cell.tool_path()
    shares = _shares(clock, states, limits)
    worst, where, kept, way = float("nan"), "", 0.0, 0.0
    untold: list[int] = []
    for piece in following.pieces:
        if piece.kind != "row":
            continue
        row = tool_path.rows[piece.row]
        trace = _speeds(cell, clock, looks, piece, states, blur, row.turning_radius)
        figures = judge_feed(trace, feed, shares, float(np.diff(row.s).max()))
        if figures is None:
            untold.append(piece.row)
            continue
        kept, way = kept + figures.kept, way + figures.way
        if not figures.deviation <= worst and figures.deviation == figures.deviation:
            worst, where = figures.deviation, f"row {piece.row} at {figures.time:.4f} s"
        for fault, what in (
            (figures.too_fast, "faster than the feed"),
            (figures.too_slow, "slower than the feed although no joint limit requires it"),
        ):
            if fault is not None:
                findings.wrong("feed", "tool", what, fault.time, fault.speed, feed, "m/s", fault.count,
                               place=f"on row {piece.row}:")  # fmt: skip
    if untold:
        rows = {piece.row for piece in following.pieces if piece.kind == "row"}
        on = "" if set(untold) == rows else f" on {len(set(untold))} of {len(rows)} rows"
        findings.known.append(f"feed not told{on}")
    findings.check("speed on rows off the feed by", worst, FEED_KEPT, "share",
                   f"{where} ({kept / way:.1%} of the way at the feed)" if way else "")  # fmt: skip


def _shares(clock: Clock, states: MotionStates, limits: NDArray[np.float64]) -> LimitShares:
    """Return what shares of their limits joints take over time, as far as the file tells."""
    if states.given and not clock.sampled:
        return shares_of_knots(states.knots, limits)
    if states.given:
        return shares_of_samples(clock.t, states.knots.derivatives, states.rounding[:3], limits)
    return shares_along(clock, states.knots.derivatives[0], states.rounding[0], limits)


def _speeds(
    cell: Cell, clock: Clock, looks: Looks, piece: Piece, states: MotionStates, blur: tuple[float, float],
    radius: float,
) -> SpeedTrace:  # fmt: skip
    """Return the tool's speed on a piece: of the quintics themselves, or between samples."""
    own = piece.looks
    if states.given and not clock.sampled:
        start, end = looks.t[[own.start, own.stop - 1]].tolist()
        return speeds_of_knots(cell, states.knots, start, end, radius=radius)
    # of a grid the samples are exact; between points far apart one has to look in between
    which = looks.sample[own] if clock.sampled else np.ones(own.stop - own.start, dtype=bool)
    t, position, rotation = (values[own][which] for values in (looks.t, looks.position, looks.rotation))
    return speeds_of_places(
        t, position, rotation, feed=cell.process.feed, blur=blur[0] if clock.sampled else blur[1], radius=radius
    )


def _clearance(cell: Cell, looks: Looks, following: Following, blur: float, findings: Findings) -> None:
    distance, clearance = cell.distance(), cell.process.clearance
    if distance is None:
        return
    least, clear = float("nan"), float("nan")
    for stretch in following.stretches:
        if stretch.looks.stop <= stretch.looks.start:
            continue
        d = np.asarray(distance(looks.position[stretch.looks]), dtype=float)
        nearest, near, faults = judge_stretch(
            stretch.kind, stretch.name, looks.t[stretch.looks], d, cell.process, blur=blur
        )
        least, clear = float(np.fmin(least, nearest)), float(np.fmin(clear, near))
        for fault in faults:
            limit = -deepest(cell.process) if fault.what == "inside" else clearance
            what = {
                "inside": "distance from the workpiece",
                "too near": "clearance",
                "turns back": "turns back too near",
            }
            findings.wrong("clearance", "tool", what[fault.what], fault.time, fault.distance, limit, "m",
                           place=f"on the {fault.segment}")  # fmt: skip
    findings.check("least distance from the workpiece off rows", least, -deepest(cell.process), "m")
    findings.check("least clearance where the tool travels", clear, clearance, "m")


def _rows(
    table: MotionTable, cell: Cell, tool_path: ToolPath, looks: Looks, following: Following,
    followed: tuple[float, float], findings: Findings,
) -> None:  # fmt: skip
    """Compare the file's own row numbers and kinds of segment with the rows that the tool was found on."""
    if table.row is None:
        return
    found = np.full(len(looks.t), -1)
    judged = np.zeros(len(looks.t), dtype=bool)
    for piece in following.pieces:
        if piece.kind == "row":
            found[piece.looks] = piece.row
            # where the tool stands at an end of the row the arm may be on its way to the next one
            judged[piece.looks] = ~_at_ends(cell, tool_path, looks, piece, followed)
    found, judged = found[looks.sample], judged[looks.sample]
    # the first and the last sample of a row may be either's
    judged[1:] &= found[1:] == found[:-1]
    judged[:-1] &= found[:-1] == found[1:]
    other = judged & (table.row != found)
    if other.any():
        k = int(other.argmax())
        findings.wrong(
            "row", "columns", f"row of sample {k} in the file", table.t[k], table.row[k], found[k], "", other.sum()
        )
    if table.segment is None:
        return
    no_row = judged & ~other & (table.segment != "row")
    if no_row.any():
        k = int(no_row.argmax())
        what = (
            f"the file calls sample {k} {str(table.segment[k])!r}, the tool follows row {found[k]}; samples of the kind"
        )
        findings.wrong("row", "columns", what, table.t[k], no_row.sum(), 0.0, "")


def _at_ends(
    cell: Cell, tool_path: ToolPath, looks: Looks, piece: Piece, followed: tuple[float, float]
) -> NDArray[np.bool_]:
    """Return at which looks of a row's piece the tool is at one of the row's ends, within (m, rad)."""
    position, rotation = looks.position[piece.looks], looks.rotation[piece.looks]
    there = np.zeros(len(position), dtype=bool)
    for end in tool_path.pose(piece.row, np.array([0.0, tool_path.rows[piece.row].length])):
        near = np.flatnonzero(np.linalg.norm(position - end[:3, 3], axis=1) <= followed[0])
        targets = np.broadcast_to(end[:3, :3], (len(near), 3, 3))
        there[near] |= tool_rotation_error(cell, rotation[near], targets) <= followed[1]
    return there
