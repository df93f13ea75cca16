"""The pipeline: cell to trajectory, the stages in order. No files, no printing."""

from __future__ import annotations

import operator
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from qparm.cell import Cell
from qparm.choices import METHODS, STRATEGIES, TIMING_FORMS
from qparm.errors import InvalidInput

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from qparm.ik import StepRule, StepSolver
    from qparm.path import JointPath, ToolPath, Trajectory
    from qparm.planning import (
        BreakRecord,
        GraphRecord,
        PathProblem,
        PathSolution,
        Planner,
        ReverseStatistics,
        SmoothRecord,
        TrackRecord,
    )
    from qparm.reach import Reach
    from qparm.robot import SerialChain
    from qparm.verify import Verdict

__all__ = ["Options", "Plan", "plan"]

StrategyName = Literal["graph", "reverse", "general"]
MethodName = Literal["cwln", "wln", "gpm", "dls"]
TimingName = Literal["quintic", "ruckig"]

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
    strategy: StrategyName | Planner = "graph",
    method: MethodName | StepRule = "cwln",
    solver: str | StepSolver = "auto",
    smooth: bool | None = None,
    for_linear: bool = False,
    timing: TimingName | Callable[..., Trajectory] = "quintic",
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
    if not isinstance(solver, str) and not hasattr(solver, "solve"):
        raise InvalidInput(f"solver must be a name such as 'auto', or an object with solve(step), not {solver!r}")
    for what, value in (("smooth", smooth), ("for_linear", for_linear)):
        if not isinstance(value, bool) and not (what == "smooth" and value is None):
            raise InvalidInput(f"{what} must be True or False, not {value!r}")
    options = Options(
        strategy=_name("strategy", strategy, STRATEGIES),
        method=_name("method", method, METHODS),
        solver=solver if isinstance(solver, str) else solver.name,
        smooth=bool(smooth),
        for_linear=for_linear,
        timing=_name("timing", timing, TIMING_FORMS),
        seed=seed,
    )
    clock = _Clock(progress)
    with clock.stage("cell"):
        cell = Cell.load(cell).with_process({"feed": feed, "tool_spin": tool_spin, "tool_tilt": tool_tilt})
    with clock.stage("kernels"):
        # loaded here, where a first run compiles them, so that no other stage's time includes it
        from qparm.ik import make_solver
        from qparm.planning import assemble, problem_of, rest_at_corners, smooth_found, undriven
        from qparm.planning.search.filling import filled
        from qparm.planning.strategies import Steps, strategy_of
        from qparm.timing import FORMS
        from qparm.timing import kernels as _timing_kernels  # noqa: F401
        from qparm.timing import speed_kernels as _speed_kernels  # noqa: F401

        chosen = strategy_of(strategy)
        chosen.load()
    if smooth is None:
        options = replace(options, smooth=chosen.smooths)
    if isinstance(solver, str) and solver != "auto":
        # a name that nothing answers to is refused by every strategy, used or not
        make_solver(solver, cell.chain().n)
    with clock.stage("tool path"):
        asked = problem_of(cell, seed=options.seed, for_linear=for_linear)
        if callable(strategy):
            # what a planner of one's own returns is held to the cell's own tolerances
            asked = replace(asked, position_tolerance=cell.process.position_tolerance,
                            rotation_tolerance=cell.process.rotation_tolerance)  # fmt: skip
        if asked.relaxation.free and not chosen.frees:
            raise InvalidInput(
                "only the graph strategy uses a tool that may spin or tilt; leave tool_spin and tool_tilt out"
            )
        dense = filled(asked.chain, asked.tool_path, fill=chosen.fills)
        problem = replace(asked, tool_path=dense)
    with clock.stage("joint path", asked.tool_path.point_count) as advance:
        found = chosen.find(problem, Steps(method, solver, keep_traces), advance)
        solution = found.candidates[0]
    smoothing: SmoothRecord | None = None
    if options.smooth:
        with clock.stage("smoothing"):
            solution, smoothing = smooth_found(problem, found.candidates, follows=chosen.follows)
    with clock.stage("between points"):
        path, solution = dense.trimmed(rest_at_corners(problem, solution))
        joint_path, breaks = assemble(replace(problem, tool_path=path), solution)
    solution = undriven(path.of_points(solution), breaks)
    with clock.stage("reach"):
        reach = _reach(asked, cell, found.record.unreached)
    with clock.stage("trajectory"):
        make = timing if callable(timing) else FORMS[timing].of_path
        between = asked.between
        trajectory = make(
            asked.chain, joint_path, feed=asked.feed, position=between.position, rotation=between.rotation
        )
        breaks = _driven(breaks, joint_path, trajectory)
    planned = Plan(
        cell=cell,
        options=options,
        chain=asked.chain,
        tool_path=asked.tool_path,
        joint_path=joint_path,
        trajectory=trajectory,
        solution=solution,
        record=found.record,
        search=_told_in_the_end(found.search, solution, asked.tool_path),
        smoothing=smoothing,
        breaks=breaks,
        reach=reach,
        stages=clock.stages,
    )
    with clock.stage("verdict"):
        verdict = planned.verdict
        judged = replace(trajectory, executable=verdict.executable, reasons=verdict.reasons)
        planned = replace(planned, trajectory=judged)
        # the same motion, which need not be judged again
        planned.__dict__["verdict"] = verdict
    return planned


