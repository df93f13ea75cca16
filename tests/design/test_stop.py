"""When to stop, which bounds limit, and the box of valid designs."""

import numpy as np
import pytest

from qparm.design import (
    Evaluations,
    Objective,
    Outcome,
    Problem,
    Variable,
    active_bounds,
    extended,
    stalled,
    valid_box,
)


def told(problem, X, evaluate):
    return Evaluations.none(problem).and_also(problem, X, [evaluate(x) for x in X])


def total(X):
    return X.sum(axis=1)


def made(a=(0.3, 0.6), hard=(0.1, 0.9)):
    """Two lengths; together at least 0.8 for the work to be reached; the second objective falls with length."""
    return Problem(
        (Variable("L1", *a, *hard), Variable("L3", 0.3, 0.5, 0.1, 0.6)),
        (Objective("length", total), Objective("margin")),
    )


def reach(x):
    short = max(0.0, 0.8 - x[0] * 0.8 - x[1] * 1.2)
    return Outcome(short) if short > 0 else Outcome(0.0, (x.sum(), 1.0 - 0.8 * x[0] - 1.2 * x[1] + (x[1] - 0.4) ** 2))


def spread(problem, count=400, seed=0):
    return problem.from_unit(np.random.default_rng(seed).random((count, problem.d)))


def test_a_search_that_gained_nothing_has_stalled():
    problem = made()
    X = spread(problem, 60)
    best = told(problem, np.vstack([X, X, X]), reach)
    assert stalled(best, batch=10)
    # Half the window new designs, far better ones, and it has not.
    better = best.and_also(problem, X[:20], [Outcome(0.0, (0.1, 0.1))] * 20)
    assert not stalled(better, batch=10)
    # With larger batches the window reaches back to before anything was known.
    assert not stalled(best, batch=36)


def test_nothing_valid_is_no_stall():
    problem = made()
    X = spread(problem, 200)
    assert not stalled(told(problem, X, lambda x: Outcome(1.0)), batch=10)
    assert not stalled(Evaluations.none(problem), batch=10)


def test_a_bound_across_which_length_shrinks_is_active():
    # The paper's second range: shorter L1 pays, and 0.48 was chosen by a person.
    problem = made(a=(0.48, 0.6))
    X = np.vstack([spread(problem), [[0.48, 0.35], [0.481, 0.36]]])
    bounds = active_bounds(problem, told(problem, X, reach))
    lower = next(bound for bound in bounds if (bound.variable, bound.side) == ("L1", "lower"))
    assert "length" in lower.objectives
    assert lower.extended == pytest.approx(0.48 - 0.2 * 0.12)
    assert not lower.hard
    assert "design limited by bound L1 >= 0.48" in str(lower)
    wider = extended(problem, bounds)
    assert wider.lower[0] == lower.extended
    assert wider.upper[0] == (0.6 if all(b.side == "lower" or b.variable != "L1" for b in bounds) else 0.624)


def test_a_range_goes_no_further_than_its_hard_bound():
    problem = made(a=(0.48, 0.6), hard=(0.475, 0.6))
    X = np.vstack([spread(problem), [[0.48, 0.35]]])
    bounds = active_bounds(problem, told(problem, X, reach))
    lower = next(bound for bound in bounds if (bound.variable, bound.side) == ("L1", "lower"))
    assert lower.extended == 0.475
    problem = made(a=(0.475, 0.6), hard=(0.475, 0.6))
    X = np.vstack([spread(problem), [[0.475, 0.36]]])
    bounds = active_bounds(problem, told(problem, X, reach))
    lower = next(bound for bound in bounds if (bound.variable, bound.side) == ("L1", "lower"))
    assert lower.hard
    assert extended(problem, (lower,)) == problem


def test_an_optimum_within_the_range_limits_nothing():
    problem = Problem((Variable("a", 0, 1, -1, 2), Variable("b", 0, 1, -1, 2)), (Objective("f"), Objective("g")))

    def bowls(x):
        return Outcome(0.0, (float(((x - 0.4) ** 2).sum()), float(((x - 0.6) ** 2).sum())))

    assert active_bounds(problem, told(problem, spread(problem), bowls)) == ()
    assert active_bounds(problem, Evaluations.none(problem)) == ()


def test_an_objective_without_formula_is_followed_by_its_slope():
    problem = Problem((Variable("a", 0, 1, -1, 2), Variable("b", 0, 1, -1, 2)), (Objective("f"), Objective("g")))

    def slope(x):
        return Outcome(0.0, (float(x[0] + (x[1] - 0.5) ** 2), float((x[1] - 0.7) ** 2 + 0.1 * x[0])))

    bounds = active_bounds(problem, told(problem, np.vstack([spread(problem), [[0.0, 0.5], [0.0, 0.7]]]), slope))
    assert [(bound.variable, bound.side) for bound in bounds] == [("a", "lower")]
    assert "f" in bounds[0].objectives


def test_the_valid_box_finds_the_valid_corner_and_keeps_the_archive():
    problem = made()

    def corner(x):
        return Outcome(0.0, (x[0], -x[1])) if x[0] > 0.45 and x[1] > 0.4 else Outcome(1.0)

    X = spread(problem, 600)
    evaluations = told(problem, X, corner)
    box = valid_box(problem, evaluations)
    assert box.valid_share >= 0.9
    assert box.support >= 0.15
    np.testing.assert_allclose(box.lower, [0.45, 0.4], atol=0.02)
    np.testing.assert_array_equal(box.upper, [0.6, 0.5])
    inside = ((box.lower <= X) & (box.upper >= X)).all(axis=1)
    assert box.valid_share == pytest.approx(evaluations.valid[inside].mean())
    # An archived design amid invalid ones is never cut off.
    lonely = evaluations.and_also(problem, [[0.35, 0.45]], [Outcome(0.0, (0.0, -1.0))])
    assert valid_box(problem, lonely).lower[0] <= 0.35


def test_the_valid_box_of_nothing_is_the_range():
    problem = made()
    box = valid_box(problem, Evaluations.none(problem))
    np.testing.assert_array_equal([box.lower, box.upper], [problem.lower, problem.upper])
    assert np.isnan(box.valid_share)
    assert np.isnan(box.support)
