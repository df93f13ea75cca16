"""The problem that a design engine solves: variables, objectives, and the outcomes of evaluations."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from qparm.errors import InvalidInput

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

__all__ = ["Evaluations", "Objective", "Outcome", "Problem", "Variable"]


@dataclass(frozen=True)
class Variable:
    """One number that may be chosen.

    Attributes
    ----------
    name : str
        What messages call it, such as ``arm.joints.2.a``.
    lower, upper : float
        The range searched (SI).
    hard_lower, hard_upper : float
        How far the range may be extended where a bound turns out to limit the design.

    Raises
    ------
    InvalidInput
        Not finite, reversed or empty, or the range beyond its hard bounds.
    """

    name: str
    lower: float
    upper: float
    hard_lower: float
    hard_upper: float

    def __post_init__(self) -> None:
        for key in ("lower", "upper", "hard_lower", "hard_upper"):
            if not math.isfinite(getattr(self, key)):
                raise InvalidInput(f"variable {self.name!r}: {key} must be finite, not {getattr(self, key)}")
        if not self.lower < self.upper:
            raise InvalidInput(f"variable {self.name!r}: lower {self.lower:g} must be below upper {self.upper:g}")
        if not self.hard_lower <= self.lower or not self.upper <= self.hard_upper:
            raise InvalidInput(
                f"variable {self.name!r}: the range {self.lower:g} to {self.upper:g} must lie within its hard bounds "
                f"{self.hard_lower:g} to {self.hard_upper:g}"
            )


@dataclass(frozen=True)
class Objective:
    """One number to be minimised.

    Attributes
    ----------
    name : str
    exact : callable, optional
        Designs (m, d) in the variables' units to values (m,), where no evaluation is needed to know them (length,
        mass). Must hold beyond the range too, up to the hard bounds.
    """

    name: str
    exact: Callable[[NDArray[np.float64]], NDArray[np.float64]] | None = None


@dataclass(frozen=True)
class Problem:
    """Variables and objectives; all objectives are minimised.

    Raises
    ------
    InvalidInput
        No variable, no objective, or a name twice.
    """

    variables: tuple[Variable, ...]
    objectives: tuple[Objective, ...]

    def __post_init__(self) -> None:
        for kind, items in (("variable", self.variables), ("objective", self.objectives)):
            if not items:
                raise InvalidInput(f"a design problem needs at least one {kind}")
            names = [item.name for item in items]
            twice = next((name for name in names if names.count(name) > 1), None)
            if twice is not None:
                raise InvalidInput(f"two {kind}s are called {twice!r}; each needs a name of its own")

    @property
    def d(self) -> int:
        """Number of variables."""
        return len(self.variables)

    @property
    def m(self) -> int:
        """Number of objectives."""
        return len(self.objectives)

    @property
    def lower(self) -> NDArray[np.float64]:
        """Lower ends of the ranges, (d,)."""
        return np.array([variable.lower for variable in self.variables])

    @property
    def upper(self) -> NDArray[np.float64]:
        """Upper ends of the ranges, (d,)."""
        return np.array([variable.upper for variable in self.variables])

    def to_unit(self, X: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return designs as fractions of their ranges, (m, d); outside [0, 1] where outside the range."""
        return (X - self.lower) / (self.upper - self.lower)

    def from_unit(self, U: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return designs (m, d) in the variables' units, on the range's ends where U is 0 or 1."""
        lower, upper = self.lower, self.upper
        return np.clip(lower + U * (upper - lower), lower, upper)

    def with_range(self, name: str, lower: float, upper: float) -> Problem:
        """Return the problem with another range of one variable."""
        if name not in [variable.name for variable in self.variables]:
            raise InvalidInput(f"no variable is called {name!r}")
        return replace(
            self,
            variables=tuple(
                replace(variable, lower=lower, upper=upper) if variable.name == name else variable
                for variable in self.variables
            ),
        )


@dataclass(frozen=True)
class Outcome:
    """What is known of one design.

    Attributes
    ----------
    violation : float
        0 where the design is valid, otherwise how far it is from that: graded, larger is worse.
    objectives : tuple of float, optional
        None where the design is invalid or its objectives were not looked for.

    Raises
    ------
    InvalidInput
        Not finite, or a negative violation.
    """

    violation: float
    objectives: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        if not math.isfinite(self.violation) or self.violation < 0:
            raise InvalidInput(f"violation must be finite and not negative, not {self.violation}")
        if self.objectives is not None:
            for k, value in enumerate(self.objectives):
                if not math.isfinite(value):
                    raise InvalidInput(
                        f"objective {k} is {value}; give None for all objectives where they are not known"
                    )


@dataclass(frozen=True, eq=False)
class Evaluations:
    """All that was evaluated, in the order it was told.

    Attributes
    ----------
    X : ndarray, shape (N, d)
        Designs.
    violation : ndarray, shape (N,)
    F : ndarray, shape (N, m)
        Objectives; NaN where not known, and of invalid designs.
    """

    X: NDArray[np.float64]
    violation: NDArray[np.float64]
    F: NDArray[np.float64]

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Which designs are valid, (N,)."""
        return self.violation == 0

    @property
    def known(self) -> NDArray[np.bool_]:
        """Which designs are valid and have objectives, (N,)."""
        return self.valid & np.isfinite(self.F).all(axis=1)

    def __len__(self) -> int:
        return len(self.X)

    @classmethod
    def none(cls, problem: Problem) -> Evaluations:
        """Return no evaluations of a problem."""
        return cls(np.empty((0, problem.d)), np.empty(0), np.empty((0, problem.m)))

    def first(self, count: int) -> Evaluations:
        """Return the first so many."""
        return Evaluations(self.X[:count], self.violation[:count], self.F[:count])

    def and_also(self, problem: Problem, X: ArrayLike, outcomes: Sequence[Outcome]) -> Evaluations:
        """Return these and further ones.

        Raises
        ------
        InvalidInput
            Wrong shape, not finite, not one outcome for each design, or not one value for each objective.
        """
        X = np.array(X, dtype=float, ndmin=2)
        if X.size == 0:
            X = X.reshape(0, problem.d)
        if X.ndim != 2 or X.shape[1] != problem.d:
            raise InvalidInput(f"designs must have shape (n, {problem.d}), not {X.shape}")
        if not np.isfinite(X).all():
            i, k = np.argwhere(~np.isfinite(X))[0]
            raise InvalidInput(f"design {i}: variable {problem.variables[k].name!r} is {X[i, k]}, it must be finite")
        if len(outcomes) != len(X):
            raise InvalidInput(f"{len(X)} designs need {len(X)} outcomes, not {len(outcomes)}")
        F = np.full((len(X), problem.m), np.nan)
        for i, outcome in enumerate(outcomes):
            if outcome.objectives is None:
                continue
            if len(outcome.objectives) != problem.m:
                raise InvalidInput(f"outcome {i} has {len(outcome.objectives)} objectives, the problem {problem.m}")
            if outcome.violation == 0:
                F[i] = outcome.objectives
        violation = np.array([outcome.violation for outcome in outcomes], dtype=float)
        return Evaluations(np.vstack([self.X, X]), np.concatenate([self.violation, violation]), np.vstack([self.F, F]))
