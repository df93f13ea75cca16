"""A motion as the one JointTrajectory in a rosbag2."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from qparm.errors import InvalidInput
from qparm.extras import load_extra
from qparm.files.reading import SETTINGS_BYTES, guarded, parse_yaml, read_text, require_regular, shown
from qparm.verify.readers.joint_trajectory import MESSAGE_TYPE, only_message, read_message

if TYPE_CHECKING:
    from qparm.cell import Cell
    from qparm.verify.motion import MotionTable

__all__ = ["METADATA", "read_rosbag2"]

# What describes the bag in its folder.
METADATA = "metadata.yaml"


def read_rosbag2(file: Path, cell: Cell) -> MotionTable:
    """Return the motion in the folder of a bag, sqlite3 or MCAP inside, on whatever topic."""
    rosbag2 = load_extra("rosbags.rosbag2", instead="a file of the format mcap")
    typesys = load_extra("rosbags.typesys", instead="a file of the format mcap")
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    _require_own_files(file)
    # what the library raises on a broken file is of many kinds
    with guarded(file, what="a whole rosbag2", foreign=True), rosbag2.Reader(file) as reader:
        wanted = [connection for connection in reader.connections if connection.msgtype == MESSAGE_TYPE]
        read = reader.messages(connections=wanted) if wanted else ()
        messages = [(one.topic, store.deserialize_cdr(data, MESSAGE_TYPE)) for one, _, data in read]
    return read_message(file, cell, only_message(file, messages), format="rosbag2")


def _require_own_files(folder: Path) -> None:
    """Refuse a bag whose description names files that are not regular files of its folder."""
    description = folder / METADATA
    found = parse_yaml(read_text(description, largest=SETTINGS_BYTES), description)
    information = found.get("rosbag2_bagfile_information") if isinstance(found, dict) else None
    names = information.get("relative_file_paths") if isinstance(information, dict) else None
    if not isinstance(names, list) or not names or not all(isinstance(name, str) and name for name in names):
        raise InvalidInput(f"{folder.name} is not a whole rosbag2: {METADATA} names no files")
    for name in names:
        if "\0" in name or Path(name).name != name or (folder / name).is_symlink():
            raise InvalidInput(f"{folder.name}: {METADATA} names {shown(name)!r}, which is no file of the folder")
        require_regular(folder / name)
