"""Paths on one clock: plain quintics through the points of each row at t = arc length / feed, nothing stretched.

Whatever the limits say, so that paths and not timings are compared. A row that breaks is several pieces.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

import qparm

__all__ = ["Smoothness", "draw_clock", "pieces", "smoothness_on_one_clock"]

_PLACES = 16


@dataclass(frozen=True)
class Smoothness:
    """Root mean square and peak of each joint's acceleration and jerk inside rows (deg or mm, per s^2 and s^3)."""

    joints: tuple[str, ...]
    acceleration_rms: tuple[float, ...]
    acceleration_peak: tuple[float, ...]
    jerk_rms: tuple[float, ...]
    jerk_peak: tuple[float, ...]


def pieces(plan: qparm.Plan) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return times and configurations of every run of reached neighbouring points, whatever their steps."""
    tool_path, solution = plan.tool_path, plan.solution
    row, found = tool_path.row_of_point, []
    together = solution.reached[1:] & solution.reached[:-1] & (row[1:] == row[:-1])
    borders = [0, *(np.flatnonzero(~together) + 1).tolist(), len(row)]
    for first, last in pairwise(borders):
        if last - first >= 3 and solution.reached[first]:
            found.append((tool_path.s[first:last] / plan.cell.process.feed, solution.q[first:last]))
    return found


def quintic(t: np.ndarray, q: np.ndarray, order: int) -> tuple[np.ndarray, np.ndarray]:
    """Return samples of the quintics through points with the states of parabolas, at 16 places per interval."""
    from scipy.interpolate import BPoly

    h = np.diff(t)[:, None]
    slope = np.diff(q, axis=0) / h
    v, a = np.gradient(q, t, axis=0, edge_order=2), np.zeros_like(q)
    a[1:-1] = 2 * np.diff(slope, axis=0) / (h[:-1] + h[1:])
    a[0], a[-1] = a[1], a[-2]
    curve = BPoly.from_derivatives(t, np.stack([q, v, a], axis=1))
    places = (t[:-1, None] + h * (np.arange(_PLACES) + 0.5) / _PLACES).ravel()
    return places, curve(places, order)


def smoothness_on_one_clock(plan: qparm.Plan) -> Smoothness:
    """Return how smooth a plan's path is inside rows."""
    runs = pieces(plan)
    unit = np.where(plan.chain.prismatic, 1e3, 180 / np.pi)
    measures = []
    for order in (2, 3):
        values = np.concatenate([quintic(t, q, order)[1] for t, q in runs]) * unit
        measures += [np.sqrt((values**2).mean(axis=0)), np.abs(values).max(axis=0)]
    return Smoothness(plan.chain.names, *(tuple(m.tolist()) for m in measures))


def draw_clock(plan: qparm.Plan, file: Path) -> None:
    """Draw joints, velocities and accelerations on the one clock, row after row: the paper's figures 10 to 15."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 9), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(3, 1, sharex=True)
    unit = np.where(plan.chain.prismatic, 1e2, 180 / np.pi)
    labels = ("position (deg, rail: cm)", "velocity (/s)", "acceleration (/s²)")
    for order, (axis, label) in enumerate(zip(axes, labels, strict=True)):
        start = 0.0
        for number, (t, q) in enumerate(pieces(plan)):
            places, values = quintic(t, q, order)
            for joint, name in enumerate(plan.chain.names):
                shown = name if number == 0 else None
                axis.plot(start + places - t[0], values[:, joint] * unit[joint], color=f"C{joint}", lw=0.8, label=shown)
            start += t[-1] - t[0]
        axis.set_ylabel(label)
        axis.grid(alpha=0.3)
    axes[0].legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    axes[-1].set_xlabel("time at the feed, row after row (s)")
    figure.suptitle(f"{plan.cell.name}: strategy {plan.options.strategy}, one clock, nothing stretched")
    figure.savefig(file)
