"""The trajectory as Parquet: the columns of the CSV, to the last bit."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from qparm.export.trajectory_csv import column_names
from qparm.extras import load_extra

if TYPE_CHECKING:
    from qparm.export.sampled import SampledTrajectory

__all__ = ["write_parquet"]


def write_parquet(sampled: SampledTrajectory, file: Path) -> None:
    """Write a table in double precision; joint names, units and whether it may be executed as metadata ``qparm``."""
    arrow = load_extra("pyarrow", instead="--to npz")
    parquet = load_extra("pyarrow.parquet", instead="--to npz")
    numbers = np.column_stack([sampled.t, *sampled.derivatives])
    columns = dict(zip(column_names(sampled.joint_names, sampled.units), numbers.T, strict=True))
    said = {
        "joint_names": list(sampled.joint_names),
        "units": list(sampled.units),
        "executable": sampled.trajectory.executable,
    }
    table = arrow.table(
        columns | {"row": sampled.row, "segment": sampled.kind.tolist(), "process_on": sampled.process_on},
        metadata={"qparm": json.dumps(said)},
    )
    parquet.write_table(table, file)
