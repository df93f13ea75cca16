"""How near to the optimum a path is timed, how exactly its forms keep to it, and how long that takes.

    python -m comparisons timings
    python -m comparisons timings --problems FOLDER      # waypoints and limits from elsewhere, with their bounds

The bound is toppra's time within velocity and acceleration limits alone, on the same path with the same stops (from
PyPI, where it can be installed; it is no dependency). The jerk limit is ten times that of acceleration, as a number.
"""

from __future__ import annotations

import argparse
import json
import logging
import resource
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import PPoly, make_interp_spline

import qparm
from comparisons.tables import save_table
from qparm.path import JointPath, SegmentKind
from qparm.robot import MotionLimits, rest_to_rest_time
from qparm.timing import (
    PathTiming,
    SpeedProfile,
    StraightMotion,
    quintic_form,
    quintic_trajectory,
    ruckig_form,
    ruckig_trajectory,
    straight_motion,
    time_path,
    time_waypoints,
)

# The bars: of limits, the tool (m), the share of a row at the feed, 100,000 waypoints.
SHARE, TOOL, FEED, SECONDS, MEGABYTES = 1.001, 5e-6, 0.99, 30.0, 1000.0
KEPT, NOT_KEPT = "kept", "**not kept**"
# Points between two of toppra's grid, which holds the waypoints.
_GRID = 8


