"""The trajectory as CSV at a fixed period: position, velocity, acceleration and jerk of every joint."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from qparm.path import Trajectory
from qparm.robot import SerialChain

__all__ = ["write_samples_csv", "write_trajectory_csv"]

_DERIVATIVES = (("q", ""), ("qd", "/s"), ("qdd", "/s^2"), ("qddd", "/s^3"))


def write_trajectory_csv(chain: SerialChain, trajectory: Trajectory, file: Path, *, period: float) -> None:
    """Write the trajectory of an arm: see :func:`write_samples_csv`, with units of its joints."""
    units = ["m" if prismatic else "rad" for prismatic in chain.prismatic]
    write_samples_csv(trajectory, file, period=period, units=units)


def write_samples_csv(trajectory: Trajectory, file: Path, *, period: float, units: Sequence[str] | None = None) -> None:
    """Write ``t``, all positions, velocities, accelerations and jerks, then ``row,segment,process_on``.

    Twelve significant digits, SI; the last sample is the trajectory's end, whatever the period.

    Parameters
    ----------
    trajectory : Trajectory
    file : Path
    period : float
        s.
    units : sequence of str, optional
        Of the joints' positions; unknown without.
    """
    header = ["t[s]"]
    for symbol, per in _DERIVATIVES:
        for joint, name in enumerate(trajectory.joint_names):
            header.append(f"{symbol}_{name}" + (f"[{units[joint]}{per}]" if units is not None else ""))
    header += ["row", "segment", "process_on"]
    t, derivatives = trajectory.sample(period)
    numbers = np.column_stack([t, *derivatives])
    tails = [f"{s.row},{s.kind.value},{int(s.process_on)}" for s in trajectory.segments]
    line = ",".join(["%.12g"] * numbers.shape[1])
    at = trajectory.segment_at(t).tolist()
    with file.open("w", encoding="utf-8", newline="\n") as out:
        out.write(",".join(header) + "\n")
        for values, segment in zip(numbers.tolist(), at, strict=True):
            out.write(f"{line % tuple(values)},{tails[segment]}\n")
