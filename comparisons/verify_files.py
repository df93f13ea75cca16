"""Whether `qparm verify` passes every file as written, at every period, and none that is off by one per cent.

    python -m comparisons.verify_files [--cell CELL] [--quick] [--programs]

Two tables: every format at its periods, unaltered, both forms; and twenty alterations of the motion or of the cell, on
samples of every column and on positions alone. Controller programs take six axes and a track, which the cell need not
be: their files are of the six-axis arm of the examples on a track, two rows of 73 points (``--programs`` alone). Exit
status 1 if a file as written is refused or an altered one kept.
"""

from __future__ import annotations

import argparse
import tempfile
import time
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import qparm
from comparisons.tables import save_table
from qparm.export import FORMATS, export_trajectory
from qparm.verify import MotionTable, read_motion, verify_motion

_MESSAGES = ("json", "yaml", "mcap", "rosbag2")
_TABLES = ("csv", "npz", "parquet", "stream")
_PROGRAMS = ("krl", "rapid")
_PERIODS, _FINE = (0.004, 0.008, 0.02), 0.001
# A program needs samples this near to each other (s) for its verdict to tell the feed.
_PROGRAM_PERIOD = 0.004
Case = tuple[str, float | None]

Altered = tuple[MotionTable, qparm.Cell]
Alteration = Callable[[MotionTable, qparm.Plan], Altered]


def cases_of(periods: tuple[float, ...], fine: tuple[str, ...]) -> list[Case]:
    """Return every format that takes any arm, with its periods."""
    cases: list[Case] = [(to, None) for to in _MESSAGES]
    cases += [(to, period) for to in _TABLES for period in periods]
    return [*cases, ("json", periods[-1]), *((to, _FINE) for to in fine)]


def program_cell() -> qparm.Cell:
    """Return the six-axis arm of the examples on a track before two rows of 73 points."""
    data = tomllib.loads(Path("examples/six_axis.toml").read_text(encoding="utf-8"))
    arm = data["arm"]
    first = arm["joints"][0]
    track = {
        "name": "track", "type": "prismatic",
        "dh": {"alpha": "-90 deg", "a": "0 mm", "d": "0 mm", "theta": "0 deg"},
        "position": ["0 mm", "800 mm"], "velocity": "200 mm/s", "acceleration": "600 mm/s^2", "jerk": "6000 mm/s^3",
    }  # fmt: skip
    # along y, with the base axis upright on it
    arm["joints"] = [track, first | {"dh": first["dh"] | {"alpha": "90 deg", "theta": "90 deg"}}, *arm["joints"][1:]]
    arm["home"] = ["250 mm", *arm["home"]]
    arm["base"] = {"position": ["0 mm"] * 3, "rpy": ["0 deg"] * 3}
    data["workpiece"]["elevation"] = ["10 deg", "20 deg"]
    data["process"] |= {"rows": 2, "points": 73}
    return qparm.Cell.load(data | {"name": "six axes on a track"})


def unaltered(plan: qparm.Plan, cases: Sequence[Case]) -> tuple[list[list[str]], bool]:
    """Return a line for every format and period, and whether all were kept."""
    rows, good = [], True
    with tempfile.TemporaryDirectory() as folder:
        for k, (to, period) in enumerate(cases):
            file = Path(folder) / f"f{k}{FORMATS[to].extension}"
            export_trajectory(plan.trajectory, file, to=to, units=plan.chain.units, period=period)
            start = time.process_time()
            report = verify_motion(read_motion(file, plan.cell), plan.cell)
            seconds = time.process_time() - start
            good &= report.kept
            told = f" ({', '.join(report.known)})" if report.known else ""
            verdict = f"kept{told}" if report.kept else f"REFUSED: {report.problems(1)[0]}"
            when = f"{period * 1e3:g} ms" if period is not None else "50 ms" if to in _PROGRAMS else "own points"
            rows.append([plan.trajectory.timing, to, when, f"{report.samples:,}", f"{seconds:.1f} s", verdict])
    return rows, good


