"""The trajectory as NPZ: numpy arrays, to the last bit."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from qparm.export.sampled import SampledTrajectory

__all__ = ["write_npz"]


def write_npz(sampled: SampledTrajectory, file: Path) -> None:
    """Write the arrays ``t``, ``q``, ``qd``, ``qdd``, ``qddd``, ``joint_names``, ``units``, ``row`` and the like."""
    q, qd, qdd, qddd = sampled.derivatives
    np.savez_compressed(
        file,
        t=sampled.t,
        q=q,
        qd=qd,
        qdd=qdd,
        qddd=qddd,
        joint_names=np.array(sampled.joint_names),
        units=np.array(sampled.units),
        row=sampled.row,
        segment=sampled.kind,
        process_on=sampled.process_on,
        executable=np.array(sampled.trajectory.executable),
    )
