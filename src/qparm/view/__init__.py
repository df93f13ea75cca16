"""Pictures of a cell and of a plan."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from qparm.view.joints import draw_joints
from qparm.view.scene import draw_arm, draw_surface
from qparm.view.style import load_ahead
from qparm.view.workspace import draw_coverage, draw_workspace

if TYPE_CHECKING:
    from qparm.pipeline import Plan

PICTURES = ("joints.png", "velocity.png", "acceleration.png", "surface.png")

__all__ = [
    "PICTURES",
    "draw_arm",
    "draw_coverage",
    "draw_joints",
    "draw_plan",
    "draw_surface",
    "draw_workspace",
    "load_ahead",
]


def draw_plan(plan: Plan, folder: Path, *, progress: Callable[[int, int], None] | None = None) -> None:
    """Draw ``joints.png``, ``velocity.png``, ``acceleration.png`` and ``surface.png`` into a folder."""
    *joints, surface = PICTURES
    for order, name in enumerate(joints):
        if progress is not None:
            progress(order, 4)
        draw_joints(plan, order, folder / name)
    if progress is not None:
        progress(3, 4)
    draw_surface(plan, folder / surface)
    if progress is not None:
        progress(4, 4)


def __dir__() -> list[str]:
    return sorted(__all__)
