"""The files of a workspace in one folder: numbers, verdicts, points and pictures."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from qparm.view import draw_coverage, draw_workspace

if TYPE_CHECKING:
    from qparm.reach.workspace import Workspace

__all__ = ["WORKSPACE_FILES", "write_workspace"]

WORKSPACE_FILES = ("workspace.json", "coverage.csv", "region.csv", "workspace.png", "coverage.png")


def write_workspace(found: Sequence[Workspace], folder: Path) -> tuple[str, ...]:
    """Write numbers, verdicts, points and pictures into a folder and return the names of the files."""
    numbers = {
        "spacing_m": found[0].spacing,
        "depth_m": found[0].depth,
        "arms": [w.numbers() for w in found],
    }
    (folder / "workspace.json").write_text(json.dumps(numbers, indent=2, allow_nan=False) + "\n", encoding="utf-8")
    with (folder / "coverage.csv").open("w", encoding="utf-8", newline="\n") as file:
        file.write("arm,point,row,x[m],y[m],z[m],verdict,excess[m],attainable_margin\n")
        for k, w in enumerate(found):
            path = w.cell.tool_path()
            for i, (place, verdict) in enumerate(zip(path.poses[:, :3, 3].tolist(), w.reach, strict=True)):
                margin = "" if np.isnan(w.margin[i]) else f"{w.margin[i]:.6f}"
                x, y, z = (f"{value:.9f}" for value in place)
                row = int(path.row_of_point[i])
                file.write(f"{k},{i},{row},{x},{y},{z},{verdict.reason.value},{verdict.excess:.9f},{margin}\n")
    with (folder / "region.csv").open("w", encoding="utf-8", newline="\n") as file:
        file.write("arm,x[m],y[m],z[m],rim\n")
        for k, w in enumerate(found):
            for (x, y, z), rim in zip(w.points.tolist(), w.rim.tolist(), strict=True):
                file.write(f"{k},{x:.6f},{y:.6f},{z:.6f},{int(rim)}\n")
    draw_workspace(found, folder / "workspace.png")
    draw_coverage(found, folder / "coverage.png")
    return WORKSPACE_FILES
