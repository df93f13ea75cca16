"""Files: one file a format, and the folder that holds a plan's."""

from qparm.export.folder import FILES, require_writable, write
from qparm.export.joint_path_csv import write_joint_path_csv
from qparm.export.joint_trajectory_json import joint_trajectory_message, write_joint_trajectory_json
from qparm.export.trajectory_csv import write_samples_csv, write_trajectory_csv

__all__ = [
    "FILES",
    "joint_trajectory_message",
    "require_writable",
    "write",
    "write_joint_path_csv",
    "write_joint_trajectory_json",
    "write_samples_csv",
    "write_trajectory_csv",
]
