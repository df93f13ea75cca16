"""Joint position, velocity and acceleration over time: the paper's figures 10 to 15 in form."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from qparm.path import SegmentKind
from qparm.view.style import COLOURS, GAP, SELF_MOTION, margins, new_figure, plain, save

if TYPE_CHECKING:
    from qparm.pipeline import Plan

__all__ = ["draw_joints"]

_TITLES = ("position", "velocity", "acceleration")
_PER = ("", "/s", "/s²")
_SAMPLES = 12_000
# More names in one column would be higher than the panel, and crush it.
_LEGEND_ROWS = 12


def draw_joints(plan: Plan, order: int, file: Path) -> None:
    """Draw one derivative of all joints over time.

    Revolute joints share one panel, prismatic ones another; limits of velocity and acceleration are
    dashed, breaks and transitions shaded.

    Parameters
    ----------
    plan : Plan
    order : {0, 1, 2}
        Position, velocity, acceleration.
    file : Path
        The PNG.
    """
    chain, trajectory = plan.chain, plan.trajectory
    # the knots too: a short segment may lie between two of the even samples
    t = np.unique(np.concatenate([np.linspace(0, trajectory.duration, _SAMPLES), trajectory.knots]))
    values = trajectory(t, order)
    groups: list[tuple[str, np.ndarray, float, str]] = []
    if (~chain.prismatic).any():
        groups.append(("revolute", np.flatnonzero(~chain.prismatic), 180 / np.pi, "deg"))
    if chain.prismatic.any():
        groups.append(("prismatic", np.flatnonzero(chain.prismatic), 1e3, "mm"))
    columns = max(math.ceil(len(joints) / _LEGEND_ROWS) for _, joints, *_ in groups)
    figure = new_figure(11 + 1.2 * (columns - 1), 3.2 * len(groups) + 0.8, laid_out=False)
    axes = figure.subplots(len(groups), 1, sharex=True, squeeze=False)[:, 0]
    limits = (None, chain.velocity, chain.acceleration)[order]
    legends = []
    for axis, (kind, joints, factor, unit) in zip(axes, groups, strict=True):
        _shade(axis, plan)
        for joint in joints:
            colour = COLOURS[joint % len(COLOURS)]
            axis.plot(t, values[:, joint] * factor, color=colour, linewidth=0.9, label=chain.names[joint])
        if limits is not None:
            for limit in sorted(set((limits[joints] * factor).tolist())):
                for sign in (1, -1):
                    axis.axhline(sign * limit, color="0.45", linestyle="--", linewidth=0.8)
        axis.set_ylabel(f"{kind} {_TITLES[order]}\n({unit}{_PER[order]})")
        axis.margins(x=0)
        axis.grid(alpha=0.25)
        ncols = math.ceil(len(joints) / _LEGEND_ROWS)
        size = 8 if ncols == 1 else 6
        legends.append(
            axis.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, fontsize=size, ncols=ncols)
        )
    axes[-1].set_xlabel("time (s)")
    figure.suptitle(_title(plan, order), fontsize=11)
    widest = max(legend.get_window_extent().width for legend in legends) / figure.dpi
    margins(figure, left=0.95, right=widest + 0.1, bottom=0.55, top=0.4)
    save(figure, file)


def _title(plan: Plan, order: int) -> str:
    options = plan.options
    breaks = sum(motion.kind is SegmentKind.BREAK for motion in plan.breaks)
    what = f"{breaks} breaks (red)" if breaks else "no breaks"
    if len(plan.record.unreached) == plan.tool_path.point_count:
        what = "nothing reached"
    dashed = "; limits dashed" if order else ""
    return (
        f"{plain(plan.cell.name)}: joint {_TITLES[order]}, strategy {options.strategy}, timing {options.timing};"
        f" {what}, transitions orange{dashed}"
    )


def _shade(axis: Any, plan: Plan) -> None:
    for segment in plan.trajectory.segments:
        if segment.kind is SegmentKind.BREAK:
            # a break may be far narrower than a pixel
            axis.axvspan(segment.start, segment.end, color=GAP, alpha=0.25, linewidth=0)
            axis.axvline(segment.start, color=GAP, alpha=0.5, linewidth=0.8)
        elif segment.kind is SegmentKind.TRANSITION:
            axis.axvspan(segment.start, segment.end, color=SELF_MOTION, alpha=0.18, linewidth=0)
