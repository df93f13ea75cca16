"""The result of the reverse strategy: configurations, breaks, and an account of every jump. Data, no planning."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np

from qparm.planning.paper.general import PointRecord, TrackRecord
from qparm.planning.solution import PathSolution, driven_edges

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.ik import StepCounts

__all__ = ["MetJump", "Repair", "ReversePath", "ReverseStatistics", "Step"]


class Repair(StrEnum):
    """What became of a jump."""

    SELF_MOTION = "self-motion"
    """The tool stays, the arm moves towards the previous configuration until the jump is none (step 2)."""
    REVERSE = "reverse planning"
    """The row was planned anew, backwards from here: the jump has moved to the row's start (step 3)."""
    JOINED = "joined"
    """The row was planned anew backwards from here, drawn by self-motion to what it was before, and met it: the jump
    is gone. Not in the paper; tried before the sacrifice."""
    SACRIFICE = "sacrifice"
    """The arm reconfigures here, inside the row, away from the surface (step 3, last resort)."""
    AT_ROW_END = "self-motion area"
    """It lies in a self-motion area, where the arm may reconfigure."""
    RESTART = "restart"
    """The first pose of a row, or after a gap, was reached from a random start; there is no edge before it."""
    UNREACHED = "unreached"
    """No start reached the pose; the path has a gap."""


@dataclass(frozen=True)
class Step:
    """How far one edge is from its jump criterion.

    Attributes
    ----------
    joint : str
        The worst joint.
    size : float
        Its step (m or rad).
    ratio : float
        Over its criterion; a jump if over 1.
    """

    joint: str
    size: float
    ratio: float


@dataclass(frozen=True)
class MetJump:
    """A jump that was met, or a pose that was not reached, and what was done about it.

    Attributes
    ----------
    row, place : int
        Where: the row and the point's place in it, from 0.
    point : int
        The point's index in the tool path; the jump is on the edge before it.
    step : Step or None
        The jump as met; None where following did not reach the pose.
    repair : Repair
    tries : int
        Random solutions that were tried.
    moved_to : int or None
        The point before which the jump lies now, if it was moved: the row's first, or a point of a self-motion
        area, a break or a gap.
    moved_step : Step or None
        How large the edge there is in the finished path; None at the path's very first point and after a gap.
    """

    row: int
    place: int
    point: int
    step: Step | None
    repair: Repair
    tries: int = 0
    moved_to: int | None = None
    moved_step: Step | None = None


@dataclass(frozen=True)
class ReverseStatistics:
    """What the strategy met and did.

    Attributes
    ----------
    jumps : tuple of MetJump
        In the order in which they were met. Jumps inside reverse planning are part of its tries. A sacrifice may be
        undone by reverse planning from a later point: ``ReversePath.breaks`` has what is left.
    row_ends : tuple of Step or None
        The edge from each row's last point to the next row's first, in the finished path; None if one of the two
        is not reached.
    poses_solved : int
        Pose solves in all: following, random starts, tries.
    start_solutions : int
        How many of the random starts solved the first pose.
    """

    jumps: tuple[MetJump, ...]
    row_ends: tuple[Step | None, ...] = field(repr=False)
    poses_solved: int
    start_solutions: int

    def count(self, repair: Repair) -> int:
        """Return how many jumps were repaired in one way."""
        return sum(jump.repair is repair for jump in self.jumps)

    @property
    def tries(self) -> int:
        """Random solutions tried in all."""
        return sum(jump.tries for jump in self.jumps)

    @property
    def row_end_reconfigurations(self) -> int:
        """Row ends whose edge is over the jump criterion."""
        return sum(step is not None and step.ratio > 1 for step in self.row_ends)


@dataclass(frozen=True, eq=False)
class ReversePath:
    """Configurations at the points, by the paper's strategy.

    Attributes
    ----------
    q : (P, n) ndarray
        m and rad; where a point is not reached, where its search ended.
    reached : (P,) ndarray of bool
        Within the tolerances and the limits.
    breaks : (B,) ndarray of int
        Points k whose edge from k - 1, inside a row, is over the jump criterion: a reconfiguration. Both ends are
        reached; gaps are not in it.
    breaks_in_area : (B,) ndarray of bool
        Which of them lie in a self-motion area.
    counts : StepCounts
    points : tuple of PointRecord
    statistics : ReverseStatistics
    """

    q: NDArray[np.float64]
    reached: NDArray[np.bool_]
    breaks: NDArray[np.int64]
    breaks_in_area: NDArray[np.bool_]
    counts: StepCounts
    points: tuple[PointRecord, ...] = field(repr=False)
    statistics: ReverseStatistics

    def solution(self, criteria: NDArray[np.float64]) -> PathSolution:
        """Return the configurations in the form that every strategy ends in; ``criteria`` (n,) or (P - 1, n)."""
        q = np.where(self.reached[:, None], self.q, 0.0)
        driven = driven_edges(q, self.reached, criteria)
        return PathSolution(q, np.zeros((len(q), 3)), self.reached, driven)

    def record(self) -> TrackRecord:
        """Return the account point by point."""
        return TrackRecord(
            points=self.points, q_end=self.q, counts=self.counts, start_solutions=self.statistics.start_solutions
        )
