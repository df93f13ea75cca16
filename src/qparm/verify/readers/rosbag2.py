"""A motion as the one JointTrajectory in a rosbag2."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from qparm.errors import InvalidInput
from qparm.extras import load_extra
from qparm.verify.readers.joint_trajectory import MESSAGE_TYPE, only_message, read_message

if TYPE_CHECKING:
    from qparm.cell import Cell
    from qparm.verify.motion import MotionTable

__all__ = ["read_rosbag2"]


def read_rosbag2(file: Path, cell: Cell) -> MotionTable:
    """Return the motion in the folder of a bag, sqlite3 or MCAP inside, on whatever topic."""
    rosbag2 = load_extra("rosbags.rosbag2", instead="a file of the format mcap")
    typesys = load_extra("rosbags.typesys", instead="a file of the format mcap")
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    try:
        with rosbag2.Reader(file) as reader:
            wanted = [connection for connection in reader.connections if connection.msgtype == MESSAGE_TYPE]
            read = reader.messages(connections=wanted) if wanted else ()
            messages = [(one.topic, store.deserialize_cdr(data, MESSAGE_TYPE)) for one, _, data in read]
    except Exception as error:  # what the library raises on a broken file is of many kinds
        raise InvalidInput(f"{file.name} is not a whole rosbag2: {type(error).__name__} {error}") from None
    return read_message(file, cell, only_message(file, messages), format="rosbag2")
