"""The general method: the paper's step 1 alone, from point to point with a warm start.

It is the baseline that the paper compares with (its figures 13 to 15): no restarts inside the path, no
look-ahead. Where it fails it says so: unreached points are recorded and left out, jumps are recorded and
bridged by a break, and nothing is smoothed over.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from qparm.ik import Method, PoseSolution, PoseSolver, PoseStatus, StepCounts, StepRule, StepSolver
from qparm.ik.solve import active_limits
from qparm.planning.solution import PathSolution, driven_edges

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.planning.problem import PathProblem

__all__ = ["PointRecord", "TrackRecord", "points_of", "track"]

# How many random solutions of the first pose compete to be the start; the paper's number for reverse planning.
START_CANDIDATES = 50


@dataclass(frozen=True)
class PointRecord:
    """What the planner saw at one point of the tool path.

    Attributes
    ----------
    status : PoseStatus
    position_error, rotation_error : float
        Where the iteration ended (m, rad).
    iterations : int
    active_limits : tuple of str
        Joints at a position limit at the end.
    """

    status: PoseStatus
    position_error: float
    rotation_error: float
    iterations: int
    active_limits: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class TrackRecord:
    """What the planner did; the report's figures about the path come from the path, not from here.

    Attributes
    ----------
    points : tuple of PointRecord
        One for each point of the tool path.
    q_end : (P, n) ndarray
        Where the iteration ended at each point, reached or not.
    counts : StepCounts
        How all steps were answered.
    start_solutions : int
        How many of the random starts solved the first pose.
    traces : tuple of (k, n) ndarray
        Configurations at which steps were formed, for each point; empty unless asked for.
    """

    points: tuple[PointRecord, ...]
    q_end: NDArray[np.float64] = field(repr=False)
    counts: StepCounts
    start_solutions: int
    traces: tuple[NDArray[np.float64], ...] = field(repr=False, default=())

    @property
    def unreached(self) -> NDArray[np.int64]:
        """Indices of the points that were not reached."""
        return np.flatnonzero([point.status is not PoseStatus.REACHED for point in self.points])


def track(
    problem: PathProblem,
    *,
    method: Method | StepRule = "cwln",
    solver: str | StepSolver = "auto",
    keep_traces: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[PathSolution, TrackRecord]:
    """Choose configurations by following the tool path from point to point.

    The first configuration is the one farthest from its limits among the solutions of 50 random starts
    (the paper does not say where it begins); every other pose starts from the configuration at which the
    pose before it ended, reached or not.

    Parameters
    ----------
    problem : PathProblem
        The search starts at its home if no random start solves the first pose; steps are judged by the criteria with
        its feed.
    method, solver
        See :class:`qparm.ik.PoseSolver`.
    keep_traces : bool
        Keep the configurations of every iteration in the record.
    progress : callable, optional
        ``progress(done, total)``, called after each row with counts of points.

    Returns
    -------
    solution : PathSolution
    record : TrackRecord
    """
    chain, tool_path = problem.chain, problem.tool_path
    pose_solver = PoseSolver(
        chain,
        method=method,
        solver=solver,
        position_tolerance=problem.position_tolerance,
        rotation_tolerance=problem.rotation_tolerance,
        keep_trace=keep_traces,
    )
    poses, row_of_point = tool_path.poses, tool_path.row_of_point
    q, counts, start_solutions = _first_configuration(problem, pose_solver, poses[0])
    solutions: list[PoseSolution] = []
    for row in range(len(tool_path.rows)):
        for k in np.flatnonzero(row_of_point == row):
            solution = pose_solver.solve(poses[k], q)
            q = solution.q
            solutions.append(solution)
        if row < len(tool_path.transitions):
            # the transition's poses too: the next row starts from where the arm then is
            for pose in tool_path.transition_poses(row):
                via = pose_solver.solve(np.ascontiguousarray(pose), q)
                q, counts = via.q, counts + via.counts
        if progress is not None:
            progress(len(solutions), len(poses))
    for solution in solutions:
        counts += solution.counts
    record = TrackRecord(
        points=tuple(
            PointRecord(s.status, s.position_error, s.rotation_error, s.iterations, s.active_limits) for s in solutions
        ),
        q_end=np.array([s.q for s in solutions]),
        counts=counts,
        start_solutions=start_solutions,
        traces=tuple(s.trace for s in solutions) if keep_traces else (),
    )
    q_of_points = np.array([s.q for s in solutions])
    reached = np.array([s.reached for s in solutions])
    rho = np.zeros((len(q_of_points), 3))
    return PathSolution(q_of_points, rho, reached, driven_edges(q_of_points, reached, problem.criteria_by_feed)), record


def _first_configuration(
    problem: PathProblem, pose_solver: PoseSolver, pose: NDArray[np.float64]
) -> tuple[NDArray[np.float64], StepCounts, int]:
    """Return the solution farthest from its limits, home if there is none."""
    best, best_margin, counts, found = problem.home, -np.inf, StepCounts(), 0
    for q_start in problem.chain.random(problem.rng(0), START_CANDIDATES):
        solution = pose_solver.solve(pose, q_start)
        counts += solution.counts
        if not solution.reached:
            continue
        found += 1
        margin = float(problem.chain.distance_to_limits(solution.q))
        if margin > best_margin:
            best, best_margin = solution.q, margin
    return best, counts, found


def points_of(problem: PathProblem, solution: PathSolution) -> TrackRecord:
    """Return the record of a strategy that solves points as a whole: errors measured, no iterations counted."""
    chain = problem.chain
    targets = problem.relaxation.targets(problem.tool_path.poses, solution.rho)
    E = chain.pose_error(chain.forward(solution.q), targets)
    position, rotation = np.linalg.norm(E[:, :3], axis=1), np.linalg.norm(E[:, 3:], axis=1)
    points = tuple(
        PointRecord(PoseStatus.REACHED, float(position[k]), float(rotation[k]), 0, active_limits(chain, solution.q[k]))
        if solution.reached[k]
        else PointRecord(PoseStatus.NOT_CONVERGED, float("nan"), float("nan"), 0, ())
        for k in range(len(solution.q))
    )
    return TrackRecord(points=points, q_end=solution.q, counts=StepCounts(), start_solutions=0)
