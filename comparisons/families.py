"""Families of step problems, seeded: every solver is compared over the same ones.

Two axes are common to the made-up families. lambda^2 is set to 1e-2, 1e-4, 1e-6, 1e-8, 1e-10 and 1e-12 in turn on
the *same* Jacobian, weights and task. Bounds are one of

    inactive     wider than the unbounded step by half of its way and 1e-3 at both ends
    some         one or two joints may go 0.3 to 0.9 of the way that they go without bounds, the others as above
    all          a box so small that every joint with S > 1e-6 ends at a bound (its size is found by shrinking)
    infeasible   four to all joints may go 0.05 to 0.5 of their unbounded way, the others twice: the task is not met

and, but for *inactive*, no wider than the trust region (0.3). The task's size |e| is log-uniform between 1e-4 and 0.1;
under *inactive* and *some* it is the image J d of a random step, under *all* and *infeasible* a random direction.

    random J             entries of J independent, normal, of unit variance
    sigma_min 1e-4       the same with the smallest singular value set to 1e-4
    sigma_min 0, task in range
                         the same with the sixth row -1/2 of the first, so that the rank is 5 to the last bit; so is e
    sigma_min 0, task out of range
                         the same rank 5, with 0.1 to 1 times |e| of the task in the direction that no joint moves
    joints at limits     one to three joints exactly at a limit: W~ = 0, S = 0 (cwln), or W at its largest (wln);
                         with three at limits fewer than six joints can move
    recorded             steps of the reference plan by the method itself, with their own lambda^2 and bounds, whose
                         |e| is between 1e-4 and 0.1
    recorded, lambda^2 set
                         some of these with lambda^2 replaced by each of the six values

S and c are those of the four methods (dls, wln, cwln, gpm; see docs/steps.md) at a random configuration of the
reference arm with each joint within the last tenth of its range with probability 0.4.

The true answer to each (`exact_step`): the active set solved in 80-bit floats, whose rounding over lambda^2 is too much
where the task is out of range, so solved again on that active set with 60 digits, KKT conditions and all.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from decimal import Decimal, localcontext
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import qparm
from comparisons.recorded import recorded_steps
from comparisons.truth import true_step
from qparm.errors import KernelError
from qparm.ik import Method, StepProblem, active_set, chan_dubey_weights, clamping_weights, closed_form

__all__ = [
    "AT_LIMITS",
    "BOUNDS",
    "DAMPINGS",
    "METHODS",
    "Case",
    "Truth",
    "exact_step",
    "made_up_cases",
    "recorded_cases",
    "step_cases",
]

DAMPINGS = (1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12)
METHODS: tuple[Method, ...] = ("dls", "wln", "cwln", "gpm")
BOUNDS = ("inactive", "some", "all", "infeasible")
RANDOM, NEARLY, IN_RANGE, OUT_OF_RANGE, AT_LIMITS, RECORDED, RECORDED_SET = (
    "random J",
    "sigma_min 1e-4",
    "sigma_min 0, task in range",
    "sigma_min 0, task out of range",
    "joints at limits",
    "recorded",
    "recorded, lambda^2 set",
)
_SMALLEST_TASK, _LARGEST_TASK = 1e-4, 0.1
_TRUST = 0.3
_GPM_GAIN = 0.1


@dataclass(frozen=True, eq=False)
class Case:
    """One step problem and where it comes from.

    Attributes
    ----------
    family : str
        See the module's list.
    method : Method
        Whose S and c it has.
    bounds : str
        One of ``BOUNDS``, or "own".
    damping : str
        lambda^2 as a label, or "own".
    step : StepProblem
    """

    family: str
    method: Method
    bounds: str
    damping: str
    step: StepProblem


def _jacobian(rng: np.random.Generator, family: str, n: int) -> NDArray[np.float64]:
    J = rng.normal(size=(6, n))
    if family == NEARLY:
        U, sizes, Vt = np.linalg.svd(J, full_matrices=False)
        sizes[-1] = 1e-4
        J = (U * sizes) @ Vt
    elif family in (IN_RANGE, OUT_OF_RANGE):
        J[5] = -0.5 * J[0]
    return J


def _task(rng: np.random.Generator, family: str, J: NDArray[np.float64], *, reachable: bool) -> NDArray[np.float64]:
    """Return a task of a size between 1e-4 and 0.1."""
    size = np.exp(rng.uniform(np.log(_SMALLEST_TASK), np.log(_LARGEST_TASK)))
    e = J @ rng.normal(size=J.shape[1]) if reachable else rng.normal(size=6)
    if family in (IN_RANGE, OUT_OF_RANGE):
        e[5] = -0.5 * e[0]
    e *= size / np.linalg.norm(e)
    if family == OUT_OF_RANGE:
        blocked = np.array([0.5, 0, 0, 0, 0, 1.0]) / np.sqrt(1.25)
        e += rng.uniform(0.1, 1.0) * size * blocked
    if family == IN_RANGE:
        e[5] = -0.5 * e[0]  # to the last bit
    return e * min(1.0, _LARGEST_TASK / np.linalg.norm(e)) if family == OUT_OF_RANGE else e


def _configuration(rng: np.random.Generator, chain: qparm.SerialChain, *, at_limits: bool) -> NDArray[np.float64]:
    q = rng.uniform(chain.lower, chain.upper)
    width = chain.upper - chain.lower
    depth = rng.uniform(0.0, 0.1, chain.n) * width
    near = np.where(rng.random(chain.n) < 0.5, chain.lower + depth, chain.upper - depth)
    q = np.where(rng.random(chain.n) < 0.4, near, q)
    if at_limits:
        at = rng.choice(chain.n, rng.integers(1, 4), replace=False)
        q[at] = np.where(rng.random(len(at)) < 0.5, chain.lower[at], chain.upper[at])
    return q


def _weights(
    chain: qparm.SerialChain, method: Method, q: NDArray[np.float64], size: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return S and c of a method; c shrinks with a task smaller than 1e-2."""
    S, c, shrink = np.ones(chain.n), np.zeros(chain.n), min(1.0, size / 1e-2)
    if method == "wln":
        S = 1.0 / np.sqrt(chan_dubey_weights(chain, q))
    elif method == "cwln":
        W, phi = clamping_weights(chain, q)
        S, c = np.sqrt(W), -shrink * (1.0 - W) * phi
    elif method == "gpm":
        c = -shrink * _GPM_GAIN * (q - 0.5 * (chain.lower + chain.upper)) / chain.scale
    return S, c


