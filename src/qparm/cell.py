"""The cell: arm, workpiece, process and home in one TOML file, validated all at once.

Every quantity with a dimension is written with its unit, as a string. What is wrong is reported
together, each problem with the path of its key.
"""

from __future__ import annotations

import difflib
import math
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import pydantic
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PlainSerializer,
    ValidationInfo,
    field_validator,
)
from pydantic_core import PydanticCustomError

from qparm.errors import CellError, InvalidInput
from qparm.units import Dimension, format_quantity, parse_quantity

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from qparm.path import ToolPath
    from qparm.robot import SerialChain
    from qparm.surface import SphericalZone

__all__ = ["Arm", "Cell", "Pose", "PrismaticJoint", "Process", "RevoluteJoint", "SelfMotion", "SphereZone"]


# No cell is larger (m); beyond it lies a wrong unit, and the squares that kinematics takes lose their digits.
_LARGEST_LENGTH = 1e4


def _parsed(value: object, dimension: Dimension) -> float:
    try:
        si = parse_quantity(value, dimension)
    except ValueError as error:
        raise PydanticCustomError("quantity", "{sentence}", {"sentence": str(error)}) from None
    if dimension == "length" and abs(si) > _LARGEST_LENGTH:
        sentence = f"{value!r} is more than {_LARGEST_LENGTH / 1e3:g} km; is the unit right?"
        raise PydanticCustomError("quantity", "{sentence}", {"sentence": sentence})
    return si


def _quantity(dimension: Dimension) -> Any:
    def parse(value: object) -> float:
        return _parsed(value, dimension)

    return Annotated[
        float,
        BeforeValidator(parse),
        PlainSerializer(lambda value: format_quantity(value, dimension), return_type=str),
    ]


if TYPE_CHECKING:
    Length = Angle = Speed = float
    LinearVelocity = LinearAcceleration = LinearJerk = float
    AngularVelocity = AngularAcceleration = AngularJerk = float
    LengthOrName = float | str
else:
    Length, Angle, Speed = _quantity("length"), _quantity("angle"), _quantity("linear velocity")
    LinearVelocity, LinearAcceleration = _quantity("linear velocity"), _quantity("linear acceleration")
    LinearJerk = _quantity("linear jerk")
    AngularVelocity, AngularAcceleration = _quantity("angular velocity"), _quantity("angular acceleration")
    AngularJerk = _quantity("angular jerk")

    _NAME = re.compile(r"^[A-Za-z_]\w*$")

    def _length_or_name(value: object, info: ValidationInfo) -> float | str:
        if isinstance(value, str) and _NAME.match(value) and value.lower() not in ("nan", "inf", "infinity"):
            known = (info.context or {}).get("lengths", ())
            if value not in known:
                names = ", ".join(known) or "none"
                raise _problem(f"{value!r} is neither a length with a unit nor a name in arm.lengths (known: {names})")
            return value
        return _parsed(value, "length")

    LengthOrName = Annotated[
        float | str,
        BeforeValidator(_length_or_name),
        PlainSerializer(
            lambda value: value if isinstance(value, str) else format_quantity(value, "length"),
            return_type=str,
        ),
    ]


def _joint_name(value: str) -> str:
    if not value:
        raise _problem("must have at least 1 character")
    if not re.fullmatch(r"\w[\w.-]*", value):
        raise _problem(
            f"{value!r} cannot be a joint's name: letters, digits, '_', '-' and '.' (it heads columns of tables)"
        )
    return value


def _name(value: str) -> str:
    if not value.isprintable():
        raise _problem(f"{value!r} has a character that cannot be printed")
    return value


JointName = Annotated[str, AfterValidator(_joint_name)]
Name = Annotated[str, Field(min_length=1), AfterValidator(_name)]


def _problem(sentence: str) -> PydanticCustomError:
    return PydanticCustomError("cell", "{sentence}", {"sentence": sentence})


def _positive(value: float, info: ValidationInfo) -> float:
    if not value > 0:
        raise _problem(f"must be greater than zero, not {value:g} (SI)")
    return value


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True, allow_inf_nan=False)


class Pose(_Part):
    """A position and a rotation by roll, pitch, yaw: about x, then y, then z of the fixed frame."""

    position: tuple[Length, Length, Length] = (0.0, 0.0, 0.0)
    rpy: tuple[Angle, Angle, Angle] = (0.0, 0.0, 0.0)

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


def _ascending(value: tuple[float, float]) -> tuple[float, float]:
    if not value[0] < value[1]:
        raise _problem(f"the limits are reversed or equal: {value[0]:g} to {value[1]:g} (SI)")
    return value


