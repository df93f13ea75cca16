"""What the paper's general method leaves undone on a cell, over seeds, and what a step costs it.

    python -m comparisons.general [--cell FILE] [--seeds N] [--out FOLDER]

A seed draws the 50 random starts of which the first configuration is chosen. The whole plan is made and
measured; nothing is written but the table.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import qparm
from comparisons.tables import save_table


def main() -> None:
    """Print and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cell", type=Path, default=Path("examples/dome.toml"))
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--method", choices=["cwln", "wln", "gpm", "dls"], default="cwln")
    parser.add_argument("--out", type=Path, default=Path("comparisons/out"))
    arguments = parser.parse_args()
    rows = []
    unreached, jumps = [], []
    for seed in range(arguments.seeds):
        plan = qparm.plan(arguments.cell, strategy="general", seed=seed, method=arguments.method)
        figures = qparm.report(plan).figures
        places = [jump.place for jump in figures.reconfigurations if jump.ratio > 1]
        unreached.append(figures.points - figures.reached)
        jumps.append(len(places))
        rows.append(
            [
                seed,
                unreached[-1],
                places.count("row"),
                places.count("row end"),
                places.count("gap"),
                len(plan.joint_path.breaks),
                f"{np.degrees(figures.largest_step_revolute):.1f}",
                f"{figures.largest_step_prismatic * 1e3:.0f}",
                f"{figures.position_error_max * 1e6:.2g}",
                f"{figures.duration:.0f}",
            ]
        )
    header = ["seed", "not reached", "jumps in rows", "at row ends", "across missing points", "breaks",
              "largest step (deg)", "(mm)", "position error max (um)", "duration (s)"]  # fmt: skip
    points = plan.tool_path.point_count
    title = f"The general method ({arguments.method}) on {plan.cell.name}, {points} points"
    print(save_table(arguments.out, f"general_{arguments.method}", title, header, rows))
    print(
        f"not reached: {min(unreached)} to {max(unreached)}, median {np.median(unreached):.0f};"
        f" jumps over the criterion, those across missing points included: {min(jumps)} to {max(jumps)}"
    )


if __name__ == "__main__":
    main()
