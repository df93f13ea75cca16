"""Problems for design engines: what an evaluation answers, and the true front, computed densely.

Three are like the designs qparm is for: a synthetic map with a count as objective, an S-R-S arm on a slide and a
fixed S-R-S arm with six variables, the latter two by closed forms. The first two come again as tables of 41 x 41
designs, of which the nearest answers. The last is Osyczka and Kundu's (1995), which comes from elsewhere; no engine was
tuned on it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import qmc

from qparm.design import Objective, Outcome, Problem, Variable, hypervolume, non_dominated

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["PROBLEMS", "Task", "true_front"]

_CHUNK = 4096


@dataclass(frozen=True)
class Task:
    """A problem and its evaluation.

    Attributes
    ----------
    name, what : str
    problem : Problem
    evaluate : callable
        Designs (n, d) to violations (n,) and objectives (n, 2); the latter are looked at only of valid designs.
    reference : tuple of float
        Reference point of the hypervolume.
    known : callable, optional
        Designs known to be on the true front.
    table : bool
        Whether the nearest of a table's designs answers, so that all is constant in steps.
    """

    name: str
    what: str
    problem: Problem
    evaluate: Callable[[NDArray[np.float64]], tuple[NDArray[np.float64], NDArray[np.float64]]]
    reference: tuple[float, float]
    known: Callable[[], NDArray[np.float64]] | None = None
    table: bool = False

    def outcomes(self, X: NDArray[np.float64]) -> list[Outcome]:
        """Return what an engine is told of designs."""
        violation, F = self.evaluate(X)
        return [Outcome(float(v), tuple(map(float, f)) if v == 0 else None) for v, f in zip(violation, F, strict=True)]

    @property
    def blind(self) -> Task:
        """The same without objectives known exactly."""
        objectives = tuple(replace(objective, exact=None) for objective in self.problem.objectives)
        return replace(self, problem=replace(self.problem, objectives=objectives))


def _variables(*ranges: tuple[str, float, float]) -> tuple[Variable, ...]:
    return tuple(Variable(name, low, high, low, high) for name, low, high in ranges)


# --- a synthetic map -----------------------------------------------------------------------------------------------


def _map(X: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    u, v = (X[:, 0] - 0.3) / 0.3, (X[:, 1] - 0.3) / 0.2
    short = 0.8 - (u + 0.6 * v + 0.16 * np.sin(5.0 * v))
    wide = v - (1.0 - 0.3 * u**3)
    pocket = 1.0 - np.hypot((u - 0.72) / 0.12, (v - 0.52) / 0.2)
    violation = np.maximum(short, 0) + np.maximum(wide, 0) + 0.3 * np.maximum(pocket, 0)
    count = np.floor(12.0 * (1.0 - u) ** 1.5 + 5.0 * np.abs(v - 0.6) + 2.0 * np.sin(11.0 * v + 5.0 * u) ** 2)
    return violation, np.column_stack([X.sum(axis=1), count])


# --- arms ------------------------------------------------------------------------------------------------------------


def _dome(radius: float, half_angle: float, rows: int, columns: int) -> tuple[NDArray, NDArray]:
    """Return points on a dome above its centre and its normals, (rows * columns, 3) each."""
    angles = np.linspace(-half_angle, half_angle, rows)[:, None], np.linspace(-half_angle, half_angle, columns)[None]
    a, b = np.broadcast_arrays(*angles)
    n = np.stack([np.sin(b) * np.cos(a), np.sin(a), np.cos(b) * np.cos(a)], axis=-1).reshape(-1, 3)
    return radius * n, n


def _graded(missed: NDArray[np.bool_], excess: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the share of points missed and a tenth of their mean relative distance."""
    return np.where(missed.any(axis=1), missed.mean(axis=1) + 0.1 * np.maximum(excess, 0.0).mean(axis=1), 0.0)


_ELBOW = np.radians([12.0, 140.0])


def _elbow_reach(a: NDArray[np.float64], b: NDArray[np.float64]) -> tuple[NDArray, NDArray]:
    """Return the least and largest distance from shoulder to wrist."""
    far, near = (np.sqrt(a**2 + b**2 + 2 * a * b * np.cos(angle)) for angle in _ELBOW)
    return near, far


