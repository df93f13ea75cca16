"""A trajectory format of your own: one line of positions in degrees and millimetres for every 20 ms."""

import tempfile
from pathlib import Path

import numpy as np

import qparm
from qparm.export import FORMATS, Format, at_period, export_trajectory


def write_plain(sampled, file):
    """Write the positions, separated by blanks."""
    scale = np.where(np.array(sampled.units) == "rad", 180 / np.pi, 1e3)
    np.savetxt(file, sampled.derivatives[0] * scale, fmt="%.6f")


FORMATS["plain"] = Format(write_plain, at_period, period=0.02, extension=".txt")
plan = qparm.plan("examples/dome.toml", feed="200 mm/s")
with tempfile.TemporaryDirectory() as folder:
    done = export_trajectory(plan.trajectory, Path(folder) / "dome.txt", to="plain", units=plan.chain.units)
    print(f"{done.samples} lines, the first: {done.files[0].read_text().splitlines()[0]}")
