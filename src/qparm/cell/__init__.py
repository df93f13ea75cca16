"""The cell file: arm, workpiece, process and home in one TOML file, validated all at once."""

from qparm.cell.model import (
    Arm,
    Cell,
    Design,
    DesignVariable,
    Pose,
    PoseList,
    PrismaticJoint,
    Process,
    RevoluteJoint,
    SelfMotion,
    SphereZone,
    UrdfArm,
)

__all__ = [
    "Arm",
    "Cell",
    "Design",
    "DesignVariable",
    "Pose",
    "PoseList",
    "PrismaticJoint",
    "Process",
    "RevoluteJoint",
    "SelfMotion",
    "SphereZone",
    "UrdfArm",
]


def __dir__() -> list[str]:
    return sorted(__all__)
