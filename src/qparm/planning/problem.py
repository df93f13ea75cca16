"""The problem that planning solves: an arm, a path for its tool, and what the way along it is held to.

It travels through planning whole: strategies, smoothing and assembly are functions of it, and what one of them
changes (an arm a little inside its limits, a path with poses put in) is a problem of its own, made with
``dataclasses.replace``.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from qparm.path.relaxation import EXACT, Relaxation
from qparm.planning.interpolation.exact import inset
from qparm.planning.moves.clearance import Distance, ToolDistance
from qparm.planning.paper.jump import jump_criteria
from qparm.planning.tolerances import REST_MARGIN, TURN_MARGIN

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.cell import Cell
    from qparm.path import ToolPath
    from qparm.robot import SerialChain

__all__ = ["Between", "PathProblem", "problem_of", "row_end"]

# Poses are solved to this share of the cell's tolerances (one more iteration): the rest is for what comes after.
_MARGIN = 0.01


@dataclass(frozen=True)
class Between:
    """What holds between the points of the tool path, and off it.

    Attributes
    ----------
    position, rotation : float
        How far the tool may be off its path (m, rad).
    for_linear : bool
        Whether that must hold with linear joint interpolation too.
    clearance : float
        Distance of the tool point from the workpiece on motions off the path (m).
    """

    position: float = 5e-6
    rotation: float = 20e-6
    for_linear: bool = False
    clearance: float = 0.02


@dataclass(frozen=True, eq=False)
class PathProblem:
    """An arm, a path for its tool, and what the way along it is held to.

    Attributes
    ----------
    chain : SerialChain
    tool_path : ToolPath
    home : (n,) ndarray
        Where the arm comes from and goes back to (m, rad).
    jump : (n,) or (P - 1, n) ndarray
        A larger step between neighbouring points is a reconfiguration, unless it can be followed (m, rad): for every
        edge alike, as ``cell.jump()`` has it, or for each.
    feed : float, optional
        Speed of the tool on rows (m/s). It does not change the path, but where the paper's strategies choose by it.
    position_tolerance, rotation_tolerance : float
        To which points are solved (m, rad).
    relaxation : Relaxation
        Which rotations of the tool are free.
    between : Between
    distance : Distance, optional
        See :class:`qparm.planning.moves.clearance.Distance`; None where no surface is known.
    seed : int
        Of every random draw: the same seed gives the same path, for any number of threads.
    threads : int, optional
        All cores by default.
    """

    chain: SerialChain
    tool_path: ToolPath
    home: NDArray[np.float64]
    jump: NDArray[np.float64]
    feed: float | None = None
    position_tolerance: float = 1e-8
    rotation_tolerance: float = 1e-7
    relaxation: Relaxation = EXACT
    between: Between = field(default_factory=Between)
    distance: Distance | None = None
    seed: int = 0
    threads: int | None = None

    @cached_property
    def criteria(self) -> NDArray[np.float64]:
        """The largest step that is no jump across each edge, (P - 1, n); see :mod:`qparm.planning.paper.jump`."""
        return jump_criteria(self.chain, self.tool_path, self.jump)

    @cached_property
    def criteria_by_feed(self) -> NDArray[np.float64]:
        """The same as the paper has it: no joint turns farther than it can in an edge's time, (P - 1, n)."""
        return jump_criteria(self.chain, self.tool_path, self.jump, feed=self.feed)

    @cached_property
    def row_ends(self) -> NDArray[np.bool_]:
        """Which edges lie in self-motion areas, (P - 1,)."""
        return row_end(self.tool_path)

    @cached_property
    def inside(self) -> PathProblem:
        """The problem of an arm a little inside its limits, for what is searched and smoothed."""
        flows = any(transition.flows for transition in self.tool_path.transitions)
        return replace(self, chain=inset(self.chain, TURN_MARGIN if flows else REST_MARGIN))

    def rng(self, stage: int) -> np.random.Generator:
        """Return the generator of a stage's draws, the same whatever other stages drew."""
        return np.random.default_rng([self.seed, stage])


def problem_of(cell: Cell, *, seed: int = 0, for_linear: bool = False, threads: int | None = None) -> PathProblem:
    """Return the problem that a cell poses.

    Parameters
    ----------
    cell : Cell
    seed : int
    for_linear : bool
        See :class:`Between`.
    threads : int, optional
    """
    process, chain, of_points = cell.process, cell.chain(), cell.distance()
    return PathProblem(
        chain=chain,
        tool_path=cell.tool_path(),
        home=cell.home(),
        jump=cell.jump(),
        feed=process.feed,
        position_tolerance=_MARGIN * process.position_tolerance,
        rotation_tolerance=_MARGIN * process.rotation_tolerance,
        relaxation=cell.relaxation(),
        between=Between(process.position_between, process.rotation_between, for_linear, process.clearance),
        distance=None if of_points is None else ToolDistance(chain, of_points),
        seed=seed,
        threads=threads,
    )


def row_end(tool_path: ToolPath) -> NDArray[np.bool_]:
    """Return which edges, (P - 1,), lie in a self-motion area: a row end, or between two of its points."""
    area = tool_path.in_self_motion_area
    row = tool_path.row_of_point
    return (row[:-1] != row[1:]) | (area[:-1] & area[1:])