def _bounded(rng: np.random.Generator, free: StepProblem, bounds: str) -> StepProblem:
    """Give an unbounded problem its bounds."""
    c, movable = free.c, np.flatnonzero(free.S > 0)
    way = closed_form(free) - c
    lb, ub = c + np.minimum(way, 0.0), c + np.maximum(way, 0.0)
    margin = 0.5 * np.abs(way) + 1e-3
    if bounds == "inactive":
        return replace(free, lb=lb - margin, ub=ub + margin)
    if bounds == "all":
        movable = np.flatnonzero(free.S > 1e-6)
        size = 0.5 * min(_TRUST, float(np.abs(way[movable]).max()))
        shares = rng.uniform(0.5, 1.0, free.n)
        for _ in range(40):
            step = replace(free, lb=c - size * shares, ub=c + size * shares)
            d = active_set(step)
            if ((d == step.lb) | (d == step.ub))[movable].all():
                return step
            size *= 0.4
        return step
    if bounds == "some":
        chosen = movable[np.argsort(-np.abs(way[movable]))[: rng.integers(1, 3)]]
        share = rng.uniform(0.3, 0.9, free.n)
    else:
        margin = np.abs(way) + 1e-9
        chosen = rng.choice(movable, rng.integers(min(4, len(movable)), len(movable) + 1), replace=False)
        share = rng.uniform(0.05, 0.5, free.n)
    lb, ub = lb - margin, ub + margin
    lb[chosen], ub[chosen] = (c - np.abs(way) * share)[chosen], (c + np.abs(way) * share)[chosen]
    return replace(free, lb=np.maximum(lb, c - _TRUST), ub=np.minimum(ub, c + _TRUST))


def made_up_cases(chain: qparm.SerialChain, *, seed: int = 0, repetitions: int = 3) -> Iterator[Case]:
    """Yield the families that are not recorded: each method, kind of bounds, lambda^2, several times.

    Parameters
    ----------
    chain : SerialChain
        The arm whose ranges the weights are made from.
    seed : int
    repetitions : int
        Jacobians per family, method and kind of bounds.
    """
    rng = np.random.default_rng(seed)
    open_ = np.full(chain.n, np.inf)
    for family in (RANDOM, NEARLY, IN_RANGE, OUT_OF_RANGE, AT_LIMITS):
        for method in ("wln", "cwln") if family == AT_LIMITS else METHODS:
            for bounds in BOUNDS * repetitions:
                J = _jacobian(rng, family, chain.n)
                e = _task(rng, family, J, reachable=bounds in ("inactive", "some"))
                q = _configuration(rng, chain, at_limits=family == AT_LIMITS)
                S, c = _weights(chain, method, q, float(np.linalg.norm(e)))
                for lam2 in DAMPINGS:
                    free = StepProblem(J, e, S, c, lam2, -open_, open_)
                    yield Case(family, method, bounds, f"{lam2:.0e}", _bounded(rng, free, bounds))


