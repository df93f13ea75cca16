"""Pictures of workspaces: the region as a cloud and in sections (the paper's figures 2 and 3), and the coverage."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from qparm.reach import ReachReason
from qparm.view.scene import arm_line, backwards, draw_chain, draw_workpiece
from qparm.view.style import GAP, REACHED, SELF_MOTION, new_figure, plain, save

if TYPE_CHECKING:
    from qparm.reach.workspace import Slice, Workspace

__all__ = ["draw_coverage", "draw_workspace"]

# Not reached, by reason; each with a mark of its own, for eyes and prints without colour.
_MARKS = {
    ReachReason.TOO_FAR: (GAP, "x"),
    ReachReason.TOO_NEAR: ("#cc79a7", "+"),
    ReachReason.LIMITS: (SELF_MOTION, "s"),
    ReachReason.ORIENTATION: ("#009e73", "^"),
    ReachReason.POSITION: ("#000000", "d"),
}
# Points of the path this near to a section (m) are drawn in it.
_NEAR = 0.02
_MOST_DOTS = 6000


def draw_workspace(found: Sequence[Workspace], file: Path) -> None:
    """Draw each arm's region in a row: rim and arm in space, the upright section, the level one."""
    figure = new_figure(15, 4.9 * len(found))
    boxes = [w.extent for w in found]
    low = np.nanmin([low for low, _ in boxes], axis=0)
    high = np.nanmax([high for _, high in boxes], axis=0)
    for k, w in enumerate(found):
        scene: Any = figure.add_subplot(len(found), 3, 3 * k + 1, projection="3d", computed_zorder=False)
        _draw_cloud(scene, w, low, high)
        for column, section in enumerate(w.slices):
            _draw_slice(figure.add_subplot(len(found), 3, 3 * k + 2 + column), w, section, found)
    save(figure, file)


def _draw_cloud(scene: Any, w: Workspace, low: np.ndarray, high: np.ndarray) -> None:
    # the half behind the upright section, so that one sees into the region
    section = w.slices[0]
    behind = (w.points - section.origin) @ np.cross(section.across, section.up) <= 0
    rim = w.points[w.rim & behind]
    rim = rim[:: max(1, len(rim) // _MOST_DOTS)]
    scene.scatter(*rim.T, c=rim[:, 2], cmap="Blues", vmin=2 * low[2] - high[2], vmax=high[2], s=5, alpha=0.35,
                  linewidths=0, depthshade=False)  # fmt: skip
    draw_workpiece(scene, w.cell)
    scene.scatter(*w.cell.tool_path().poses[:, :3, 3].T, color=GAP, s=1.5, linewidths=0, depthshade=False)
    draw_chain(scene, w.cell.chain(), w.cell.home(), rail=True)
    scene.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    scene.set(xlabel="x (m)", ylabel="y (m)", zlabel="z (m)")
    scene.set_aspect("equal")
    scene.set_box_aspect(None, zoom=0.85)  # or the labels leave the panel
    normal = np.cross(section.across, section.up)
    scene.view_init(elev=18, azim=np.degrees(np.arctan2(normal[1], normal[0])) + 25)
    scene.set_title(f"{plain(w.cell.arm.name)}: {w.volume:.2f} m³ reached, {w.share_used:.1%} of it used", fontsize=10)


def _draw_slice(axis: Any, w: Workspace, section: Slice, found: Sequence[Workspace]) -> None:
    from matplotlib.colors import ListedColormap

    axis.pcolormesh(
        section.x, section.y, np.where(section.reached, 1.0, np.nan).T, cmap=ListedColormap(["#a9c9e2"]),
        shading="nearest", rasterized=True,
    )  # fmt: skip
    if section.reached.any() and not section.reached.all():
        axis.contour(section.x, section.y, section.reached.T.astype(float), levels=[0.5], colors=REACHED, linewidths=1)
    places = w.cell.tool_path().poses[:, :3, 3]
    axis.plot(*section.flat(places[section.distance(places) <= _NEAR]).T, ".", color=GAP, markersize=4)
    chain = w.cell.chain()
    axis.plot(*section.flat(arm_line(chain, w.cell.home())).T, color="0.15", linewidth=2, marker="o",
              markersize=3)  # fmt: skip
    same = [other for v in found for other in v.slices if other.name == section.name]
    axis.set_xlim(min(s.x[0] for s in same), max(s.x[-1] for s in same))
    axis.set_ylim(min(s.y[0] for s in same), max(s.y[-1] for s in same))
    axis.set_aspect("equal")
    axis.grid(alpha=0.25)
    normal = np.cross(section.across, section.up)
    axis.set_xlabel(_axis_label(section.across))
    axis.set_ylabel(_axis_label(section.up))
    axis.set_title(f"section at {_plane_label(normal, section.origin)}; red: the path in it", fontsize=10)


def _axis_label(direction: np.ndarray) -> str:
    for name, unit in zip("xyz", np.eye(3), strict=True):
        if np.allclose(direction, unit, atol=1e-6):
            return f"{name} (m)"
    return "towards the work (m)"


def _plane_label(normal: np.ndarray, point: np.ndarray) -> str:
    for name, unit in zip("xyz", np.eye(3), strict=True):
        if np.allclose(np.abs(normal), unit, atol=1e-6):
            return f"{name} = {float(unit @ point) + 0.0:.2f} m"
    return "the middle of the path"


def draw_coverage(found: Sequence[Workspace], file: Path) -> None:
    """Draw each arm's path unrolled: the attainable margin where it is reached, the reason where it is not."""
    figure = new_figure(7.5 * len(found) + 0.8, 5.6)
    finite = np.concatenate([w.margin[np.isfinite(w.margin)] for w in found])
    top = float(finite.max()) if len(finite) else 1.0
    axes, colours = [], None
    for k, w in enumerate(found):
        axis: Any = figure.add_subplot(1, len(found), k + 1)
        axes.append(axis)
        x, y = _unrolled(w)
        within = np.isfinite(w.margin)
        if within.any():
            colours = axis.scatter(x[within], y[within], c=w.margin[within], cmap="viridis", vmin=0.0, vmax=top, s=13)
        for reason, (colour, mark) in _MARKS.items():
            missed = np.array([verdict.reason is reason for verdict in w.reach])
            if missed.any():
                axis.scatter(x[missed], y[missed], color=colour, marker=mark, s=18, linewidths=1,
                             label=f"{reason.value} ({int(missed.sum())})")  # fmt: skip
        axis.set_xlabel("arc length from the middle of the row (mm)")
        axis.set_ylabel("row")
        count = w.reasons[ReachReason.WITHIN_REACH]
        axis.set_title(f"{plain(w.cell.arm.name)}: {count} of {len(w.reach)} points within reach", fontsize=10)
        if count < len(w.reach):
            axis.legend(loc="upper center", bbox_to_anchor=(0.5, -0.1), ncols=5, frameon=False, fontsize=8)
    if colours is not None:
        figure.colorbar(colours, ax=axes, shrink=0.85, label="attainable singularity margin")
    save(figure, file)


def _unrolled(w: Workspace) -> tuple[np.ndarray, np.ndarray]:
    """Return each point's arc length from the middle of its row (mm), from the same side for all, and its row."""
    path = w.cell.tool_path()
    along = [row.length - row.s if back else row.s for row, back in zip(path.rows, backwards(path), strict=True)]
    return np.concatenate([s - 0.5 * row.length for s, row in zip(along, path.rows, strict=True)]) * 1e3, (
        path.row_of_point
    )
