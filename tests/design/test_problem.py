"""What a problem and an outcome refuse, and what they keep."""

import numpy as np
import pytest

from qparm.design import Evaluations, Objective, Outcome, Problem, Variable
from qparm.errors import InvalidInput

A, B = Variable("a", 1.0, 3.0, 0.0, 4.0), Variable("b", -1.0, 1.0, -1.0, 1.0)
PROBLEM = Problem((A, B), (Objective("f"), Objective("g")))


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ((np.nan, 1, 0, 1), "variable 'x': lower must be finite, not nan"),
        ((0, 1, 0, np.inf), "variable 'x': hard_upper must be finite, not inf"),
        ((1, 1, 0, 2), "lower 1 must be below upper 1"),
        ((0, 1, 0.5, 1), "must lie within its hard bounds 0.5 to 1"),
        ((0, 1, 0, 0.9), "must lie within its hard bounds 0 to 0.9"),
    ],
)
def test_a_range_that_is_none_is_refused(values, message):
    with pytest.raises(InvalidInput, match=message):
        Variable("x", *values)


def test_a_problem_needs_names_that_differ():
    with pytest.raises(InvalidInput, match="at least one variable"):
        Problem((), (Objective("f"),))
    with pytest.raises(InvalidInput, match="at least one objective"):
        Problem((A,), ())
    with pytest.raises(InvalidInput, match="two variables are called 'a'"):
        Problem((A, A), (Objective("f"),))


def test_units_and_fractions_agree_at_the_ends():
    np.testing.assert_array_equal(PROBLEM.from_unit(np.array([[0.0, 1.0]])), [[1.0, 1.0]])
    np.testing.assert_allclose(PROBLEM.to_unit(np.array([[2.0, 0.5]])), [[0.5, 0.75]])
    assert PROBLEM.with_range("a", 0.5, 3.5).lower[0] == 0.5
    with pytest.raises(InvalidInput, match="no variable is called 'c'"):
        PROBLEM.with_range("c", 0, 1)
    with pytest.raises(InvalidInput, match="hard bounds"):
        PROBLEM.with_range("a", -0.5, 3.5)


@pytest.mark.parametrize("violation", [np.nan, np.inf, -0.1])
def test_a_violation_that_is_none_is_refused(violation):
    with pytest.raises(InvalidInput, match="violation must be finite and not negative"):
        Outcome(violation)


def test_an_objective_that_is_nan_is_refused_by_place():
    with pytest.raises(InvalidInput, match="objective 1 is nan; give None"):
        Outcome(0.0, (1.0, np.nan))


@pytest.mark.parametrize(
    ("X", "outcomes", "message"),
    [
        ([[1.0]], [Outcome(0.0)], r"shape \(n, 2\)"),
        ([[1.0, np.nan]], [Outcome(0.0)], "design 0: variable 'b' is nan"),
        ([[1.0, 0.0]], [], "1 designs need 1 outcomes, not 0"),
        ([[1.0, 0.0]], [Outcome(0.0, (1.0,))], "outcome 0 has 1 objectives, the problem 2"),
    ],
)
def test_evaluations_that_do_not_fit_are_refused(X, outcomes, message):
    with pytest.raises(InvalidInput, match=message):
        Evaluations.none(PROBLEM).and_also(PROBLEM, X, outcomes)


def test_valid_without_objectives_is_valid_but_not_known():
    evaluations = Evaluations.none(PROBLEM).and_also(
        PROBLEM, [[1.0, 0.0], [2.0, 0.0], [3.0, 0.0]], [Outcome(0.0), Outcome(0.5), Outcome(0.0, (1.0, 2.0))]
    )
    np.testing.assert_array_equal(evaluations.valid, [True, False, True])
    np.testing.assert_array_equal(evaluations.known, [False, False, True])
    assert len(evaluations.first(2)) == 2
