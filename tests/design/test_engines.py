"""Engines on small problems: what holds for all, and the parts of each."""

import numpy as np
import pytest

from qparm.design import METHODS, Objective, Outcome, Problem, Variable, make_engine
from qparm.design.engines.grid import grid_side
from qparm.design.engines.potential_field import repulsion
from qparm.design.engines.swarm import better, roulette
from qparm.errors import InvalidInput


def total(X):
    return X.sum(axis=1)


PROBLEM = Problem(
    (Variable("L1", 0.3, 0.6, 0.1, 0.8), Variable("L3", 0.3, 0.5, 0.1, 0.8)),
    (Objective("length", total), Objective("margin")),
)
BLIND = Problem(PROBLEM.variables, (Objective("length"), Objective("margin")))
REFERENCE = np.array([1.2, 0.2])


def outcome(x):
    short = 0.85 - x.sum() + 0.2 * (x[1] - 0.4)
    return Outcome(float(short)) if short > 0 else Outcome(0.0, (float(x.sum()), float(-x[0] * x[1])))


def run(method, problem, *, seed=0, budget=60, batch=10, evaluate=outcome):
    engine = make_engine(method, problem, seed=seed, budget=budget)
    while len(X := engine.ask(batch)):
        engine.tell(X, [evaluate(x) for x in X])
    return engine


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("problem", [PROBLEM, BLIND], ids=["exact", "blind"])
@pytest.mark.slow
def test_a_seed_gives_one_run_within_range_and_budget(method, problem):
    one, two = (run(method, problem, seed=3) for _ in range(2))
    np.testing.assert_array_equal(one.evaluations.X, two.evaluations.X)
    assert one.evaluated == (7**2 if method == "grid" else 60)
    assert (problem.lower <= one.evaluations.X).all()
    assert (problem.upper >= one.evaluations.X).all()
    assert len(np.unique(one.evaluations.X, axis=0)) > 0.5 * one.evaluated
    if method != "grid":
        assert not np.array_equal(one.evaluations.X, run(method, problem, seed=4).evaluations.X)


@pytest.mark.parametrize("method", METHODS)
def test_results_may_come_in_parts_as_long_as_they_come_in_order(method):
    whole, parts = (make_engine(method, PROBLEM, seed=1, budget=40) for _ in range(2))
    for _ in range(4):
        X = whole.ask(9)
        np.testing.assert_array_equal(parts.ask(9), X)
        whole.tell(X, [outcome(x) for x in X])
        for x in X:
            parts.tell(x[None], [outcome(x)])
    np.testing.assert_array_equal(parts.evaluations.X, whole.evaluations.X)


@pytest.mark.parametrize(("method", "budget"), [("hybrid", 60), ("mopso", 300), ("paper", 300)])
def test_a_search_beats_points_at_random(method, budget):
    # Five variables: with two, points at random are about as good as a swarm.
    variables = tuple(Variable(name, 0.0, 1.0, 0.0, 1.0) for name in "abcde")
    problem = Problem(variables, (Objective("f"), Objective("g")))

    def bowls(x):
        short = 1.5 - float(x.sum())
        return (
            Outcome(short)
            if short > 0
            else Outcome(0.0, (float(((x - 0.2) ** 2).sum()), float(((x - 0.6) ** 2).sum())))
        )

    found, random = (
        np.median(
            [run(name, problem, seed=k, budget=budget, evaluate=bowls).archive.hypervolume([2, 2]) for k in range(3)]
        )
        for name in (method, "sobol")
    )
    assert found > random


@pytest.mark.parametrize("method", METHODS)
def test_nothing_valid_is_searched_on_and_no_archive(method):
    engine = run(method, PROBLEM, evaluate=lambda x: Outcome(1.0 + float(x[0])))
    assert engine.evaluated >= 49
    assert len(engine.archive) == 0


