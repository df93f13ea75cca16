"""The trajectory as CSV: position, velocity, acceleration and jerk of every joint at a fixed period."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from qparm.export.decimal_text import lines_of
from qparm.export.sampled import at_period

if TYPE_CHECKING:
    from qparm.export.sampled import SampledTrajectory
    from qparm.path import Trajectory

__all__ = ["column_names", "write_csv", "write_samples_csv"]

# Lines at a time: as text they take twice the memory.
_CHUNK = 10_000
_DERIVATIVES = (("q", ""), ("qd", "/s"), ("qdd", "/s^2"), ("qddd", "/s^3"))


def column_names(joint_names: Sequence[str], units: Sequence[str]) -> list[str]:
    """Return the names of the columns of numbers: the time, then all joints order by order, with their units.

    Parameters
    ----------
    joint_names, units : sequence of str
        A joint of unknown unit, ``""``, has none in its names.
    """
    names = ["t[s]"]
    for symbol, per in _DERIVATIVES:
        for name, unit in zip(joint_names, units, strict=True):
            names.append(f"{symbol}_{name}" + (f"[{unit}{per}]" if unit else ""))
    return names


def write_csv(sampled: SampledTrajectory, file: Path) -> None:
    """Write ``t``, positions, velocities, accelerations, jerks, then ``row,segment,process_on``; 12 digits, SI."""
    header = [*column_names(sampled.joint_names, sampled.units), "row", "segment", "process_on"]
    tails = [f"{s.row},{s.kind.value},{int(s.process_on)}" for s in sampled.trajectory.segments]
    with file.open("wb") as out:
        out.write((",".join(header) + "\n").encode())
        for first in range(0, len(sampled.t), _CHUNK):
            part = slice(first, first + _CHUNK)
            numbers = np.column_stack([sampled.t[part], *sampled.derivatives[:, part]])
            out.write(lines_of(numbers, sampled.segment[part], tails))


def write_samples_csv(
    trajectory: Trajectory, file: str | Path, *, period: float, units: Sequence[str] | None = None
) -> None:
    """Write a trajectory every ``period`` seconds: see :func:`write_csv`.

    Parameters
    ----------
    trajectory : Trajectory
    file : str or Path
    period : float
        s. The last sample is the trajectory's end, whatever the period.
    units : sequence of str, optional
        Of the joints' positions; unknown without.
    """
    units = [""] * len(trajectory.joint_names) if units is None else units
    write_csv(at_period(trajectory, units, period), Path(file))
