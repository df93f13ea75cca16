"""The trajectory as CSV at a fixed period: position, velocity, acceleration and jerk of every joint."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from qparm.path import Trajectory
from qparm.robot import SerialChain

__all__ = ["write_trajectory_csv"]

_DERIVATIVES = (("q", ""), ("qd", "/s"), ("qdd", "/s^2"), ("qddd", "/s^3"))


def write_trajectory_csv(chain: SerialChain, trajectory: Trajectory, file: Path, *, period: float) -> None:
    """Write ``t``, all positions, velocities, accelerations and jerks, then ``row,segment,process_on``.

    Twelve significant digits, SI; the last sample is the trajectory's end, whatever the period.
    """
    units = ["m" if prismatic else "rad" for prismatic in chain.prismatic]
    header = ["t[s]"]
    for symbol, per in _DERIVATIVES:
        header += [f"{symbol}_{name}[{unit}{per}]" for name, unit in zip(chain.names, units, strict=True)]
    header += ["row", "segment", "process_on"]
    t = trajectory.sample_times(period)
    numbers = np.column_stack([t, *(trajectory(t, order) for order in range(4))])
    tails = [f"{s.row},{s.kind.value},{int(s.process_on)}" for s in trajectory.segments]
    line = ",".join(["%.12g"] * numbers.shape[1])
    at = trajectory.segment_at(t).tolist()
    with file.open("w", encoding="utf-8", newline="\n") as out:
        out.write(",".join(header) + "\n")
        for values, segment in zip(numbers.tolist(), at, strict=True):
            out.write(f"{line % tuple(values)},{tails[segment]}\n")