def test_the_first_valid_design_is_found_by_less_violation():
    # Valid is a corner of a thousandth of the range; the violation leads there.
    variables = tuple(Variable(name, 0.0, 1.0, 0.0, 1.0) for name in "abc")
    problem = Problem(variables, (Objective("f"), Objective("g")))

    def corner(x):
        away = float(np.maximum(0.9 - x, 0).sum())
        return Outcome(away) if away > 0 else Outcome(0.0, (float(x[0]), float(-x[1])))

    for seed in range(3):
        engine = run("hybrid", problem, seed=seed, budget=50, evaluate=corner)
        assert engine.evaluations.valid.sum() >= 5
        assert not engine.evaluations.valid[:10].all()


@pytest.mark.parametrize("method", METHODS)
def test_designs_known_from_elsewhere_are_taken_in(method):
    engine = make_engine(method, PROBLEM, seed=0, budget=49)
    X = PROBLEM.from_unit(np.random.default_rng(0).random((10, 2)))
    engine.tell(X, [outcome(x) for x in X])
    assert engine.evaluated == 10
    assert len(engine.archive) > 0
    assert len(engine.ask(60)) == 39
    assert len(engine.ask(1)) == 0


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.slow
def test_a_range_may_grow_on_the_way(method):
    engine = make_engine(method, PROBLEM, seed=0, budget=100)
    for _ in range(3):
        X = engine.ask(10)
        engine.tell(X, [outcome(x) for x in X])
    wider = PROBLEM.with_range("L3", 0.2, 0.5)
    engine.extend(wider)
    while len(X := engine.ask(10)):
        engine.tell(X, [outcome(x) for x in X])
    assert (wider.lower <= engine.evaluations.X).all()
    if method in ("hybrid", "sobol"):
        assert engine.evaluations.X[30:, 1].min() < 0.3
    with pytest.raises(InvalidInput, match="same variables and objectives"):
        engine.extend(Problem(PROBLEM.variables[:1], PROBLEM.objectives))


@pytest.mark.parametrize("method", ["hybrid", "paper"])
def test_one_objective_and_three_are_searched_too(method):
    for count in (1, 3):
        problem = Problem(PROBLEM.variables, tuple(Objective(f"f{k}") for k in range(count)))

        def several(x, count=count):
            values = (float(x.sum()), float(-x[0] * x[1]), float((x[0] - 0.5) ** 2))
            return Outcome(0.0, values[:count]) if x.sum() > 0.75 else Outcome(float(0.75 - x.sum()))

        engine = run(method, problem, budget=40, evaluate=several)
        assert len(engine.archive) >= count
        if count == 1 and method == "hybrid":
            assert engine.archive.F[0, 0] < 0.755


def test_an_objective_that_does_not_vary_stops_nothing():
    engine = run("hybrid", PROBLEM, budget=40, evaluate=lambda x: Outcome(0.0, (float(x.sum()), 0.0)))
    assert engine.archive.F[0, 0] == pytest.approx(0.6, abs=1e-6)


@pytest.mark.parametrize("method", METHODS)
def test_bad_input_is_refused(method):
    with pytest.raises(InvalidInput, match="budget must be at least 1, not 0"):
        make_engine(method, PROBLEM, seed=0, budget=0)
    engine = make_engine(method, PROBLEM, seed=0, budget=20)
    with pytest.raises(InvalidInput, match="at least one design, not 0"):
        engine.ask(0)
    X = engine.ask(2)
    with pytest.raises(InvalidInput, match="2 designs need 2 outcomes, not 1"):
        engine.tell(X, [Outcome(0.0)])
    with pytest.raises(InvalidInput, match="design 1: variable 'L3' is nan"):
        engine.tell([[0.3, 0.3], [0.3, np.nan]], [Outcome(0.0)] * 2)
    assert engine.evaluated == 0


