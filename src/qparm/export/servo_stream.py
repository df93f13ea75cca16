"""The trajectory as a stream of set points for a servo interface: one line of positions for every tick."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from qparm.export.sampled import SampledTrajectory

__all__ = ["write_stream"]


def write_stream(sampled: SampledTrajectory, file: Path) -> None:
    """Write ``t`` and all positions as CSV, every line one period after the one before; 12 digits, SI."""
    header = ["t[s]", *(f"{name}[{unit}]" for name, unit in zip(sampled.joint_names, sampled.units, strict=True))]
    line = ",".join(["%.12g"] * len(header))
    with file.open("w", encoding="utf-8", newline="\n") as out:
        out.write(",".join(header) + "\n")
        for t, q in zip(sampled.t.tolist(), sampled.derivatives[0].tolist(), strict=True):
            out.write(line % (t, *q) + "\n")
