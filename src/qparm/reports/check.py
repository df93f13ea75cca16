"""Check of a cell before planning: its values, where the arm stands, which points it reaches."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from qparm.reach import Reach, ReachReason, check_reach
from qparm.reports.words import corner_lines, many, spans
from qparm.verify.clearance import LINKS_NOT_CHECKED

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.cell import Cell
    from qparm.path import ToolPath

__all__ = ["CheckedCell", "check_cell", "check_text", "gap_lines", "home_distance", "missed_lines"]

_BATCH = 61
_GAPS_SHOWN = 5
# A joint that turns through more than this between its limits more likely has limits in another unit (rad).
_MOST_TURNED = 4 * np.pi * (1 + 1e-9)


@dataclass(frozen=True, eq=False)
class CheckedCell:
    """A cell and what was found out about it.

    Attributes
    ----------
    cell : Cell
    reach : tuple of Reach
        One verdict for each point of the raster.
    home_distance : float
        Distance of the tool point from the workpiece at home (m), negative inside; NaN where no surface is known.
    """

    cell: Cell
    reach: tuple[Reach, ...]
    home_distance: float

    @property
    def all_reached(self) -> bool:
        """Whether the arm reaches every point."""
        return all(verdict.reason is ReachReason.WITHIN_REACH for verdict in self.reach)

    @property
    def home_clear(self) -> bool:
        """Whether the tool point keeps the cell's clearance at home, as far as the surface is known."""
        return not self.home_distance < self.cell.process.clearance

    @property
    def problems(self) -> tuple[str, ...]:
        """A sentence for everything but the reach that keeps the cell from being executed."""
        if self.home_clear:
            return ()
        distance, clearance = self.home_distance * 1e3, self.cell.process.clearance * 1e3
        where = (
            f"{-distance:.1f} mm inside the workpiece"
            if distance < -0.05
            else f"{abs(distance):.1f} mm from the workpiece, within the clearance of {clearance:g} mm"
        )
        return (f"home: the tool point lies {where}; choose another arm.home",)

    @property
    def warnings(self) -> tuple[str, ...]:
        """A sentence for everything that is allowed but is probably a mistake."""
        return tuple(
            f"joint {joint.name!r} may turn {(high - low) / (2 * np.pi):.3g} times between its limits,"
            f" {np.degrees(low):.5g} to {np.degrees(high):.5g} deg; are they in the right unit? A URDF has radians"
            for joint, endless in zip(self.cell.arm.joints, self.cell.chain().continuous, strict=True)
            for low, high in [joint.position]
            if joint.type == "revolute" and not endless and high - low > _MOST_TURNED
        )


def check_cell(cell: Cell, *, seed: int = 0, progress: Callable[[str, int, int], None] | None = None) -> CheckedCell:
    """Return the reach of every point of a cell's raster, each from many starts."""
    chain, poses = cell.chain(), cell.tool_path().poses
    rng = np.random.default_rng([seed, 1])
    verdicts: list[Reach] = []
    for first in range(0, len(poses), _BATCH):
        if progress is not None:
            progress("reach", first, len(poses))
        verdicts += check_reach(
            chain,
            poses[first : first + _BATCH],
            rng=rng,
            relaxation=cell.relaxation(),
            position_tolerance=cell.process.position_tolerance,
            rotation_tolerance=cell.process.rotation_tolerance,
        )
    if progress is not None:
        progress("reach", len(poses), len(poses))
    return CheckedCell(cell, tuple(verdicts), home_distance(cell))


def home_distance(cell: Cell) -> float:
    """Return how far the tool point is from the workpiece at home (m), negative inside; NaN if no surface is known."""
    distance = cell.distance()
    return float("nan") if distance is None else float(distance(cell.chain().forward(cell.home())[None, :3, 3])[0])


