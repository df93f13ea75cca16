"""The cell: arm, workpiece, process and home in one TOML file, validated all at once.

Every quantity with a dimension is written with its unit, as a string. What is wrong is reported
together, each problem with the path of its key.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import pydantic
from pydantic import BaseModel, ConfigDict, Field, ValidationInfo, field_validator

from qparm.cell_problems import told, toml_data
from qparm.cell_quantities import (
    DIMENSION_OF_KIND,
    Angle,
    AnglePair,
    AngleTriple,
    AngularAcceleration,
    AngularJerk,
    AngularVelocity,
    JointName,
    Length,
    LengthOrName,
    LengthPair,
    LengthTriple,
    LinearAcceleration,
    LinearJerk,
    LinearVelocity,
    Name,
    ascending,
    between,
    not_negative,
    positive,
    problem,
    quantity,
    usable_limit,
    wrong_at_home,
)
from qparm.errors import CellError, InvalidInput

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from qparm.path import ToolPath
    from qparm.robot import SerialChain
    from qparm.surface import SphericalZone

__all__ = ["Arm", "Cell", "Pose", "PrismaticJoint", "Process", "RevoluteJoint", "SelfMotion", "SphereZone"]


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Pose(_Part):
    """A position and a rotation by roll, pitch, yaw: about x, then y, then z of the fixed frame."""

    position: LengthTriple = (0.0, 0.0, 0.0)
    rpy: AngleTriple = (0.0, 0.0, 0.0)

    def matrix(self) -> NDArray[np.float64]:
        """Return the (4, 4) pose."""
        import numpy as np
        from scipy.spatial.transform import Rotation

        T = np.eye(4)
        T[:3, :3] = Rotation.from_euler("xyz", self.rpy).as_matrix() if any(self.rpy) else np.eye(3)
        T[:3, 3] = self.position
        return T


class _DHConstants(_Part):
    alpha: Angle
    a: LengthOrName
    d: LengthOrName
    theta: Angle


class PrismaticJoint(_Part):
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


class RevoluteJoint(_Part):
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


class Arm(_Part):
    """The arm as a Denavit-Hartenberg table with limits.

    ``lengths`` names link lengths that the table refers to, such as ``a = "L1"``.
    """

    name: Name = "arm"
    convention: Literal["modified", "standard"]
    lengths: dict[str, Length] = {}
    characteristic_length: Length = 0.4
    base: Pose = Pose()
    tool: Pose = Pose()
    joints: tuple[AnyJoint, ...] = Field(min_length=1)
    home: tuple[str, ...]

    _positive = field_validator("characteristic_length")(positive)

    @field_validator("joints")
    @classmethod
    def _names_differ(cls, joints: tuple[AnyJoint, ...]) -> tuple[AnyJoint, ...]:
        names = [joint.name for joint in joints]
        repeated = sorted({name for name in names if names.count(name) > 1})
        if repeated:
            raise problem(f"joint names must differ; repeated: {', '.join(repeated)}")
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


class SphereZone(_Part):
    """The workpiece: a zone of a sphere and where its frame stands."""

    shape: Literal["sphere zone"]
    radius: Length
    elevation: AnglePair
    azimuth: AnglePair
    pose: Pose

    _positive = field_validator("radius")(positive)
    _ascending = field_validator("elevation", "azimuth")(ascending)

    @field_validator("elevation")
    @classmethod
    def _within_poles(cls, value: tuple[float, float]) -> tuple[float, float]:
        if not (-math.pi / 2 < value[0] and value[1] < math.pi / 2):
            raise problem("must lie within -90 deg and 90 deg, poles excluded: a row there has no length")
        return value

    @field_validator("azimuth")
    @classmethod
    def _one_turn(cls, value: tuple[float, float]) -> tuple[float, float]:
        if value[1] - value[0] > 2 * math.pi * (1 + 1e-12):
            raise problem("must span no more than 360 deg")
        return value

    def surface(self) -> SphericalZone:
        """Return the surface in the workpiece frame."""
        from qparm.surface import SphericalZone

        return SphericalZone(radius=self.radius, elevation=self.elevation, azimuth=self.azimuth)


class SelfMotion(_Part):
    """The self-motion areas at the row ends."""

    points: int = Field(default=0, ge=0, strict=True)
    transition: Literal["follow", "lift"] = "follow"
    lift: Length = 0.0

    _not_negative = field_validator("lift")(not_negative)


# A raster beyond this would not fit into memory.
_MOST_POINTS = 5_000_000


class Process(_Part):
    """The raster and what counts as done."""

    rows: int = Field(ge=1, le=_MOST_POINTS, strict=True)
    points: int = Field(ge=2, le=_MOST_POINTS, strict=True)
    feed: LinearVelocity
    stand_off: Length = 0.0
    position_tolerance: Length = 1e-6
    rotation_tolerance: Angle = 1e-5
    jump: Angle = math.radians(50)
    jump_prismatic: Length | None = None
    self_motion: SelfMotion = SelfMotion()

    _positive = field_validator("jump")(positive)
    _not_negative = field_validator("stand_off")(not_negative)
    _feed = field_validator("feed")(between(1e-6, 100.0, "0.001 mm/s and 100 m/s"))
    _position = field_validator("position_tolerance")(between(1e-9, 0.01, "0.001 um and 10 mm"))
    _rotation = field_validator("rotation_tolerance")(between(1e-9, math.radians(10), "0.001 urad and 10 deg"))

    @field_validator("points")
    @classmethod
    def _not_too_many(cls, value: int, info: ValidationInfo) -> int:
        rows = info.data.get("rows")
        if rows is not None and rows * value > _MOST_POINTS:
            raise problem(f"{rows} rows of {value} points are more than {_MOST_POINTS:,} in all")
        return value

    @field_validator("jump_prismatic")
    @classmethod
    def _jump_positive(cls, value: float | None) -> float | None:
        return value if value is None else positive(value)

    @field_validator("self_motion")
    @classmethod
    def _fits_row(cls, value: SelfMotion, info: ValidationInfo) -> SelfMotion:
        points = info.data.get("points")
        if points is not None and value.points > points // 2:
            raise problem(f"points = {value.points} is more than half of a row of {points} points")
        if value.transition == "lift" and value.lift == 0:
            raise problem('transition = "lift" needs a lift, such as lift = "30 mm"')
        return value


class Cell(_Part):
    """One cell: arm, workpiece, process.

    Examples
    --------
    >>> cell = Cell.load("examples/dome.toml")  # doctest: +SKIP
    >>> cell.chain().n  # doctest: +SKIP
    8
    """

    schema_version: Literal[1] = Field(alias="schema")
    name: Name = "cell"
    arm: Arm
    workpiece: SphereZone
    process: Process

    @field_validator("schema_version", mode="before")
    @classmethod
    def _whole(cls, value: object) -> object:
        # true and 1.0 are equal to 1 in Python, so Literal lets them pass
        if isinstance(value, (bool, float)):
            raise problem(f"must be the whole number 1, not {str(value).lower()}")
        return value

    # --- in and out ------------------------------------------------------------------------------

    @classmethod
    def load(cls, source: Cell | Mapping[str, Any] | str | Path) -> Cell:
        """Return the cell of a TOML file, of a dictionary, or the cell itself.

        Raises
        ------
        CellError
            With everything that is wrong, each problem with the path of its key.
        """
        if isinstance(source, Cell):
            return source
        if isinstance(source, Mapping):
            return _validated(dict(source), "cell")
        if not isinstance(source, (str, os.PathLike)):
            raise InvalidInput(f"a cell is a TOML file, a dictionary or a Cell, not {source!r}")
        if not str(source):
            raise InvalidInput("a cell is a TOML file, a dictionary or a Cell; the file's name is empty")
        return _validated(toml_data(source), str(source))

    def to_dict(self) -> dict[str, Any]:
        """Return the cell with every default filled in and every quantity as a string with its SI unit.

        ``Cell.load(cell.to_dict()) == cell``.
        """
        return self.model_dump(mode="json", by_alias=True, exclude_none=True)

    def save(self, path: str | Path) -> None:
        """Write the cell as TOML, with every default filled in."""
        import tomli_w

        Path(path).write_text(tomli_w.dumps(self.to_dict()), encoding="utf-8")

    # --- what it describes -----------------------------------------------------------------------

    def chain(self) -> SerialChain:
        """Return the arm."""
        from qparm.robot import DHRow, chain_from_dh

        def length(value: float | str) -> float:
            return self.arm.lengths[value] if isinstance(value, str) else value

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
            for joint in self.arm.joints
        ]
        return chain_from_dh(
            rows,
            convention=self.arm.convention,
            name=self.arm.name,
            transform_base=self.arm.base.matrix(),
            transform_tool=self.arm.tool.matrix(),
            characteristic_length=self.arm.characteristic_length,
        )

    def home(self) -> NDArray[np.float64]:
        """Return the home configuration, (n,), m and rad."""
        import numpy as np

        joints = zip(self.arm.home, self.arm.joints, strict=True)
        return np.array([quantity(value, DIMENSION_OF_KIND[joint.type]) for value, joint in joints])

    def tool_path(self) -> ToolPath:
        """Return the raster over the workpiece."""
        from qparm.surface import serpentine_raster

        return serpentine_raster(
            self.workpiece.surface(),
            rows=self.process.rows,
            points=self.process.points,
            pose_base_workpiece=self.workpiece.pose.matrix(),
            stand_off=self.process.stand_off,
            self_motion_points=self.process.self_motion.points,
            transition=self.process.self_motion.transition,
            lift=self.process.self_motion.lift,
        )

    def jump(self) -> NDArray[np.float64]:
        """Return the joint steps beyond which neighbouring points are a jump, (n,), m and rad.

        A prismatic joint's, unless the cell gives it, is what it travels in the time in which the slowest
        revolute joint turns through the angle.
        """
        import numpy as np

        chain = self.chain()
        prismatic = self.process.jump_prismatic
        if prismatic is None:
            turning = chain.velocity[~chain.prismatic]
            seconds = self.process.jump / turning.min() if len(turning) else math.inf
            return np.where(chain.prismatic, chain.velocity * seconds, self.process.jump)
        return np.where(chain.prismatic, prismatic, self.process.jump)


def _validated(data: dict[str, Any], source: str) -> Cell:
    try:
        cell = Cell.model_validate(data, context=_context(data))
    except pydantic.ValidationError as error:
        raise CellError(source, [told(one, Cell) for one in error.errors(include_url=False)]) from None
    try:
        cell.tool_path()
    except InvalidInput as error:
        raise CellError(source, [("process", str(error))]) from None
    return cell


def _context(data: dict[str, Any]) -> dict[str, Any]:
    """Return what validators of single keys need to know of others that may be invalid themselves."""
    arm = data.get("arm")
    lengths, joints = (arm.get("lengths"), arm.get("joints")) if isinstance(arm, Mapping) else (None, None)
    tables = [joint if isinstance(joint, Mapping) else {} for joint in joints] if isinstance(joints, list) else None
    return {
        "lengths": tuple(filter(lambda key: isinstance(key, str), lengths)) if isinstance(lengths, Mapping) else (),
        "joints": None if tables is None else [(table.get("name"), table.get("type"), None) for table in tables],
    }
