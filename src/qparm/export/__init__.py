"""Files: one file per format, and the folder that holds a plan's."""

from qparm.export.folder import FILES, write
from qparm.export.formats import FORMATS, Exported, Format, export_trajectory
from qparm.export.joint_path_csv import write_joint_path_csv
from qparm.export.joint_trajectory_json import joint_trajectory_message, write_joint_trajectory_json
from qparm.export.sampled import SampledTrajectory, at_knots, at_period, at_steps, at_ticks
from qparm.export.saved_trajectory import SavedTrajectory, load_trajectory
from qparm.export.trajectory_csv import write_samples_csv
from qparm.files.output import require_writable

__all__ = [
    "FILES",
    "FORMATS",
    "Exported",
    "Format",
    "SampledTrajectory",
    "SavedTrajectory",
    "at_knots",
    "at_period",
    "at_steps",
    "at_ticks",
    "export_trajectory",
    "joint_trajectory_message",
    "load_trajectory",
    "require_writable",
    "write",
    "write_joint_path_csv",
    "write_joint_trajectory_json",
    "write_samples_csv",
]


def __dir__() -> list[str]:
    return sorted(__all__)
