"""Valid inputs of every kind that qparm reads, small enough to be read in a blink: what the fuzzer changes.

All of them belong to one tiny cell, three points of a sphere just under the tool of a six-axis arm at home; qparm plans
it once and writes the files itself.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import qparm
from qparm.export import FORMATS, export_trajectory, write

__all__ = ["KINDS", "Kind", "make_seeds", "tiny_cell"]

EXAMPLE = Path(__file__).resolve().parents[1] / "examples" / "six_axis.toml"
URDF = """<?xml version="1.0"?>
<robot name="three">
  <link name="base"/><link name="l1"/><link name="l2"/><link name="l3"/><link name="l4"/><link name="l5"/>
  <link name="tip"/>
  <joint name="j1" type="revolute"><parent link="base"/><child link="l1"/><origin xyz="0 0 0.3"/><axis xyz="0 0 1"/>
    <limit lower="-3" upper="3" velocity="2" effort="1"/></joint>
  <joint name="j2" type="revolute"><parent link="l1"/><child link="l2"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" velocity="2" effort="1"/></joint>
  <joint name="j3" type="revolute"><parent link="l2"/><child link="l3"/><origin xyz="0 0 0.4"/><axis xyz="0 1 0"/>
    <limit lower="-2.5" upper="2.5" velocity="2" effort="1"/></joint>
  <joint name="j4" type="continuous"><parent link="l3"/><child link="l4"/><origin xyz="0 0 0.4"/><axis xyz="0 0 1"/>
    <limit velocity="3" effort="1"/></joint>
  <joint name="j5" type="revolute"><parent link="l4"/><child link="l5"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" velocity="3" effort="1"/></joint>
  <joint name="j6" type="continuous"><parent link="l5"/><child link="tip"/><origin xyz="0 0 0.1"/><axis xyz="0 0 1"/>
    <limit velocity="3" effort="1"/></joint>