def recorded_cases(cell: Path, *, seed: int = 0, own: int = 60, replaced: int = 10) -> Iterator[Case]:
    """Yield recorded steps of plans by every method, ``own`` of them as they are, ``replaced`` at six lambda^2.

    Parameters
    ----------
    cell : Path
    seed : int
        Of the plan.
    own, replaced : int
        Steps per method, spread evenly over those with |e| between 1e-4 and 0.1.
    """
    for method in METHODS:
        plan = qparm.plan(cell, strategy="general", seed=seed, method=method, keep_traces=True)
        steps = [
            step for step in recorded_steps(plan) if _SMALLEST_TASK <= float(np.linalg.norm(step.e)) <= _LARGEST_TASK
        ]
        for k in np.linspace(0, len(steps) - 1, min(own, len(steps))).astype(int):
            yield Case(RECORDED, method, "own", "own", steps[k])
        for k in np.linspace(0, len(steps) - 1, min(replaced, len(steps)) + 2)[1:-1].astype(int):
            for lam2 in DAMPINGS:
                yield Case(RECORDED_SET, method, "own", f"{lam2:.0e}", replace(steps[k], lam2=lam2))


def step_cases(cell: Path, *, seed: int = 0, limit: int | None = None) -> list[Case]:
    """Return every family, or a seeded choice of ``limit`` cases from them all.

    Parameters
    ----------
    cell : Path
        Its arm gives the ranges, its plans the recorded steps.
    seed : int
    limit : int, optional
    """
    chain = qparm.Cell.load(cell).chain()
    cases = [*made_up_cases(chain, seed=seed), *recorded_cases(cell, seed=seed)]
    if limit is not None and limit < len(cases):
        chosen = np.sort(np.random.default_rng(seed).permutation(len(cases))[:limit])
        cases = [cases[k] for k in chosen]
    return cases


@dataclass(frozen=True, eq=False)
class Truth:
    """The true step in extended precision and which of its joints are held by a bound."""

    d: NDArray[np.longdouble]
    active: NDArray[np.bool_]


def _rational(values: NDArray) -> NDArray[np.object_]:
    return np.vectorize(lambda v: Decimal(float(v)), otypes=[object])(values)


def _solve(A: NDArray[np.object_], b: NDArray[np.object_]) -> NDArray[np.object_]:
    """Solve A x = b for a positive definite A by elimination."""
    A, b = A.copy(), b.copy()
    for k in range(len(b)):
        for i in range(k + 1, len(b)):
            factor = A[i, k] / A[k, k]
            A[i, k:] -= factor * A[k, k:]
            b[i] -= factor * b[k]
    x = b.copy()
    for k in range(len(b) - 1, -1, -1):
        x[k] = (b[k] - A[k, k + 1 :] @ x[k + 1 :]) / A[k, k] if k + 1 < len(b) else b[k] / A[k, k]
    return x


def exact_step(step: StepProblem) -> Truth | None:
    """Return the true step: the 80-bit active set, solved again with 60 digits, None if its KKT conditions fail."""
    try:
        guess = active_set(step)
    except KernelError:
        guess = step.c
    rough = true_step(step, guess)
    if rough is None:
        return None
    near = [5e-19 * (np.abs(step.c) + np.abs(bound)) for bound in (step.lb, step.ub)]
    movable = step.S > 0
    low, high = movable & (np.abs(rough - step.lb) <= near[0]), movable & (np.abs(rough - step.ub) <= near[1])
    free = movable & ~low & ~high
    with localcontext() as context:
        context.prec = 60
        J, S, c, e = (_rational(x) for x in (step.J, step.S, step.c, step.e))
        lam2, d = Decimal(step.lam2), c.copy()
        d[low], d[high] = _rational(step.lb[low]), _rational(step.ub[high])
        y = np.array([(d[i] - c[i]) / S[i] if movable[i] else Decimal(0) for i in range(step.n)])
        B = J * S
        r = e - J @ c
        if free.any():
            F = B[:, free]
            y[free] = _solve(F.T @ F + lam2 * _rational(np.eye(int(free.sum()))), F.T @ (r - B[:, ~free] @ y[~free]))
            d[free] = c[free] + S[free] * y[free]
        pull = B.T @ ((r - B @ y) / lam2) - y  # the multiplier of the bounds
        slack = Decimal(10) ** -30 * (1 + max(abs(p) for p in pull))
        for i in np.flatnonzero(movable & (step.lb < step.ub)):
            if (
                (free[i] and not (Decimal(float(step.lb[i])) <= d[i] <= Decimal(float(step.ub[i]))))
                or (low[i] and pull[i] > slack)
                or (high[i] and pull[i] < -slack)
            ):
                return None
        # a double and the rest: nothing of the 60 digits that 80 bits can hold is lost
        head = np.array([float(x) for x in d])
        rest = np.array([float(x - Decimal(h)) for x, h in zip(d, head.tolist(), strict=True)])
    return Truth(head.astype(np.longdouble) + rest, low | high)
