"""The curve between the points: exact on rows, flowing at row ends, resting at corners."""

from typing import TYPE_CHECKING

from qparm.lazy_names import on_demand

if TYPE_CHECKING:
    from qparm.planning.interpolation.corners import rest_at_corners
    from qparm.planning.interpolation.exact import beyond_limits, inset

__all__ = ["beyond_limits", "inset", "rest_at_corners"]

__getattr__, __dir__ = on_demand(
    __name__,
    {
        "beyond_limits": "exact",
        "inset": "exact",
        "rest_at_corners": "corners",
    },
    __all__,
)
