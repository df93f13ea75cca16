"""The arm: a serial chain of prismatic and revolute joints, its kinematics and its limits."""

from qparm.robot.chain import CONTINUOUS_RANGE, Joint, SerialChain, check_pose, check_poses
from qparm.robot.dh import DHRow, chain_from_dh
from qparm.robot.limits import rest_to_rest_time
from qparm.robot.motion_limits import MotionLimits
from qparm.robot.urdf import JointLimits, chain_from_urdf
from qparm.robot.urdf_tree import urdf_text

__all__ = [
    "CONTINUOUS_RANGE",
    "DHRow",
    "Joint",
    "JointLimits",
    "MotionLimits",
    "SerialChain",
    "chain_from_dh",
    "chain_from_urdf",
    "check_pose",
    "check_poses",
    "rest_to_rest_time",
    "urdf_text",
]


def __dir__() -> list[str]:
    return sorted(__all__)
