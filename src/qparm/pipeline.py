"""The pipeline: cell to trajectory, the stages in order. No files, no printing."""

from __future__ import annotations

import operator
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

from qparm.cell import Cell
from qparm.errors import InvalidInput

if TYPE_CHECKING:
    from qparm.ik import Reach, StepRule, StepSolver
    from qparm.path import JointPath, ToolPath, Trajectory
    from qparm.planning import (
        BreakRecord,
        GraphRecord,
        PathSolution,
        Planner,
        ReverseStatistics,
        SmoothRecord,
        TrackRecord,
    )
    from qparm.robot import SerialChain
    from qparm.verify import Verdict

__all__ = ["Options", "Plan", "plan"]

Strategy = Literal["graph", "reverse", "general"]
MethodName = Literal["cwln", "wln", "gpm", "dls"]
TimingForm = Literal["quintic", "ruckig"]

# Poses are solved to this share of the cell's tolerances (one more iteration): the rest is for what comes after.
_MARGIN = 0.01
# Velocity-scaled distance from the joint limits at which rows and turns are planned that flow into each other (rad).
_TURN_MARGIN = 5e-3
# ... and other paths: Ruckig misses positions by 1e-8, which must not lead beyond a limit that a joint rests at.
_MISSED = 2e-7

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Options:
    """How a cell is planned.

    Attributes
    ----------
    strategy : {"graph", "reverse", "general"}
        ``graph``: the whole path at once, over samples of every pose's solutions. ``reverse``: the paper's improved
        strategy. ``general``: the paper's baseline, from point to point with a warm start.
    method : {"cwln", "wln", "gpm", "dls"}
        The IK step of ``reverse`` and ``general``.
    solver : str
        ``auto``: closed form, else the compiled active set; any other name sends every step of ``reverse`` and
        ``general`` to that QP solver.
    smooth : bool
        Whether the path is smoothed as a whole.
    for_linear : bool
        Add waypoints until linear joint interpolation keeps the tolerances between points too.
    timing : {"quintic", "ruckig"}
    seed : int
        Seed of every random draw; the same seed gives the same plan.
    """

    strategy: str = "graph"
    method: str = "cwln"
    solver: str = "auto"
    smooth: bool = True
    for_linear: bool = False
    timing: str = "quintic"
    seed: int = 0

    def __post_init__(self) -> None:
        try:
            seed = operator.index(self.seed)
        except TypeError:
            seed = -1
        if isinstance(self.seed, bool) or seed < 0:
            raise InvalidInput(f"seed must be an integer from 0, not {self.seed!r}")
        object.__setattr__(self, "seed", seed)


@dataclass(frozen=True, eq=False)
class Plan:
    """A planned cell.

    Attributes
    ----------
    cell : Cell
    options : Options
    chain : SerialChain
    tool_path : ToolPath
    joint_path : JointPath
    trajectory : Trajectory
    solution : PathSolution
        The configurations at the points, smoothed or not.
    record : TrackRecord
        What the planner did and where it failed, point by point.
    search : GraphRecord, ReverseStatistics or None
        What the strategy says of its work.
    smoothing : SmoothRecord or None
    breaks : tuple of BreakRecord
        The motions off the path: approach, breaks, retract.
    reach : dict of int to Reach
        For every unreached point, whether the arm could reach it at all.
    stages : dict of str to float
        Seconds spent in each stage.
    """

    cell: Cell
    options: Options
    chain: SerialChain
    tool_path: ToolPath
    joint_path: JointPath
    trajectory: Trajectory
    solution: PathSolution
    record: TrackRecord
    search: GraphRecord | ReverseStatistics | None
    smoothing: SmoothRecord | None
    breaks: tuple[BreakRecord, ...]
    reach: dict[int, Reach]
    stages: dict[str, float]

    def __repr__(self) -> str:
        points, failed = self.tool_path.point_count, len(self.record.unreached)
        return (
            f"Plan({self.cell.name!r}: {points - failed} of {points} points reached,"
            f" {sum(motion.kind.value == 'break' for motion in self.breaks)} breaks, {self.trajectory!r})"
        )

    @cached_property
    def verdict(self) -> Verdict:
        """What speaks against executing the trajectory, judged as its file would be."""
        from qparm.verify import Finding, Verdict, verify_motion
        from qparm.verify.motion import motion_of_trajectory

        own = [
            Finding("motion", f"the {motion.name}", f"no safe motion was found: {motion.failure}")
            for motion in self.breaks
            if motion.failure
        ]
        if len(self.trajectory.boundaries) < 2:
            own.append(Finding("row-not-worked", "tool path", "no point of it is reached, and the arm stays at home"))
            return Verdict(tuple(own), None)
        return Verdict(tuple(own), verify_motion(motion_of_trajectory(self.trajectory), self.cell))

    @property
    def row_length(self) -> float:
        """Length of all rows (m)."""
        return sum(row.length for row in self.tool_path.rows)

    @property
    def row_length_not_worked(self) -> float:
        """Length of the rows over which the tool does not go on the surface (m): at breaks and points not reached."""
        from qparm.path import SegmentKind

        path = self.joint_path
        worked = [s[-1] - s[0] for one, s in zip(path.segments, path.parameters, strict=True)
                  if one.kind is SegmentKind.ROW]  # fmt: skip
        return max(0.0, self.row_length - float(sum(worked)))

    @property
    def feed_lost(self) -> float:
        """Seconds that the rows take longer than at the feed from end to end."""
        from qparm.path import SegmentKind

        path, knots = self.joint_path, self.trajectory.knots
        return sum(
            float(knots[one.last] - knots[one.first] - (s[-1] - s[0]) / self.cell.process.feed)
            for one, s in zip(path.segments, path.parameters, strict=True)
            if one.kind is SegmentKind.ROW
        )


