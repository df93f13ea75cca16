"""Objectives that are constant in steps: widths are found from which outcomes agree, and no step is asked for twice."""

import numpy as np
import pytest

from qparm.design import Objective, Outcome, Problem, Variable, make_engine
from qparm.design.engines.steps import same_step, step_widths
from qparm.design.problem import Evaluations

PROBLEM = Problem((Variable("a", 0, 1, 0, 1), Variable("b", 0, 1, 0, 1)), (Objective("f"), Objective("g")))


def told(X: np.ndarray, values: tuple[int, int] | None) -> list[Outcome]:
    """Return outcomes of designs, of the nearest in a table of so many values where there is one."""
    if values is not None:
        many = np.array(values) - 1
        X = np.round(X * many) / many
    short = 0.35 - X.sum(axis=1)
    F = np.column_stack([X[:, 0] + 1.3 * X[:, 1], (1 - X[:, 0]) ** 2 + (1 - X[:, 1]) ** 2])
    return [Outcome(float(s)) if s > 0 else Outcome(0.0, tuple(map(float, f))) for s, f in zip(short, F, strict=True)]


def evaluations(count: int, values: tuple[int, int] | None) -> Evaluations:
    X = np.random.default_rng(3).random((count, 2))
    return Evaluations.none(PROBLEM).and_also(PROBLEM, X, told(X, values))


def test_widths_are_found() -> None:
    known = evaluations(150, (11, 26))
    widths = step_widths(known.X, known)
    assert widths is not None
    assert widths == pytest.approx([1 / 10, 1 / 25], rel=0.3)


def test_smooth_objectives_have_no_steps() -> None:
    known = evaluations(150, None)
    assert step_widths(known.X, known) is None


def test_invalid_designs_of_one_violation_make_no_steps() -> None:
    X = np.random.default_rng(3).random((80, 2))
    known = Evaluations.none(PROBLEM).and_also(PROBLEM, X, [Outcome(10.0)] * 80)
    assert step_widths(X, known) is None


def test_chances_of_being_on_a_step() -> None:
    seen, widths = np.array([[0.5, 0.5]]), np.array([0.1, 0.2])
    C = np.array([[0.5, 0.5], [0.55, 0.5], [0.55, 0.6], [0.61, 0.5]])
    assert same_step(C, seen, widths) == pytest.approx([1.0, 0.5, 0.25, 0.0])


@pytest.mark.slow
def test_a_table_is_searched_without_asking_for_its_designs_again() -> None:
    engine = make_engine("hybrid", PROBLEM, seed=0, budget=100)
    while len(X := engine.ask(10)):
        engine.tell(X, told(X, (21, 21)))
    cells = np.round(engine.evaluations.X * 20)
    again = len(cells) - len(np.unique(cells, axis=0))
    assert again < 25  # of 100; without regard to steps about half are asked for again