def _usable_limit(value: float) -> float:
    if not value > 0:
        raise _problem(f"must be greater than zero, not {value:g} (SI)")
    # outside this range durations and their powers leave what floating point can hold
    if not 1e-6 <= value <= 1e9:
        raise _problem(f"must lie between 1e-6 and 1e9 (SI), not {value:g}")
    return value


class PrismaticJoint(_Part):
    """A joint that slides along z; ``dh.d`` is the offset at zero."""

    name: JointName
    type: Literal["prismatic"]
    dh: _DHConstants
    position: tuple[Length, Length]
    velocity: LinearVelocity
    acceleration: LinearAcceleration
    jerk: LinearJerk

    _ascending = field_validator("position")(_ascending)
    _usable = field_validator("velocity", "acceleration", "jerk")(_usable_limit)


class RevoluteJoint(_Part):
    """A joint that turns about z; ``dh.theta`` is the offset at zero."""

    name: JointName
    type: Literal["revolute"]
    dh: _DHConstants
    position: tuple[Angle, Angle]
    velocity: AngularVelocity
    acceleration: AngularAcceleration
    jerk: AngularJerk

    _ascending = field_validator("position")(_ascending)
    _usable = field_validator("velocity", "acceleration", "jerk")(_usable_limit)


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

    _positive = field_validator("characteristic_length")(_positive)

    @field_validator("joints")
    @classmethod
    def _names_differ(cls, joints: tuple[AnyJoint, ...]) -> tuple[AnyJoint, ...]:
        names = [joint.name for joint in joints]
        repeated = sorted({name for name in names if names.count(name) > 1})
        if repeated:
            raise _problem(f"joint names must differ; repeated: {', '.join(repeated)}")
        return joints

    @field_validator("home")
    @classmethod
    def _home_fits(cls, home: tuple[str, ...], info: ValidationInfo) -> tuple[str, ...]:
        joints = info.data.get("joints")
        count = (info.context or {}).get("joint_count") if joints is None else len(joints)
        if count is not None and len(home) != count:
            raise _problem(f"the arm has {count} joints, home has {len(home)} values: one a joint, in order")
        if joints is None:
            return home
        for value, joint in zip(home, joints, strict=True):
            try:
                q = parse_quantity(value, _position_dimension(joint))
            except ValueError as error:
                raise _problem(f"value of joint {joint.name!r}: {error}") from None
            if not joint.position[0] <= q <= joint.position[1]:
                raise _problem(
                    f"value of joint {joint.name!r}: {value} lies outside its limits"
                    f" {joint.position[0]:g} to {joint.position[1]:g} (SI)"
                )
        return home


class SphereZone(_Part):
    """The workpiece: a zone of a sphere and where its frame stands."""

    shape: Literal["sphere zone"]
    radius: Length
    elevation: tuple[Angle, Angle]
    azimuth: tuple[Angle, Angle]
    pose: Pose

    _positive = field_validator("radius")(_positive)
    _ascending = field_validator("elevation", "azimuth")(_ascending)

    @field_validator("elevation")
    @classmethod
    def _within_poles(cls, value: tuple[float, float]) -> tuple[float, float]:
        if not (-math.pi / 2 < value[0] and value[1] < math.pi / 2):
            raise _problem("must lie within -90 deg and 90 deg, poles excluded: a row there has no length")
        return value

    @field_validator("azimuth")
    @classmethod
    def _one_turn(cls, value: tuple[float, float]) -> tuple[float, float]:
        if value[1] - value[0] > 2 * math.pi * (1 + 1e-12):
            raise _problem("must span no more than 360 deg")
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

    @field_validator("lift")
    @classmethod
    def _lift_given(cls, value: float, info: ValidationInfo) -> float:
        if value < 0:
            raise _problem(f"must not be negative, not {value:g} m")
        return value


# A raster beyond this would not fit into memory.
_MOST_POINTS = 5_000_000


