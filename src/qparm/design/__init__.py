"""Design: which arm for a surface. Variables, objectives, engines that search, and what their findings mean."""

from qparm.design.archive import Archive, crowding, hypervolume, knee, non_dominated, reference_point
from qparm.design.engines import METHODS, Engine, make_engine
from qparm.design.problem import Evaluations, Objective, Outcome, Problem, Variable
from qparm.design.stop import ActiveBound, active_bounds, extended, stalled
from qparm.design.valid_region import ValidBox, valid_box

__all__ = [
    "METHODS",
    "ActiveBound",
    "Archive",
    "Engine",
    "Evaluations",
    "Objective",
    "Outcome",
    "Problem",
    "ValidBox",
    "Variable",
    "active_bounds",
    "crowding",
    "extended",
    "hypervolume",
    "knee",
    "make_engine",
    "non_dominated",
    "reference_point",
    "stalled",
    "valid_box",
]


def __dir__() -> list[str]:
    return sorted(__all__)