</robot>
"""
POSES = """# three poses
x,y,z,qw,qx,qy,qz,row
0.45,-0.02,0.30,0,1,0,0,0
0.45,0.00,0.30,0,1,0,0,0
0.45,0.02,0.30,0,1,0,0,0
0.47,0.02,0.30,0,1,0,0,1
0.47,0.00,0.30,0,1,0,0,1
"""
WAYPOINTS = "t [s],a1,a2\n" + "".join(f"{0.1 * k:.1f},{math.sin(k):.6f},{math.cos(k):.6f}\n" for k in range(8))
LIMITS: dict[str, Any] = {"velocity": [1.0, 1.5], "acceleration": [3, 4], "jerk": [30.0, 40.0]}


@dataclass(frozen=True)
class Kind:
    """One kind of input.

    Attributes
    ----------
    name : str
    file : str
        The file that is changed, in the folder of the seeds; empty for options of commands.
    arguments : tuple of str
        Of the command that reads it, in that folder; ``{out}`` is a folder of its own.
    binary : bool
        Whether changes go by bytes alone.
    reads_cell : bool
        Whether the file makes the cell that the command works on: a larger one is more work, and no fault.
    """

    name: str
    file: str
    arguments: tuple[str, ...]
    binary: bool = False
    reads_cell: bool = False


def _verify(name: str, file: str, target: str = "", *, binary: bool = False) -> Kind:
    return Kind(name, file, ("verify", target or file, "--cell", "cell.toml"), binary)


def _time(name: str, waypoints: str, limits: str, changed: str) -> Kind:
    return Kind(name, changed, ("time", waypoints, "--limits", limits, "--out", "{out}/timed.csv"))


_CHECK = ("check", "changed.toml", "--out", "{out}")
_DESIGN = ("design", "design.toml", "--out", "{out}", "--method", "sobol", "--budget", "2", "--level", "reach",
           "--plans", "0", "--workers", "1")  # fmt: skip
_EXPORT = ("export", "trajectory", "plan", "--to", "{to}", "--out", "{out}/{file}")
KINDS: tuple[Kind, ...] = (
    Kind("cell", "changed.toml", _CHECK, reads_cell=True),
    Kind("cell, plan", "changed.toml", ("plan", "changed.toml", "--out", "{out}"), reads_cell=True),
    Kind("cell, workspace", "changed.toml", ("workspace", "changed.toml", "--out", "{out}", "--spacing", "500 mm",
         "--depth", "20 mm"), reads_cell=True),
    Kind("cell, design", "design.toml", _DESIGN, reads_cell=True),
    Kind("journal", "journal.jsonl", (*_DESIGN, "--resume")),
    Kind("urdf", "arm.urdf", ("check", "elsewhere.toml", "--out", "{out}"), reads_cell=True),
    Kind("cell of a urdf", "elsewhere.toml", ("check", "elsewhere.toml", "--out", "{out}"), reads_cell=True),
    Kind("pose list", "poses.csv", ("check", "elsewhere.toml", "--out", "{out}"), reads_cell=True),
    _time("waypoints", "waypoints.csv", "limits.json", "waypoints.csv"),
    _time("limits, json", "waypoints.csv", "limits.json", "limits.json"),
    _time("limits, toml", "waypoints.csv", "limits.toml", "limits.toml"),
    _time("limits, yaml", "waypoints.csv", "limits.yaml", "limits.yaml"),
    _verify("csv", "motion.csv"),
    _verify("stream", "stream.csv"),
    _verify("npz", "motion.npz", binary=True),
    _verify("parquet", "motion.parquet", binary=True),
    _verify("json", "motion.json"),
    _verify("yaml", "motion.yaml"),
    _verify("mcap", "motion.mcap", binary=True),
    _verify("rosbag2, data", "bag/bag.db3", "bag", binary=True),
    _verify("rosbag2, metadata", "bag/metadata.yaml", "bag"),
    _verify("krl, src", "motion.src"),
    _verify("krl, dat", "motion.dat", "motion.src"),
    _verify("rapid", "motion.mod"),
    Kind("plan, trajectory", "plan/trajectory.json", _EXPORT),
    Kind("plan, joint path", "plan/joint_path.csv", _EXPORT),
    Kind("plan, report", "plan/report.json", _EXPORT),
    Kind("options", "", ()),
)  # fmt: skip


def tiny_cell() -> dict[str, Any]:
    """Return the cell of three points just under the tool at home."""
    data = qparm.Cell.load(EXAMPLE).to_dict()
    data["name"] = "tiny"
    data["arm"]["home"][5] = "-90 deg"
    data["workpiece"] |= {"elevation": ["60 deg", "61 deg"], "azimuth": ["-1 deg", "1 deg"]}
    data["workpiece"]["pose"]["position"] = ["0 mm", "1415 mm", "500 mm"]
    data["process"] |= {"rows": 1, "points": 3, "feed": "50 mm/s"}
    return data


def make_seeds(folder: Path, tell: Callable[[str], object] = print) -> None:
    """Write one valid file of every kind into a folder."""
    import tomli_w
    import yaml

    data = tiny_cell()
    for name in ("cell.toml", "changed.toml"):
        (folder / name).write_text(tomli_w.dumps(data), encoding="utf-8")
    design = data | {"design": {"variables": {"arm.lengths.upper": {"range": ["600 mm", "800 mm"]}}}}
    (folder / "design.toml").write_text(tomli_w.dumps(design), encoding="utf-8")
    (folder / "arm.urdf").write_text(URDF, encoding="utf-8")
    (folder / "poses.csv").write_text(POSES, encoding="utf-8")
    elsewhere = {
        "schema": 1,
        "arm": {
            "urdf": "arm.urdf", "base_link": "base", "tip_link": "tip",
            "home": ["0 deg", "30 deg", "60 deg", "0 deg", "60 deg", "0 deg"],
            "limits": {"revolute": {"acceleration": "300 deg/s^2", "jerk": "3000 deg/s^3"}},
        },
        "workpiece": {"shape": "pose list", "poses": "poses.csv"},
        "process": {"feed": "50 mm/s"},
    }  # fmt: skip
    (folder / "elsewhere.toml").write_text(tomli_w.dumps(elsewhere), encoding="utf-8")
    (folder / "waypoints.csv").write_text(WAYPOINTS, encoding="utf-8")
    (folder / "limits.json").write_text(json.dumps(LIMITS), encoding="utf-8")
    (folder / "limits.toml").write_text(tomli_w.dumps(LIMITS), encoding="utf-8")
    by_joint = {
        name: {f"max_{order}": float(LIMITS[order][k]) for order in LIMITS} for k, name in enumerate(("a1", "a2"))
    }
    (folder / "limits.yaml").write_text(yaml.safe_dump({"joint_limits": by_joint}), encoding="utf-8")
    tell("planning the tiny cell")
    cell = qparm.Cell.load(folder / "cell.toml")
    plan = qparm.plan(cell)
    write(plan, folder / "plan", pictures=False)
    for to, form in FORMATS.items():
        name = {"rosbag2": "bag", "stream": "stream.csv"}.get(to, f"motion{form.extension}")
        period = 0.02 if form.period is not None else None
        export_trajectory(plan.trajectory, folder / name, to=to, units=plan.chain.units, period=period)
    _write_journal(folder)


def _write_journal(folder: Path) -> None:
    from qparm.design.evaluate import evaluate
    from qparm.design.journal import Journal, problem_hash
    from qparm.design.space import DesignSpace

    space = DesignSpace.of(folder / "design.toml")
    journal = Journal(problem_hash(space, 0), folder / "journal.jsonl")
    for length in np.linspace(0.6, 0.8, 3):
        journal.add(evaluate(space, [float(length)], level=2))
