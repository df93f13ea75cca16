"""Which strategy, and whether the bars of whole paths hold.

    python -m comparisons.strategies [--seeds N] [--quick] [--out FOLDER]

Tables: the graph strategy over seeds; reverse and general beside it; smoothness of the three, all by plain quintics
on one clock (arc length over feed); other cells with the same code; the public paths; time and memory by the number
of points. Exit status 1 if a bar does not hold. Figures: the paper's 10 to 15, joints of each strategy on that clock.
"""

from __future__ import annotations

import argparse
import copy
import json
import subprocess
import sys
import tempfile
import time
import tomllib
from pathlib import Path
from typing import Any

import numpy as np

import qparm
import qparm.ik
from comparisons.clock import Smoothness, draw_clock, smoothness_on_one_clock
from comparisons.tables import save_table

ROOT = Path(__file__).resolve().parents[1]
DOME = ROOT / "examples" / "dome.toml"

# What each cell allows: points out of reach, and the least reconfigurations inside rows and at row ends.
EXPECTED = {"azimuth +-75 deg": (90, 0, 0), "reconfiguration.toml": (0, 1, 1)}

# The bars of the reference cell.
STEP_BEFORE, STEP_AFTER, RMS, PEAK = 10.0, 8.0, 0.115, 0.40
RUNS, SECONDS, MEGABYTES = 5, 10.0, 1000.0


def cells() -> dict[str, dict[str, Any]]:
    """Return variations of the reference cell, by name."""
    base = tomllib.loads(DOME.read_text(encoding="utf-8"))

    def changed(**parts: Any) -> dict[str, Any]:
        data = copy.deepcopy(base)
        for table, values in parts.items():
            data[table] |= values
        return data

    narrow = changed()
    for joint in narrow["arm"]["joints"]:
        if joint["name"] == "theta8":
            joint["position"] = ["-60 deg", "60 deg"]
    small = changed(workpiece={"radius": "300 mm"})
    small["workpiece"]["pose"] = base["workpiece"]["pose"] | {"position": ["0 mm", "1200 mm", "360 mm"]}
    return {
        "azimuth +-45 deg": changed(workpiece={"azimuth": ["-45 deg", "45 deg"]}, process={"points": 46}),
        "azimuth +-75 deg": changed(workpiece={"azimuth": ["-75 deg", "75 deg"]}, process={"points": 76}),
        "300 mm dome": small,
        "theta8 within +-60 deg": narrow,
        "spin free": changed(process={"tool_spin": "free"}),
        "tilt 10 deg": changed(process={"tool_tilt": "10 deg"}),
        "reconfiguration.toml": tomllib.loads((ROOT / "examples" / "reconfiguration.toml").read_text(encoding="utf-8")),
    }


def graph_over_seeds(seeds: int) -> tuple[list[list[str]], bool]:
    """Return a line for each seed of the graph strategy on the reference cell, and whether all bars hold."""
    lines, held = [], True
    for seed in range(seeds):
        start = time.perf_counter()
        plan = qparm.plan(DOME, seed=seed)
        seconds = time.perf_counter() - start
        report = qparm.report(plan)
        figures, smoothing = report.figures, plan.smoothing
        assert smoothing is not None
        inside, ends = plan.solution.reconfigurations(plan.tool_path)
        step = np.degrees(smoothing.largest_scaled_step)
        rms, peak = np.degrees(smoothing.second_differences[1])
        good = (
            figures.reached == figures.points and (inside, ends) == (0, 0) and step[0] <= STEP_BEFORE
            and step[1] <= STEP_AFTER and rms <= RMS and peak <= PEAK and report.executable
            and figures.position_error_max <= 1e-6 and figures.rotation_error_max <= 1e-5
        )  # fmt: skip
        held &= good
        lines.append([
            str(seed), f"{figures.reached} of {figures.points}", f"{figures.position_error_max * 1e6:.1e}",
            f"{inside} + {ends}", f"{step[0]:.2f}", f"{step[1]:.2f}", f"{rms:.3f}", f"{peak:.3f}",
            f"{figures.between.position * 1e6:.3f}", "yes" if report.executable else "no", f"{seconds:.1f}",
            "" if good else "**not held**",
        ])  # fmt: skip
        print(f"seed {seed}: {lines[-1][1:]}", flush=True)
    return lines, held


GRAPH_HEADER = [
    "seed", "reached", "error um", "reconfigurations in rows + at ends", "largest step before deg", "after deg",
    "second differences rms deg", "peak deg", "between points um", "executable", "seconds", "",
]  # fmt: skip


