"""The arm: a serial chain of prismatic and revolute joints, its kinematics and its limits."""

from qparm.robot.chain import Joint, SerialChain, check_pose, check_poses
from qparm.robot.dh import DHRow, chain_from_dh
from qparm.robot.limits import rest_to_rest_time

__all__ = [
    "DHRow",
    "Joint",
    "SerialChain",
    "chain_from_dh",
    "check_pose",
    "check_poses",
    "rest_to_rest_time",
]
