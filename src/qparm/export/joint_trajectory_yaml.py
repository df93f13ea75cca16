"""The trajectory with the fields of ROS ``trajectory_msgs/JointTrajectory``, as YAML: what ``ros2 topic pub`` takes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from qparm.export.joint_trajectory_json import joint_trajectory_message
from qparm.extras import load_extra

if TYPE_CHECKING:
    from qparm.export.sampled import SampledTrajectory

__all__ = ["write_yaml"]


def write_yaml(sampled: SampledTrajectory, file: Path) -> None:
    """Write the message; numbers read back to the same bits, times to the nanosecond."""
    yaml = load_extra("yaml", instead="--to json")
    dumper = getattr(yaml, "CSafeDumper", yaml.SafeDumper)  # compiled, where the wheel has it: five times faster
    message = joint_trajectory_message(sampled.trajectory, times=sampled.t)
    with file.open("w", encoding="utf-8", newline="\n") as out:
        yaml.dump(message, out, Dumper=dumper, sort_keys=False, default_flow_style=None, width=10**9)
