"""The arm, the surface and the rows in three dimensions: the paper's figures 1, 4, 7 and 8."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from qparm.path import SegmentKind
from qparm.view.style import GAP, REACHED, SELF_MOTION, SURFACE, new_figure, plain, save

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.cell import Cell
    from qparm.path import ToolPath
    from qparm.pipeline import Plan
    from qparm.robot import SerialChain

__all__ = ["arm_line", "backwards", "draw_arm", "draw_chain", "draw_surface", "draw_workpiece"]


def draw_surface(plan: Plan, file: Path) -> None:
    """Draw arm, surface, rows and self-motion areas, and beside it the rows unrolled with what failed."""
    figure = new_figure(13, 6.2, laid_out=False)
    scene: Any = figure.add_axes((0.0, 0.02, 0.5, 0.91), projection="3d", computed_zorder=False)
    tool_path = plan.tool_path
    draw_workpiece(scene, plan.cell)
    _draw_rows(scene, tool_path, plan.record.unreached)
    at_points = np.flatnonzero(plan.joint_path.point >= 0)
    if len(plan.record.unreached) == tool_path.point_count or not len(at_points):
        q, where = plan.cell.home(), "nothing reached, arm at home"
    else:
        q, where = plan.joint_path.q[at_points[len(at_points) // 2]], "arm at the middle of its path"
    draw_chain(scene, plan.chain, q, rail=True)
    _finish(scene, plan.chain, tool_path)
    scene.set_title(f"{plain(plan.cell.name)}: {where}", fontsize=10)
    _draw_unrolled(figure.add_axes((0.545, 0.15, 0.44, 0.79)), plan)
    save(figure, file)


def draw_arm(cell: Cell, file: Path) -> None:
    """Draw the arm at zero and at home, with the frames of its joints, before the workpiece."""
    chain, tool_path = cell.chain(), cell.tool_path()
    zero, home = np.clip(np.zeros(chain.n), chain.lower, chain.upper), cell.home()
    same = np.array_equal(zero, home)
    poses = [("at zero, which is home", zero)] if same else [("at zero", zero), ("at home", home)]
    figure = new_figure(7.5 * len(poses) + 0.5, 7)
    for k, (where, q) in enumerate(poses):
        scene: Any = figure.add_subplot(1, len(poses), k + 1, projection="3d", computed_zorder=False)
        draw_workpiece(scene, cell)
        _draw_rows(scene, tool_path, np.array([], dtype=int))
        draw_chain(scene, chain, q, rail=True, frames=True)
        _finish(scene, chain, tool_path)
        scene.set_title(f"{plain(cell.arm.name)} {where}", fontsize=10)
    save(figure, file)


def draw_workpiece(scene: Any, cell: Cell) -> None:
    """Draw the workpiece's surface, if it is known, where it stands."""
    surface = cell.workpiece.surface()
    if surface is None:
        return
    u, v = np.meshgrid(np.linspace(0, 1, 49), np.linspace(0, 1, 29))
    points = surface.point(u, v)
    T = cell.workpiece.pose.matrix()
    points = points @ T[:3, :3].T + T[:3, 3]
    scene.plot_surface(
        points[..., 0],
        points[..., 1],
        points[..., 2],
        color=SURFACE,
        alpha=0.55,
        linewidth=0,
        rstride=1,
        cstride=1,
    )


def _draw_rows(scene: Any, tool_path: ToolPath, unreached: NDArray[np.int64]) -> None:
    for k, row in enumerate(tool_path.rows):
        p = tool_path.pose(k, np.linspace(0, row.length, 60))[:, :3, 3]
        scene.plot(*p.T, color=REACHED, linewidth=0.9, label="rows" if k == 0 else None)
    for k, transition in enumerate(tool_path.transitions):
        s = np.linspace(0, transition.length, 12)
        p = (tool_path.pose_base_workpiece @ transition.curve(s))[:, :3, 3]
        scene.plot(*p.T, color=SELF_MOTION, linewidth=3, label="self-motion areas" if k == 0 else None)
    marked = tool_path.poses[tool_path.in_self_motion_area, :3, 3]
    if len(marked):
        scene.scatter(*marked.T, color=SELF_MOTION, s=12)
    if len(unreached):
        scene.scatter(*tool_path.poses[unreached, :3, 3].T, color=GAP, s=7, label="not reached", depthshade=False)
    scene.legend(loc="upper left", fontsize=8, frameon=False)


