"""Quantities: a number and its unit in, SI out, and back to the same bits."""

from __future__ import annotations

import math
import struct
from typing import get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from qparm.units import Dimension, format_quantity, parse_quantity

DIMENSIONS: tuple[Dimension, ...] = get_args(Dimension)
FINITE = st.floats(allow_nan=False, allow_infinity=False)
WHOLE = st.integers(min_value=-(10**9), max_value=10**9)

# one spelling of each dimension and its SI value, worked out by hand
EXAMPLES: dict[Dimension, tuple[str, float]] = {
    "length": ("600 mm", 0.6),
    "angle": ("180 deg", math.pi),
    "time": ("20 ms", 0.02),
    "linear velocity": ("20 mm/s", 0.02),
    "linear acceleration": ("600 mm/s^2", 0.6),
    "linear jerk": ("6000 mm/s^3", 6.0),
    "angular velocity": ("180 deg/s", math.pi),
    "angular acceleration": ("180 deg/s^2", math.pi),
    "angular jerk": ("180 deg/s^3", math.pi),
    "linear stiffness": ("20 kN/mm", 2e7),
    "torsional stiffness": ("50 kN m/rad", 5e4),
    "bending stiffness": ("200 kN m^2", 2e5),
    "compliance": ("2 um/N", 2e-6),
}


def bits(value: float) -> bytes:
    return struct.pack("<d", value)


def test_the_examples_cover_every_dimension() -> None:
    assert set(EXAMPLES) == set(DIMENSIONS)


@pytest.mark.parametrize("dimension", DIMENSIONS)
def test_example_of_every_dimension_is_exact(dimension: Dimension) -> None:
    text, value = EXAMPLES[dimension]
    assert bits(parse_quantity(text, dimension)) == bits(value)


@pytest.mark.parametrize("dimension", DIMENSIONS)
@given(value=FINITE)
def test_format_then_parse_gives_the_same_bits(dimension: Dimension, value: float) -> None:
    assert bits(parse_quantity(format_quantity(value, dimension), dimension)) == bits(value)


@pytest.mark.parametrize("value", [0.0, -0.0, 5e-324, -5e-324, 1.7976931348623157e308, 0.1, 1e16, 1e-7])
@pytest.mark.parametrize("dimension", DIMENSIONS)
def test_round_trip_of_extreme_numbers(dimension: Dimension, value: float) -> None:
    assert bits(parse_quantity(format_quantity(value, dimension), dimension)) == bits(value)


@pytest.mark.parametrize(
    ("text", "dimension", "value"),
    [
        ("50 kNm/rad", "torsional stiffness", 5e4),
        ("50 kN*m/rad", "torsional stiffness", 5e4),
        ("50 kN·m / rad", "torsional stiffness", 5e4),
        ("100 N m/arcmin", "torsional stiffness", 100 * 180 * 60 / math.pi),
        ("1 N m/deg", "torsional stiffness", 180 / math.pi),
        ("30 N/um", "linear stiffness", 3e7),
        ("7 N mm**2", "bending stiffness", 7e-6),
        ("7 N m²", "bending stiffness", 7.0),
        ("0.5 mm/kN", "compliance", 5e-7),
    ],
)
def test_units_with_a_force(text: str, dimension: Dimension, value: float) -> None:
    assert parse_quantity(text, dimension) == pytest.approx(value, rel=1e-14)


@pytest.mark.parametrize("text", ["5 N/rad", "5 N m", "5 kN m/s", "5 N m^2/rad", "5"])
def test_a_unit_of_something_else_is_no_torsional_stiffness(text: str) -> None:
    with pytest.raises(ValueError, match='such as "50 kN m/rad"'):
        parse_quantity(text, "torsional stiffness")


def test_a_numpy_float_is_formatted_like_a_float() -> None:
    assert format_quantity(np.float64(0.1), "length") == "0.1 m"


@given(count=WHOLE)
def test_whole_millimetres_and_microns_are_the_nearest_double(count: int) -> None:
    assert parse_quantity(f"{count} mm", "length") == count / 1000
    assert parse_quantity(f"{count} cm", "length") == count / 100
    assert parse_quantity(f"{count} um", "length") == count / 10**6
    assert parse_quantity(f"{count} ms", "time") == count / 1000
    assert parse_quantity(f"{count} mm/s", "linear velocity") == count / 1000
    assert parse_quantity(f"{count} mm/s^2", "linear acceleration") == count / 1000
    assert parse_quantity(f"{count} mm/s^3", "linear jerk") == count / 1000
    assert parse_quantity(f"{count} urad", "angle") == count / 10**6


@given(count=FINITE)
def test_degrees_are_what_radians_makes_of_them(count: float) -> None:
    assert parse_quantity(f"{count!r} deg", "angle") == math.radians(count)