def check_text(checked: CheckedCell) -> str:
    """Return the readable echo of a cell."""
    cell = checked.cell
    chain, tool_path = cell.chain(), cell.tool_path()
    bound = chain.reach_bound
    lines = [
        f"{cell.name}: arm {cell.arm.name!r}, {chain.n} joints, {cell.arm.described()}",
        "",
        "joint        type        lower      upper    velocity   acceleration        jerk   home",
    ]
    for joint, home, endless in zip(cell.arm.joints, cell.arm.home, chain.continuous, strict=True):
        factor, unit = (1e3, "mm") if joint.type == "prismatic" else (180 / np.pi, "deg")
        values = (*joint.position, joint.velocity, joint.acceleration, joint.jerk)
        low, high, v, a, j = (f"{value * factor:.5g}" for value in values)
        kind = joint.type
        if endless:
            kind, low, high = "continuous", "-", "-"
        lines.append(f"{joint.name:<12} {kind:<10}{low:>7} {high:>10}{v:>12}{a:>15}{j:>12}   {home}   ({unit}, s)")
    zero = np.clip(np.zeros(chain.n), chain.lower, chain.upper)
    lines += [
        "",
        _pose_line("tool at zero", chain.forward(zero)),
        _pose_line("tool at home", chain.forward(cell.home())),
    ]
    if bound is not None:
        lines.append(f"greatest reach  {bound.reach * 1e3:.1f} mm from the first to the last revolute axis")
    process = cell.process
    way = "lifted" if process.self_motion.transition == "lift" else "on the surface"
    way = cell.workpiece.between_rows or way
    if process.self_motion.row_end == "flow":
        way += ", turning beyond the rows"
    steps = np.concatenate([np.diff(row.s) for row in tool_path.rows])
    counts = sorted({len(row.s) for row in tool_path.rows})
    within = sum(verdict.reason is ReachReason.WITHIN_REACH for verdict in checked.reach)
    lines += [
        "",
        f"workpiece       {cell.workpiece.described()}",
        _pose_line("  stands at", cell.workpiece.pose.matrix()),
        f"rows            {len(tool_path.rows)} of {' to '.join(map(str, counts[:1] + counts[1:][-1:]))} points,"
        f" {steps.min() * 1e3:.1f} to {steps.max() * 1e3:.1f} mm apart;"
        f" length {sum(row.length for row in tool_path.rows):.2f} m at {process.feed * 1e3:.5g} mm/s",
        *corner_lines(tool_path),
        f"self-motion     {many(len(tool_path.transitions), 'row end')} ({way}),"
        f" {process.self_motion.points} points at either side",
        *gap_lines(cell),
        f"tolerance       {process.position_tolerance * 1e6:.3g} um, {process.rotation_tolerance * 1e6:.3g} urad",
        *([f"tool            {cell.relaxation().words.removeprefix('the tool ')}"] if cell.relaxation().free else []),
        "jump criterion  " + ", ".join(_steps(chain.prismatic, cell.jump())),
        "",
        f"points within reach: {within} of {len(checked.reach)}",
    ]
    lines += [f"  {line}" for line in missed_lines(tool_path, checked.reach)]
    lines += checked.problems
    lines += [f"warning: {sentence}" for sentence in checked.warnings]
    return "\n".join([*lines, LINKS_NOT_CHECKED])


def gap_lines(cell: Cell) -> list[str]:
    """Return which gaps of a pose list are so wide that a new row may be meant to begin there."""
    gaps = cell.workpiece.wide_gaps()
    lines = [
        f"wide gap        {gap * 1e3:.4g} mm between lines {first} and {last} of the list, {times:.3g} times the row's"
        " median; does a new row begin there?"
        for first, last, gap, times in gaps[:_GAPS_SHOWN]
    ]
    return lines + ([f"                and {len(gaps) - _GAPS_SHOWN} more"] if len(gaps) > _GAPS_SHOWN else [])


def missed_lines(tool_path: ToolPath, reach: Sequence[Reach]) -> list[str]:
    """Return which points are missed and why, a line for each row and reason."""
    first_of_row = np.searchsorted(tool_path.row_of_point, np.arange(len(tool_path.rows)))
    missed: dict[tuple[int, str], list[int]] = {}
    for index, verdict in enumerate(reach):
        if verdict.reason is not ReachReason.WITHIN_REACH:
            row = int(tool_path.row_of_point[index])
            # a proved excess differs from point to point: the row tells the reason, its worst point the amount
            missed.setdefault((row, verdict.reason.value), []).append(index)
    lines = []
    for (row, _), indices in missed.items():
        worst = max((reach[index] for index in indices), key=lambda verdict: verdict.excess)
        lines.append(f"row {row} points {spans([int(i - first_of_row[row]) for i in indices])}: {worst}")
    return lines


def _pose_line(what: str, T: NDArray[np.float64]) -> str:
    from scipy.spatial.transform import Rotation

    x, y, z = (T[:3, 3] * 1e3).round(3) + 0.0
    # what rounds to nothing has no sign
    qx, qy, qz, qw = Rotation.from_matrix(T[:3, :3]).as_quat(canonical=True).round(5) + 0.0
    return f"{what:<15} ({x:.3f}, {y:.3f}, {z:.3f}) mm, qx {qx:.5f} qy {qy:.5f} qz {qz:.5f} qw {qw:.5f}"


def _steps(prismatic: NDArray[np.bool_], jump: NDArray[np.float64]) -> list[str]:
    angles = sorted({float(x) for x in jump[~prismatic]})
    travels = sorted({float(x) for x in jump[prismatic]})
    return [f"{np.degrees(x):.3g} deg" for x in angles] + [f"{x * 1e3:.4g} mm" for x in travels]