def bound(curve: PPoly, limits: MotionLimits) -> float:
    """Return toppra's time on a curve, velocity and acceleration limits alone; NaN where it is not installed."""
    try:
        import toppra
        from toppra.algorithm import TOPPRA
        from toppra.constraint import JointAccelerationConstraint, JointVelocityConstraint
    except ImportError:
        return float("nan")
    logging.getLogger("toppra").setLevel(logging.ERROR)

    class Curve(toppra.interpolator.AbstractGeometricPath):
        waypoints = None
        dof = property(lambda _self: curve.c.shape[2])
        path_interval = property(lambda _self: np.array([0.0, curve.x[-1]]))

        def __call__(self, s: Any, order: int = 0) -> Any:
            return curve(s, order)

    x = curve.x
    per = max(_GRID, 200 // len(x))
    grid = np.append((x[:-1, None] + np.diff(x)[:, None] * np.arange(per) / per).ravel(), x[-1])
    constraints = [JointVelocityConstraint(limits.velocity), JointAccelerationConstraint(limits.acceleration)]
    solved = TOPPRA(constraints, Curve(), gridpoints=grid, parametrizer="ParametrizeConstAccel").compute_trajectory()
    return float("nan") if solved is None else float(solved.duration)


def bound_of(timing: PathTiming) -> float:
    """Return toppra's time over all curves of a timing, and that of straight motions without a jerk limit."""
    return sum(
        bound(motion.curve, timing.limits)
        if isinstance(motion, SpeedProfile)
        else straight_bound(motion, timing.limits)
        for motion in timing.motions
    )


def straight_bound(motion: StraightMotion, limits: MotionLimits) -> float:
    """Return the least time of a straight motion from rest to rest within velocity and acceleration limits alone."""
    step = np.maximum(np.abs(motion.step), 1e-300)
    velocity, acceleration = float((limits.velocity / step).min()), float((limits.acceleration / step).min())
    if velocity**2 >= acceleration:
        return 2.0 * acceleration**-0.5
    return 1.0 / velocity + velocity / acceleration


def with_row_ends(cell: qparm.Cell, row_end: str) -> qparm.Cell:
    """Return a cell whose row ends are passed without a stop, or with one."""
    data = cell.to_dict()
    data["process"]["self_motion"]["row_end"] = row_end
    return qparm.Cell.load(data)


def refined(path: JointPath, count: int) -> JointPath:
    """Return a path with about as many waypoints, all on its curve."""
    factor = count / (len(path.q) - 1)
    q, segments, parameters, first = [path.q[:1]], [], [], 0
    for index, segment in enumerate(path.segments):
        s = path.parameters[index]
        gaps = len(s) - 1
        fine = max(1, round(gaps * factor)) if gaps > 1 else 1
        at = np.interp(np.linspace(0, gaps, fine + 1), np.arange(gaps + 1), s)
        q.append(path.curve(index)(at)[1:])
        segments.append(replace(segment, first=first, last=first + fine))
        parameters.append(at)
        first += fine
    N = first + 1
    return replace(
        path, q=np.concatenate(q), point=np.full(N, -1), row=np.zeros(N, dtype=np.int64), kind=(path.kind[0],) * N,
        status=("reached",) * N, s=np.zeros(N), segments=tuple(segments), parameters=tuple(parameters), deviations=None,
    )  # fmt: skip


def near_the_optimum(plan: qparm.Plan, flowing: qparm.Plan) -> list[list[str]]:
    """Return durations over the bound: the reference path and its refinement, with stops and without."""
    chain = plan.chain
    limits = MotionLimits(chain.velocity, chain.acceleration, 10 * chain.acceleration)
    rows = []
    fine = refined(plan.joint_path, 5000)
    for name, path, bar, seconds in (("reference path", plan.joint_path, "1.08", "1 s"),
                                     ("refined", fine, "1.10", "6 s")):  # fmt: skip
        start = time.perf_counter()
        timing = time_path(path, limits)
        elapsed = time.perf_counter() - start
        rows.append(_near(f"{name}, {len(path.q)} waypoints", timing.duration, bound_of(timing), bar, elapsed, seconds))
    # the same waypoints as a list: at the row ends they have kinks, where a stop is quicker than a curve round them
    coarse, fine = (_on_surface(path) for path in (plan.joint_path, fine))
    for name, q in (("reference path", coarse), ("refined", fine)):
        start = time.perf_counter()
        timing = time_waypoints(q, limits)
        elapsed = time.perf_counter() - start
        title = f"{name}, rows and transitions as a list of waypoints"
        rows.append(_near(title, timing.duration, bound_of(timing), "", elapsed, ""))
        rows.append(_near(f"{title}, over one curve", timing.duration, _bound_of_one_curve(q, limits), "1.10", 0.0, ""))
    for name, path in (("reference path", flowing.joint_path), ("refined", refined(flowing.joint_path, 5000))):
        start = time.perf_counter()
        timing = time_path(path, limits)
        elapsed = time.perf_counter() - start
        title = f"{name}, row ends flow, {len(path.q)} waypoints"
        rows.append(_near(title, timing.duration, bound_of(timing), "", elapsed, ""))
    rng = np.random.default_rng(0)
    noisy = fine + 1e-5 * rng.normal(size=fine.shape)
    clean, band = time_waypoints(fine, limits), time_waypoints(noisy, limits, band=1e-4)
    rows.append(_near("noise 1e-5 rad, band 1e-4, over clean", band.duration, clean.duration, "1.10", 0.0, ""))
    return rows


def _bound_of_one_curve(q: np.ndarray, limits: MotionLimits) -> float:
    """Return toppra's time on one curve through waypoints, whatever kinks they have."""
    chord = np.linalg.norm(np.diff(q, axis=0) / limits.velocity, axis=1)
    s = np.concatenate([[0.0], np.cumsum(chord)])
    single = [PPoly.from_spline(make_interp_spline(s, joint, k=5)) for joint in q.T]
    proper = np.flatnonzero(np.diff(single[0].x) > 0)
    c = np.stack([one.c[:, proper] for one in single], axis=2)
    return bound(PPoly(c, single[0].x[np.append(proper, proper[-1] + 1)]), limits)


def _on_surface(path: JointPath) -> np.ndarray:
    """Return the waypoints from the first row's start to the last row's end."""
    rows = [segment for segment in path.segments if segment.kind is SegmentKind.ROW]
    return path.q[rows[0].first : rows[-1].last + 1]


def _near(name: str, ours: float, theirs: float, bar: str, elapsed: float, seconds: str) -> list[str]:
    took, ratio = f"{elapsed:.2f} s" if elapsed else "", ours / theirs
    judged = bar != "" and np.isfinite(ratio)
    kept = ratio <= float(bar or "inf") and elapsed <= float(seconds.removesuffix(" s") or "inf")
    verdict = "" if not judged else KEPT if kept else NOT_KEPT
    return [name, f"{ours:.4g} s", f"{theirs:.4g} s", f"{ratio:.3f}", bar, took, seconds, verdict]


def public_problems(folder: Path) -> list[list[str]]:
    """Return durations over the bounds that stand with waypoints from elsewhere."""
    bars = {"ruckig_example03": "1.05", "moveit_large_accel": "1.10", "toppra_issue26": "3.3"}
    rows = []
    for file in sorted(folder.glob("*.json")):
        problem = json.loads(file.read_text(encoding="utf-8"))
        q = np.loadtxt(file.with_suffix(".csv"), delimiter=",", skiprows=1)
        limits = MotionLimits(*(problem["limits"][key] for key in "vaj"))
        start = time.perf_counter()
        timing = time_waypoints(q, limits)
        elapsed = time.perf_counter() - start
        bar = bars.get(file.stem, "")
        rows.append(_near(file.stem, timing.duration, problem["bound_duration"], bar, elapsed, ""))
    return rows


def forms(plan: qparm.Plan) -> list[list[str]]:
    """Return what the two forms hold at the cell's feed, and beside them motions from rest to rest."""
    chain, path, feed = plan.chain, plan.joint_path, plan.cell.process.feed
    rows = []
    for name, make in (("quintic", quintic_trajectory), ("ruckig", ruckig_trajectory)):
        start = time.perf_counter()
        trajectory = make(chain, path, feed=feed)
        elapsed = time.perf_counter() - start
        report = trajectory.verify(MotionLimits.of(chain), path=path, chain=chain, tool_path=plan.tool_path, feed=feed)
        rows.append(
            [name, f"{trajectory.duration:.2f} s", f"{report.shares.max():.6f}",
             f"{report.tool_deviation * 1e6:.2f} um", f"{report.tool_rotation * 1e6:.1f} urad",
             f"{report.feed_kept.min():.2%}", f"{report.feed_lost:.2f} s", f"{len(trajectory.boundaries) - 1}",
             f"{elapsed:.2f} s",
             KEPT if report.shares.max() <= SHARE and report.tool_deviation <= TOOL and report.feed_kept.min() >= FEED
             else NOT_KEPT]
        )  # fmt: skip
    limits = MotionLimits.of(chain)
    plain = float(rest_to_rest_time(chain, path.q[:-1], path.q[1:]).sum())
    jerk = sum(straight_motion(a, b, limits).duration for a, b in zip(path.q[:-1], path.q[1:], strict=True))
    free = time_path(path, limits)
    rows += [[name, f"{seconds:.2f} s", *[""] * 8] for name, seconds in (
        ("no feed: one timing", free.duration), ("no feed: quintics from rest to rest, as the paper", plain),
        ("no feed: Ruckig from rest to rest", jerk))]  # fmt: skip
    return rows


def many_waypoints() -> list[list[str]]:
    """Return time and memory by the number of waypoints."""
    limits = MotionLimits(np.ones(8), 3 * np.ones(8), 30 * np.ones(8))
    rows = []
    for count in (25_000, 50_000, 100_000):
        rng = np.random.default_rng(0)
        knots = 0.1 * np.cumsum(rng.normal(size=(count // 100, 8)), axis=0)
        q = make_interp_spline(np.arange(len(knots)), knots, k=5)(np.linspace(0, len(knots) - 1, count))
        row = [f"{count:,}"]
        for form in (quintic_form, ruckig_form):
            start = time.process_time()
            form(time_waypoints(q, limits))
            row.append(f"{time.process_time() - start:.1f} s")
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        slowest = max(float(cell.removesuffix(" s")) for cell in row[1:])
        rows.append([*row, f"{peak:.0f} MB", KEPT if slowest <= SECONDS and peak <= MEGABYTES else NOT_KEPT])
    return rows


def main() -> int:
    """Print and write the tables; return 1 if a bar is not kept."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cell", type=Path, default=Path("examples/dome.toml"))
    parser.add_argument("--out", type=Path, default=Path("comparisons/out"))
    parser.add_argument("--problems", type=Path, help="Folder with pairs of CSV and JSON files.")
    parser.add_argument("--quick", action="store_true", help="Leave the long lists of waypoints out.")
    arguments = parser.parse_args()
    tables: list[list[list[str]]] = []
    if not arguments.quick:
        title = "100,000 waypoints: at most 30 s and 1,000 MB"
        header = ["waypoints", "quintic, CPU", "ruckig, CPU", "peak memory so far", ""]
        tables.append(many_waypoints())
        print(save_table(arguments.out, "timings_by_size", title, header, tables[-1]))
    plan = qparm.plan(arguments.cell)
    flowing = qparm.plan(with_row_ends(plan.cell, "flow"))
    rows = near_the_optimum(plan, flowing)
    if arguments.problems:
        rows += public_problems(arguments.problems)
    both = forms(plan) + [[f"row ends flow: {name}", *values] for name, *values in forms(flowing)]
    print(save_table(
        arguments.out, "timings", "Duration over the bound without jerk limits",
        ["path", "ours", "bound", "ratio", "bar", "took", "bar", ""], rows,
    ))  # fmt: skip
    print(save_table(
        arguments.out, "timings_forms", "The two forms on the reference path, row ends as stops and flowing",
        ["form", "duration", "largest share of a limit", "tool off its path", "orientation error",
         "at the feed, least of a row",
         "lost on rows", "intervals", "took", ""],
        both,
    ))  # fmt: skip
    return 1 if any(row[-1] == NOT_KEPT for table in (*tables, rows, both) for row in table) else 0


if __name__ == "__main__":
    raise SystemExit(main())
