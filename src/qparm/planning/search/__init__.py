"""The graph strategy: samples of every pose, dynamic programming over them, and what follows a row."""

from typing import TYPE_CHECKING

from qparm.lazy_names import on_demand

if TYPE_CHECKING:
    from qparm.planning.search.continuation import joined_rows
    from qparm.planning.search.continuity import driven_where_followed
    from qparm.planning.search.filling import FilledPath, filled
    from qparm.planning.search.graph_search import graph, graph_relaxed
    from qparm.planning.search.sampling import Sampling

__all__ = ["FilledPath", "Sampling", "driven_where_followed", "filled", "graph", "graph_relaxed", "joined_rows"]

__getattr__, __dir__ = on_demand(
    __name__,
    {
        "FilledPath": "filling",
        "Sampling": "sampling",
        "driven_where_followed": "continuity",
        "filled": "filling",
        "graph": "graph_search",
        "graph_relaxed": "graph_search",
        "joined_rows": "continuation",
    },
    __all__,
)