def three_strategies(out: Path, seed: int) -> tuple[list[list[str]], list[list[str]]]:
    """Return lines on the three strategies and on their smoothness, and draw their joints on one clock."""
    lines, smooth, found = [], [], dict[str, Smoothness]()
    for strategy in ("graph", "reverse", "general"):
        start = time.perf_counter()
        plan = qparm.plan(DOME, strategy=strategy, seed=seed)
        seconds = time.perf_counter() - start
        report = qparm.report(plan)
        inside, ends = plan.solution.reconfigurations(plan.tool_path)
        breaks = sum(motion.kind.value == "break" for motion in plan.breaks)
        lines.append([
            strategy, f"{report.figures.reached} of {report.figures.points}", str(inside), str(ends), str(breaks),
            "yes" if report.executable else "no", f"{plan.stages['joint path']:.2f}", f"{seconds:.2f}",
        ])  # fmt: skip
        found[strategy] = smoothness_on_one_clock(plan)
        draw_clock(plan, out / f"clock_{strategy}.png")
    for name in found["graph"].joints:
        row = [name]
        for measure in ("acceleration_rms", "acceleration_peak", "jerk_rms", "jerk_peak"):
            values = {s: getattr(f, measure)[f.joints.index(name)] for s, f in found.items()}
            row += [f"{values[s]:.3g}" for s in found] + [f"{values['graph'] / values['general']:.2f}"]
        smooth.append(row)
    return lines, smooth


SMOOTH_HEADER = ["joint"] + [
    f"{measure} {column}"
    for measure in ("acceleration rms", "acceleration peak", "jerk rms", "jerk peak")
    for column in ("graph", "reverse", "general", "graph / general")
]


def other_cells() -> tuple[list[list[str]], bool]:
    """Return a line for each other cell, and whether each is planned as it can be."""
    lines, held = [], True
    for name, data in cells().items():
        start = time.perf_counter()
        plan = qparm.plan(data)
        seconds = time.perf_counter() - start
        report = qparm.report(plan)
        inside, ends = plan.solution.reconfigurations(plan.tool_path)
        unreached = report.figures.points - report.figures.reached
        # points out of reach are named; nothing else may stand against execution
        other = [reason for reason in report.reasons if "points are not reached" not in reason]
        within = qparm.reach.ReachReason.WITHIN_REACH
        named = all(plan.reach[k].reason is not within for k in plan.record.unreached.tolist())
        good = not other and named and (unreached, inside, ends) == EXPECTED.get(name, (0, 0, 0))
        held &= good
        smoothing = plan.smoothing
        assert smoothing is not None
        lines.append([
            name, f"{report.figures.reached} of {report.figures.points}", f"{unreached} named" if unreached else "-",
            f"{inside} + {ends}", f"{np.degrees(smoothing.largest_scaled_step[0]):.1f}",
            f"{np.degrees(smoothing.largest_scaled_step[1]):.1f}",
            " / ".join(f"{np.degrees(x):.2f}" for x in smoothing.second_differences[1]),
            f"{report.figures.between.position * 1e6:.2f}", f"{seconds:.1f}", "yes" if good else "**no**",
        ])  # fmt: skip
        print(lines[-1], flush=True)
    return lines, held


CELLS_HEADER = [
    "cell", "reached", "out of reach", "reconfigurations in rows + at ends", "largest step before deg", "after deg",
    "second differences rms / peak deg", "between points um", "seconds", "valid",
]  # fmt: skip

_SIZE = """
import json, resource, sys, time
import qparm
from qparm.cell import Cell
data = Cell.load(sys.argv[1]).to_dict()
data["process"] |= {"rows": int(sys.argv[2]), "points": int(sys.argv[3])}
start = time.perf_counter()
plan = qparm.plan(data)
seconds = time.perf_counter() - start
print(json.dumps({
    "seconds": seconds, "stages": plan.stages, "knots": plan.search.knots,
    "reconfigurations": list(plan.solution.reconfigurations(plan.tool_path)),
    "reached": int(plan.solution.reached.sum()),
    "exact": bool(plan.joint_path.deviations.exact(5e-6, 2e-5).all()),
    "memory": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
}))
"""


