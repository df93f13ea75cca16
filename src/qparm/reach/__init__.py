"""What an arm can reach: proofs, verdicts with reasons, many arms at once, coverage, margins and the workspace."""

from typing import TYPE_CHECKING

from qparm.lazy_names import on_demand
from qparm.reach.verdict import Reach, ReachReason, check_reach

if TYPE_CHECKING:
    from qparm.reach.many_arms import DesignReach, reach_of_designs
    from qparm.reach.margin import AttainableMargin, attainable_margin

__all__ = [
    "AttainableMargin",
    "DesignReach",
    "Reach",
    "ReachReason",
    "attainable_margin",
    "check_reach",
    "reach_of_designs",
]

__getattr__, __dir__ = on_demand(
    __name__,
    {
        "AttainableMargin": "margin",
        "DesignReach": "many_arms",
        "attainable_margin": "margin",
        "reach_of_designs": "many_arms",
    },
    __all__,
)
