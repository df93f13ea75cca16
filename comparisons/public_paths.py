"""Public tool paths for arms that are not ours: is a whole path valid, how long is it in joint space.

    python -m comparisons.public_paths [--data FOLDER] [--strategy NAME] [--method NAME] [--seed N] [--problem NAME ...]

The folder holds ``problems.csv`` (problem, urdf, base, tip), ``joints.csv`` (urdf, joint, type), ``urdf/*.urdf`` and
``targets/<problem>.csv`` (poses). It is no part of this repository; where it is absent the script says so and ends.

A path is valid if every pose is met within 0.1 mm and 0.1 deg, no revolute joint steps by 7 deg or more between
neighbours, no prismatic one by 2 cm or more, and every joint keeps its limits. All of it is measured with the plain
kinematics of ``qparm.verify``, on one ``qparm.plan`` call.
"""

from __future__ import annotations

import argparse
import csv
import time
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import qparm
from comparisons.tables import save_table
from qparm.reports.words import spans
from qparm.verify.kinematics import joint_transforms, rotation_angle

__all__ = ["Verdict", "cell_of", "judge", "main"]

POSITION, ROTATION = 1e-4, np.radians(0.1)
STEP_REVOLUTE, STEP_PRISMATIC = np.radians(7), 0.02
# The bars: three problems valid from one call, and the poses of another that no configuration meets.
VALID = ("fetch__hello", "fetch_arm__rot_yz2", "panda__flappy_bird")
UNREACHABLE = {"panda__square": tuple(range(153, 182))}
HEADER = (
    "problem", "arm", "poses", "met", "unreachable", "valid", "why not", "largest step", "length", "gaps", "time",
)  # fmt: skip


@dataclass(frozen=True)
class Verdict:
    """What a planned path is worth.

    Attributes
    ----------
    met : int
        Poses with a configuration within tolerance.
    unreachable : tuple of int
        Poses that the reach check calls out of reach, from 0.
    missed : tuple of int
        Poses that are not met, though the reach check found a configuration for them.
    reasons : tuple of str
        Why the path is not valid; empty if it is.
    largest_revolute, largest_prismatic : float
        Step between neighbours, gaps left out (rad, m).
    length_revolute, length_prismatic : float
        Sum of absolute steps over all neighbouring waypoints of poses (rad, m).
    gaps : int
        Where neighbouring poses have no configurations to step between.
    """

    met: int
    unreachable: tuple[int, ...]
    missed: tuple[int, ...]
    reasons: tuple[str, ...]
    largest_revolute: float
    largest_prismatic: float
    length_revolute: float
    length_prismatic: float
    gaps: int


def cell_of(folder: Path, problem: dict[str, str]) -> qparm.Cell:
    """Return the cell of one problem; continuous joints as ``joints.csv`` has them, home in the middle of limits."""
    root = ET.parse(folder / "urdf" / f"{problem['urdf']}.urdf").getroot()
    with (folder / "joints.csv").open(encoding="utf-8") as file:
        types = {row["joint"]: row["type"] for row in csv.DictReader(file) if row["urdf"] == problem["urdf"]}
    for joint in root.findall("joint"):
        if types.get(joint.get("name", "")) == "continuous":
            joint.set("type", "continuous")
    text = ET.tostring(root, encoding="unicode")
    limits = qparm.JointLimits(acceleration=1.0, jerk=1.0)
    chain = qparm.chain_from_urdf(text, base=problem["base"], tip=problem["tip"], revolute=limits, prismatic=limits)
    middle = np.where(chain.continuous, 0.0, 0.5 * (chain.lower + chain.upper))
    data: dict[str, Any] = {
        "schema": 1,
        "name": problem["problem"],
        "arm": {
            "name": problem["urdf"],
            "urdf": text,
            "base_link": problem["base"],
            "tip_link": problem["tip"],
            "limits": {
                "revolute": {"acceleration": "10 rad/s^2", "jerk": "100 rad/s^3"},
                "prismatic": {"acceleration": "1 m/s^2", "jerk": "10 m/s^3"},
            },
            "home": [
                f"{float(value)!r} {'m' if prismatic else 'rad'}"
                for value, prismatic in zip(middle, chain.prismatic, strict=True)
            ],
        },
        "workpiece": {"shape": "pose list", "poses": str(folder / "targets" / f"{problem['problem']}.csv")},
        "process": {"feed": "50 mm/s", "jump": "7 deg", "jump_prismatic": "20 mm"},
    }
    return qparm.Cell.load(data)


def _pose(plan: qparm.Plan, point: int) -> int:
    """Return the pose of the list that a point is; one at a corner ends a row and begins the next."""
    row = plan.tool_path.row_of_point[point]
    return point - sum(corner.row <= row for corner in plan.tool_path.corners)


