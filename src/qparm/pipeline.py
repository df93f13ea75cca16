"""The pipeline: cell to trajectory, the stages in order. No files, no printing."""

from __future__ import annotations

import operator
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

from qparm.cell import Cell
from qparm.errors import InvalidInput

if TYPE_CHECKING:
    from qparm.ik import Reach, StepRule, StepSolver
    from qparm.path import JointPath, ToolPath, Trajectory
    from qparm.planning import Planner, TrackRecord
    from qparm.robot import SerialChain

__all__ = ["Options", "Plan", "plan"]

Strategy = Literal["general"]
MethodName = Literal["cwln", "wln", "gpm", "dls"]
TimingForm = Literal["quintic", "ruckig"]

# Poses are solved to this share of the cell's tolerances (one more iteration): the rest is for what comes after.
_MARGIN = 0.01

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Options:
    """How a cell is planned.

    Attributes
    ----------
    strategy : {"general"}
        ``general``: the paper's baseline, from point to point with a warm start.
    method : {"cwln", "wln", "gpm", "dls"}
        The IK step.
    solver : str
        ``auto``: closed form, else the compiled active set; any other name sends every step to that QP solver.
    timing : {"quintic", "ruckig"}
    seed : int
        Of every random draw; the same seed gives the same plan.
    """

    strategy: str = "general"
    method: str = "cwln"
    solver: str = "auto"
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
    record : TrackRecord
        What the planner did and where it failed.
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
    record: TrackRecord
    reach: dict[int, Reach]
    stages: dict[str, float] = field(repr=False)


def plan(
    cell: Cell | Mapping[str, Any] | str | Path,
    *,
    strategy: Strategy | Planner = "general",
    method: MethodName | StepRule = "cwln",
    solver: str | StepSolver = "auto",
    timing: TimingForm = "quintic",
    seed: int = 0,
    keep_traces: bool = False,
    progress: Progress | None = None,
) -> Plan:
    """Plan a cell: tool path, joint path, trajectory.

    Parameters
    ----------
    cell : Cell, mapping, str or Path
        A cell, or what :meth:`Cell.load` takes.
    strategy, method, solver, timing, seed
        See :class:`Options`. A strategy may also be a function (:func:`qparm.planning.plan_by`), a method a function
        and a solver an object (:class:`qparm.ik.PoseSolver`): your own, in the place of ours.
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
    options = Options(
        strategy=_name("strategy", strategy, Strategy),
        method=_name("method", method, MethodName),
        solver=solver if isinstance(solver, str) else solver.name,
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
        cell = Cell.load(cell)
        chain, home, jump = cell.chain(), cell.home(), cell.jump()
    with stage("kernels", 1):
        # imported here, where a first run compiles them, so that no other stage's time includes it
        import numpy as np

        from qparm.ik import check_reach
        from qparm.planning import plan_by, track
        from qparm.timing import kernels as _timing_kernels  # noqa: F401
        from qparm.timing import quintic_trajectory, ruckig_trajectory
    with stage("tool path", 1):
        tool_path = cell.tool_path()
    with stage("joint path", tool_path.point_count) as advance:
        rng = np.random.default_rng([seed, 0])
        position_tolerance, rotation_tolerance = cell.process.position_tolerance, cell.process.rotation_tolerance
        if callable(strategy):
            joint_path, record = plan_by(
                strategy,
                chain,
                tool_path,
                home,
                jump=jump,
                position_tolerance=position_tolerance,
                rotation_tolerance=rotation_tolerance,
                rng=rng,
            )
        else:
            joint_path, record = track(
                chain,
                tool_path,
                home,
                jump=jump,
                position_tolerance=_MARGIN * position_tolerance,
                rotation_tolerance=_MARGIN * rotation_tolerance,
                rng=rng,
                method=method,
                solver=solver,
                keep_traces=keep_traces,
                progress=advance,
            )
    unreached = record.unreached
    with stage("reach", 1):
        verdicts = check_reach(
            chain,
            tool_path.poses[unreached],
            rng=np.random.default_rng([seed, 1]),
            position_tolerance=cell.process.position_tolerance,
            rotation_tolerance=cell.process.rotation_tolerance,
        )
        reach = dict(zip(unreached.tolist(), verdicts, strict=True))
    with stage("trajectory", 1):
        make = {"quintic": quintic_trajectory, "ruckig": ruckig_trajectory}[timing]
        trajectory = make(chain, joint_path, feed=cell.process.feed, reasons=_reasons(record, joint_path))
    return Plan(
        cell=cell,
        options=options,
        chain=chain,
        tool_path=tool_path,
        joint_path=joint_path,
        trajectory=trajectory,
        record=record,
        reach=reach,
        stages=stages,
    )


def _name(what: str, value: object, allowed: Any) -> str:
    """Return the name of one of ours, or of what the caller brought."""
    if callable(value):
        return getattr(value, "__name__", type(value).__name__)
    if value not in get_args(allowed):
        raise InvalidInput(f"{what} must be one of {', '.join(get_args(allowed))}, not {value!r}")
    return str(value)


def _reasons(record: TrackRecord, joint_path: JointPath) -> tuple[str, ...]:
    """Return why the trajectory must not be executed, as far as the planner knows."""
    reasons = []
    if len(record.unreached):
        reasons.append(f"{len(record.unreached)} of {len(record.points)} points are not reached")
    if joint_path.breaks:
        reasons.append(
            f"the tool leaves its path at {len(joint_path.breaks)} breaks, which are not planned against contact"
        )
    return tuple(reasons)
