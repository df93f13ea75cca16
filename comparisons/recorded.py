"""The IK steps that a plan made at its points, formed again from its recorded configurations.

Those of the random starts of the first pose and of the via poses at row ends are not recorded.
"""

from __future__ import annotations

import qparm
from qparm.ik import StepProblem, step_problem

__all__ = ["recorded_steps"]


def recorded_steps(plan: qparm.Plan, *, limit: int | None = None) -> list[StepProblem]:
    """Return the steps of a plan that was made with ``keep_traces=True``, evenly thinned to ``limit``."""
    pairs = [(q, pose) for trace, pose in zip(plan.record.traces, plan.tool_path.poses, strict=True) for q in trace]
    if limit is not None and limit < len(pairs):
        pairs = [pairs[round(k * (len(pairs) - 1) / (limit - 1))] for k in range(limit)]
    return [step_problem(plan.chain, q, pose, method=plan.options.method) for q, pose in pairs]
