"""Quantities at the border: ``"600 mm"`` and ``"60 deg/s"`` to SI numbers and back.

Inside qparm every number is SI (m, rad, s); a bare number is never accepted for a quantity with
a dimension, so a unit is written and never guessed.
"""

from __future__ import annotations

import math
import re
from typing import Literal

__all__ = ["SI_UNITS", "Dimension", "format_quantity", "parse_quantity"]

Dimension = Literal[
    "length",
    "angle",
    "time",
    "linear velocity",
    "linear acceleration",
    "linear jerk",
    "angular velocity",
    "angular acceleration",
    "angular jerk",
    "linear stiffness",
    "torsional stiffness",
    "bending stiffness",
    "compliance",
]

_LENGTH = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "μm": 1e-6, "in": 0.0254}
_ANGLE = {
    "rad": 1.0,
    "mrad": 1e-3,
    "urad": 1e-6,
    "µrad": 1e-6,
    "μrad": 1e-6,
    "deg": math.pi / 180,
    "°": math.pi / 180,
}
_TIME = {"s": 1.0, "ms": 1e-3, "min": 60.0}
_FORCE = {"N": 1.0, "kN": 1e3, "MN": 1e6}
# Units with a force, whole and without spaces, dots and stars.
_LINEAR_STIFFNESS = {f"{force}/{length}": f / m for force, f in _FORCE.items() for length, m in _LENGTH.items()}
_TORSIONAL_STIFFNESS = {
    f"{force}m/{angle}": f / a
    for force, f in _FORCE.items()
    for angle, a in {**_ANGLE, "arcmin": math.pi / 10800}.items()
}
_BENDING_STIFFNESS = {
    f"{force}{length}{two}": f * m**2
    for force, f in _FORCE.items()
    for length, m in _LENGTH.items()
    for two in ("^2", "²", "**2")
}
_COMPLIANCE = {f"{length}/{force}": m / f for force, f in _FORCE.items() for length, m in _LENGTH.items()}
_SPACING = re.compile(r"[\s·⋅]|(?<!\*)\*(?!\*)")

# base units and the power of the second in the denominator, None where the units are whole
_DIMENSIONS: dict[str, tuple[dict[str, float], int | None, str]] = {
    "length": (_LENGTH, 0, "600 mm"),
    "angle": (_ANGLE, 0, "60 deg"),
    "time": (_TIME, 0, "20 ms"),
    "linear velocity": (_LENGTH, 1, "20 mm/s"),
    "linear acceleration": (_LENGTH, 2, "600 mm/s^2"),
    "linear jerk": (_LENGTH, 3, "6000 mm/s^3"),
    "angular velocity": (_ANGLE, 1, "60 deg/s"),
    "angular acceleration": (_ANGLE, 2, "180 deg/s^2"),
    "angular jerk": (_ANGLE, 3, "1800 deg/s^3"),
    "linear stiffness": (_LINEAR_STIFFNESS, None, "20 kN/mm"),
    "torsional stiffness": (_TORSIONAL_STIFFNESS, None, "50 kN m/rad"),
    "bending stiffness": (_BENDING_STIFFNESS, None, "200 kN m^2"),
    "compliance": (_COMPLIANCE, None, "2 um/N"),
}

# The SI unit of each.
SI_UNITS: dict[Dimension, str] = {
    "length": "m",
    "angle": "rad",
    "time": "s",
    "linear velocity": "m/s",
    "linear acceleration": "m/s^2",
    "linear jerk": "m/s^3",
    "angular velocity": "rad/s",
    "angular acceleration": "rad/s^2",
    "angular jerk": "rad/s^3",
    "linear stiffness": "N/m",
    "torsional stiffness": "N m/rad",
    "bending stiffness": "N m^2",
    "compliance": "m/N",
}

