"""The values of a cell: quantities with their unit, names, and the limits within which they make sense.

Whatever is refused is refused with one sentence; :mod:`qparm.cell.messages` adds the key.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import AfterValidator, BeforeValidator, PlainSerializer, ValidationInfo, WithJsonSchema
from pydantic_core import PydanticCustomError

from qparm.names import wrong_joint_name, wrong_name
from qparm.units import SI_UNITS, Dimension, format_quantity, parse_quantity

__all__ = [
    "DIMENSION_OF_KIND",
    "Angle",
    "AnglePair",
    "AngleTriple",
    "AngularAcceleration",
    "AngularJerk",
    "AngularVelocity",
    "BendingStiffness",
    "JointName",
    "Length",
    "LengthOrName",
    "LengthPair",
    "LengthTriple",
    "LinearAcceleration",
    "LinearJerk",
    "LinearStiffness",
    "LinearVelocity",
    "Name",
    "TorsionalStiffness",
    "ascending",
    "between",
    "joint_name",
    "not_negative",
    "positive",
    "problem",
    "quantity",
    "usable_limit",
    "wrong_at_home",
]

# No cell is larger (m); beyond it lies a wrong unit, and the squares that kinematics takes lose their digits.
_LARGEST_LENGTH = 1e4
# No joint turns farther (rad); beyond it sine and cosine lose digits.
_LARGEST_ANGLE = 1e3
DIMENSION_OF_KIND: dict[str, Dimension] = {"prismatic": "length", "revolute": "angle"}


def problem(sentence: str) -> PydanticCustomError:
    """Return the error that tells a sentence as it is."""
    return PydanticCustomError("cell", "{sentence}", {"sentence": sentence})


def quantity(value: object, dimension: Dimension) -> float:
    """Return the SI value of a quantity of a cell.

    Raises
    ------
    ValueError
        With a sentence: not a quantity of the dimension, or larger than any cell's.
    """
    si = parse_quantity(value, dimension)
    if dimension == "length" and abs(si) > _LARGEST_LENGTH:
        raise ValueError(f"{value!r} is more than {_LARGEST_LENGTH / 1e3:g} km; is the unit right?")
    if dimension == "angle" and abs(si) > _LARGEST_ANGLE:
        raise ValueError(f"{value!r} is more than {_LARGEST_ANGLE:g} rad; is the unit right?")
    return si


def _parsed(value: object, dimension: Dimension) -> float:
    try:
        return quantity(value, dimension)
    except ValueError as error:
        raise problem(str(error)) from None


def _schema(dimension: Dimension) -> dict[str, Any]:
    """Return what an editor can check of a quantity: that it is text, a number and a unit."""
    unit = SI_UNITS[dimension]
    return {
        "type": "string",
        "pattern": r"^\s*[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?\s*(?![eE][-+]?\d)[A-Za-zµμ°].*$",
        "description": f'A {dimension} with its unit, such as "1.5 {unit}".',
    }


def _quantity(dimension: Dimension) -> Any:
    def parse(value: object) -> float:
        return _parsed(value, dimension)

    return Annotated[
        float,
        BeforeValidator(parse),
        PlainSerializer(lambda value: format_quantity(value, dimension), return_type=str),
        WithJsonSchema(_schema(dimension)),
    ]


def _values(count: int) -> BeforeValidator:
    """Return the check that a list has so many values."""

    def check(value: object) -> object:
        if not isinstance(value, (list, tuple)):
            raise PydanticCustomError("list of values", "must be a list of {count} values", {"count": count})
        if len(value) != count:
            raise problem(f"must have {count} values, not {len(value)}")
        return value

    return BeforeValidator(check)


if TYPE_CHECKING:
    Length = Angle = float
    LinearVelocity = LinearAcceleration = LinearJerk = float
    AngularVelocity = AngularAcceleration = AngularJerk = float
    LinearStiffness = TorsionalStiffness = BendingStiffness = float
    LengthPair = AnglePair = tuple[float, float]
    LengthTriple = AngleTriple = tuple[float, float, float]
    LengthOrName = float | str
else:
    Length, Angle, LinearVelocity = _quantity("length"), _quantity("angle"), _quantity("linear velocity")
    LinearAcceleration, LinearJerk = _quantity("linear acceleration"), _quantity("linear jerk")
    AngularVelocity, AngularAcceleration = _quantity("angular velocity"), _quantity("angular acceleration")
    AngularJerk = _quantity("angular jerk")
    LinearStiffness, TorsionalStiffness = _quantity("linear stiffness"), _quantity("torsional stiffness")
    BendingStiffness = _quantity("bending stiffness")
    LengthPair, AnglePair = (Annotated[tuple[item, item], _values(2)] for item in (Length, Angle))
    LengthTriple, AngleTriple = (Annotated[tuple[item, item, item], _values(3)] for item in (Length, Angle))

    _NAME = re.compile(r"^[A-Za-z_]\w*$")

    def _length_or_name(value: object, info: ValidationInfo) -> float | str:
        if isinstance(value, str) and _NAME.match(value) and value.lower() not in ("nan", "inf", "infinity"):
            known = (info.context or {}).get("lengths", ())
            if value not in known:
                names = ", ".join(known) or "none"
                raise problem(f"{value!r} is neither a length with a unit nor a name in arm.lengths (known: {names})")
            return value
        return _parsed(value, "length")

    LengthOrName = Annotated[
        float | str,
        BeforeValidator(_length_or_name),
        PlainSerializer(
            lambda value: value if isinstance(value, str) else format_quantity(value, "length"),
            return_type=str,
        ),
        WithJsonSchema({"type": "string", "description": "A length with its unit, or a name of arm.lengths."}),
    ]


# --- names ------------------------------------------------------------------------------------------


def joint_name(value: str) -> str:
    """Refuse what cannot be the name of a joint."""
    wrong = wrong_joint_name(value)
    if wrong:
        raise problem(wrong)
    return value


def _name(value: str) -> str:
    wrong = wrong_name(value)
    if wrong:
        raise problem(wrong)
    return value


JointName = Annotated[str, AfterValidator(joint_name)]
Name = Annotated[str, AfterValidator(_name)]


# --- within what makes sense ------------------------------------------------------------------------


def positive(value: float) -> float:
    """Refuse what is not greater than zero."""
    if not value > 0:
        raise problem(f"must be greater than zero, not {value:g} (SI)")
    return value


def not_negative(value: float) -> float:
    """Refuse what is negative."""
    if value < 0:
        raise problem(f"must not be negative, not {value:g} (SI)")
    return value


def between(low: float, high: float, words: str) -> Callable[[float], float]:
    """Return the check that a value lies between two others; ``words`` say them with their unit."""

    def check(value: float) -> float:
        if low > 0:
            positive(value)
        # the unit's conversion may round the very limit beyond it
        if not low * (1 - 1e-12) <= value <= high * (1 + 1e-12):
            raise problem(f"must lie between {words}, not {value:g} (SI)")
        return value

    return check


def ascending(value: tuple[float, float]) -> tuple[float, float]:
    """Refuse limits that are reversed or equal."""
    if not value[0] < value[1]:
        raise problem(f"the limits are reversed or equal: {value[0]:g} to {value[1]:g} (SI)")
    return value


def usable_limit(value: float) -> float:
    """Refuse a limit of velocity, acceleration or jerk with which nothing can be computed."""
    positive(value)
    # outside this range durations and their powers leave what floating point can hold
    if not 1e-6 <= value <= 1e9:
        raise problem(f"must lie between 1e-6 and 1e9 (SI), not {value:g}")
    return value


# --- home -------------------------------------------------------------------------------------------


def repeated_names(names: list[str]) -> str:
    """Return what is wrong with the names of joints, empty if nothing."""
    repeated = sorted({name for name in names if names.count(name) > 1})
    return f"joint names must differ; repeated: {', '.join(repeated)}" if repeated else ""


def wrong_at_home(home: Sequence[object], joints: Sequence[tuple[object, object, tuple[float, float] | None]]) -> str:
    """Return all that is wrong with the values at home as one sentence, empty if nothing is.

    Parameters
    ----------
    home : sequence
        The values as they are written.
    joints : sequence of (name, kind, limits)
        As far as they are known: a kind may be anything, limits may be missing.
    """
    if len(home) != len(joints):
        return f"the arm has {len(joints)} joints, home has {len(home)} values: one per joint, in order"
    wrong = []
    for k, (value, (name, kind, limits)) in enumerate(zip(home, joints, strict=True)):
        sentence = _wrong_value_at_home(value, kind, limits)
        if sentence:
            wrong.append(f"value {k} ({name}): {sentence}" if isinstance(name, str) else f"value {k}: {sentence}")
    return "; ".join(wrong)


def _wrong_value_at_home(value: object, kind: object, limits: tuple[float, float] | None) -> str:
    dimension = DIMENSION_OF_KIND.get(kind) if isinstance(kind, str) else None
    if dimension is None:
        return "" if isinstance(value, str) else f'{value!r} has no unit; write it as a string such as "60 deg"'
    try:
        q = quantity(value, dimension)
    except ValueError as error:
        return str(error)
    if limits is None or limits[0] <= q <= limits[1]:
        return ""
    return f"{value} lies outside its limits {limits[0]:g} to {limits[1]:g} (SI)"
