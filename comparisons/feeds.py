"""Whether the feed leaves the path alone: no breaks, never slower when it is higher, the same tool path.

    python -m comparisons.feeds [--out FOLDER]

The dome and the cell of `qparm new` at 20 to 600 mm/s. Exit status 1 if a bar does not hold.
"""

from __future__ import annotations

import argparse
import tempfile
from importlib.resources import files
from pathlib import Path

import numpy as np

import qparm
from comparisons.tables import save_table
from qparm.planning import second_differences

__all__ = ["main"]

ROOT = Path(__file__).resolve().parents[1]
FEEDS = (20, 50, 100, 200, 300, 600)
# How far the tool may be off its path (m), and by what share second differences may differ from those at 20 mm/s.
_OFF, _SAME = 5e-6, 1e-9


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("comparisons/out"))
    out: Path = parser.parse_args().out
    rows, kept = [], True
    with tempfile.TemporaryDirectory() as folder:
        new = Path(folder) / "cell.toml"
        new.write_text(files("qparm.cell").joinpath("new_cell.toml").read_text(encoding="utf-8"), encoding="utf-8")
        for name, file in (("dome", ROOT / "examples" / "dome.toml"), ("qparm new", new)):
            last, at_first = np.inf, (0.0, 0.0)
            for feed in FEEDS:
                plan = qparm.plan(file, feed=f"{feed} mm/s")
                report = qparm.report(plan)
                bends = second_differences(plan.chain, plan.tool_path, plan.solution)
                at_first = bends if feed == FEEDS[0] else at_first
                duration, breaks = plan.trajectory.duration, len(plan.joint_path.breaks)
                off = max(report.figures.between.position, report.off_path[0])
                good = (
                    report.executable and not breaks and duration <= last and off <= _OFF
                    and np.allclose(bends, at_first, rtol=_SAME)
                )  # fmt: skip
                last, kept = duration, kept and good
                rows.append((
                    name, feed, breaks, f"{duration:.2f}", f"{off * 1e6:.2f}", f"{np.degrees(bends[0]):.3f}",
                    f"{report.figures.feed.kept:.0%}", f"{report.figures.feed.highest * 1e3:.1f}",
                    "kept" if good else "**not kept**",
                ))  # fmt: skip
    header = ("cell", "feed mm/s", "breaks", "duration s", "tool off its path um", "second differences deg rms",
              "of the way at the feed", "highest feed of every row mm/s", "verdict")  # fmt: skip
    print(save_table(out, "feeds", "The same path at any feed", header, rows))
    return 0 if kept else 1


if __name__ == "__main__":
    raise SystemExit(main())
