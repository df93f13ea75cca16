"""The joint path as CSV: one line per waypoint, SI, the unit in every column's name."""

from __future__ import annotations

from pathlib import Path

from qparm.path import JointPath
from qparm.robot import SerialChain

__all__ = ["write_joint_path_csv"]


def write_joint_path_csv(chain: SerialChain, path: JointPath, file: Path) -> None:
    """Write ``index,row,kind,status,s[m]`` and the joints; numbers read back to the same bits.

    ``index`` is the point of the raster and ``row`` its row, both from 0 and -1 for a waypoint that is none (home,
    and the index of a waypoint between points). ``s`` is the tool's arc length within its row or transition.
    """
    header = [
        "index",
        "row",
        "kind",
        "status",
        "s[m]",
        *(f"{n}[{u}]" for n, u in zip(chain.names, chain.units, strict=True)),
    ]
    with file.open("w", encoding="utf-8", newline="\n") as out:
        out.write(",".join(header) + "\n")
        for k in range(len(path.q)):
            joints = ",".join(repr(value) for value in path.q[k].tolist())
            out.write(
                f"{path.point[k]},{path.row[k]},{path.kind[k].value},{path.status[k]},{float(path.s[k])!r},{joints}\n"
            )
