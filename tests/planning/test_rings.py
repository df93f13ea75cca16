"""Rings of poses round a bowl, the tool free to spin: what an arm of six axes has to break, and no more.

The tool lies along the last axis, so spinning it turns that joint alone: the others have to follow the tool's axis as
it is. How far theta4 turns on the way along a ring says whether the ring fits within its limits.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import qparm
from conftest import ROOT, cell_data
from made_arm import pose_list
from qparm.ik import PoseSolver, PoseStatus

CENTRE, RADIUS = np.array([0.0, 1.1, 0.75]), 0.25
# polar angle from straight down, and poses in a ring
OUTER = ((50.0, 22), (65.0, 26))


def ring_poses(polar: float, count: int) -> np.ndarray:
    """Return the poses of a ring: z outward, into the bowl; x along the ring."""
    angle = np.linspace(0.0, 2 * np.pi, count, endpoint=False)
    sine, cosine = np.sin(np.radians(polar)), np.cos(np.radians(polar))
    z = np.column_stack([sine * np.cos(angle), sine * np.sin(angle), np.full(count, -cosine)])
    x = np.column_stack([-np.sin(angle), np.cos(angle), np.zeros(count)])
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3] = np.stack([x, np.cross(z, x), z], axis=2)
    poses[:, :3, 3] = CENTRE + RADIUS * z
    return poses


def bowl(wrist: str) -> dict[str, Any]:
    data = cell_data(ROOT / "examples" / "six_axis.toml")
    data["arm"]["joints"][3]["position"] = [f"-{wrist}", wrist]
    rings = [ring_poses(polar, count) for polar, count in OUTER]
    data["workpiece"] = {"shape": "pose list", "poses": pose_list(*rings)}
    data["process"] = {"feed": "20 mm/s", "tool_spin": "free"}
    return data


def turn_of_the_wrist() -> float:
    """Return how far theta4 turns along the outermost ring, followed without limits in steps of a fifth of a degree."""
    chain = qparm.Cell.load(bowl("1000 deg")).chain()
    solver = PoseSolver(chain, position_tolerance=1e-7, rotation_tolerance=1e-7)
    polar, count = OUTER[1]
    fine = ring_poses(polar, 60 * count)[: 60 * (count - 1) + 1]
    q = qparm.plan(bowl("1000 deg")).solution.q[OUTER[0][1]]
    spin = fine[0, :3, :3].T @ chain.forward(q)[..., :3, :3]
    turns = []
    for pose in fine:
        target = pose.copy()
        target[:3, :3] = pose[:3, :3] @ spin
        solved = solver.solve(target, q)
        assert solved.status is PoseStatus.REACHED
        assert np.abs(solved.q - q).max() < 0.1
        q = solved.q
        turns.append(q[3])
    return float(np.ptp(turns))


@pytest.mark.slow
def test_a_wrist_that_turns_too_far_is_turned_back_once() -> None:
    assert np.radians(350) < turn_of_the_wrist() < np.radians(353)
    # within 350 deg the outer ring must be broken once; and where the inner one ends, theta4 has to begin anew
    plan = qparm.plan(bowl("175 deg"))
    assert plan.record.unreached.size == 0
    assert plan.solution.reconfigurations(plan.tool_path) == (1, 1)
    (inside,) = [one for one in plan.breaks if one.place == "row"]
    assert "by the limits of theta4" in inside.why
    assert plan.verdict.executable
    # within 540 deg both rings can be driven as one
    wide = qparm.plan(bowl("270 deg"))
    assert wide.solution.reconfigurations(wide.tool_path) == (0, 0)
    assert wide.verdict.executable
