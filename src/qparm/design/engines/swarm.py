"""The multi-objective particle swarm of Coello, Pulido and Lechuga (2004)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from qparm.design.engines.engine import Engine
from qparm.design.engines.sobol import sobol_points
from qparm.design.problem import Problem

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["SwarmEngine", "better", "roulette"]

# Coello's inertia; the weights of own best and leader are drawn from [0, 1].
_INERTIA = 0.4
_CELLS = 10
_MUTATION = 0.5


class SwarmEngine(Engine):
    """Particles that follow their own best design and one of the archive.

    The leader is drawn by roulette: a cell of a grid over the objectives, the likelier the fewer archived designs it
    holds, then one of these at random. Positions beyond the range stop at its end and turn back. Mutation reaches over
    the whole range at first and fades with the budget. Of two designs the valid one is better, of two invalid ones
    that of less violation. Particles move in turn, so any number can be asked for at once.
    """

    method = "mopso"
    size = 20

    def __init__(self, problem: Problem, *, seed: int, budget: int) -> None:
        super().__init__(problem, seed=seed, budget=budget)
        self.low, self.high = np.zeros(problem.d), np.ones(problem.d)
        self.position = sobol_points(problem.d, self.size, self.rng)
        self.velocity = np.zeros_like(self.position)
        # Place of each particle's best design in the evaluations; -1 before its first.
        self.best = np.full(self.size, -1)
        self._moves = 0
        self._flying: list[tuple[NDArray[np.float64], int]] = []

    def _propose(self, n: int) -> NDArray[np.float64]:
        particles = [(self._moves + k) % self.size for k in range(n)]
        for particle in particles:
            if self._moves >= self.size:
                self._move(particle)
            self._moves += 1
            place = self.problem.from_unit(self.position[particle : particle + 1])[0]
            self._flying.append((place, particle))
        return np.array([self.problem.to_unit(place) for place, _ in self._flying[-n:]])

    def _move(self, particle: int) -> None:
        u, rng = self.position[particle], self.rng
        velocity = _INERTIA * self.velocity[particle]
        if self.best[particle] >= 0:
            velocity += rng.random(len(u)) * (self._place(self.best[particle]) - u)
        leader = self._leader()
        if leader is not None:
            velocity += rng.random(len(u)) * (self._place(leader) - u)
        velocity += self._push(u)
        moved = u + velocity
        moved = self._mutated(moved)
        inside = np.clip(moved, self.low, self.high)
        self.velocity[particle] = np.where(inside == moved, velocity, -velocity)
        self.position[particle] = inside

    def _place(self, index: int) -> NDArray[np.float64]:
        return self.problem.to_unit(self.evaluations.X[index])

    def _leader(self) -> int | None:
        if len(self.archive):
            return int(self.archive.index[roulette(self.archive.F, self.rng)])
        return int(np.argmin(self.evaluations.violation)) if self.evaluated else None

    def _push(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return what else changes the velocity of a particle at u."""
        return np.zeros_like(u)

    def _mutated(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return a position of which one coordinate may be drawn anew (Coello 2004, Fig. 4)."""
        left = max(0.0, 1.0 - self._moves / self.budget) ** (5.0 / _MUTATION)
        if self.rng.random() < left:
            k = self.rng.integers(len(u))
            reach = (self.high[k] - self.low[k]) * left
            u[k] = self.rng.uniform(max(self.low[k], u[k] - reach), max(self.low[k], min(self.high[k], u[k] + reach)))
        return u

    def _observe(self, first: int) -> None:
        for index in range(first, self.evaluated):
            row = self.evaluations.X[index]
            for k, (place, particle) in enumerate(self._flying):
                if np.array_equal(row, place):
                    del self._flying[k]
                    best = self.best[particle]
                    if best < 0 or self._better(index, best):
                        self.best[particle] = index
                    break

    def _better(self, a: int, b: int) -> bool:
        e = self.evaluations
        verdict = better(e.violation[a], e.F[a], e.violation[b], e.F[b])
        return bool(self.rng.random() < 0.5) if verdict is None else verdict

    def _extended(self, previous: Problem) -> None:
        old = previous.upper - previous.lower
        new = self.problem.upper - self.problem.lower
        self.position = self.problem.to_unit(previous.from_unit(self.position))
        self.velocity = self.velocity * old / new


def better(
    violation_a: float, a: NDArray[np.float64], violation_b: float, b: NDArray[np.float64]
) -> bool | None:
    """Return whether design a is better than b; None where neither is (objectives NaN where not known)."""
    if violation_a != violation_b:
        return bool(violation_a < violation_b)
    if np.isnan(a).any() or np.isnan(b).any():
        return None if np.isnan(a).any() == np.isnan(b).any() else bool(np.isnan(b).any())
    if np.all(a <= b) and np.any(a < b):
        return True
    return False if np.all(b <= a) and np.any(b < a) else None


def roulette(F: NDArray[np.float64], rng: np.random.Generator) -> int:
    """Return a row of a front (n, m), lonely ones likelier: 10 / count weighs each cell of a grid that holds any."""
    extent = np.ptp(F, axis=0)
    cell = np.floor((F - F.min(axis=0)) / np.where(extent > 0, extent, 1.0) * (_CELLS - 1e-9)).astype(int)
    _, place, count = np.unique(cell, axis=0, return_inverse=True, return_counts=True)
    weight = 10.0 / count
    chosen = rng.choice(len(count), p=weight / weight.sum())
    return int(rng.choice(np.flatnonzero(place.reshape(-1) == chosen)))