def arm_line(chain: SerialChain, q: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the line that stands for the arm, (n + 2, 3): its foot, the origins of its joints, the tool."""
    points = chain.frames(q)[:, :3, 3]
    points[0] = chain.transform_base[:3, 3]
    return points


def draw_chain(
    scene: Any, chain: SerialChain, q: NDArray[np.float64], *, rail: bool = False, frames: bool = False
) -> None:
    """Draw the arm at one configuration as a line through its joints, and the travel of its prismatic joints."""
    poses = chain.frames(q)
    points = arm_line(chain, q)
    if rail:
        for i in np.flatnonzero(chain.prismatic):
            ends = np.array([q, q])
            ends[:, i] = chain.lower[i], chain.upper[i]
            track = np.array([chain.frames(end)[i + 1, :3, 3] for end in ends])
            scene.plot(*track.T, color="0.35", linewidth=5, alpha=0.5, solid_capstyle="butt")
    scene.plot(*points.T, color="0.15", linewidth=3.5, solid_joinstyle="round")
    scene.scatter(*points[1:-1].T, color="0.15", s=26, depthshade=False)
    scene.scatter(*points[-1:].T, color=GAP, s=30, depthshade=False)
    if frames:
        size = 0.25 * chain.characteristic_length
        for T in poses:
            for axis, colour in enumerate(("#d62728", "#2ca02c", "#1f77b4")):
                tip = T[:3, 3] + size * T[:3, axis]
                scene.plot(*np.stack([T[:3, 3], tip]).T, color=colour, linewidth=1.6)
        # frames that share an origin share a label
        labels: dict[tuple[float, ...], list[str]] = {}
        for name, p in zip(["base", *chain.names, "tool"], points, strict=True):
            labels.setdefault(tuple(np.round(p, 6)), []).append(name)
        for p, names in labels.items():
            scene.text(p[0] - 0.6 * size, p[1] - 0.6 * size, p[2], ", ".join(names), fontsize=7, ha="right")


def _finish(scene: Any, chain: SerialChain, tool_path: ToolPath) -> None:
    from matplotlib.ticker import MaxNLocator

    scene.set_xlabel("x (m)")
    scene.set_ylabel("y (m)")
    scene.set_zlabel("z (m)")
    scene.set_aspect("equal")
    for axis in (scene.xaxis, scene.yaxis, scene.zaxis):
        axis.set_major_locator(MaxNLocator(4))  # the numbers of a small cell are long and would overlap
    # from the side of the arm, where the work is seen
    outward = -tool_path.poses[:, :3, 2].mean(axis=0)
    azimuth = np.degrees(np.arctan2(outward[1], outward[0])) if np.hypot(outward[0], outward[1]) > 1e-6 else -90.0
    scene.view_init(elev=22, azim=azimuth + 38)


def backwards(tool_path: ToolPath) -> list[bool]:
    """Return which rows run against the first: each is compared with the one before it, which it lies beside."""
    share = np.linspace(0.0, 1.0, 33)
    places = [tool_path.pose(k, share * row.length)[:, :3, 3] for k, row in enumerate(tool_path.rows)]
    found = [False]
    for before, row in pairwise(places):
        against = np.linalg.norm(row[::-1] - before, axis=1).sum() < np.linalg.norm(row - before, axis=1).sum()
        found.append(found[-1] != bool(against))
    return found


def _draw_unrolled(axis: Any, plan: Plan) -> None:
    """Draw every point by arc length and row."""
    tool_path = plan.tool_path
    # of rows that run back and forth, arc length is measured from the same side for all
    along = np.concatenate(
        [row.length - row.s if back else row.s for row, back in zip(tool_path.rows, backwards(tool_path), strict=True)]
    )
    lengths = np.array([row.length for row in tool_path.rows])
    x = (along - 0.5 * lengths[tool_path.row_of_point]) * 1e3
    y = tool_path.row_of_point
    reached = np.ones(tool_path.point_count, dtype=bool)
    reached[plan.record.unreached] = False
    axis.scatter(x[reached], y[reached], s=9, color=REACHED, label=f"reached ({int(reached.sum())})")
    marked = reached & tool_path.in_self_motion_area
    if marked.any():
        axis.scatter(x[marked], y[marked], s=9, color=SELF_MOTION, label=f"in self-motion areas ({int(marked.sum())})")
    if (~reached).any():
        axis.scatter(
            x[~reached],
            y[~reached],
            s=16,
            color=GAP,
            marker="x",
            label=f"not reached ({int((~reached).sum())})",
        )
    first = True
    for k in range(len(tool_path.transitions)):
        a = np.flatnonzero(y == k)[-1]
        b = np.flatnonzero(y == k + 1)[0]
        axis.plot(x[[a, b]], y[[a, b]], color=SELF_MOTION, linewidth=3, label="transitions" if first else None)
        first = False
    breaks = [motion for motion in plan.breaks if motion.kind is SegmentKind.BREAK]
    for k, motion in enumerate(breaks):
        ends = [motion.first, motion.last]
        axis.plot(x[ends], y[ends], color=GAP, linewidth=1.2, linestyle=":",
                  label=f"breaks ({len(breaks)})" if k == 0 else None)  # fmt: skip
    axis.set_xlabel("arc length from the middle of the row (mm)")
    axis.set_ylabel("row")
    axis.yaxis.get_major_locator().set_params(integer=True)
    axis.set_title("the rows unrolled", fontsize=10)
    axis.legend(loc="upper center", bbox_to_anchor=(0.5, -0.1), ncols=4, frameon=False, fontsize=8)
