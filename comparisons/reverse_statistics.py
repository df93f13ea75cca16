"""What the paper's improved strategy meets and repairs on a cell, over seeds, beside the general method.

    python -m comparisons.reverse_statistics [--cell FILE] [--seeds N] [--out FOLDER]

Two tables: the strategy as qparm has it, which tries to join a row as it stands before it breaks it, and the letter
of the paper without that. Jumps are counted against min(jump criterion, largest joint speed x distance / feed), from
the configurations themselves. Exit status 1 if fewer than three quarters of the seeds are free of jumps inside rows.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import numpy as np

import qparm
from comparisons.tables import save_table
from qparm.planning import problem_of, track
from qparm.planning.paper.reverse import reverse
from qparm.planning.paper.reverse_record import Repair, ReversePath

__all__ = ["Outcome", "compare", "main"]

# As the pipeline has it: solved to a hundredth of the tolerance.

T = TypeVar("T")


@dataclass(frozen=True)
class Outcome:
    """One seed: both methods, counted alike.

    Attributes
    ----------
    seed : int
    general_jumps, general_gap_jumps, general_unreached : int
        Of the general method: jumps inside rows, jumps across missing points inside rows, missing points.
    general_seconds : float
    jumps, unreached : int
        Of the reverse strategy: jumps inside rows, missing points.
    seconds : float
    path : ReversePath
    """

    seed: int
    general_jumps: int
    general_gap_jumps: int
    general_unreached: int
    general_seconds: float
    jumps: int
    unreached: int
    seconds: float
    path: ReversePath


def in_row_jumps(
    tool_path: qparm.ToolPath, q: np.ndarray, reached: np.ndarray, criteria: np.ndarray
) -> tuple[int, int]:
    """Return how many edges inside rows are jumps, and how many gaps inside rows are crossed by one."""
    at = np.flatnonzero(reached)
    row = tool_path.row_of_point[at]
    same_row = row[1:] == row[:-1]
    neighbours = np.diff(at) == 1
    jumped = (np.abs(np.diff(q[at], axis=0)) > criteria[at[1:] - 1]).any(axis=1)
    return int((jumped & same_row & neighbours).sum()), int((jumped & same_row & ~neighbours).sum())


def timed(make: Callable[[], T]) -> tuple[T, float]:
    """Return what a function gives, and its seconds."""
    start = time.perf_counter()
    made = make()
    return made, time.perf_counter() - start


def compare(cell: qparm.Cell, chain: qparm.SerialChain, tool_path: qparm.ToolPath, seed: int, *, join: bool) -> Outcome:
    """Plan a cell by both methods with one seed; what chain and tool path keep once found is nobody's time."""
    problem = replace(problem_of(cell, seed=seed), chain=chain, tool_path=tool_path)
    criteria = problem.criteria_by_feed
    (_, record), general_seconds = timed(lambda: track(problem))
    path, seconds = timed(lambda: reverse(problem, join=join))
    there = np.ones(tool_path.point_count, dtype=bool)
    there[record.unreached] = False
    general = in_row_jumps(tool_path, record.q_end, there, criteria)
    return Outcome(
        seed=seed,
        general_jumps=general[0],
        general_gap_jumps=general[1],
        general_unreached=len(record.unreached),
        general_seconds=general_seconds,
        jumps=sum(in_row_jumps(tool_path, path.q, path.reached, criteria)),
        unreached=int((~path.reached).sum()),
        seconds=seconds,
        path=path,
    )


HEADER = ["seed", "met", "self-motion", "reverse planning", "joined", "sacrificed", "tries", "poses solved",
          "jumps in rows", "not reached", "row-end reconfigurations", "largest row-end step (of the criterion)",
          "time (ms)", "general: jumps in rows", "across missing points", "not reached", "time (ms)",
          "time ratio"]  # fmt: skip


def line(outcome: Outcome) -> list[object]:
    """Return one row of the table."""
    statistics = outcome.path.statistics
    ends = [step.ratio for step in statistics.row_ends if step is not None]
    return [
        outcome.seed,
        len(statistics.jumps),
        *(statistics.count(repair) for repair in (Repair.SELF_MOTION, Repair.REVERSE, Repair.JOINED, Repair.SACRIFICE)),
        statistics.tries,
        statistics.poses_solved,
        outcome.jumps,
        outcome.unreached,
        statistics.row_end_reconfigurations,
        f"{max(ends, default=0.0):.2f}",
        f"{outcome.seconds * 1e3:.0f}",
        outcome.general_jumps,
        outcome.general_gap_jumps,
        outcome.general_unreached,
        f"{outcome.general_seconds * 1e3:.0f}",
        f"{outcome.seconds / outcome.general_seconds:.1f}",
    ]  # fmt: skip


def main() -> int:
    """Print and write the tables; return 1 if the bar does not hold."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cell", type=Path, default=Path("examples/dome.toml"))
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--out", type=Path, default=Path("comparisons/out"))
    arguments = parser.parse_args()
    cell = qparm.Cell.load(arguments.cell)
    chain, tool_path = cell.chain(), cell.tool_path()
    compare(cell, chain, tool_path, 0, join=True)  # loads the kernels, and what is found once
    good = True
    for join, name, what in (
        (True, "reverse_statistics", "The reverse strategy"),
        (False, "reverse_letter", "The reverse strategy by the letter of the paper, without joining"),
    ):
        outcomes = [compare(cell, chain, tool_path, seed, join=join) for seed in range(arguments.seeds)]
        title = f"{what}, on {cell.name}, {tool_path.point_count} points"
        print(save_table(arguments.out, name, title, HEADER, [line(outcome) for outcome in outcomes]))
        free = sum(outcome.jumps == 0 for outcome in outcomes)
        ratio = np.median([outcome.seconds / outcome.general_seconds for outcome in outcomes])
        print(
            f"free of jumps inside rows: {free} of {len(outcomes)} seeds (general method:"
            f" {sum(o.general_jumps + o.general_gap_jumps + o.general_unreached == 0 for o in outcomes)});"
            f" time {ratio:.1f} times the general method's (median)\n"
        )
        good = good and (not join or 4 * free >= 3 * len(outcomes))
    return 0 if good else 1


if __name__ == "__main__":
    raise SystemExit(main())
