"""The default engine: a swarm's moves, chosen by what models expect of them.

Gaussian processes predict the objectives that need an evaluation; those known exactly are taken as they are. A third
process follows the graded violation and tells how likely a design is to be valid. A batch is picked one design at a
time: the largest expected gain of hypervolume times the probability of being valid, each pick counted as evaluated
with the values expected of it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from qparm.design.archive import Archive, crowding, free_boxes, non_dominated, reference_point
from qparm.design.engines.engine import Engine
from qparm.design.engines.gaussian_process import Prediction, below_zero, fit_censored, fit_values
from qparm.design.engines.improvement import expected_gain, expected_shortfall
from qparm.design.engines.sobol import sobol_points
from qparm.design.problem import Problem

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["HybridEngine"]

_CANDIDATES = 1500
_NEAREST_CHOSEN, _NEAREST_EVALUATED = 5e-3, 2e-3
_MOST = 350


class HybridEngine(Engine):
    """Swarm moves and models."""

    method = "hybrid"
    GAMMA = 1.0
    POWER = 0.5
    START = 3
    CANDS = 1500
    ROUNDS = 2
    MORE = 250
    TOP = 12
    REF = 0.1
    CLIP = 0.0
    INFLATE = 0.0

    def __init__(self, problem: Problem, *, seed: int, budget: int) -> None:
        super().__init__(problem, seed=seed, budget=budget)
        self._points = sobol_points(problem.d, budget, self.rng)
        self._begun = 0
        self._theta = {}

    def _propose(self, n: int) -> NDArray[np.float64]:
        if self._begun < max(self.START * (self.problem.d + 1), 8) or not self.evaluated:
            self._begun += n
            return self._points[self._begun - n : self._begun]
        return self._chosen(n)

    def _models(self, U):
        e = self.evaluations
        d = U.shape[1]
        m = self.problem.m
        known = e.known
        models = []
        for j, o in enumerate(self.problem.objectives):
            if o.exact is not None:
                models.append(None)
                continue
            y = e.F[known, j]
            if len(y) == 0:
                models.append(None)
                continue
            if self.CLIP and len(self.archive) > 1:
                r = reference_point(self.archive.F)[j]
                x = self.CLIP * (r - self.archive.F[:, j].min())
                y = np.where(y > r, r + x * np.log1p(np.maximum(y - r, 0) / x), y)
            mu, s = y.mean(), y.std()
            s = s if s > 0 else 1.0
            gp = fit_values(U[known], (y - mu) / s, start=self._theta.get(j), iterations=15 if j in self._theta else 40)
            self._theta[j] = gp.theta
            models.append((gp, mu, s))
        v = e.violation
        valid_model = None
        if (v > 0).any():
            scale = np.median(v[v > 0])
            y = (v / scale) ** self.POWER
            y = np.minimum(y, 3.0)
            valid_model = fit_censored(U, y, start=self._theta.get("v"), iterations=15 if "v" in self._theta else 40)
            self._theta["v"] = valid_model.theta
        return models, valid_model

    def _candidates(self, U, A, count):
        d = U.shape[1]
        rng = self.rng
        parts = [sobol_points(d, count // 3, rng)]
        base = A if len(A) else U[np.argsort(self.evaluations.violation, kind="stable")[:5]]
        pick = rng.integers(len(base), size=count // 3)
        steps = 10.0 ** rng.uniform(-2.3, -0.5, (count // 3, 1)) * rng.standard_normal((count // 3, d))
        steps *= rng.random((count // 3, d)) < rng.uniform(0.3, 1.0, (count // 3, 1))
        parts.append(base[pick] + steps)
        a, b, c = (base[rng.integers(len(base), size=count // 3)] for _ in range(3))
        parts.append(a + rng.uniform(0.2, 1.2, (count // 3, 1)) * (b - c) + 0.01 * rng.standard_normal((count // 3, d)))
        return np.clip(np.vstack(parts), 0, 1)

    def _score(self, C, models, valid_model, boxes):
        X = self.problem.from_unit(C)
        preds = [None if mm is None else mm[0].predict(C) for mm in models]
        vp = None if valid_model is None else valid_model.predict(C)
        return preds, vp, X

    def _values(self, X, preds, vp, models, boxes, C):
        k = len(X)
        p = np.ones(k) if vp is None else below_zero(vp)
        if boxes is None:
            if vp is None:
                return p
            e = self.evaluations
            return expected_shortfall(np.zeros(1), vp.mean, np.sqrt(vp.variance))
        mean = np.empty((k, self.problem.m))
        dev = np.zeros_like(mean)
        for j, o in enumerate(self.problem.objectives):
            if o.exact is not None:
                mean[:, j] = o.exact(X)
            else:
                gp, mu, s = models[j]
                mean[:, j] = mu + s * preds[j].mean
                dev[:, j] = s * np.sqrt(preds[j].variance)
        gain = expected_gain(*boxes, mean, dev)
        return gain * p**self.GAMMA, mean

    def _chosen(self, n):
        e = self.evaluations
        U = self.problem.to_unit(e.X)
        models, valid_model = self._models(U)
        front = self.archive.F
        A = self.problem.to_unit(self.archive.X)
        has = len(front) > 0
        if has:
            reference = reference_point(front)
            if self.REF == 'wide':
                Fk = e.F[e.known]; reference = np.maximum(reference, Fk.max(axis=0) + 1e-6)
            elif self.REF == 'half':
                Fk = e.F[e.known]; reference = 0.5*(reference + np.maximum(reference, Fk.max(axis=0)))
            boxes = free_boxes(front, reference)
        else:
            boxes = None
        C = self._candidates(U, A, self.CANDS)

        def val(C):
            preds, vp, X = self._score(C, models, valid_model, boxes)
            out = self._values(X, preds, vp, models, boxes, C)
            return preds, vp, X, out

        for rnd in range(self.ROUNDS):
            preds, vp, X, out = val(C)
            s = out[0] if has else out
            top = C[np.argsort(-s, kind="stable")[:self.TOP]]
            more = top[self.rng.integers(len(top), size=self.MORE)] + 10.0 ** self.rng.uniform(-2.5, -1.0, (self.MORE, 1)) * self.rng.standard_normal(
                (self.MORE, C.shape[1])
            )
            C = np.clip(np.vstack([C[np.argsort(-s, kind="stable")[:1000]], more]), 0, 1)
        preds, vp, X, out = val(C)
        pend = self.problem.to_unit(np.array(self._pending)) if self._pending else np.empty((0, C.shape[1]))
        near = np.vstack([U, pend])
        ok = np.ones(len(C), bool)
        for u in near:
            ok &= np.abs(C - u).max(axis=1) > _NEAREST_EVALUATED
        picks = []
        wide = None
        if has and self.REF == 'alternate':
            Fk = e.F[e.known]; wide = np.maximum(reference, Fk.max(axis=0) + 1e-6)
        narrow = reference if has else None
        for t in range(n):
            if wide is not None:
                reference = wide if t % 2 else narrow
                boxes = free_boxes(front, reference)
                out = self._values(X, preds, vp, models, boxes, C)
            s, mean = out if has else (out, None)
            s = np.where(ok, s, -1)
            i = int(np.argmax(s))
            picks.append(i)
            ok &= np.abs(C - C[i]).max(axis=1) > _NEAREST_CHOSEN
            for pr in (*preds, vp):
                if pr is not None:
                    pr.expect(i)
            if has:
                front = np.vstack([front, mean[i]])
                boxes = free_boxes(front, reference)
            out = self._values(X, preds, vp, models, boxes, C)
        return C[picks]