_NUMBER_AND_UNIT = re.compile(
    r"^\s*([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?|[+-]?nan|[+-]?inf(?:inity)?)\s*(.*?)\s*$", re.I
)
# No quantity is longer as text.
_LONGEST = 100
# 360,5 mm, where a comma stands for the point
_DECIMAL_COMMA = re.compile(r"^\s*[+-]?\d+,\d+(?:[eE][+-]?\d+)?\s*[^\d,]*$", re.ASCII)
_POWERS = {"": 1, "^1": 1, "^2": 2, "²": 2, "**2": 2, "^3": 3, "³": 3, "**3": 3}


def _unit_factor(unit: str, dimension: Dimension) -> float | None:
    """Return what one ``unit`` is in SI, None if the unit is not of the dimension."""
    base, power, _ = _DIMENSIONS[dimension]
    if power is None:
        return base.get(_SPACING.sub("", unit))
    numerator, slash, denominator = (part.strip() for part in unit.partition("/"))
    if numerator not in base:
        return None
    if not slash:
        return base[numerator] if power == 0 else None
    for second, seconds in _TIME.items():
        if denominator.startswith(second) and denominator[len(second) :] in _POWERS:
            if _POWERS[denominator[len(second) :]] != power:
                return None
            return base[numerator] / seconds**power
    return None


def _short(value: object) -> str:
    """Return a value that is no text as it can stand in a sentence; Python writes out no number of 4300 digits."""
    try:
        text = repr(value)
    except (ValueError, RecursionError):
        return f"this {type(value).__name__}"
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."


def parse_quantity(value: object, dimension: Dimension) -> float:
    """Return the SI value of a quantity written with its unit.

    Parameters
    ----------
    value : object
        A string such as ``"600 mm"`` or ``"60 deg/s"``; anything else is refused.
    dimension : Dimension
        What the quantity must be.

    Returns
    -------
    float
        The finite value in m, rad, s, N and their products and quotients.

    Raises
    ------
    ValueError
        With one sentence that says what was wrong and shows a right spelling.

    Examples
    --------
    >>> parse_quantity("600 mm", "length")
    0.6
    >>> parse_quantity("180 deg/s^2", "angular acceleration") == math.pi
    True
    """
    _, _, example = _DIMENSIONS[dimension]
    article = "an" if dimension[0] in "aeiou" else "a"
    if isinstance(value, bool) or not isinstance(value, str):
        number = isinstance(value, (int, float)) and not isinstance(value, bool)
        wrong = "has no unit" if number else f"is not {article} {dimension}"
        what = f"{article} {dimension}" if number else "it"
        raise ValueError(f'{_short(value)} {wrong}; write {what} as a string such as "{example}"')
    if len(value) > _LONGEST:
        raise ValueError(f'{value[:_LONGEST]!r}... is no {dimension}; write it such as "{example}"')
    if _DECIMAL_COMMA.match(value):
        point = value.replace(",", ".").strip()
        raise ValueError(f'{value!r} has a decimal comma; write "{point}", {article} {dimension} such as "{example}"')
    match = _NUMBER_AND_UNIT.match(value)
    if match is None:
        raise ValueError(f'{value!r} is not a number with a unit; write {article} {dimension} such as "{example}"')
    number, unit = float(match[1]), match[2]
    if not math.isfinite(number):
        raise ValueError(f'{value!r} is not finite; write {article} {dimension} such as "{example}"')
    if not unit:
        raise ValueError(f'{value!r} has no unit; write {article} {dimension} such as "{example}"')
    factor = _unit_factor(unit, dimension)
    if factor is None:
        raise ValueError(f'{unit!r} is not a unit of {dimension}; write it such as "{example}"')
    # dividing by an exact power of ten rounds once: 20 / 1000 is 0.02 where 20 * 0.001 may not be
    inverse = 1.0 / factor
    si = number / round(inverse) if factor < 1 and inverse == round(inverse) else number * factor
    if not math.isfinite(si):
        raise ValueError(f"{value!r} is not finite in SI units")
    return si


def format_quantity(value: float, dimension: Dimension) -> str:
    """Return an SI value as a string that :func:`parse_quantity` reads back to the same bits."""
    return f"{float(value)!r} {SI_UNITS[dimension]}"
