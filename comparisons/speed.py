"""The speed bars: kernels beside Pinocchio, solver steps beside the bare solver, whole plans by size.

    python -m comparisons.speed [--out FOLDER]

Every ratio is taken in one run, the two sides in turn, and is the median over repetitions.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

import qparm
from comparisons.extras import load
from comparisons.pinocchio_model import pinocchio_model
from comparisons.recorded import recorded_steps
from comparisons.solvers import listening
from comparisons.tables import save_table
from qparm.ik import PoseSolver, closed_form, make_solver

_REPETITIONS = 25


def _paired(a: Callable[[], float], b: Callable[[], float]) -> tuple[float, float, float]:
    """Return the medians of two timings taken in turn, and the median of their ratios pair by pair."""
    pairs = np.array([(a(), b()) for _ in range(_REPETITIONS)])
    return float(np.median(pairs[:, 0])), float(np.median(pairs[:, 1])), float(np.median(pairs[:, 0] / pairs[:, 1]))


def iteration_against_pinocchio(chain: qparm.SerialChain) -> list[list[str]]:
    """Return the time of one compiled CWLN iteration over Pinocchio's FK + Jacobian, called from Python."""
    pin = load("pinocchio")

    model, data, frame = pinocchio_model(chain)
    rng = np.random.default_rng(1)
    Q = chain.random(rng, 400)
    targets = chain.forward(np.clip(Q + 0.3 * rng.normal(size=Q.shape) * chain.scale, chain.lower, chain.upper))
    solver = PoseSolver(chain, method="cwln", position_tolerance=1e-12, rotation_tolerance=1e-12, max_iterations=60)

    def by_iterations(pick: Callable[[qparm.ik.PoseSolution], bool]) -> Callable[[], float]:
        chosen = [k for k in range(len(Q)) if pick(solver.solve(targets[k], Q[k]))]

        def seconds() -> float:
            start, iterations = time.perf_counter(), 0
            for k in chosen:
                iterations += solver.solve(targets[k], Q[k]).iterations
            return (time.perf_counter() - start) / iterations

        return seconds

    def pinocchio() -> float:
        start = time.perf_counter()
        for q in Q:
            pin.computeJointJacobians(model, data, q)
            pin.updateFramePlacement(model, data, frame)
            pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
        return (time.perf_counter() - start) / len(Q)

    rows = []
    cases = {
        "CWLN iteration, all": lambda s: s.iterations > 10,
        "CWLN iteration, bound active in at least half of the steps": lambda s: (
            s.iterations > 10 and s.counts.active_set >= 0.5 * s.iterations
        ),
    }
    for name, pick in cases.items():
        ours, theirs, ratio = _paired(by_iterations(pick), pinocchio)
        rows.append([name, f"{ours * 1e6:.2f}", f"{theirs * 1e6:.2f}", f"{ratio:.2f}", "4"])
    return rows


def proxqp_step_against_itself(plan: qparm.Plan) -> list[list[str]]:
    """Return the time of a bounded step through ProxSuite over that of the calls of ProxSuite inside."""
    steps = [s for s in recorded_steps(plan) if not s.within_bounds(closed_form(s))]
    steps = steps[:: max(1, len(steps) // 400)]
    solver = make_solver("proxqp", steps[0].n)

    def whole() -> float:
        start = time.perf_counter()
        for step in steps:
            solver.solve(step)
        return (time.perf_counter() - start) / len(steps)

    def solver_alone() -> float:
        with listening() as heard:
            for step in steps:
                solver.solve(step)
        return (heard.own or 0.0) / len(steps)

    a, b, ratio = _paired(whole, solver_alone)
    return [["bounded step through ProxSuite", f"{a * 1e6:.1f}", f"{b * 1e6:.1f}", f"{ratio:.2f}", "2"]]


def plan_by_size(cell: Path) -> list[list[str]]:
    """Return the time of planning 2,000 and 20,000 points, cell to trajectory, and the ratio."""
    data = qparm.Cell.load(cell).to_dict()
    seconds = {}
    qparm.plan(data, strategy="general")
    for rows, points in ((33, 61), (328, 61)):
        data["process"] |= {"rows": rows, "points": points}
        times = []
        for _ in range(5):
            start = time.perf_counter()
            qparm.plan(data, strategy="general")
            times.append(time.perf_counter() - start)
        seconds[rows * points] = float(np.median(times))
    (small, t_small), (large, t_large) = seconds.items()
    return [
        [
            f"plan of {large} over {small} points",
            f"{t_large:.2f} s",
            f"{t_small:.2f} s",
            f"{t_large / t_small:.1f}",
            "12",
        ]
    ]


def whole_program(cell: Path) -> list[list[str]]:
    """Return wall time and peak memory of the command, after a first run."""
    rows = []
    for _ in range(2):
        with tempfile.TemporaryDirectory() as folder:
            start = time.perf_counter()
            subprocess.run(
                [sys.executable, "-m", "qparm.cli", "plan", str(cell), "--out", folder, "--quiet"], check=False
            )
            elapsed = time.perf_counter() - start
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
    rows.append(["`qparm plan`, wall time", f"{elapsed:.1f} s", "", "", "10 s"])
    rows.append(["`qparm plan`, peak memory", f"{peak:.0f} MB", "", "", "1000 MB"])
    return rows


def main() -> None:
    """Print and write the table of speed bars."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cell", type=Path, default=Path("examples/dome.toml"))
    parser.add_argument("--out", type=Path, default=Path("comparisons/out"))
    arguments = parser.parse_args()
    plan = qparm.plan(arguments.cell, strategy="general", keep_traces=True)
    rows = [
        *iteration_against_pinocchio(plan.chain),
        *proxqp_step_against_itself(plan),
        *plan_by_size(arguments.cell),
        *whole_program(arguments.cell),
    ]
    header = ["what", "qparm (us)", "beside (us)", "ratio", "bar"]
    print(save_table(arguments.out, "speed", "Speed bars (medians, taken in turn in one run)", header, rows))


if __name__ == "__main__":
    main()
