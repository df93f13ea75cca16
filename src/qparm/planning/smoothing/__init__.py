"""Smoothing of whole paths by banded convex subproblems, and the turns between rows."""

from typing import TYPE_CHECKING

from qparm.lazy_names import on_demand

if TYPE_CHECKING:
    from qparm.planning.smoothing.smooth_path import smooth_solution, smoothest

__all__ = ["smooth_solution", "smoothest"]

__getattr__, __dir__ = on_demand(
    __name__,
    {
        "smooth_solution": "smooth_path",
        "smoothest": "smooth_path",
    },
    __all__,
)