def plan(
    cell: Cell | Mapping[str, Any] | str | Path,
    *,
    strategy: Strategy | Planner = "graph",
    method: MethodName | StepRule = "cwln",
    solver: str | StepSolver = "auto",
    smooth: bool | None = None,
    for_linear: bool = False,
    timing: TimingForm = "quintic",
    seed: int = 0,
    feed: str | None = None,
    tool_spin: Literal["fixed", "free"] | None = None,
    tool_tilt: str | None = None,
    keep_traces: bool = False,
    progress: Progress | None = None,
) -> Plan:
    """Plan a cell: tool path, joint path, trajectory.

    Parameters
    ----------
    cell : Cell, mapping, str or Path
        A cell, or what :meth:`Cell.load` takes.
    smooth : bool, optional
        By default what ``graph`` and ``reverse`` find is smoothed; the baseline, and a path of your own, are left.
    strategy, method, solver, for_linear, timing, seed
        See :class:`Options`. A strategy may also be a function (:func:`qparm.planning.plan_by`), a method a function
        and a solver an object (:class:`qparm.ik.PoseSolver`): your own, in the place of ours.
    feed, tool_spin, tool_tilt : str, optional
        In place of the cell's, such as ``"50 mm/s"``, ``"free"``, ``"10 deg"`` (:meth:`Cell.with_process`).
    keep_traces : bool
        Keep the configurations of every IK iteration in ``plan.record.traces``.
    progress : callable, optional
        ``progress(stage, done, total)``, called as the work goes on.

    Returns
    -------
    Plan
        Points that could not be reached are data in it, not exceptions.

    Raises
    ------
    CellError
        If the cell is not valid.
    InvalidInput, SolverUnavailable
        If an option is not usable.

    Examples
    --------
    >>> import qparm
    >>> plan = qparm.plan("examples/dome.toml")  # doctest: +SKIP
    >>> plan.trajectory(1.0).shape  # doctest: +SKIP
    (8,)
    """
    for what, value in (("smooth", smooth), ("for_linear", for_linear)):
        if not isinstance(value, bool) and not (what == "smooth" and value is None):
            raise InvalidInput(f"{what} must be True or False, not {value!r}")
    if not isinstance(solver, str) and not hasattr(solver, "solve"):
        raise InvalidInput(f"solver must be a name such as 'auto', or an object with solve(step), not {solver!r}")
    if isinstance(seed, bool) or not isinstance(seed, int) or seed < 0:
        raise InvalidInput(f"seed must be a whole number from 0, not {seed!r}")
    options = Options(
        strategy=_name("strategy", strategy, Strategy),
        method=_name("method", method, MethodName),
        solver=solver if isinstance(solver, str) else solver.name,
        smooth=strategy in ("graph", "reverse") if smooth is None else bool(smooth),
        for_linear=bool(for_linear),
        timing=_name("timing", timing, TimingForm),
        seed=seed,
    )
    stages: dict[str, float] = {}

    @contextmanager
    def stage(name: str, total: int) -> Iterator[Callable[[int, int], None]]:
        def advance(done: int, _total: int = total) -> None:
            if progress is not None:
                progress(name, done, total)

        start = time.perf_counter()
        advance(0)
        yield advance
        advance(total)
        stages[name] = time.perf_counter() - start

    with stage("cell", 1):
        cell = Cell.load(cell).with_process({"feed": feed, "tool_spin": tool_spin, "tool_tilt": tool_tilt})
        chain, home, jump = cell.chain(), cell.home(), cell.jump()
    with stage("kernels", 1):
        # imported here, where a first run compiles them, so that no other stage's time includes it
        import numpy as np

        from qparm.ik import check_reach, make_solver
        from qparm.planning import (
            LIMIT_MARGIN,
            Between,
            GraphRecord,
            assemble,
            driven_where_followed,
            filled,
            inset,
            joined_rows,
            jump_criteria,
            plan_by,
            points_of,
            rest_at_corners,
            row_end,
            smooth_solution,
            smoothest,
            track,
            undriven,
            wound,
            wound_graph,
        )
        from qparm.timing import kernels as _timing_kernels  # noqa: F401
        from qparm.timing import quintic_trajectory, ruckig_trajectory
        from qparm.timing import speed_kernels as _speed_kernels  # noqa: F401

        if strategy == "reverse":
            import qparm.planning.reverse as _reverse_kernels  # noqa: F401
    if isinstance(solver, str) and solver != "auto":
        # a name that nothing answers to is refused by every strategy, used or not
        make_solver(solver, chain.n)
    with stage("tool path", 1):
        tool_path = cell.tool_path()
    process = cell.process
    relaxation = cell.relaxation()
    if relaxation.free and strategy != "graph":
        raise InvalidInput(
            "only the graph strategy uses a tool that may spin or tilt; leave tool_spin and tool_tilt out"
        )
    # the paper's strategies and planners of one's own are given the points as they are
    dense = filled(chain, tool_path, fill=strategy == "graph")
    criteria = jump_criteria(chain, dense, jump)
    edges = criteria[1:]
    # what the paper's strategies choose by
    by_feed = jump_criteria(chain, tool_path, jump, feed=process.feed)
    tolerances: Any = {
        "position_tolerance": _MARGIN * process.position_tolerance,
        "rotation_tolerance": _MARGIN * process.rotation_tolerance,
    }
    search: GraphRecord | ReverseStatistics | None = None
    candidates: tuple[PathSolution, ...] = ()
    # a turn bends the curve: where a joint rested on its limit, that would lead beyond it
    arm = inset(chain, _TURN_MARGIN if process.self_motion.row_end == "flow" else _MISSED)
    with stage("joint path", tool_path.point_count) as advance:
        rng = np.random.default_rng([seed, 0])
        if callable(strategy):
            solution, record = plan_by(
                strategy, chain, tool_path, home, jump=edges, rng=rng,
                position_tolerance=process.position_tolerance, rotation_tolerance=process.rotation_tolerance,
            )  # fmt: skip
        elif strategy == "graph":
            candidates, search = wound_graph(
                arm, dense, home, jump=edges, seed=seed, relaxation=relaxation, **tolerances,
                # of the points that were asked for
                progress=lambda done, total: advance(done * tool_path.point_count // total, total),
            )  # fmt: skip
            solution = candidates[0]
            record = points_of(chain, tool_path, dense.of_points(solution), relaxation)
        elif strategy == "reverse":
            from qparm.planning.reverse import reverse

            # where a joint rests on its limit the curve between the points swings beyond it
            found = reverse(
                inset(chain, LIMIT_MARGIN), tool_path, home, jump=by_feed, rng=rng, method=method, solver=solver,
                progress=advance, **tolerances,
            )  # fmt: skip
            solution, record, search = found.solution(by_feed), found.record(), found.statistics
        else:
            solution, record = track(
                chain, tool_path, home, jump=by_feed[1:], rng=rng, method=method, solver=solver,
                keep_traces=keep_traces, progress=advance, **tolerances,
            )  # fmt: skip
    if strategy != "graph":
        if strategy in ("reverse", "general"):
            solution = wound(chain, tool_path, solution, home)
        solution = driven_where_followed(chain, tool_path, solution)
    if strategy == "reverse":
        # the baseline and a planner of one's own are shown as they are
        solution = joined_rows(chain, tool_path, solution, row_end(tool_path))
    smoothing: SmoothRecord | None = None
    if options.smooth:
        with stage("smoothing", 1):
            solution, smoothing = smoothest(
                chain,
                dense,
                [
                    smooth_solution(arm, dense, one, jump=edges, relaxation=relaxation, **tolerances)
                    for one in (candidates or (solution,))
                ],
            )
            if strategy in ("graph", "reverse") and solution.reconfigurations(dense)[0]:
                # what was smoothed is followed once more from both sides of what is still broken
                joined = joined_rows(chain, dense, solution, row_end(dense), relaxation=relaxation)
                again = smooth_solution(arm, dense, joined, jump=edges, relaxation=relaxation, **tolerances)
                solution, smoothing = smoothest(chain, dense, [(solution, smoothing), again])
    with stage("between points", 1):
        solution = rest_at_corners(chain, dense, solution, jump=edges)
        dense, solution = dense.trimmed(solution)
        criteria = jump_criteria(chain, dense, jump)
        between = Between(process.position_between, process.rotation_between, options.for_linear, process.clearance)
        joint_path, breaks = assemble(
            chain, dense, home, solution, jump=criteria, rng=np.random.default_rng([seed, 2]), between=between,
            relaxation=relaxation, distance=cell.distance(),
        )  # fmt: skip
    solution = undriven(dense.of_points(solution), breaks)
    if isinstance(search, GraphRecord):
        inside, at_ends = solution.reconfigurations(tool_path)
        search = replace(search, inside=inside, row_ends=at_ends, proven=search.proven and inside + at_ends == 0)
    unreached = record.unreached
    with stage("reach", 1):
        verdicts = check_reach(
            chain,
            tool_path.poses[unreached],
            rng=np.random.default_rng([seed, 1]),
            relaxation=relaxation,
            position_tolerance=cell.process.position_tolerance,
            rotation_tolerance=cell.process.rotation_tolerance,
        )
        reach = dict(zip(unreached.tolist(), verdicts, strict=True))
    with stage("trajectory", 1):
        make = {"quintic": quintic_trajectory, "ruckig": ruckig_trajectory}[timing]
        trajectory = make(
            chain, joint_path, feed=process.feed, position=process.position_between, rotation=process.rotation_between
        )
        breaks = _driven(breaks, joint_path, trajectory)
    planned = Plan(
        cell=cell,
        options=options,
        chain=chain,
        tool_path=tool_path,
        joint_path=joint_path,
        trajectory=trajectory,
        solution=solution,
        record=record,
        search=search,
        smoothing=smoothing,
        breaks=breaks,
        reach=reach,
        stages=stages,
    )
    with stage("verdict", 1):
        verdict = planned.verdict
        judged = replace(trajectory, executable=verdict.executable, reasons=verdict.reasons)
        planned = replace(planned, trajectory=judged)
        # the same motion, which need not be judged again
        planned.__dict__["verdict"] = verdict
    return planned


def _driven(breaks: tuple[BreakRecord, ...], joint_path: JointPath, trajectory: Trajectory) -> tuple[BreakRecord, ...]:
    """Return the records of motions with the times that the trajectory takes for them, in place of estimates."""
    at = {int(point): k for k, point in enumerate(joint_path.point) if point >= 0}
    last = len(joint_path.q) - 1
    knots = trajectory.knots
    return tuple(
        replace(one, time=float(knots[at.get(one.last, last)] - knots[at.get(one.first, 0)])) for one in breaks
    )


def _name(what: str, value: object, allowed: Any) -> str:
    """Return the name of one of ours, or of what the caller brought."""
    if callable(value):
        return getattr(value, "__name__", type(value).__name__)
    if value not in get_args(allowed):
        raise InvalidInput(f"{what} must be one of {', '.join(get_args(allowed))}, not {value!r}")
    return str(value)