# --- one per cent -------------------------------------------------------------------------------------


def changed(cell: qparm.Cell, change: Callable[[dict[str, Any]], None]) -> qparm.Cell:
    """Return the cell with its data changed."""
    data = cell.to_dict()
    change(data)
    return qparm.Cell.load(data)


def times(text: str, factor: float) -> str:
    """Return a quantity times a factor."""
    value, unit = text.split(" ", 1)
    return f"{float(value) * factor!r} {unit}"


def limit(order: int, key: str) -> Alteration:
    """Lower the limit that the motion uses most of."""

    def alter(table: MotionTable, plan: qparm.Plan) -> Altered:
        shares = qparm.report(plan).timed.shares[order]
        joint = int(shares.argmax())

        def change(data: dict[str, Any]) -> None:
            one = data["arm"]["joints"][joint]
            one[key] = times(one[key], 0.99)

        return table, changed(plan.cell, change)

    return alter


def position_limit(table: MotionTable, plan: qparm.Plan) -> Altered:
    """Set the upper limit of joint 2 one per cent below what it reaches."""

    def change(data: dict[str, Any]) -> None:
        joint = data["arm"]["joints"][1]
        reached = float(table.q[:, table.joints.index(joint["name"])].max())
        joint["position"] = [joint["position"][0], f"{reached - 0.01 * abs(reached)!r} rad"]

    return table, changed(plan.cell, change)


def process(key: str, factor: float) -> Alteration:
    """Change a key of the process."""
    return lambda table, plan: (
        table,
        changed(plan.cell, lambda data: data["process"].update({key: times(data["process"][key], factor)})),
    )


def link(table: MotionTable, plan: qparm.Plan) -> Altered:
    """Lengthen the first link."""
    name = next(iter(plan.cell.to_dict()["arm"]["lengths"]))

    def change(data: dict[str, Any]) -> None:
        lengths = data["arm"]["lengths"]
        lengths[name] = times(lengths[name], 1.01)

    return table, changed(plan.cell, change)


def value(order: str, joints: str, kind: str, share: float = 0.37) -> Alteration:
    """Change the largest value, or all joints' values, of a sample in the last segment of a kind."""

    def alter(table: MotionTable, plan: qparm.Plan) -> Altered:
        segment = [one for one in plan.trajectory.segments if one.kind.value == kind][-1]
        k = int(np.searchsorted(table.t, segment.start + share * (segment.end - segment.start)))
        values = getattr(table, order).copy()
        values[k, slice(None) if joints == "all" else int(np.abs(values[k]).argmax())] *= 1.01
        return replace(table, **{order: values}), plan.cell

    return alter


