"""Whether a design study keeps its bars on the reference cell, and whether the paper's F2 can tell designs apart.

    python -m comparisons.design_study [--budget 200] [--out FOLDER]

- the default study of 200 designs, front measured and planned, against 200 plans of the same machine and hour;
- the 41 x 41 map at reach of all points;
- the shortest valid design by map, by both swarms and by the default method, of the search alone and after its border
  was followed; the same with L1 from 480 mm, the paper's second range; how far (480, 418) is from it;
- what share of the variance of F2 (singularities met by the paper's planner) and of the attainable margin belongs to
  the designs, and not to the draws: 12 valid designs, 4 seeds (intraclass correlation, one way).

Times are by the clock, so the table names the load. Exit status 1 if a bar is not kept.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from comparisons.tables import save_table
from qparm.design.evaluate import evaluate
from qparm.design.planned import counted_measures
from qparm.design.space import DesignSpace
from qparm.design.study import DesignStudy, design

CELL = "examples/dome.toml"
PLAN_SHARE, MAP_SECONDS, AGREEMENT = 0.25, 60.0, 0.005
PAPER = np.array([0.480, 0.418])
DESIGNS, SEEDS = 12, 4
# Of a map's budget, what its border, the recommended design's surroundings and the cell's own design get.
BESIDE = 100

Row = tuple[str, str, str]


def plan_seconds() -> float:
    """Return how long one plan takes as a whole process, by the clock."""
    with tempfile.TemporaryDirectory() as folder:
        start = time.perf_counter()
        subprocess.run([sys.executable, "-m", "qparm.cli", "plan", CELL, "--quiet", "--out", folder], check=True)
        return time.perf_counter() - start


def shortest(study: DesignStudy, place: int | None) -> tuple[np.ndarray, float]:
    """Return a design (d,) and its length (m)."""
    assert place is not None
    one = study.evaluations[place]
    return np.array(one.x), one.measures["length"]


def words(x: np.ndarray, length: float) -> str:
    """Return a design as people read it."""
    return f"({1e3 * x[0]:.1f}, {1e3 * x[1]:.1f}) mm, {1e3 * length:.1f} mm in all"


def verdict(kept: bool) -> str:
    """Return a table's last column."""
    return "kept" if kept else "**not kept**"


def repeatable_share(values: np.ndarray) -> float:
    """Return the intraclass correlation of values (designs, seeds): 1 where seeds change nothing."""
    count = values.shape[1]
    between = count * values.mean(axis=1).var(ddof=1)
    within = values.var(axis=1, ddof=1).mean()
    return max(0.0, float((between - within) / (between + (count - 1) * within)))


def repeatability(space: DesignSpace) -> Row:
    """Measure valid designs with several seeds each."""
    rng = np.random.default_rng(0)
    lower, upper = (np.array([getattr(v, end) for v in space.variables]) for end in ("lower", "upper"))
    counts, margins = [], []
    while len(counts) < DESIGNS:
        x = lower + rng.random(len(lower)) * (upper - lower)
        if not evaluate(space, x.tolist(), level=2).valid:
            continue
        cell = space.cell_at(x)
        tool_path = cell.tool_path()
        counts.append([counted_measures(cell, tool_path, seed=s)["singularities"] for s in range(SEEDS)])
        told = [evaluate(space, x.tolist(), level=3, names=("singularity_margin",), seed=s) for s in range(SEEDS)]
        margins.append([one.measures["singularity_margin"] for one in told])
    share, ours = repeatable_share(np.array(counts)), repeatable_share(np.array(margins))
    figure = f"F2 {share:.2f} (mean {np.mean(counts):.1f}), attainable margin {ours:.3f}"
    return f"share of variance that is the design's, {DESIGNS} designs, {SEEDS} seeds", figure, "a question"


def agreement(studies: dict[str, DesignStudy]) -> list[Row]:
    """Compare the shortest designs with the map's."""
    rows: list[Row] = []
    best, _ = shortest(studies["grid"], studies["grid"].least)
    for method, study in studies.items():
        for what, place in (("search alone", study.least_of_search), ("with its border followed", study.least)):
            x, length = shortest(study, place)
            off = float(np.abs(x - best).max())
            # a method's answer is what it returns, its border followed; what its search found is shown beside it
            judged = what != "search alone"
            name = f"shortest design, {method}, {what}: within 5 mm of the map's"
            rows.append(
                (name, f"{words(x, length)}: {1e3 * off:.1f} mm off", verdict(off <= AGREEMENT) if judged else "shown")
            )
    return rows


def main() -> int:
    """Run all and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("comparisons/out"))
    parser.add_argument("--budget", type=int, default=200, help="designs of the default study and of the swarms")
    arguments = parser.parse_args()
    space, budget = DesignSpace.of(CELL), arguments.budget
    one_plan = plan_seconds()
    studies = {"grid": design(CELL, method="grid", budget=41 * 41 + BESIDE, border=BESIDE - 5, plans=0)}
    studies["hybrid"] = design(CELL, budget=budget)
    one_plan = 0.5 * (one_plan + plan_seconds())  # before and after, on a machine that others use too
    for method in ("mopso", "paper"):
        studies[method] = design(CELL, method=method, budget=budget, plans=0)
    narrow = design(
        CELL, method="grid", budget=21 * 21 + BESIDE, border=BESIDE - 5, plans=0,
        ranges={"arm.lengths.L1": ("480 mm", "600 mm")},
    )  # fmt: skip
    ours, drawn = studies["hybrid"], studies["grid"]
    share = ours.seconds / (budget * one_plan)
    each = ", ".join(
        f"level {level} {total / count:.2f} s x {count}" for level, (count, total) in ours.level_seconds.items()
    )
    rows: list[Row] = [
        (
            f"{budget} designs ≤ {PLAN_SHARE} x {budget} plans",
            f"{ours.seconds:.0f} s, a plan {one_plan:.1f} s: {share:.3f} ({each})",
            verdict(share <= PLAN_SHARE),
        ),
        (f"41 x 41 map ≤ {MAP_SECONDS:.0f} s", f"{drawn.seconds:.0f} s", verdict(drawn.seconds <= MAP_SECONDS)),
        *agreement(studies),
    ]
    x, length = shortest(narrow, narrow.least)
    active = any(bound.variable == "arm.lengths.L1" and bound.side == "lower" for bound in narrow.active)
    rows.append(
        ("L1 ≥ 480 mm: on that bound, and flagged", words(x, length), verdict(active and abs(x[0] - 0.48) < 1e-3))
    )
    x, length = shortest(ours, ours.least)
    own = evaluate(space, PAPER.tolist(), level=2)
    assert own.valid
    apart = ", ".join(f"{1e3 * d:+.1f}" for d in PAPER - x)
    longer = 1e3 * (own.measures["length"] - length)
    rows.append(("from the shortest to the paper's (480, 418)", f"{apart} mm, {longer:.1f} mm longer", "a question"))
    rows.append(repeatability(space))
    load = ", ".join(f"{value:.1f}" for value in os.getloadavg())
    title = f"Design study on the reference cell ({os.cpu_count()} cores, load at the end {load})"
    print(save_table(arguments.out, "design_study", title, ("bar", "figure", "verdict"), rows))
    return 1 if any("not kept" in row[2] for row in rows) else 0


if __name__ == "__main__":
    raise SystemExit(main())
