"""A planner of your own: a function from poses to configurations, held to the same account as ours."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from qparm.errors import InvalidInput
from qparm.ik import PoseStatus, StepCounts
from qparm.path import ToolPath
from qparm.planning.paper.general import PointRecord, TrackRecord
from qparm.planning.solution import PathSolution, driven_edges

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.planning.problem import PathProblem
    from qparm.robot import SerialChain

__all__ = ["Planner", "plan_by"]

Planner = Callable[["SerialChain", ToolPath, "NDArray[np.float64]", np.random.Generator], "NDArray[np.float64]"]


def plan_by(planner: Planner, problem: PathProblem) -> tuple[PathSolution, TrackRecord]:
    """Return a planner's configurations, each checked against its pose.

    Parameters
    ----------
    planner : callable
        ``planner(chain, tool_path, home, rng)`` returns (P, n) configurations, one for each point of
        ``tool_path.poses``; NaN in a row means that the planner has none.
    problem : PathProblem
        A configuration counts as reached within its tolerances and the limits, whatever the planner says. The
        generator that is handed to the planner is seeded with its seed.

    Returns
    -------
    solution : PathSolution
    record : TrackRecord

    Raises
    ------
    InvalidInput
        If the planner returns something else than (P, n) numbers.
    """
    chain, tool_path, home = problem.chain, problem.tool_path, problem.home
    q = np.asarray(planner(chain, tool_path, home, problem.rng(0)), dtype=float)
    P = tool_path.point_count
    if q.shape != (P, chain.n):
        raise InvalidInput(f"the planner must return ({P}, {chain.n}) configurations, not {q.shape}")
    there = np.asarray(np.isfinite(q).all(axis=1))
    q = np.where(there[:, None], q, home)
    E = chain.pose_error(chain.forward(q), tool_path.poses)
    position, rotation = np.linalg.norm(E[:, :3], axis=1), np.linalg.norm(E[:, 3:], axis=1)
    exact = (position <= problem.position_tolerance) & (rotation <= problem.rotation_tolerance)
    reached = there & exact & chain.within_limits(q).all(axis=1)
    record = TrackRecord(
        points=tuple(
            PointRecord(
                PoseStatus.REACHED if reached[k] else PoseStatus.NOT_CONVERGED,
                float(position[k]),
                float(rotation[k]),
                0,
                (),
            )
            for k in range(P)
        ),
        q_end=q,
        counts=StepCounts(),
        start_solutions=0,
    )
    return PathSolution(q, np.zeros((P, 3)), reached, driven_edges(q, reached, problem.criteria)), record
