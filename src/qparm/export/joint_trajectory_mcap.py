"""The trajectory as one ``trajectory_msgs/JointTrajectory`` in an MCAP file, without ROS."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from qparm.export.joint_trajectory_json import joint_trajectory_message
from qparm.extras import load_extra

if TYPE_CHECKING:
    from qparm.export.sampled import SampledTrajectory

__all__ = ["MESSAGE_TYPE", "topic", "write_mcap"]

MESSAGE_TYPE = "trajectory_msgs/msg/JointTrajectory"
_RULE = "=" * 80
# The message and all that it is made of, as ROS 2 defines them.
_DEFINITION = f"""\
std_msgs/Header header
string[] joint_names
trajectory_msgs/JointTrajectoryPoint[] points
{_RULE}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{_RULE}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
{_RULE}
MSG: trajectory_msgs/JointTrajectoryPoint
float64[] positions
float64[] velocities
float64[] accelerations
float64[] effort
builtin_interfaces/Duration time_from_start
{_RULE}
MSG: builtin_interfaces/Duration
int32 sec
uint32 nanosec
"""


def topic(executable: bool) -> str:
    """Return the topic: no controller listens to that of a trajectory that must not be executed."""
    return "/joint_trajectory" if executable else "/joint_trajectory_not_executable"


def write_mcap(sampled: SampledTrajectory, file: Path) -> None:
    """Write the message at time zero; numbers to the last bit, times to the nanosecond."""
    writer_module = load_extra("mcap_ros2.writer", instead="--to json")
    message = joint_trajectory_message(sampled.trajectory, times=sampled.t)
    executable = message.pop("executable", True)
    with file.open("wb") as out:
        writer = writer_module.Writer(out)
        schema = writer.register_msgdef(MESSAGE_TYPE, _DEFINITION)
        writer.write_message(topic(executable), schema, message, log_time=0, publish_time=0)
        writer.finish()