def waypoint(table: MotionTable, plan: qparm.Plan) -> Altered:
    """Change joint 6 in the sample nearest to a point of the raster."""
    at = int(np.flatnonzero(plan.joint_path.point == plan.tool_path.point_count // 3 + 7)[0])
    q = table.q.copy()
    q[int(np.abs(table.t - plan.trajectory.knots[at]).argmin()), 5] *= 1.01
    return replace(table, q=q), plan.cell


def column(order: str, joint: int) -> Alteration:
    """Change all values of a joint."""

    def alter(table: MotionTable, plan: qparm.Plan) -> Altered:
        values = getattr(table, order).copy()
        values[:, joint] *= 1.01
        return replace(table, **{order: values}), plan.cell

    return alter


def one_time(table: MotionTable, plan: qparm.Plan) -> Altered:
    """Move one sample by one per cent of the interval before it."""
    t, k = table.t.copy(), len(table.t) // 2
    t[k] += 0.01 * (t[k] - t[k - 1])
    return replace(table, t=t), plan.cell


ALTERATIONS: dict[str, Alteration] = {
    "velocity limit": limit(0, "velocity"),
    "acceleration limit": limit(1, "acceleration"),
    "jerk limit": limit(2, "jerk"),
    "position limit": position_limit,
    "feed lower": process("feed", 0.99),
    "feed higher": process("feed", 1.01),
    "length of a link": link,
    "position of a sample on a row": value("q", "one", "row"),
    "position of a sample of the approach": value("q", "one", "approach"),
    "positions of a sample of a transition": value("q", "all", "transition"),
    "velocity of a sample of the approach": value("velocity", "one", "approach"),
    "acceleration of a sample of the retract": value("acceleration", "one", "retract", 0.04),
    "a waypoint": waypoint,
    "a column of positions": column("q", 0),
    "a column of velocities": column("velocity", 7),
    "a column of accelerations": column("acceleration", 2),
    "a column of jerks": column("jerk", 3),
    "all times slower": lambda table, plan: (replace(table, t=1.01 * table.t), plan.cell),
    "all times faster": lambda table, plan: (replace(table, t=0.99 * table.t), plan.cell),
    "one time": one_time,
}


def altered(plan: qparm.Plan, period: float, formats: tuple[str, str]) -> tuple[list[list[str]], bool]:
    """Return a line for every alteration, and whether each was refused."""
    tables: dict[str, MotionTable] = {}
    with tempfile.TemporaryDirectory() as folder:
        for to in formats:
            file = Path(folder) / f"{to}{FORMATS[to].extension}"
            export_trajectory(plan.trajectory, file, to=to, units=plan.chain.units, period=period)
            tables[to] = read_motion(file, plan.cell)
    rows, good = [], True
    for name, alter in ALTERATIONS.items():
        row = [name]
        for table in tables.values():
            if table.velocity is None and name.endswith(("velocities", "accelerations", "jerks")):
                row.append("no such column")
                continue
            if table.velocity is None and name.startswith(("velocity of", "acceleration of")):
                row.append("no such column")
                continue
            report = verify_motion(*alter(table, plan))
            good &= not report.kept
            row.append("KEPT" if report.kept else report.problems(1)[0])
        rows.append(row)
    return rows, good


def main() -> int:
    """Print both tables; return 1 if a verdict is wrong."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cell", type=Path, default=Path("examples/dome.toml"))
    parser.add_argument("--out", type=Path, default=Path("comparisons/out"))
    parser.add_argument("--quick", action="store_true", help="20 ms alone, quintics alone")
    parser.add_argument("--programs", action="store_true", help="controller programs alone")
    arguments = parser.parse_args()
    rows, good, both = [], True, []
    formats: list[tuple[str, qparm.Cell, tuple[str, str], float]] = [
        ("programs", program_cell(), _PROGRAMS, _PROGRAM_PERIOD)
    ]
    if not arguments.programs:
        formats.insert(0, ("altered", qparm.Cell.load(arguments.cell), ("csv", "stream"), _PERIODS[-1]))
    for name, cell, kinds, period in formats:
        plan = qparm.plan(cell)
        if kinds == _PROGRAMS:
            cases: list[Case] = [(to, step) for to in kinds for step in (None, *_PERIODS)]
        else:
            quick = arguments.quick
            cases = cases_of(_PERIODS[-1:] if quick else _PERIODS, () if quick else ("npz", "stream"))
        more, kept = unaltered(plan, cases)
        rows, good = rows + more, good and kept
        if not arguments.quick:
            slower = [(to, None) for to in kinds] if kinds == _PROGRAMS else cases_of(_PERIODS[-1:], ())
            more, kept = unaltered(qparm.plan(cell, timing="ruckig"), slower)
            rows, good = rows + more, good and kept
        lines, refused = altered(plan, period, kinds)
        good &= refused
        when = f"at {period * 1e3:g} ms: first finding"
        header = ["off by one per cent", *(f"{to} {when}" for to in kinds)]
        both.append((f"verify_{name}", header, lines))
    header = ["form", "format", "period", "samples", "verified in, CPU", "verdict"]
    print(save_table(arguments.out, "verify_files", "Files as written", header, rows))
    for name, header, lines in both:
        print(save_table(arguments.out, name, "Altered files", header, lines))
    return 0 if good else 1


if __name__ == "__main__":
    raise SystemExit(main())
