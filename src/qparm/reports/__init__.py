"""Reports: what is said of a plan, of a cell and of a workspace, as data and as text."""

from typing import TYPE_CHECKING

from qparm.lazy_names import on_demand

if TYPE_CHECKING:
    from qparm.reports.check import check_cell, check_text
    from qparm.reports.plan import Report, report
    from qparm.reports.workspace import workspace_text

__all__ = ["Report", "check_cell", "check_text", "report", "workspace_text"]

__getattr__, __dir__ = on_demand(
    __name__,
    {
        "Report": "plan",
        "check_cell": "check",
        "check_text": "check",
        "report": "plan",
        "workspace_text": "workspace",
    },
    __all__,
)