class Process(_Part):
    """The raster and what counts as done."""

    rows: int = Field(ge=1, le=_MOST_POINTS, strict=True)
    points: int = Field(ge=2, le=_MOST_POINTS, strict=True)
    feed: Speed
    stand_off: Length = 0.0
    position_tolerance: Length = 1e-6
    rotation_tolerance: Angle = 1e-5
    jump: Angle = math.radians(50)
    jump_prismatic: Length | None = None
    self_motion: SelfMotion = SelfMotion()

    _positive = field_validator("feed", "position_tolerance", "rotation_tolerance", "jump")(_positive)

    @field_validator("points")
    @classmethod
    def _not_too_many(cls, value: int, info: ValidationInfo) -> int:
        rows = info.data.get("rows")
        if rows is not None and rows * value > _MOST_POINTS:
            raise _problem(f"{rows} rows of {value} points are more than {_MOST_POINTS:,} in all")
        return value

    @field_validator("jump_prismatic")
    @classmethod
    def _jump_positive(cls, value: float | None) -> float | None:
        if value is not None and not value > 0:
            raise _problem(f"must be greater than zero, not {value:g} m")
        return value

    @field_validator("self_motion")
    @classmethod
    def _fits_row(cls, value: SelfMotion, info: ValidationInfo) -> SelfMotion:
        points = info.data.get("points")
        if points is not None and value.points > points // 2:
            raise _problem(f"points = {value.points} is more than half of a row of {points} points")
        if value.transition == "lift" and value.lift == 0:
            raise _problem('transition = "lift" needs a lift, such as lift = "30 mm"')
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
        path = Path(source)
        try:
            with path.open("rb") as file:
                data = tomllib.load(file)
        except FileNotFoundError:
            raise CellError(
                str(source), [("", "there is no such file; `qparm new` writes one to start from")]
            ) from None
        except OSError as error:
            raise CellError(str(source), [("", f"cannot be read: {error.strerror}")]) from None
        except UnicodeDecodeError as error:
            raise CellError(str(source), [("", f"is not UTF-8 text: byte {error.start} cannot be read")]) from None
        except tomllib.TOMLDecodeError as error:
            raise CellError(str(source), [("", f"is not valid TOML: {error}")]) from None
        return _validated(data, str(source))

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

        return np.array(
            [
                parse_quantity(value, _position_dimension(joint))
                for value, joint in zip(self.arm.home, self.arm.joints, strict=True)
            ]
        )

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


def _position_dimension(joint: PrismaticJoint | RevoluteJoint) -> Dimension:
    return "length" if joint.type == "prismatic" else "angle"


# --- errors -----------------------------------------------------------------------------------------


def _validated(data: dict[str, Any], source: str) -> Cell:
    try:
        cell = Cell.model_validate(data, context=_context(data))
    except pydantic.ValidationError as error:
        raise CellError(source, [_told(problem) for problem in error.errors(include_url=False)]) from None
    try:
        cell.tool_path()
    except InvalidInput as error:
        raise CellError(source, [("process", str(error))]) from None
    return cell


def _context(data: dict[str, Any]) -> dict[str, Any]:
    """Return what validators of single keys need to know of others that may be invalid themselves."""
    arm = data.get("arm")
    lengths, joints = (arm.get("lengths"), arm.get("joints")) if isinstance(arm, Mapping) else (None, None)
    return {
        "lengths": tuple(lengths) if isinstance(lengths, Mapping) else (),
        "joint_count": len(joints) if isinstance(joints, (list, tuple)) else None,
    }


# union tags that pydantic puts into a location although they are no keys
_TAGS = frozenset({"prismatic", "revolute"})


def _told(problem: Any) -> tuple[str, str]:
    """Return key path and sentence of one of pydantic's errors."""
    loc = problem["loc"]
    # the tag follows the joint's index: arm.joints[0].prismatic.position
    location = [part for k, part in enumerate(loc) if not (part in _TAGS and k and isinstance(loc[k - 1], int))]
    key = ""
    for part in location:
        key += f"[{part}]" if isinstance(part, int) else f".{part}" if key else str(part)
    kind, context = problem["type"], problem.get("ctx", {})
    if kind == "extra_forbidden":
        return key, f"unknown key{_suggestion(location)}"
    if kind == "missing":
        return key, "is missing"
    if kind in ("literal_error", "union_tag_invalid"):
        expected = context.get("expected") or context.get("expected_tags")
        return (
            key,
            f"must be {expected}, not {problem['input'] if kind == 'literal_error' else context['tag']!r}",
        )
    if kind == "union_tag_not_found":
        return f"{key}.type", "is missing: 'prismatic' or 'revolute'"
    if kind in ("quantity", "cell"):
        return key, problem["msg"]
    value = problem["input"]
    shown = f", not {value!r}" if isinstance(value, (str, int, float, bool)) else ""
    return key, problem["msg"][0].lower() + problem["msg"][1:] + shown


def _suggestion(location: list[Any]) -> str:
    model: Any = Cell
    for part in location[:-1]:
        if isinstance(part, int):
            continue
        field = next((f for name, f in getattr(model, "model_fields", {}).items() if part in (name, f.alias)), None)
        if field is None:
            return ""
        model = RevoluteJoint if part == "joints" else field.annotation
    names = [field.alias or name for name, field in getattr(model, "model_fields", {}).items()]
    near = difflib.get_close_matches(str(location[-1]), names, n=1)
    return f"; did you mean {near[0]!r}?" if near else f"; known here: {', '.join(names)}" if names else ""
