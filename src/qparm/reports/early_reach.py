"""Points out of reach, named before a plan is searched: proofs for all, and a short search for the others."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from qparm.reach import Reach, ReachReason, check_reach
from qparm.reach.relaxed_bound import relaxed_excess
from qparm.reports.check import missed_lines

if TYPE_CHECKING:
    from qparm.cell import Cell

__all__ = ["early_lines"]

# Points looked at together: one that no start reaches takes a third of a second, all others next to nothing.
_BATCH = 16
# So many points that are missed without a proof end the search; so many rows have their points listed.
_ENOUGH, _LISTED = 5, 5


def early_lines(cell: Cell, *, seed: int = 0) -> tuple[str, ...]:
    """Return what is known of points out of reach before a plan is begun; nothing if every point is within reach.

    Points that the links cannot reach are all found, by proof. Those that joint limits or the tool's orientation put
    out of reach are looked for until a few are found.
    """
    chain, tool_path, process = cell.chain(), cell.tool_path(), cell.process
    poses, relaxation = tool_path.poses, cell.relaxation()
    rng = np.random.default_rng([seed, 1])
    far, near = relaxed_excess(chain, poses, relaxation)
    reasons = [ReachReason.TOO_FAR if one > 0 else ReachReason.TOO_NEAR for one in far]
    excess = np.maximum(far, near)
    verdicts = [
        Reach(reason, float(by), relaxation.words) if by > 0 else Reach(ReachReason.WITHIN_REACH)
        for reason, by in zip(reasons, excess, strict=True)
    ]
    open_points = np.flatnonzero(excess <= 0)
    searched, found = 0, 0
    while searched < len(open_points) and found < _ENOUGH:
        part = open_points[searched : searched + _BATCH]
        said = check_reach(
            chain, poses[part], rng=rng, relaxation=relaxation, position_tolerance=process.position_tolerance,
            rotation_tolerance=process.rotation_tolerance,
        )  # fmt: skip
        for index, verdict in zip(part, said, strict=True):
            verdicts[index] = verdict
        found += sum(verdict.reason is not ReachReason.WITHIN_REACH for verdict in said)
        searched += len(part)
    missed = sum(one.reason is not ReachReason.WITHIN_REACH for one in verdicts)
    if not missed:
        return ()
    lines = missed_lines(tool_path, verdicts)
    least = "at least " if searched < len(open_points) else ""
    return (
        f"{least}{missed} of {len(poses)} points are out of reach (all of them: qparm check):",
        *(f"  {line}" for line in lines[:_LISTED]),
        *([f"  and {len(lines) - _LISTED} more lines like these"] if len(lines) > _LISTED else []),
    )
