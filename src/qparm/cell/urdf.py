"""The arm of a cell that comes from a URDF, with the limits that a URDF does not know."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field, ValidationInfo, field_validator

from qparm.cell.part import Part, Pose, file_of_cell
from qparm.cell.quantities import (
    AnglePair,
    AngularAcceleration,
    AngularJerk,
    AngularVelocity,
    JointName,
    Length,
    LengthPair,
    LinearAcceleration,
    LinearJerk,
    LinearVelocity,
    Name,
    ascending,
    joint_name,
    positive,
    problem,
    repeated_names,
    usable_limit,
    wrong_at_home,
)
from qparm.cell.stiffness import Stiffness
from qparm.errors import InvalidInput

if TYPE_CHECKING:
    from qparm.robot import JointLimits, SerialChain

__all__ = ["ArmJoint", "UrdfArm", "UrdfLimits"]


@dataclass(frozen=True)
class ArmJoint:
    """A joint of a URDF as a cell tells it: what a joint of a table has, but for the table.

    Attributes
    ----------
    name : str
    type : {"prismatic", "revolute"}
    position : tuple of float
        m or rad; of a continuous joint the range in which it works.
    velocity, acceleration, jerk : float
    continuous : bool
    """

    name: str
    type: Literal["prismatic", "revolute"]
    position: tuple[float, float]
    velocity: float
    acceleration: float
    jerk: float
    continuous: bool


class _Limits(Part):
    @field_validator("velocity", "acceleration", "jerk", check_fields=False)
    @classmethod
    def _usable(cls, value: float | None) -> float | None:
        return value if value is None else usable_limit(value)

    @field_validator("position", check_fields=False)
    @classmethod
    def _ascending(cls, value: tuple[float, float] | None) -> tuple[float, float] | None:
        return value if value is None else ascending(value)

    def limits(self) -> JointLimits:
        """Return what is given here, None for what is not."""
        from qparm.robot import JointLimits

        given = {name: getattr(self, name) for name in type(self).model_fields if name not in ("name", "type")}
        return JointLimits(**given)


class _Revolute(_Limits):
    velocity: AngularVelocity | None = None
    acceleration: AngularAcceleration | None = None
    jerk: AngularJerk | None = None


class _Prismatic(_Limits):
    velocity: LinearVelocity | None = None
    acceleration: LinearAcceleration | None = None
    jerk: LinearJerk | None = None


class _OneRevolute(_Revolute):
    name: JointName
    type: Literal["revolute"]
    position: AnglePair | None = None


class _OnePrismatic(_Prismatic):
    name: JointName
    type: Literal["prismatic"]
    position: LengthPair | None = None


_One = Annotated[_OnePrismatic | _OneRevolute, Field(discriminator="type")]


class UrdfLimits(Part):
    """Limits beside the URDF: for all joints of a kind, and for single ones, which come first."""

    revolute: _Revolute = _Revolute()
    prismatic: _Prismatic = _Prismatic()
    joints: tuple[_One, ...] = ()

    @field_validator("joints")
    @classmethod
    def _names_differ(cls, joints: tuple[_One, ...]) -> tuple[_One, ...]:
        wrong = repeated_names([joint.name for joint in joints])
        if wrong:
            raise problem(wrong)
        return joints


class UrdfArm(Part):
    """The arm as the joints between two links of a URDF.

    ``urdf`` is the whole path of a file, or the text itself. ``base`` tells where the base link stands, ``tool``
    where the tool is in the tip link's frame.
    """

    name: Name = "arm"
    characteristic_length: Length = 0.4
    base: Pose = Pose()
    tool: Pose = Pose()
    stiffness: Stiffness | None = None
    limits: UrdfLimits = UrdfLimits()
    base_link: Name
    tip_link: Name
    # after all that it is checked with
    urdf: str
    home: tuple[str, ...]

    _positive = field_validator("characteristic_length")(positive)

    @field_validator("urdf")
    @classmethod
    def _makes_a_chain(cls, value: str, info: ValidationInfo) -> str:
        if not value.lstrip().startswith("<"):
            value = file_of_cell(value, info)
        try:
            _chain({**info.data, "urdf": value})
        except InvalidInput as error:
            raise problem(str(error)) from None
        return value

    @field_validator("home", mode="before")
    @classmethod
    def _home_fits(cls, home: object, info: ValidationInfo) -> object:
        if not isinstance(home, (list, tuple)):
            return home
        chain = _chain(info.data) if "urdf" in info.data else None
        wrong = "" if chain is None else wrong_at_home(home, [(j.name, j.kind, j.position) for j in chain.joints])
        if wrong:
            raise problem(wrong)
        return home

    @cached_property
    def text(self) -> str:
        """The URDF as it was read."""
        from qparm.robot import urdf_text

        return urdf_text(self.urdf)

    @cached_property
    def made_chain(self) -> SerialChain:
        """The arm, made once of the text."""
        chain = _chain({**{name: getattr(self, name) for name in type(self).model_fields}, "urdf": self.text})
        assert chain is not None
        return chain

    @property
    def joints(self) -> tuple[ArmJoint, ...]:
        """The joints between the two links, base to tip."""
        return tuple(
            ArmJoint(j.name, j.kind, j.position, j.velocity, j.acceleration, j.jerk, j.continuous)
            for j in self.made_chain.joints
        )

    def described(self) -> str:
        """Return what describes the arm, in words."""
        return f"URDF, {self.base_link} to {self.tip_link}"

    def chain(self) -> SerialChain:
        """Return the arm."""
        return self.made_chain


def _chain(data: Mapping[str, Any]) -> SerialChain | None:
    """Return the chain of the fields of an arm, None if a field is not there because it is not valid.

    Raises
    ------
    InvalidInput
        With what is wrong with the URDF, or with what is given beside it.
    """
    from qparm.robot import chain_from_urdf

    if not all(name in data for name in UrdfArm.model_fields if name != "home"):
        return None
    limits: UrdfLimits = data["limits"]
    chain = chain_from_urdf(
        data["urdf"],
        base=data["base_link"],
        tip=data["tip_link"],
        revolute=limits.revolute.limits(),
        prismatic=limits.prismatic.limits(),
        joints={joint.name: joint.limits() for joint in limits.joints},
        name=data["name"],
        transform_base=data["base"].matrix(),
        transform_tool=data["tool"].matrix(),
        characteristic_length=data["characteristic_length"],
    )
    kinds = {joint.name: joint.type for joint in limits.joints}
    for joint in chain.joints:
        if kinds.get(joint.name, joint.kind) != joint.kind:
            raise InvalidInput(f"joint {joint.name!r} is {joint.kind} in the URDF, not {kinds[joint.name]}")
        try:
            joint_name(joint.name)
            usable_limit(joint.velocity)
        except ValueError as error:
            raise InvalidInput(f"joint {joint.name!r}: {error}") from None
        largest = 1e3 if joint.kind == "revolute" else 1e4
        if not joint.continuous and max(map(abs, joint.position)) > largest:
            raise InvalidInput(f"joint {joint.name!r}: its position limits lie beyond {largest:g} (SI)")
    return chain