def _slide(X: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Evaluate an S-R-S arm on a slide above a dome: least best elbow, sin q_e, that a place on the slide allows."""
    p, n = _dome(0.9, np.radians(38), 9, 13)
    w = p + 0.18 * n
    height, travel = 1.62, 0.45
    L1, L3 = X[:, :1], X[:, 1:2]
    across = np.hypot(w[:, 1], w[:, 2] - height)
    r_least = np.hypot(across, np.maximum(np.abs(w[:, 0]) - travel, 0.0))
    r_most = np.hypot(across, np.abs(w[:, 0]) + travel)
    near, far = _elbow_reach(L1, L3)
    low, high = np.maximum(r_least, near), np.minimum(r_most, far)
    missed = low > high
    excess = np.maximum(r_least / far - 1.0, near / r_most - 1.0)
    r = np.clip(np.sqrt(L1**2 + L3**2), low, np.maximum(low, high))
    cos = np.clip((r**2 - L1**2 - L3**2) / (2 * L1 * L3), -1, 1)
    return _graded(missed, excess), np.column_stack([X.sum(axis=1), -np.sqrt(1 - cos**2).min(axis=1)])


def _fixed(X: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Evaluate a fixed S-R-S arm beside a dome: least sin(elbow) sin(wrist), the arm angle chosen best."""
    p, n = _dome(0.25, np.radians(35), 7, 12)
    L1, L2, L3, L4, distance, level = (X[:, k : k + 1] for k in range(6))
    # From shoulder to wrist.
    x = distance + p[:, 0] + L4 * n[:, 0]
    y = p[:, 1] + L4 * n[:, 1]
    z = level + p[:, 2] + L4 * n[:, 2] - L1
    r = np.sqrt(x**2 + y**2 + z**2)
    near, far = _elbow_reach(L2, L3)
    excess = np.maximum(r / far - 1.0, near / r - 1.0)
    cos = np.clip((r**2 - L2**2 - L3**2) / (2 * L2 * L3), -1, 1)
    # The forearm lies on a cone about shoulder-wrist; the tool points along -n.
    half = np.arccos(np.clip((r**2 + L3**2 - L2**2) / (2 * r * L3), -1, 1))
    axis = np.arccos(np.clip(-(x * n[:, 0] + y * n[:, 1] + z * n[:, 2]) / r, -1, 1))
    least, most = np.abs(axis - half), np.minimum(axis + half, 2 * np.pi - axis - half)
    limit = np.radians(115.0)
    bend = np.clip(np.pi / 2, least, np.minimum(np.maximum(most, least), np.maximum(limit, least)))
    missed = (excess > 0) | (least > limit)
    excess = np.maximum(excess, least / limit - 1.0)
    dexterity = np.sqrt(1 - cos**2) * np.sin(bend)
    return _graded(missed, excess), np.column_stack([X[:, :4].sum(axis=1), -dexterity.min(axis=1)])


# --- catalogues -------------------------------------------------------------------------------------------------------

_Evaluate = Callable[["NDArray[np.float64]"], tuple["NDArray[np.float64]", "NDArray[np.float64]"]]


def _in_steps(evaluate: _Evaluate, ranges: tuple[tuple[float, float], ...], values: int) -> _Evaluate:
    """Return an evaluation of the nearest design of a table: every variable has so many values, ends included."""
    lower, upper = np.array(ranges).T

    def of_nearest(X: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        places = np.round((X - lower) / (upper - lower) * (values - 1))
        return evaluate(lower + places / (values - 1) * (upper - lower))

    return of_nearest


# --- from elsewhere --------------------------------------------------------------------------------------------------


def _osyczka(X: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Evaluate Osyczka and Kundu's problem, violations summed relative to their right sides."""
    a, b, c, d, e, f = X.T
    g = np.column_stack(
        [
            (a + b - 2) / 2,
            (6 - a - b) / 6,
            (2 - b + a) / 2,
            (2 - a + 3 * b) / 2,
            (4 - (c - 3) ** 2 - d) / 4,
            ((e - 3) ** 2 + f - 4) / 4,
        ]
    )
    first = -(25 * (a - 2) ** 2 + (b - 2) ** 2 + (c - 1) ** 2 + (d - 4) ** 2 + (e - 1) ** 2)
    violation = np.maximum(-g, 0).sum(axis=1)
    # The best designs lie on the constraints: rounding is no violation.
    return np.where(violation < 1e-9, 0.0, violation), np.column_stack([first, (X**2).sum(axis=1)])


def _osyczka_front() -> NDArray[np.float64]:
    """Return designs along the five published pieces of the front (Deb 2001, section 8.3.3)."""
    t = np.linspace(0, 1, 1500)
    a = 4.056 + 0.944 * t
    pieces = (
        (5, 1, 1 + 4 * t, 5),
        (5, 1, 1 + 4 * t, 1),
        (a, (a - 2) / 3, 1, 1),
        (0, 2, 1 + 2.732 * t, 1),
        (t, 2 - t, 1, 1),
    )
    zero = np.zeros_like(t)
    return np.vstack([np.column_stack([zero + x for x in (a, b, c, 0, e, 0)]) for a, b, c, e in pieces])


def _total(X: NDArray[np.float64]) -> NDArray[np.float64]:
    return X.sum(axis=1)


def _links(X: NDArray[np.float64]) -> NDArray[np.float64]:
    return X[:, :4].sum(axis=1)


PROBLEMS = (
    Task(
        "map-2",
        "synthetic, 2 variables: curved valid region with a pocket; length, and a count",
        Problem(
            _variables(("L1", 0.3, 0.6), ("L3", 0.3, 0.5)), (Objective("length", _total), Objective("singularities"))
        ),
        _map,
        (0.9, 8.0),
    ),
    Task(
        "slide-2",
        "S-R-S arm on a slide, 2 variables; length, and least sin of the elbow at its best",
        Problem(_variables(("L1", 0.3, 0.9), ("L3", 0.3, 0.8)), (Objective("length", _total), Objective("elbow"))),
        _slide,
        (1.38, -0.14),
    ),
    Task(
        "arm-6",
        "fixed S-R-S arm, 6 variables (4 links, distance, level); length, and least dexterity at its best",
        Problem(
            _variables(
                ("L1", 0.2, 0.8),
                ("L2", 0.2, 0.8),
                ("L3", 0.2, 0.8),
                ("L4", 0.05, 0.35),
                ("distance", 0.2, 1.2),
                ("level", -0.4, 0.6),
            ),
            (Objective("length", _links), Objective("dexterity")),
        ),
        _fixed,
        (2.0, -0.13),
    ),
    Task(
        "slide-table",
        "the same as slide-2, of the nearest of 41 x 41 designs: all objectives constant in steps",
        Problem(_variables(("L1", 0.3, 0.9), ("L3", 0.3, 0.8)), (Objective("length"), Objective("elbow"))),
        _in_steps(_slide, ((0.3, 0.9), (0.3, 0.8)), 41),
        (1.38, -0.14),
        table=True,
    ),
    Task(
        "map-table",
        "the same as map-2, of the nearest of 41 x 41 designs",
        Problem(_variables(("L1", 0.3, 0.6), ("L3", 0.3, 0.5)), (Objective("length"), Objective("singularities"))),
        _in_steps(_map, ((0.3, 0.6), (0.3, 0.5)), 41),
        (0.9, 8.0),
        table=True,
    ),
    Task(
        "osyczka-6",
        "Osyczka and Kundu, 6 variables; kept aside, nothing was tuned on it",
        Problem(
            _variables(("x1", 0, 10), ("x2", 0, 10), ("x3", 1, 5), ("x4", 0, 6), ("x5", 1, 5), ("x6", 0, 10)),
            (Objective("f1"), Objective("f2")),
        ),
        _osyczka,
        (-20.0, 83.0),
        _osyczka_front,
    ),
)


def _front_of(task: Task, X: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    kept, values = [], []
    for first in range(0, len(X), _CHUNK):
        part = X[first : first + _CHUNK]
        violation, F = task.evaluate(part)
        valid = np.flatnonzero((violation == 0) & (np.array(task.reference) > F).all(axis=1))
        valid = valid[non_dominated(F[valid])]
        kept.append(part[valid])
        values.append(F[valid])
    X, F = np.vstack(kept), np.vstack(values)
    keep = non_dominated(F)
    return X[keep], F[keep]


@cache
def true_front(task: Task) -> tuple[float, NDArray[np.float64]]:
    """Return the hypervolume of the true front and the front (n, 2).

    Sobol points, then 16,000 steps at a time from the best, at many scales, until twenty times of that gain less than
    1e-4 of the hypervolume. Nothing found is dropped.
    """
    problem, rng = task.problem, np.random.default_rng(0)
    X = problem.from_unit(qmc.Sobol(problem.d, rng=rng).random_base2(17))
    X, F = _front_of(task, X if task.known is None else np.vstack([X, task.known()]))
    volumes = [hypervolume(F, task.reference)]
    while len(volumes) < 30 or volumes[-1] > (1 + 1e-4) * volumes[-21]:
        order, parents = np.argsort(F[:, 0]), problem.to_unit(X)
        # Evenly along the front, so that no piece is left behind where others are easier.
        even = order[np.searchsorted(F[order, 0], rng.uniform(F[:, 0].min(), F[:, 0].max(), 16000))]
        one, (two, three) = parents[even], (parents[rng.integers(len(parents), size=16000)] for _ in range(2))
        step = 10.0 ** rng.uniform(-5, -0.7, (16000, 1)) * rng.standard_normal(one.shape)
        step *= rng.random(one.shape) < rng.uniform(0.1, 1.0, (16000, 1))
        along = rng.uniform(-1.0, 1.0, (16000, 1)) * (two - three) * (rng.random((16000, 1)) < 0.5)
        X, F = _front_of(task, np.vstack([X, problem.from_unit(np.clip(one + step + along, 0, 1))]))
        volumes.append(hypervolume(F, task.reference))
    return volumes[-1], F
