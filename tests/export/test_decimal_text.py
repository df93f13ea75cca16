"""Numbers as text: the same as Python's own formatting."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from qparm.export.decimal_text import lines_of


def text_of(values: np.ndarray) -> list[str]:
    """Return the text of each number."""
    lines = lines_of(values[:, None], np.zeros(len(values), dtype=np.int64), ["end"]).decode()
    assert lines.endswith(",end\n")
    return [line.removesuffix(",end") for line in lines.splitlines()]


@settings(max_examples=300)
@given(st.lists(st.floats(allow_nan=False, min_value=-1e250, max_value=1e250), min_size=1, max_size=50))
def test_any_number_is_written_to_12_digits(numbers: list[float]) -> None:
    for number, text in zip(numbers, text_of(np.array(numbers)), strict=True):
        expected = f"{number:.12g}".replace("-0", "0") if number == 0 else f"{number:.12g}"
        assert text == expected


def test_numbers_next_to_half_way_between_two_texts() -> None:
    rng = np.random.default_rng(0)
    half = (rng.integers(10**11, 10**12, 20_000) + 0.5) * 10.0 ** rng.integers(-22, 4, 20_000)
    for values in (half, np.nextafter(half, 0), np.nextafter(half, np.inf)):
        assert text_of(values) == [f"{value:.12g}" for value in values.tolist()]


def test_powers_of_ten_and_what_rounds_to_them() -> None:
    powers = 10.0 ** np.arange(-40, 40)
    for values in (powers, powers * (1 - 1e-13), powers * (1 + 1e-11), -powers):
        assert text_of(values) == [f"{value:.12g}" for value in values]


def test_multiples_of_a_period_are_short() -> None:
    times = np.round(np.arange(5000) * 0.02, 9)
    assert text_of(times) == [f"{t:.12g}" for t in times]


def test_each_line_has_its_tail() -> None:
    table = np.arange(6.0).reshape(3, 2)
    assert lines_of(table, np.array([0, 1, 0]), ["a", "bc,1"]) == b"0,1,a\n2,3,bc,1\n4,5,a\n"


def test_a_number_that_is_not_finite_is_refused() -> None:
    with pytest.raises(ValueError, match="not finite"):
        lines_of(np.array([[np.nan]]), np.array([0]), [""])
