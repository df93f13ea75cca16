"""The arm of a cell: a Denavit-Hartenberg table, or the joints between two links of a URDF.

Both have ``name``, ``joints`` (name, type, limits), ``home`` and a chain.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Discriminator, Field, Tag, ValidationInfo, field_validator

from qparm.cell.part import Part, Pose
from qparm.cell.quantities import (
    Angle,
    AnglePair,
    AngularAcceleration,
    AngularJerk,
    AngularVelocity,
    JointName,
    Length,
    LengthOrName,
    LengthPair,
    LinearAcceleration,
    LinearJerk,
    LinearVelocity,
    Name,
    ascending,
    positive,
    problem,
    repeated_names,
    usable_limit,
    wrong_at_home,
)
from qparm.cell.stiffness import Stiffness
from qparm.cell.urdf import UrdfArm

if TYPE_CHECKING:
    from qparm.robot import SerialChain

__all__ = ["AnyArm", "Arm", "PrismaticJoint", "RevoluteJoint", "arm_kind"]


class _DHConstants(Part):
    alpha: Angle
    a: LengthOrName
    d: LengthOrName
    theta: Angle


class PrismaticJoint(Part):
    """A joint that slides along z; ``dh.d`` is the offset at zero."""

    name: JointName
    type: Literal["prismatic"]
    dh: _DHConstants
    position: LengthPair
    velocity: LinearVelocity
    acceleration: LinearAcceleration
    jerk: LinearJerk

    _ascending = field_validator("position")(ascending)
    _usable = field_validator("velocity", "acceleration", "jerk")(usable_limit)


class RevoluteJoint(Part):
    """A joint that turns about z; ``dh.theta`` is the offset at zero."""

    name: JointName
    type: Literal["revolute"]
    dh: _DHConstants
    position: AnglePair
    velocity: AngularVelocity
    acceleration: AngularAcceleration
    jerk: AngularJerk

    _ascending = field_validator("position")(ascending)
    _usable = field_validator("velocity", "acceleration", "jerk")(usable_limit)


AnyJoint = Annotated[PrismaticJoint | RevoluteJoint, Field(discriminator="type")]


class Arm(Part):
    """The arm as a Denavit-Hartenberg table with limits.

    ``lengths`` names link lengths that the table refers to, such as ``a = "L1"``.
    """

    name: Name = "arm"
    convention: Literal["modified", "standard"]
    lengths: dict[Name, Length] = Field(default_factory=dict)
    characteristic_length: Length = 0.4
    base: Pose = Pose()
    tool: Pose = Pose()
    stiffness: Stiffness | None = None
    joints: tuple[AnyJoint, ...] = Field(min_length=1)
    home: tuple[str, ...]

    _positive = field_validator("characteristic_length")(positive)

    @field_validator("joints")
    @classmethod
    def _names_differ(cls, joints: tuple[AnyJoint, ...]) -> tuple[AnyJoint, ...]:
        wrong = repeated_names([joint.name for joint in joints])
        if wrong:
            raise problem(wrong)
        return joints

    @field_validator("home", mode="before")
    @classmethod
    def _home_fits(cls, home: object, info: ValidationInfo) -> object:
        if not isinstance(home, (list, tuple)):
            return home
        joints = info.data.get("joints")
        if joints is None:  # of joints that are not valid the kind may still be known, but no limits
            known = (info.context or {}).get("joints")
        else:
            known = [(joint.name, joint.type, joint.position) for joint in joints]
        wrong = "" if known is None else wrong_at_home(home, known)
        if wrong:
            raise problem(wrong)
        return home

    def described(self) -> str:
        """Return what describes the arm, in words."""
        return f"{self.convention} DH"

    def chain(self) -> SerialChain:
        """Return the arm."""
        from qparm.robot import DHRow, chain_from_dh

        def length(value: float | str) -> float:
            return self.lengths[value] if isinstance(value, str) else value

        rows = [
            DHRow(
                name=joint.name,
                kind=joint.type,
                alpha=joint.dh.alpha,
                a=length(joint.dh.a),
                d=length(joint.dh.d),
                theta=joint.dh.theta,
                position=joint.position,
                velocity=joint.velocity,
                acceleration=joint.acceleration,
                jerk=joint.jerk,
            )
            for joint in self.joints
        ]
        return chain_from_dh(
            rows,
            convention=self.convention,
            name=self.name,
            transform_base=self.base.matrix(),
            transform_tool=self.tool.matrix(),
            characteristic_length=self.characteristic_length,
        )


def arm_kind(value: object) -> str:
    """Return which of the two an arm is: what names a URDF is one, all else is a table."""
    return "<urdf>" if isinstance(value, UrdfArm) or (isinstance(value, Mapping) and "urdf" in value) else "<table>"


AnyArm = Annotated[Annotated[Arm, Tag("<table>")] | Annotated[UrdfArm, Tag("<urdf>")], Discriminator(arm_kind)]