def judge(plan: qparm.Plan) -> Verdict:
    """Return the verdict on a plan, measured with the plain kinematics."""
    path, cell = plan.joint_path, plan.cell
    at = np.flatnonzero(path.point >= 0)
    q, point = path.q[at], path.point[at]
    poses, _ = joint_transforms(cell, q)
    targets = plan.tool_path.poses[point]
    position = np.linalg.norm(poses[:, :3, 3] - targets[:, :3, 3], axis=1)
    rotation = rotation_angle(targets[:, :3, :3] @ poses[:, :3, :3].transpose(0, 2, 1))
    met = point[(position <= POSITION) & (rotation <= ROTATION)]
    not_met = np.setdiff1d(np.arange(plan.tool_path.point_count), met).tolist()
    within = {k for k in not_met if k not in plan.reach or plan.reach[k].reason == "within reach"}
    steps = np.abs(np.diff(q, axis=0))
    neighbours = np.diff(point) == 1
    prismatic = np.array([joint.type == "prismatic" for joint in cell.arm.joints])
    largest = steps[neighbours].max(axis=0, initial=0.0)
    revolute_step, prismatic_step = largest[~prismatic].max(initial=0.0), largest[prismatic].max(initial=0.0)
    limits = np.array([joint.position for joint in cell.arm.joints])
    reasons = []
    if not_met:
        reasons.append(f"{len(not_met)} poses not met")
    if revolute_step >= STEP_REVOLUTE:
        reasons.append(f"a step of {np.degrees(revolute_step):.1f} deg")
    if prismatic_step >= STEP_PRISMATIC:
        reasons.append(f"a step of {prismatic_step * 1e3:.1f} mm")
    if (q < limits[:, 0]).any() or (q > limits[:, 1]).any():
        reasons.append("a joint beyond its limits")
    return Verdict(
        met=len(met),
        unreachable=tuple(sorted({_pose(plan, k) for k in not_met if k not in within})),
        missed=tuple(sorted({_pose(plan, k) for k in within})),
        reasons=tuple(reasons),
        largest_revolute=float(revolute_step),
        largest_prismatic=float(prismatic_step),
        length_revolute=float(steps[:, ~prismatic].sum()),
        length_prismatic=float(steps[:, prismatic].sum()),
        gaps=int((~neighbours).sum()),
    )


def _line(cell: qparm.Cell, verdict: Verdict, poses: int, seconds: float) -> list[object]:
    slides = any(joint.type == "prismatic" for joint in cell.arm.joints)
    step, length = f"{np.degrees(verdict.largest_revolute):.2f} deg", f"{verdict.length_revolute:.2f} rad"
    if slides:
        step += f", {verdict.largest_prismatic * 1e3:.2f} mm"
        length += f" + {verdict.length_prismatic:.2f} m"
    return [
        cell.name, cell.arm.name, poses, verdict.met, spans(list(verdict.unreachable)) or "none",
        "no" if verdict.reasons else "yes", "; ".join(verdict.reasons) or "-", step, length, verdict.gaps,
        f"{seconds:.1f} s",
    ]  # fmt: skip


def main() -> int:
    """Plan every problem of the folder and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    default = Path(__file__).resolve().parents[2] / "shared" / "paths"
    parser.add_argument("--data", type=Path, default=default, help="default: shared/paths beside the repository")
    parser.add_argument("--out", type=Path, default=Path("comparisons/out"))
    parser.add_argument("--strategy", default="graph")
    parser.add_argument("--method", default="cwln")
    parser.add_argument("--solver", default="auto")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--problem", action="append", help="only this one; may be repeated")
    arguments = parser.parse_args()
    folder: Path = arguments.data
    if not (folder / "problems.csv").is_file():
        print(f"public_paths: no paths at {folder}; nothing to do")
        return 0
    with (folder / "problems.csv").open(encoding="utf-8") as file:
        problems = [row for row in csv.DictReader(file) if not arguments.problem or row["problem"] in arguments.problem]
    lines, judged = [], {}
    for problem in problems:
        cell = cell_of(folder, problem)
        start = time.perf_counter()
        plan = qparm.plan(
            cell,
            strategy=arguments.strategy,
            method=arguments.method,
            solver=arguments.solver,
            seed=arguments.seed,
        )
        seconds = time.perf_counter() - start
        verdict = judge(plan)
        judged[cell.name] = (
            verdict.unreachable == UNREACHABLE[cell.name] if cell.name in UNREACHABLE else (not verdict.reasons)
        )
        lines.append(_line(cell, verdict, plan.tool_path.point_count, seconds))
        if verdict.missed:
            print(f"{cell.name}: poses {spans(list(verdict.missed))} are within reach and were not met", flush=True)
    held = all(name not in judged or judged[name] for name in (*VALID, *UNREACHABLE))
    title = f"Public paths, strategy {arguments.strategy}, method {arguments.method}, seed {arguments.seed}"
    print(save_table(arguments.out, "public_paths", title, HEADER, lines))
    return 0 if held else 1


if __name__ == "__main__":
    raise SystemExit(main())