@pytest.mark.parametrize(
    ("text", "dimension", "value"),
    [
        ("600 mm", "length", 0.6),
        ("0.6 m", "length", 0.6),
        ("60 cm", "length", 0.6),
        ("600000 um", "length", 0.6),
        ("600000 µm", "length", 0.6),
        ("600000 μm", "length", 0.6),
        ("1 in", "length", 0.0254),
        ("-3.5 mm", "length", -0.0035),
        ("+3.5 mm", "length", 0.0035),
        (".5 m", "length", 0.5),
        ("5. m", "length", 5.0),
        ("1e3 mm", "length", 1.0),
        ("1E+3 mm", "length", 1.0),
        ("600mm", "length", 0.6),
        ("  600   mm  ", "length", 0.6),
        ("90°", "angle", math.pi / 2),
        ("10 urad", "angle", 1e-5),
        ("1 mrad", "angle", 1e-3),
        ("1 rad", "angle", 1.0),
        ("2 min", "time", 120.0),
        ("1.2 m/min", "linear velocity", 0.02),
        ("7 mm/ms", "linear velocity", 7.0),
        ("20 mm / s", "linear velocity", 0.02),
        ("600 mm/s²", "linear acceleration", 0.6),
        ("600 mm/s**2", "linear acceleration", 0.6),
        ("600 mm/s³", "linear jerk", 0.6),
        ("600 mm/s**3", "linear jerk", 0.6),
        ("3 um/ms^2", "linear acceleration", 3.0),
        ("1 rad/s^3", "angular jerk", 1.0),
        ("60 rad/min", "angular velocity", 1.0),
    ],
)
def test_spellings(text: str, dimension: Dimension, value: float) -> None:
    assert parse_quantity(text, dimension) == value


@pytest.mark.parametrize("dimension", DIMENSIONS)
@pytest.mark.parametrize("other", DIMENSIONS)
def test_a_unit_of_another_dimension_is_refused(dimension: Dimension, other: Dimension) -> None:
    text, _ = EXAMPLES[other]
    if other == dimension:
        assert math.isfinite(parse_quantity(text, dimension))
        return
    with pytest.raises(ValueError, match=f"is not a unit of {dimension}; write it such as"):
        parse_quantity(text, dimension)


@pytest.mark.parametrize("dimension", DIMENSIONS)
@pytest.mark.parametrize("number", [600, 0.6, 0, -1.5, math.nan, np.float64(0.6)])
def test_a_bare_number_is_refused(dimension: Dimension, number: float) -> None:
    with pytest.raises(ValueError, match=r"has no unit; write an? .* as a string such as"):
        parse_quantity(number, dimension)


@pytest.mark.parametrize("dimension", DIMENSIONS)
@pytest.mark.parametrize("text", ["600", "0.6", "-1e3", " 600 "])
def test_a_string_without_unit_is_refused(dimension: Dimension, text: str) -> None:
    with pytest.raises(ValueError, match=r"has no unit; write an? .* such as"):
        parse_quantity(text, dimension)


@pytest.mark.parametrize("dimension", DIMENSIONS)
@pytest.mark.parametrize("number", ["nan", "NaN", "inf", "-inf", "Infinity", "1e400", "-1e400"])
def test_what_is_not_finite_is_refused(dimension: Dimension, number: str) -> None:
    unit = EXAMPLES[dimension][0].partition(" ")[2]
    with pytest.raises(ValueError, match=r"is not finite; write an? .* such as"):
        parse_quantity(f"{number} {unit}", dimension)


@pytest.mark.parametrize(
    ("text", "dimension"),
    [("1e308 min", "time"), ("1e308 m/ms", "linear velocity"), ("-1e300 m/ms^3", "linear jerk")],
)
def test_a_value_that_overflows_in_si_is_refused(text: str, dimension: Dimension) -> None:
    with pytest.raises(ValueError, match="finite"):
        parse_quantity(text, dimension)


@pytest.mark.parametrize("value", [True, False, None, [], ["600 mm"], {}, b"600 mm", 1j])
@pytest.mark.parametrize("dimension", DIMENSIONS)
def test_what_is_no_string_is_refused(dimension: Dimension, value: object) -> None:
    with pytest.raises(ValueError, match=f"is not an? {dimension}; write it as a string such as"):
        parse_quantity(value, dimension)


@pytest.mark.parametrize(
    "text",
    [
        "",
        " ",
        "mm",
        "m 600",
        "garbage",
        "--5 mm",
        "5 mm mm",
        "5 mm 6",
        "5 mm; 6 mm",
        "1,5 mm",
        "1_000 mm",
        "0x10 mm",
        "1e mm",
        "5 MM",
        "5 km",
        "5 mm/",
        "5 /mm",
        "5 mm/s/s",
        "5 mm/s^0",
        "5 mm\n6 mm",
        "\N{MINUS SIGN}5 mm",
        "5 m m",
    ],
)
def test_garbage_is_refused_with_a_right_spelling(text: str) -> None:
    with pytest.raises(ValueError, match='such as "600 mm"'):
        parse_quantity(text, "length")


@given(text=st.text(max_size=12))
@pytest.mark.slow
def test_any_text_gives_a_finite_number_or_one_sentence(text: str) -> None:
    try:
        value = parse_quantity(text, "length")
    except ValueError as error:
        assert '"600 mm"' in str(error)
    else:
        assert math.isfinite(value)


def test_the_sentence_names_value_dimension_and_example() -> None:
    with pytest.raises(ValueError) as caught:
        parse_quantity(600, "length")
    assert str(caught.value) == '600 has no unit; write a length as a string such as "600 mm"'
    with pytest.raises(ValueError) as caught:
        parse_quantity("60", "angular velocity")
    assert str(caught.value) == "'60' has no unit; write an angular velocity such as \"60 deg/s\""
