"""A made-up arm of seven joints as URDF, a pose list, and a cell of both."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

__all__ = ["LIMITS", "URDF", "elsewhere_data", "pose_list", "row_of_poses"]

# Axes along every direction, fixed joints at both ends and inside, a lamp that does not matter.
URDF = """<?xml version="1.0"?>
<robot name="seven">
  <link name="floor"/><link name="base"/><link name="l1"/><link name="l2"/><link name="l3"/><link name="plate"/>
  <link name="l4"/><link name="l5"/><link name="l6"/><link name="l7"/><link name="tip"/><link name="lamp"/>
  <joint name="stand" type="fixed">
    <parent link="floor"/><child link="base"/><origin xyz="0 0 0.1" rpy="0 0 0.1"/>
  </joint>
  <joint name="a1" type="continuous">
    <parent link="base"/><child link="l1"/><origin xyz="0 0 0.2"/><axis xyz="0 0 -1"/><limit velocity="2" effort="1"/>
  </joint>
  <joint name="a2" type="revolute">
    <parent link="l1"/><child link="l2"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" velocity="2" effort="1"/>
  </joint>
  <joint name="a3" type="continuous">
    <parent link="l2"/><child link="l3"/><origin xyz="0 0 0.35"/><axis xyz="0 0 1"/><limit velocity="2" effort="1"/>
  </joint>
  <joint name="spacer" type="fixed">
    <parent link="l3"/><child link="plate"/><origin xyz="0 0 0" rpy="0.2 0 1.57079632679489661923"/>
  </joint>
  <joint name="a4" type="revolute">
    <parent link="plate"/><child link="l4"/><axis xyz="3 0 0"/>
    <limit lower="-2.2" upper="2.2" velocity="2" effort="1"/>
  </joint>
  <joint name="a5" type="continuous">
    <parent link="l4"/><child link="l5"/><origin xyz="0 0 0.35"/><axis xyz="0 0 1"/><limit velocity="3" effort="1"/>
  </joint>
  <joint name="a6" type="revolute">
    <parent link="l5"/><child link="l6"/><limit lower="-2" upper="2" velocity="3" effort="1"/>
  </joint>
  <joint name="a7" type="continuous">
    <parent link="l6"/><child link="l7"/><origin xyz="0 0 0.1"/><axis xyz="0 0 1"/><limit velocity="3" effort="1"/>
  </joint>
  <joint name="flange" type="fixed"><parent link="l7"/><child link="tip"/><origin xyz="0 0 0.05"/></joint>
  <joint name="lamp_joint" type="floating"><parent link="l7"/><child link="lamp"/></joint>
  <transmission name="drive"><joint name="a1"/></transmission>
</robot>
"""

LIMITS = {"revolute": {"acceleration": "300 deg/s^2", "jerk": "3000 deg/s^3"}}


def row_of_poses(count: int, *, turn: float = 0.0, length: float = 0.4, z: float = 0.2) -> np.ndarray:
    """Return (count, 4, 4) poses along y before the arm, the tool down, turned about its own axis on the way (rad)."""
    share = np.linspace(0.0, 1.0, count)
    poses = np.tile(np.eye(4), (count, 1, 1))
    down = Rotation.from_rotvec([np.pi, 0, 0])
    poses[:, :3, :3] = (down * Rotation.from_rotvec(turn * share[:, None] * [0.0, 0.0, 1.0])).as_matrix()
    poses[:, :3, 3] = np.column_stack([np.full(count, 0.5), length * (share - 0.5), np.full(count, z)])
    return poses


def pose_list(*rows: np.ndarray) -> str:
    """Return poses as CSV text, with the column ``row`` if there are several rows."""
    several = len(rows) > 1
    lines = ["t,x,y,z,qw,qx,qy,qz" + (",row" if several else "")]
    for number, poses in enumerate(rows):
        for k, T in enumerate(poses):
            qx, qy, qz, qw = Rotation.from_matrix(T[:3, :3]).as_quat().tolist()
            numbers = [k, *T[:3, 3].tolist(), qw, qx, qy, qz, *([number] if several else [])]
            lines.append(",".join(map(repr, numbers)))
    return "\n".join(lines) + "\n"


def elsewhere_data() -> dict[str, Any]:
    """Return a cell of the made-up arm and two rows of poses, everything in the cell itself."""
    return {
        "schema": 1,
        "name": "elsewhere",
        "arm": {
            "urdf": URDF,
            "base_link": "floor",
            "tip_link": "tip",
            "limits": {**LIMITS},
            "home": ["0 deg", "20 deg", "0 deg", "-90 deg", "0 deg", "70 deg", "0 deg"],
        },
        "workpiece": {
            "shape": "pose list",
            "poses": pose_list(row_of_poses(21), row_of_poses(21, z=0.25)[::-1]),
        },
        "process": {"feed": "50 mm/s"},
    }
