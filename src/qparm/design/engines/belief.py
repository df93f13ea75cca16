"""Predictions of the default engine's models for designs: their objectives, and whether they are valid."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from qparm.design.archive import Archive, reference_point
from qparm.design.engines.gaussian_process import (
    GaussianProcess,
    Prediction,
    below_zero,
    fit_censored,
    fit_values,
)
from qparm.design.problem import Evaluations, Problem

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["Belief", "Models"]

# Most evaluations a model is fitted to: those nearest to the archive.
_MOST = 350
# Iterations of a first fit, and of one that starts from the last.
_FIRST, _AGAIN = 40, 15
# Values beyond the reference are compressed on this scale (of the front's extent): how bad is no matter there.
_COMPRESSED = 0.5
# Roots of violations are fitted, up to this many times the median: near the border they are about straight.
_LARGEST = 3.0


class Models:
    """Gaussian processes over the unit cube, one for each objective that needs an evaluation and one for the violation.

    Parameters
    ----------
    problem : Problem
    evaluations : Evaluations
    archive : Archive
    fitted : dict
        Parameters of an earlier fit, from which this one starts; those of this one are left there.
    """

    def __init__(
        self, problem: Problem, evaluations: Evaluations, archive: Archive, fitted: dict[str, NDArray[np.float64]]
    ) -> None:
        self.problem, self._fitted = problem, fitted
        U, F = problem.to_unit(evaluations.X), evaluations.F
        self._objectives: list[tuple[GaussianProcess, float, float] | None] = []
        known = _nearest(U, np.flatnonzero(evaluations.known), problem.to_unit(archive.X))
        for j, objective in enumerate(problem.objectives):
            if objective.exact is not None or not len(known):
                self._objectives.append(None)
                continue
            y = F[known, j]
            if len(archive) > 1:
                reference = reference_point(archive.F)[j]
                scale = _COMPRESSED * (reference - archive.F[:, j].min())
                y = np.where(y > reference, reference + scale * np.log1p(np.maximum(y - reference, 0) / scale), y)
            middle, deviation = float(y.mean()), float(y.std()) or 1.0
            process = fit_values(U[known], (y - middle) / deviation, **self._start(f"objective {j}"))
            fitted[f"objective {j}"] = process.theta
            self._objectives.append((process, middle, deviation))
        self._violation: GaussianProcess | None = None
        violation = evaluations.violation
        if (violation > 0).any():
            seen = _nearest(U, np.arange(len(U)), problem.to_unit(archive.X))
            root = np.sqrt(violation[seen] / np.median(violation[violation > 0]))
            self._violation = fit_censored(U[seen], np.minimum(root, _LARGEST), **self._start("violation"))
            fitted["violation"] = self._violation.theta

    def _start(self, name: str) -> dict:
        return {"start": self._fitted.get(name), "iterations": _AGAIN if name in self._fitted else _FIRST}

    def at(self, U: NDArray[np.float64]) -> Belief:
        """Return what is believed of designs (k, d)."""
        X = self.problem.from_unit(U)
        mean = np.zeros((len(U), self.problem.m))
        predictions: list[tuple[int, Prediction, float]] = []
        for j, (objective, model) in enumerate(zip(self.problem.objectives, self._objectives, strict=True)):
            if objective.exact is not None:
                mean[:, j] = np.asarray(objective.exact(X), dtype=float).reshape(-1)
            elif model is not None:
                process, middle, deviation = model
                prediction = process.predict(U)
                mean[:, j] = middle + deviation * prediction.mean
                predictions.append((j, prediction, deviation))
        return Belief(mean, predictions, None if self._violation is None else self._violation.predict(U))


class Belief:
    """What is believed of some designs, and how it changes where one of them will be evaluated.

    Attributes
    ----------
    mean : ndarray, shape (k, m)
        Objectives expected.
    violation : Prediction or None
        Of the scaled violation, negative where valid; None where no invalid design is known.
    """

    def __init__(
        self,
        mean: NDArray[np.float64],
        predictions: list[tuple[int, Prediction, float]],
        violation: Prediction | None,
    ) -> None:
        self.mean, self.violation = mean, violation
        self._predictions = predictions

    @property
    def deviation(self) -> NDArray[np.float64]:
        """Standard deviations of the objectives, (k, m); 0 where known exactly."""
        deviation = np.zeros_like(self.mean)
        for j, prediction, scale in self._predictions:
            deviation[:, j] = scale * np.sqrt(prediction.variance)
        return deviation

    @property
    def valid(self) -> NDArray[np.float64]:
        """Probabilities of being valid, (k,)."""
        return np.ones(len(self.mean)) if self.violation is None else below_zero(self.violation)

    def expect(self, place: int) -> None:
        """Take one design as evaluated, with what is expected of it."""
        for _, prediction, _ in self._predictions:
            prediction.expect(place)
        if self.violation is not None:
            self.violation.expect(place)


def _nearest(U: NDArray[np.float64], index: NDArray[np.intp], best: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return of some evaluations those a model is fitted to, in their order: the nearest to the best, or the latest."""
    if len(index) <= _MOST:
        return index
    if not len(best):
        return index[-_MOST:]
    distance = np.array([((best - u) ** 2).sum(axis=1).min() for u in U[index]])
    return np.sort(index[np.argsort(distance, kind="stable")[:_MOST]])
