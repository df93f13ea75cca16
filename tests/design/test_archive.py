"""Dominance and hypervolume against counting and brute force."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from qparm.design import (
    Archive,
    Evaluations,
    Objective,
    Outcome,
    Problem,
    Variable,
    crowding,
    hypervolume,
    knee,
    non_dominated,
    reference_point,
)
from qparm.design.archive import free_boxes
from qparm.errors import InvalidInput

PROBLEM = Problem((Variable("a", 0.0, 1.0, 0.0, 1.0),), (Objective("f"), Objective("g")))


@st.composite
def fronts(draw, objectives=(1, 2, 3, 4), largest=7):
    """Rows on a small integer grid: ties and repeated rows are common, and cells can be counted."""
    m = draw(st.sampled_from(objectives))
    rows = draw(st.lists(st.lists(st.integers(0, 5), min_size=m, max_size=m), max_size=largest))
    return np.array(rows, dtype=float).reshape(-1, m)


def cells(m):
    """Return the lower corners of the unit cells of [0, 5]^m."""
    return np.stack(np.meshgrid(*[np.arange(5)] * m, indexing="ij"), axis=-1).reshape(-1, m)


@given(fronts())
def test_a_row_stays_if_no_other_dominates_it(F):
    keep = non_dominated(F)
    for i, a in enumerate(F):
        dominated = any((b <= a).all() and (b < a).any() for b in F)
        repeated = any((b == a).all() for b in F[:i])
        assert keep[i] == (not dominated and not repeated)


@given(fronts())
def test_hypervolume_is_the_count_of_dominated_cells(F):
    corners = cells(F.shape[1])
    dominated = (F[None] <= corners[:, None]).all(axis=2).any(axis=1)
    assert hypervolume(F, np.full(F.shape[1], 5.0)) == pytest.approx(dominated.sum(), abs=1e-9)


@given(fronts())
def test_free_boxes_are_disjoint_and_fill_what_is_not_dominated(F):
    m = F.shape[1]
    lower, upper = free_boxes(F, np.full(m, 5.0))
    corners = cells(m)
    held = ((lower[None] <= corners[:, None]) & (corners[:, None] + 1 <= upper[None])).all(axis=2).sum(axis=1)
    dominated = (F[None] <= corners[:, None]).all(axis=2).any(axis=1)
    np.testing.assert_array_equal(held, np.where(dominated, 0, 1))


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1), st.integers(2, 3))
def test_hypervolume_of_real_numbers_against_inclusion_and_exclusion(seed, m):
    F = np.random.default_rng(seed).random((5, m))
    volume = 0.0
    for mask in range(1, 2**5):
        rows = F[[k for k in range(5) if mask >> k & 1]]
        volume += (-1) ** (len(rows) + 1) * np.prod(1.2 - rows.max(axis=0))
    assert hypervolume(F, np.full(m, 1.2)) == pytest.approx(volume, rel=1e-12)


def test_archive_keeps_valid_designs_in_order_of_the_first_objective():
    outcomes = [
        Outcome(0.0, (3.0, 1.0)),
        Outcome(0.2),
        Outcome(0.0, (1.0, 3.0)),
        Outcome(0.0, (3.0, 2.0)),
        Outcome(0.0),
    ]
    evaluations = Evaluations.none(PROBLEM).and_also(PROBLEM, np.linspace(0, 1, 5)[:, None], outcomes)
    archive = Archive.of(evaluations)
    np.testing.assert_array_equal(archive.index, [2, 0])
    np.testing.assert_array_equal(archive.F, [[1, 3], [3, 1]])
    np.testing.assert_allclose(archive.X[:, 0], [0.5, 0.0])
    assert archive.hypervolume([4, 4]) == 3 + 2


def test_objectives_of_an_invalid_design_are_not_kept():
    evaluations = Evaluations.none(PROBLEM).and_also(PROBLEM, [[0.5]], [Outcome(0.1, (1.0, 1.0))])
    assert np.isnan(evaluations.F).all()
    assert not len(Archive.of(evaluations))


def test_crowding_is_infinite_at_the_ends_and_the_sum_of_gaps_between():
    np.testing.assert_allclose(crowding([[0, 4], [1, 2], [4, 0]]), [np.inf, 2.0, np.inf])
    assert crowding(np.empty((0, 2))).shape == (0,)


def test_the_knee_is_farthest_from_the_line_through_the_ends():
    F = np.array([[0, 10], [2, 5.5], [4, 1], [10, 0]])
    line = (F / 10).sum(axis=1)
    assert knee(F) == 2 == np.argmin(line)


def test_a_front_that_bulges_the_other_way_has_no_knee():
    angle = np.linspace(0, np.pi / 2, 9)
    bulging = np.column_stack([np.sin(angle), np.cos(angle)])
    assert knee(bulging) is None
    assert knee(1 - bulging) == 4
    assert knee([[0, 1], [0.5, 0.5], [1, 0]]) is None
    assert knee([[0, 1], [1, 0]]) is None
    assert knee([[3, 1]]) == 0
    # convex in a part only: the knee is there
    assert knee([[0, 10], [1, 9.5], [4, 8.5], [7, 1], [10, 0]]) == 3


def test_the_reference_lies_a_tenth_beyond():
    np.testing.assert_allclose(reference_point([[0, 4], [2, 0]]), [2.2, 4.4])
    np.testing.assert_allclose(reference_point([[2, -4]]), [2.2, -3.6])


@pytest.mark.parametrize("call", [non_dominated, crowding, knee, reference_point])
def test_nan_is_refused_by_place(call):
    with pytest.raises(InvalidInput, match="objective 1 of design 2 is nan"):
        call([[0.0, 1.0], [1.0, 0.0], [2.0, np.nan]])


def test_what_has_no_shape_or_no_rows_is_refused():
    with pytest.raises(InvalidInput, match="must have shape"):
        non_dominated([1.0, 2.0])
    with pytest.raises(InvalidInput, match=r"reference must have shape \(2,\)"):
        hypervolume([[1.0, 2.0]], [3.0])
    for call in (knee, reference_point):
        with pytest.raises(InvalidInput, match="empty front"):
            call(np.empty((0, 2)))
