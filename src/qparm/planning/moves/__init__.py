"""Motions off the path: escapes, detours, and the clearance that they keep."""

from typing import TYPE_CHECKING

from qparm.lazy_names import on_demand

if TYPE_CHECKING:
    from qparm.planning.moves.breaks import Motion, MotionFailure, plan_motion

__all__ = ["Motion", "MotionFailure", "plan_motion"]

__getattr__, __dir__ = on_demand(
    __name__,
    {
        "Motion": "breaks",
        "MotionFailure": "breaks",
        "plan_motion": "breaks",
    },
    __all__,
)
