"""Damped least norm, WLN, CWLN and GPM on the reference raster: clamped afterwards, and as bounded problems.

    python -m comparisons.methods [--cell FILE] [--seeds N] [--out FOLDER]

Each method follows the raster from point to point with a warm start, from the same first configurations. *Clamped*
takes the closed form and cuts every joint to its bounds, as the methods' sources do; *bounded* takes the optimum
within the bounds. Bounds (position limits, trust region), damping, tolerances and stop rules are the same.
"""

from __future__ import annotations

import argparse
import math
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import qparm
from comparisons.stop_rule import within_tolerance
from comparisons.tables import save_table
from qparm.ik import METHODS, active_set, closed_form, solve_poses, step_problem

_ITERATIONS, _WINDOW = 200, 20


@dataclass
class Track:
    """What following the raster once came to."""

    q: np.ndarray
    reached: np.ndarray
    iterations: int
    seconds: float
    self_motion: float
    cut: int


def follow(chain: qparm.SerialChain, poses: np.ndarray, q: np.ndarray, method: str, *, bounded: bool) -> Track:
    """Return the configurations that a method follows the poses with."""
    Q, reached = np.empty((len(poses), chain.n)), np.zeros(len(poses), dtype=bool)
    iterations, cut, self_motion, seconds = 0, 0, 0.0, 0.0
    for k, pose in enumerate(poses):
        best, since, towards = math.inf, 0, None
        for _ in range(_ITERATIONS):
            if method == "wln" and towards is None:
                d = closed_form(step_problem(chain, q, pose, method="dls"))
                towards = (d * (2 * q - chain.upper - chain.lower) > 0).astype(float)
            step = step_problem(chain, q, pose, method=method, towards=towards)
            if within_tolerance(chain, step.e):
                reached[k] = True
                break
            size = float(np.linalg.norm(step.e))
            best, since = (size, 0) if size < 0.99 * best else (best, since + 1)
            if since >= _WINDOW:
                break
            start = time.perf_counter()
            d = closed_form(step)
            inside = step.within_bounds(d)
            if not inside:
                d = active_set(step) if bounded else np.clip(d, step.lb, step.ub)
            seconds += time.perf_counter() - start
            cut += not inside
            iterations += 1
            self_motion += float(np.linalg.norm(d - np.linalg.lstsq(step.J, step.J @ d, rcond=1e-6)[0]))
            q = np.clip(q + chain.scale * d, chain.lower, chain.upper)
        Q[k] = q
    return Track(Q, reached, iterations, seconds, self_motion, cut)


def _smoothness(chain: qparm.SerialChain, tool_path: qparm.ToolPath, track: Track) -> float:
    """Return the RMS second difference inside rows over points that were reached, in degrees at 60 deg/s."""
    scaled = np.degrees(track.q / chain.velocity * chain.velocity[~chain.prismatic].min())
    row = tool_path.row_of_point
    usable = track.reached[:-2] & track.reached[1:-1] & track.reached[2:] & (row[:-2] == row[2:])
    second = np.diff(scaled, 2, axis=0)[usable]
    return float(np.sqrt((second**2).mean())) if len(second) else math.nan


def main() -> None:
    """Print and write the table, and what it says of two claims."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cell", type=Path, default=Path("examples/dome.toml"))
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--out", type=Path, default=Path("comparisons/out"))
    arguments = parser.parse_args()
    cell = qparm.Cell.load(arguments.cell)
    chain, tool_path, jump = cell.chain(), cell.tool_path(), cell.jump()
    poses = tool_path.poses
    first = solve_poses(chain, poses[:1], restarts=60, rng=np.random.default_rng(0), every_start=True)
    starts = first.q[0, first.reached[0]][: arguments.seeds]
    rows, medians = [], {}
    for method in METHODS:
        for bounded in (False, True):
            tracks = [follow(chain, poses, q, method, bounded=bounded) for q in starts]
            unreached = [int((~t.reached).sum()) for t in tracks]
            both = [t.reached[:-1] & t.reached[1:] for t in tracks]
            jumps = [
                int(((np.abs(np.diff(t.q, axis=0)) > jump).any(axis=1) & ok).sum())
                for t, ok in zip(tracks, both, strict=True)
            ]
            at_reached = np.concatenate([t.q[t.reached] for t in tracks])
            targets = np.concatenate([poses[t.reached] for t in tracks])
            E = chain.pose_error(chain.forward(at_reached), targets)
            error = np.linalg.norm(E[:, :3], axis=1).max(initial=0.0)
            iterations = float(np.median([t.iterations for t in tracks]))
            per_point = float(np.median([t.iterations / max(1, int(t.reached.sum())) for t in tracks]))
            seconds = float(np.median([t.seconds / t.iterations for t in tracks]))
            motion = float(np.median([t.self_motion / max(1, int(t.reached.sum())) for t in tracks]))
            medians[method, bounded] = (float(np.median(unreached)), per_point, motion, seconds)
            rows.append(
                [
                    method,
                    "bounded" if bounded else "clamped",
                    f"{np.median(unreached):.0f} ({min(unreached)}-{max(unreached)})",
                    f"{np.median(jumps):.0f}",
                    f"{error * 1e6:.1e}",
                    f"{np.mean([t.cut / t.iterations for t in tracks]):.0%}",
                    int((~chain.within_limits(at_reached)).sum()),
                    f"{iterations:.0f}",
                    f"{per_point:.1f}",
                    f"{seconds * 1e6:.1f}",
                    f"{motion:.4f}",
                    f"{np.median([_smoothness(chain, tool_path, t) for t in tracks]):.2f}",
                ]
            )
    header = ["method", "bounds", "not reached", "jumps", "position error max (um)", "steps that met a bound",
              "limit violations", "iterations", "a reached point", "us a step", "self-motion a reached point (rad)",
              "second difference RMS (deg)"]  # fmt: skip
    title = f"Methods on {cell.name}, {len(poses)} points, medians of {len(starts)} starts"
    print(save_table(arguments.out, "methods", title, header, rows))
    fewer = sum(medians[m, True][0] < medians[m, False][0] for m in METHODS)
    print(f"bounded leaves fewer points unreached than clamped with {fewer} of {len(METHODS)} methods")
    wln, gpm = medians["wln", True], medians["gpm", True]
    words = "less" if wln[2] < gpm[2] else "not less"
    quicker = "fewer" if wln[1] < gpm[1] else "not fewer"
    print(
        "the paper: WLN avoids self-motion and is more efficient than GPM. Here, bounded: WLN moves"
        f" {words} in the null space ({wln[2]:.4f} against {gpm[2]:.4f} rad a point) and takes {quicker} iterations"
        f" a reached point ({wln[1]:.1f} against {gpm[1]:.1f});"
        f" it leaves {wln[0]:.0f} points unreached, GPM {gpm[0]:.0f}"
    )


if __name__ == "__main__":
    main()
