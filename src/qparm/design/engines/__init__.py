"""Engines: ways of choosing which designs to evaluate next, all asked and told alike."""

from __future__ import annotations

from qparm.design.engines.engine import Engine
from qparm.design.engines.grid import GridEngine
from qparm.design.engines.hybrid import HybridEngine
from qparm.design.engines.sobol import SobolEngine
from qparm.design.engines.swarm import SwarmEngine
from qparm.design.engines.two_steps import TwoStepEngine
from qparm.design.problem import Problem
from qparm.errors import InvalidInput

__all__ = ["METHODS", "Engine", "make_engine"]

_ENGINES: dict[str, type[Engine]] = {
    engine.method: engine for engine in (HybridEngine, SwarmEngine, TwoStepEngine, GridEngine, SobolEngine)
}
METHODS = tuple(_ENGINES)


def make_engine(method: str, problem: Problem, *, seed: int, budget: int) -> Engine:
    """Return an engine by name.

    Parameters
    ----------
    method : str
        ``hybrid`` (the default elsewhere: models choose among a swarm's moves), ``mopso`` (Coello's swarm), ``paper``
        (the paper's), ``grid`` (the whole map) or ``sobol``.
    problem : Problem
    seed : int
    budget : int
        Evaluations in all.

    Raises
    ------
    InvalidInput
        An unknown name, a budget that does not do.
    """
    if method not in _ENGINES:
        raise InvalidInput(f"no method is called {method!r}; there are {', '.join(METHODS)}")
    return _ENGINES[method](problem, seed=seed, budget=budget)


def __dir__() -> list[str]:
    return sorted(__all__)