def test_an_unknown_method_and_a_grid_too_small_are_refused():
    with pytest.raises(
        InvalidInput, match="no method is called 'annealing'; there are hybrid, mopso, paper, grid, sobol"
    ):
        make_engine("annealing", PROBLEM, seed=0, budget=10)
    with pytest.raises(InvalidInput, match="a grid over 2 variables needs a budget of at least 4"):
        make_engine("grid", PROBLEM, seed=0, budget=3)


def test_the_grid_is_the_whole_map_with_its_ends():
    X = run("grid", PROBLEM, budget=1700, batch=200).evaluations.X
    assert len(X) == 41 * 41
    for k in range(2):
        np.testing.assert_allclose(np.unique(X[:, k]), np.linspace(PROBLEM.lower[k], PROBLEM.upper[k], 41), atol=1e-12)
    assert [grid_side(3, budget) for budget in (26, 27, 63, 64, 1000)] == [2, 3, 3, 4, 10]


def test_the_potential_field_points_away_from_invalid_designs():
    u = np.array([0.5, 0.5])
    alone = repulsion(u, np.array([[0.4, 0.5]]), strength=1e-3, radius=0.2)
    # η (1/0.1 - 1/0.2) / 0.1² = 1e-3 * 5 * 100
    np.testing.assert_allclose(alone, [0.2, 0.0], atol=1e-12)
    weak = repulsion(u, np.array([[0.4, 0.5]]), strength=1e-4, radius=0.2)
    np.testing.assert_allclose(weak, [0.05, 0.0], atol=1e-12)
    np.testing.assert_array_equal(repulsion(u, np.array([[0.29, 0.5]]), strength=1e-3, radius=0.2), [0, 0])
    np.testing.assert_allclose(
        repulsion(u, np.array([[0.4, 0.5], [0.6, 0.5]]), strength=1e-3, radius=0.2), [0, 0], atol=1e-12
    )
    assert np.linalg.norm(repulsion(u, np.array([[0.5, 0.499]]), strength=1.0, radius=0.2)) == pytest.approx(0.2)
    np.testing.assert_array_equal(repulsion(u, u[None], strength=1.0, radius=0.2), [0, 0])


def test_the_second_step_of_the_papers_method_keeps_to_the_valid_range():
    def corner(x):
        return Outcome(0.0, (x.sum(), -x[0])) if x[0] > 0.45 and x[1] > 0.38 else Outcome(1.0)

    engine = run("paper", PROBLEM, budget=200, evaluate=corner)
    box = engine.box
    first = len(engine.first_step)
    assert 60 <= first < 80
    assert box.valid_share >= 0.85
    assert (box.upper - box.lower).prod() < 0.7 * (PROBLEM.upper - PROBLEM.lower).prod()
    after = engine.evaluations.X[first:]
    assert (box.lower - 1e-12 <= after).all()
    assert (box.upper + 1e-12 >= after).all()
    assert engine.evaluations.valid[first:].mean() > engine.first_step.valid.mean() + 0.2


def test_of_two_designs_the_valid_one_is_better():
    nan = np.full(2, np.nan)
    assert better(0.0, nan, 0.1, nan) is True
    assert better(0.2, nan, 0.1, nan) is False
    assert better(0.0, np.array([1, 2]), 0.0, np.array([1, 3])) is True
    assert better(0.0, np.array([2, 2]), 0.0, np.array([1, 2])) is False
    assert better(0.0, np.array([1, 3]), 0.0, np.array([2, 2])) is None
    assert better(0.0, np.array([1, 3]), 0.0, nan) is True


def test_roulette_prefers_lonely_designs():
    F = np.array([[0.0, 1.0]] + [[0.9 + 0.01 * k, 0.09 - 0.01 * k] for k in range(9)])
    rng = np.random.default_rng(0)
    drawn = np.array([roulette(F, rng) for _ in range(600)])
    # Two cells, of 1 and 9 designs: 10 to 10/9.
    assert np.mean(drawn == 0) == pytest.approx(0.9, abs=0.05)
    assert len(np.unique(drawn)) > 5
