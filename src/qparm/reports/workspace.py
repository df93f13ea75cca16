"""The summary of workspaces: arms beside each other."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from qparm.reach import ReachReason

if TYPE_CHECKING:
    from qparm.reach.workspace import Workspace

__all__ = ["workspace_text"]


def workspace_text(found: Sequence[Workspace]) -> str:
    """Return what was found, readable, the arms beside each other."""
    rows: list[tuple[str, list[str]]] = [
        ("arm", [w.cell.arm.name for w in found]),
        ("joints", [str(w.cell.chain().n) for w in found]),
        ("reachable region (m^3)", [f"{w.volume:.2f}" for w in found]),
    ]
    for axis, letter in enumerate("xyz"):
        extents = [[float(corner[axis]) for corner in w.extent] for w in found]
        rows.append((f"... along {letter} (m)", [f"{a:.2f} to {b:.2f}" for a, b in extents]))
    rows += [
        (f"working space reached, {found[0].depth * 1e3:.4g} mm deep (m^3)", [f"{w.used_volume:.4f}" for w in found]),
        ("share of the region used", [f"{w.share_used:.2%}" for w in found]),
        ("points of the path", [str(len(w.reach)) for w in found]),
    ]
    for reason in ReachReason:
        counts = [w.reasons[reason] for w in found]
        if reason is ReachReason.WITHIN_REACH or any(counts):
            label = "... within reach" if reason is ReachReason.WITHIN_REACH else f"... missed: {reason.value}"
            rows.append((label, [str(count) for count in counts]))
    margins = [w.margin[np.isfinite(w.margin)] for w in found]
    rows.append(
        (
            "attainable singularity margin, least / median",
            [f"{m.min():.3f} / {np.median(m):.3f}" if len(m) else "-" for m in margins],
        )
    )
    first = max(len(label) for label, _ in rows)
    widths = [max(len(row[k]) for _, row in rows) for k in range(len(found))]
    return "\n".join(
        f"{label:<{first}}  " + "  ".join(f"{cell:>{width}}" for cell, width in zip(row, widths, strict=True))
        for label, row in rows
    )
