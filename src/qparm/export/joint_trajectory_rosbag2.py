"""The trajectory as one ``trajectory_msgs/JointTrajectory`` in a rosbag2, a folder of two files, without ROS."""

from __future__ import annotations

import errno
import os
import sqlite3
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from qparm.export.joint_trajectory_json import joint_trajectory_message
from qparm.export.joint_trajectory_mcap import MESSAGE_TYPE, topic
from qparm.extras import load_extra

if TYPE_CHECKING:
    from qparm.export.sampled import SampledTrajectory

__all__ = ["bag_files", "write_rosbag2"]

# Of the metadata: the oldest that the library writes, which the most versions of ROS 2 play.
_VERSION = 8


def bag_files(bag: Path) -> tuple[Path, Path]:
    """Return the files of a bag."""
    return bag / "metadata.yaml", bag / f"{bag.name}.db3"


def write_rosbag2(sampled: SampledTrajectory, bag: Path) -> None:
    """Write the message at time zero into a folder that must not exist; sqlite3 storage, numbers to the last bit."""
    rosbag2 = load_extra("rosbags.rosbag2", instead="--to mcap")
    typesys = load_extra("rosbags.typesys", instead="--to mcap")
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    types = store.types
    data = joint_trajectory_message(sampled.trajectory, times=sampled.t)
    executable = data.pop("executable", True)
    duration, point = types["builtin_interfaces/msg/Duration"], types["trajectory_msgs/msg/JointTrajectoryPoint"]
    points = [
        point(
            *(np.array(p[order], dtype=np.float64) for order in ("positions", "velocities", "accelerations", "effort")),
            duration(**p["time_from_start"]),
        )
        for p in data["points"]
    ]
    stamp = types["builtin_interfaces/msg/Time"](0, 0)
    header = types["std_msgs/msg/Header"](stamp, "")
    message = types[MESSAGE_TYPE](header, data["joint_names"], points)
    try:
        with rosbag2.Writer(bag, version=_VERSION) as writer:
            connection = writer.add_connection(topic(executable), MESSAGE_TYPE, typestore=store)
            writer.write(connection, 0, store.serialize_cdr(message, MESSAGE_TYPE))
    except sqlite3.Error as error:
        full = "full" in str(error)
        raise OSError(errno.ENOSPC if full else errno.EIO, os.strerror(errno.ENOSPC) if full else str(error)) from error
