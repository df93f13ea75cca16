"""Measures of a design by planning it: the paper's count of singularities, and a complete plan."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from qparm.cell import Cell
    from qparm.path import ToolPath

__all__ = ["counted_measures", "planned_measures"]


def counted_measures(cell: Cell, tool_path: ToolPath, *, seed: int) -> dict[str, float]:
    """Return ``singularities``: the jumps that the paper's planner (:mod:`qparm.planning.paper.reverse`) meets.

    The seed's second objective. A run per design, each from the same random draws; it depends on them more than on the
    design.
    """
    from qparm.planning import LIMIT_MARGIN, inset, problem_of
    from qparm.planning.paper.reverse import reverse

    problem = replace(problem_of(cell, seed=seed), tool_path=tool_path)
    found = reverse(replace(problem, chain=inset(problem.chain, LIMIT_MARGIN)))
    return {"singularities": float(len(found.statistics.jumps))}


def planned_measures(cell: Cell, *, seed: int) -> dict[str, Any]:
    """Return the measures of a whole plan by the graph strategy, with smoothing and timing.

    Returns
    -------
    dict
        ``cycle_time`` (s), ``planned_reconfigurations``, ``planned_largest_step`` (rad, velocity-scaled),
        ``planned_unreached``, ``planned_margin`` (the least smallest singular value along the path).
    """
    from qparm.pipeline import plan
    from qparm.planning import largest_step

    planned = plan(cell, seed=seed)
    solution, chain = planned.solution, planned.chain
    inside, at_ends = solution.reconfigurations(planned.tool_path)
    J = chain.scaled_jacobian(solution.q[solution.reached])
    margin = np.sqrt(np.maximum(np.linalg.eigvalsh(J @ J.transpose(0, 2, 1))[:, 0], 0.0))
    return {
        "cycle_time": float(planned.trajectory.duration),
        "planned_reconfigurations": float(inside + at_ends),
        "planned_largest_step": float(largest_step(chain, solution)),
        "planned_unreached": float((~solution.reached).sum()),
        "planned_margin": float(margin.min()) if len(margin) else 0.0,
    }
