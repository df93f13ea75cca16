"""The paper's strategies: the general method, self-motion and reverse planning, and its jump criterion."""

from typing import TYPE_CHECKING

from qparm.lazy_names import on_demand

if TYPE_CHECKING:
    from qparm.planning.paper.general import track
    from qparm.planning.paper.jump import jump_criteria
    from qparm.planning.paper.reverse_record import ReverseStatistics

__all__ = ["ReverseStatistics", "jump_criteria", "track"]

__getattr__, __dir__ = on_demand(
    __name__,
    {
        "ReverseStatistics": "reverse_record",
        "jump_criteria": "jump",
        "track": "general",
    },
    __all__,
)