class _Clock:
    """The stages, the seconds spent in each, and who is told how far they are."""

    def __init__(self, progress: Progress | None) -> None:
        self.stages: dict[str, float] = {}
        self._progress = progress

    @contextmanager
    def stage(self, name: str, total: int = 1) -> Iterator[Callable[[int, int], None]]:
        def advance(done: int, _total: int = total) -> None:
            if self._progress is not None:
                self._progress(name, done, total)

        start = time.perf_counter()
        advance(0)
        yield advance
        advance(total)
        self.stages[name] = time.perf_counter() - start


def _reach(problem: PathProblem, cell: Cell, unreached: NDArray[np.int64]) -> dict[int, Reach]:
    """Return whether the arm could reach the points that were not reached."""
    from qparm.reach import check_reach

    verdicts = check_reach(
        problem.chain, problem.tool_path.poses[unreached], rng=problem.rng(1), relaxation=problem.relaxation,
        position_tolerance=cell.process.position_tolerance, rotation_tolerance=cell.process.rotation_tolerance,
    )  # fmt: skip
    return dict(zip(unreached.tolist(), verdicts, strict=True))


def _told_in_the_end(
    search: GraphRecord | ReverseStatistics | None, solution: PathSolution, tool_path: ToolPath
) -> GraphRecord | ReverseStatistics | None:
    """Return a search's record with the reconfigurations that remain in the end."""
    from qparm.planning import GraphRecord

    if not isinstance(search, GraphRecord):
        return search
    inside, at_ends = solution.reconfigurations(tool_path)
    return replace(search, inside=inside, row_ends=at_ends, proven=search.proven and inside + at_ends == 0)


def _driven(breaks: tuple[BreakRecord, ...], joint_path: JointPath, trajectory: Trajectory) -> tuple[BreakRecord, ...]:
    """Return the records of motions with the times that the trajectory takes for them, in place of estimates."""
    at = {int(point): k for k, point in enumerate(joint_path.point) if point >= 0}
    last = len(joint_path.q) - 1
    knots = trajectory.knots
    return tuple(
        replace(one, time=float(knots[at.get(one.last, last)] - knots[at.get(one.first, 0)])) for one in breaks
    )


def _name(what: str, value: object, choices: dict[str, str]) -> str:
    """Return the name of one of ours, or of what the caller brought."""
    if callable(value):
        return getattr(value, "__name__", type(value).__name__)
    if not isinstance(value, str) or value not in choices:
        raise InvalidInput(f"{what} must be one of {', '.join(choices)}, not {value!r}")
    return str(value)
