"""One design, level by level: each costs more than the one before, and what fails at one goes no further.

    0  screen    what the greatest reach of the links proves out of reach
    1  coarse    every fourth point of the path
    2  reach     all points
    3  measures  what the arm can attain on the path, and the seed's count
    4  plan      a whole plan, for the few designs that are left

An evaluation depends on the cell, the design, the seed and nothing else, so that it is the same on every worker.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from qparm.cell import Cell
from qparm.design.attainable import OF_PATH, OF_POINTS, attainable_measures
from qparm.design.coverage import COARSE, Coverage, reach_of_points, screened
from qparm.design.planned import counted_measures, planned_measures
from qparm.design.space import DesignSpace, link_length
from qparm.errors import CellError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.path import ToolPath
    from qparm.robot import SerialChain

__all__ = ["ATTAINED", "COUNTED", "LEVELS", "PLANNED", "Evaluation", "evaluate"]

LEVELS = ("screen", "coarse", "reach", "measures", "plan")
SCREEN, COARSE_LEVEL, REACH, MEASURES_LEVEL, PLAN = range(5)
ATTAINED = (*OF_POINTS, *OF_PATH)
COUNTED = ("singularities",)
PLANNED = ("cycle_time",)
# A cell that is not valid at a design is farther from a good one than any that misses points.
_NOT_A_CELL = 10.0
# No figure of a design is larger (SI).
_LARGEST = 1e15
_T = TypeVar("_T")


@dataclass(frozen=True)
class Evaluation:
    """What is known of a design.

    Attributes
    ----------
    x : tuple of float
        The variables (SI).
    level : int
        The last level that was run, see :data:`LEVELS`.
    violation : float
        0 where the surface is covered as far as it was looked at, else graded.
    coverage : float
        Share of the path within reach; an upper bound where a level below ``reach`` refused the design.
    missed, checked : int
        Points that are not reached, of those looked at.
    reason : str
        Why the design is not valid, empty if it is.
    measures : dict of str to float
        By name, SI.
    seconds : dict of int to float
        Time of each level that was run here; no part of the result.
    """

    x: tuple[float, ...]
    level: int
    violation: float
    coverage: float
    missed: int
    checked: int
    reason: str
    measures: dict[str, float]
    seconds: dict[int, float] = field(default_factory=dict, compare=False)

    @property
    def valid(self) -> bool:
        """Whether every point that was looked at is within reach."""
        return self.violation == 0

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {
            "x": list(self.x),
            "level": self.level,
            "violation": self.violation,
            "coverage": self.coverage,
            "missed": self.missed,
            "checked": self.checked,
            "reason": self.reason,
            "measures": self.measures,
            "seconds": {str(level): value for level, value in self.seconds.items()},
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Evaluation:
        """Return what :meth:`to_dict` gave.

        Raises
        ------
        KeyError, TypeError, ValueError
            If something is missing, a measure that its level tells among it, or not of its kind.
        """
        found = cls(
            x=tuple(_finite(value) for value in data["x"]),
            level=_count(data["level"], most=PLAN),
            violation=_not_negative(data["violation"]),
            coverage=_finite(data["coverage"]),
            missed=_count(data["missed"]),
            checked=_count(data["checked"]),
            reason=_of_kind(data["reason"], str),
            measures={name: _finite(value) for name, value in _of_kind(data["measures"], dict).items()},
            seconds={int(level): _finite(value) for level, value in _of_kind(data["seconds"], dict).items()},
        )
        if found.valid:
            found._require_measures()
        return found

    def _require_measures(self) -> None:
        """Raise KeyError unless everything is there that its level tells of every valid design."""
        for name in ("length", *(PLANNED if self.level >= PLAN else ())):
            if name not in self.measures:
                raise KeyError(name)

    def knows(self, level: int, names: Sequence[str]) -> bool:
        """Return whether this answers what a level and some measures would."""
        return not self.valid or (self.level >= level and all(name in self.measures for name in names))


def _finite(value: Any) -> float:
    """Return a number as it is, or raise ValueError or TypeError."""
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) <= _LARGEST:
        raise ValueError("no finite number")
    return value


def _not_negative(value: Any) -> float:
    if _finite(value) < 0:
        raise ValueError("a negative number")
    return value


def _count(value: Any, *, most: int = 10**9) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= most:
        raise ValueError("no count")
    return value


def _of_kind(value: Any, kind: type[_T]) -> _T:
    if not isinstance(value, kind):
        raise TypeError(f"no {kind.__name__}")
    return value


def evaluate(
    space: DesignSpace, x: Sequence[float], *, level: int, names: Sequence[str] = (), seed: int = 0,
    known: Evaluation | None = None,
) -> Evaluation:  # fmt: skip
    """Return the measures of a design, up to a level.

    Parameters
    ----------
    space : DesignSpace
    x : sequence of float
        The variables (SI).
    level : int
        How far to go, see :data:`LEVELS`; a design that fails at a level goes no further.
    names : sequence of str
        The measures that are wanted.
    seed : int
        Of every draw; the same for all designs of a study.
    known : Evaluation, optional
        Of the same design, at a lower level: what it holds is not done again.
    """
    x = tuple(float(value) for value in x)
    if known is not None and known.knows(level, names):
        return known
    clock = _Clock()
    if known is not None and known.level >= REACH:
        cell, found = space.cell_at(x), replace(known, seconds={})
    else:
        cell, found = _covered(space, x, level, seed, clock)
    if cell is None or not found.valid or level < MEASURES_LEVEL:
        return replace(found, seconds=clock.seconds)
    tool_path = cell.tool_path()
    measures, reached = dict(found.measures), max(found.level, REACH)
    wanted = set(names) - set(measures)
    if wanted & set(ATTAINED):
        measures |= attainable_measures(cell, tool_path, seed=seed, names=sorted(wanted & set(ATTAINED)))
    if wanted & set(COUNTED):
        measures |= counted_measures(cell, tool_path, seed=seed)
    if len(measures) > len(found.measures):
        clock.lap(MEASURES_LEVEL)
    reached = max(reached, MEASURES_LEVEL)
    if level >= PLAN:
        measures |= planned_measures(cell, seed=seed)
        reached = PLAN
        clock.lap(PLAN)
    return replace(found, level=reached, measures=measures, seconds=clock.seconds)


class _Clock:
    """Seconds of each level."""

    def __init__(self) -> None:
        self.seconds: dict[int, float] = {}
        self._last = time.perf_counter()

    def lap(self, level: int) -> None:
        now = time.perf_counter()
        self.seconds[level] = self.seconds.get(level, 0.0) + now - self._last
        self._last = now


def _covered(
    space: DesignSpace, x: tuple[float, ...], level: int, seed: int, clock: _Clock
) -> tuple[Cell | None, Evaluation]:
    """Return the cell at a design and what of its surface is covered, up to all points."""
    try:
        cell = space.cell_at(x)
    except CellError as error:
        clock.lap(SCREEN)
        where, sentence = error.problems[0]
        return None, Evaluation(x, SCREEN, _NOT_A_CELL, 0.0, 0, 0, f"not a valid cell: {where}: {sentence}", {})
    chain, tool_path = cell.chain(), cell.tool_path()
    measures = {"length": link_length(chain)}
    coverage = screened(chain, tool_path, cell.relaxation())
    clock.lap(SCREEN)
    found = _evaluation(x, SCREEN, coverage, measures, "proved out of the links' reach", "at least ")
    points = np.arange(tool_path.point_count)
    for step, at in ((COARSE_LEVEL, points[::COARSE]), (REACH, points)):
        if not found.valid or level < step:
            return cell, found
        coverage = _reach(cell, chain, tool_path, at, seed)
        clock.lap(step)
        found = _evaluation(
            x, step, coverage, measures, "not reached from any start tried: joint limits or orientation",
            "" if step == REACH else "of every fourth point: ",
        )  # fmt: skip
    return cell, found


def _reach(cell: Cell, chain: SerialChain, tool_path: ToolPath, points: NDArray[np.int64], seed: int) -> Coverage:
    return reach_of_points(
        chain,
        tool_path,
        points,
        relaxation=cell.relaxation().planned,
        seed=seed,
        position_tolerance=cell.process.position_tolerance,
        rotation_tolerance=cell.process.rotation_tolerance,
    )


def _evaluation(
    x: tuple[float, ...], level: int, coverage: Coverage, measures: dict[str, float], why: str, looked_at: str
) -> Evaluation:
    missed, checked = int((~coverage.reached).sum()), len(coverage.points)
    reason = "" if not missed else f"{looked_at}{missed} of {checked} points {why}"
    return Evaluation(x, level, coverage.violation, coverage.share, missed, checked, reason, measures)