def by_size(*, quick: bool) -> tuple[list[list[str]], bool]:
    """Return time and memory of plans by the number of points, and whether they are linear and under 2 GB."""
    lines, found = [], []
    sizes = [(15, 61), (15, 610), (150, 61)] if quick else [(15, 61), (15, 610), (150, 61), (15, 6100), (150, 610)]
    for rows, points in sizes:
        run = subprocess.run(
            [sys.executable, "-c", _SIZE, str(DOME), str(rows), str(points)], capture_output=True, text=True, check=True
        )
        data = json.loads(run.stdout.splitlines()[-1])
        found.append(data)
        stages = data["stages"]
        lines.append([
            f"{rows} x {points}", f"{rows * points:,}", f"{data['knots']:,}", f"{data['reached']:,}",
            " + ".join(str(x) for x in data["reconfigurations"]), "yes" if data["exact"] else "no",
            *(f"{stages[name]:.1f}" for name in ("joint path", "smoothing", "between points", "trajectory")),
            f"{data['seconds']:.1f}", f"{data['memory']:.0f}",
        ])  # fmt: skip
        print(lines[-1], flush=True)
    # both the number of points and the number of searched poses may make work: time over their sum, no more than 1.5 x
    per_point = [d["seconds"] / (rows * points) for d, (rows, points) in zip(found, sizes, strict=True)]
    held = max(per_point) <= 1.5 * per_point[0] and all(
        d["memory"] < 2000 and d["exact"] and d["reconfigurations"] == [0, 0] and d["reached"] == rows * points
        for d, (rows, points) in zip(found, sizes, strict=True)
    )
    return lines, held


SIZE_HEADER = [
    "rows x points", "points", "poses searched", "reached", "reconfigurations", "exact between points", "joint path s",
    "smoothing s", "between points s", "trajectory s", "plan s", "peak memory MB",
]  # fmt: skip


def command(out: Path) -> tuple[list[list[str]], bool]:
    """Return time and memory of the whole command on the reference cell, a new process each time."""
    lines, slowest, largest = [], 0.0, 0.0
    for _ in range(RUNS):
        with tempfile.TemporaryDirectory() as folder:
            script = (
                "import resource,subprocess,sys,time; t=time.perf_counter();"
                f"subprocess.run([sys.executable,'-m','qparm.cli','plan',{str(DOME)!r},'--out',{folder!r},'-q'],"
                "check=True);"
                "print(time.perf_counter()-t, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss/1024)"
            )
            run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
            seconds, memory = (float(x) for x in run.stdout.split())
            stages = json.loads((Path(folder) / "report.json").read_text(encoding="utf-8"))["stages"]
        slowest, largest = max(slowest, seconds), max(largest, memory)
        told = ", ".join(f"{name} {value:.1f}" for name, value in stages.items() if value >= 0.05)
        lines.append([f"{seconds:.1f}", f"{memory:.0f}", told])
    return lines, slowest <= SECONDS and largest < MEGABYTES


def main() -> int:
    """Run all parts and print their tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("comparisons/out"))
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--quick", action="store_true")
    options = parser.parse_args()
    out: Path = options.out
    out.mkdir(parents=True, exist_ok=True)
    seeds = 2 if options.quick else options.seeds
    qparm.plan(DOME)  # kernels are loaded
    verdicts: dict[str, bool] = {}
    lines, verdicts["command"] = command(out)
    print(save_table(out, "strategies_command", "qparm plan, the whole command", ["seconds", "MB", "stages"], lines))
    lines, verdicts["graph"] = graph_over_seeds(seeds)
    print(save_table(out, "strategies_graph", "The graph strategy over seeds", GRAPH_HEADER, lines))
    lines, smooth = three_strategies(out, seed=0)
    header = ["strategy", "reached", "in rows", "row ends", "breaks", "executable", "joint path s", "plan s"]
    print(save_table(out, "strategies", "Three strategies, seed 0", header, lines))
    print(save_table(out, "strategies_smoothness", "Smoothness on one clock, inside rows", SMOOTH_HEADER, smooth))
    lines, verdicts["cells"] = other_cells()
    print(save_table(out, "strategies_cells", "Other cells, the same code", CELLS_HEADER, lines))
    lines, verdicts["size"] = by_size(quick=options.quick)
    print(save_table(out, "strategies_size", "Time and memory by size", SIZE_HEADER, lines))
    public = subprocess.run([sys.executable, "-m", "comparisons.public_paths", "--out", str(out)], check=False)
    verdicts["public paths"] = public.returncode == 0
    reverse = ["--seeds", str(seeds), "--out", str(out)]
    verdicts["reverse"] = (
        subprocess.run([sys.executable, "-m", "comparisons.reverse_statistics", *reverse], check=False).returncode == 0
    )
    print("bars: " + ", ".join(f"{name} {'held' if held else 'NOT held'}" for name, held in verdicts.items()))
    return 0 if all(verdicts.values()) else 1


if __name__ == "__main__":
    sys.exit(main())
