"""All files of a plan in one folder: either whole or absent, and of one plan."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from qparm.errors import InvalidInput
from qparm.export.joint_path_csv import write_joint_path_csv
from qparm.export.joint_trajectory_json import write_joint_trajectory_json
from qparm.export.trajectory_csv import write_samples_csv
from qparm.files.manifest import REPORT_FILE, hashes
from qparm.files.output import staged
from qparm.reports.plan import JOINT_PATH_FILE, KNOTS_FILE, SAMPLES_FILE, Report, judge_files
from qparm.view import PICTURES, draw_plan

if TYPE_CHECKING:
    from qparm.pipeline import Plan

__all__ = ["FILES", "write"]

FILES = (JOINT_PATH_FILE, SAMPLES_FILE, KNOTS_FILE, REPORT_FILE, *PICTURES)


def write(
    plan: Plan,
    folder: str | Path,
    *,
    period: float = 0.02,
    pictures: bool = True,
    progress: Callable[[str, int, int], None] | None = None,
) -> Report:
    """Write a plan's files and return the report measured on them.

    Parameters
    ----------
    plan : Plan
    folder : str or Path
        Made if it does not exist; files of these names in it are replaced. Where an earlier plan was written there, its
        files that this one does not have are removed.
    period : float
        Seconds between the samples of ``trajectory.csv``.
    pictures : bool
        Whether to draw the four pictures.
    progress : callable, optional
        ``progress(stage, done, total)``.

    Returns
    -------
    Report
        Recomputed from the written files; ``report.json`` holds it.

    Raises
    ------
    OutputError
        If the folder cannot be written to: then it is as before.
    """
    from qparm.pipeline import Plan

    if not isinstance(plan, Plan):
        raise InvalidInput(f"write takes a Plan, as qparm.plan returns it, not {type(plan).__name__}")
    if not (isinstance(period, (int, float)) and math.isfinite(period) and period > 0):
        raise InvalidInput(f"period must be finite and positive, not {period!r}")

    def tell(stage: str, done: int, total: int) -> None:
        if progress is not None:
            progress(stage, done, total)

    earlier = (Path(folder) / REPORT_FILE).is_file()
    with staged(folder, obsolete=FILES if earlier else ()) as staging:
        start = time.perf_counter()
        tell("files", 0, 3)
        write_joint_path_csv(plan.chain, plan.joint_path, staging / JOINT_PATH_FILE)
        tell("files", 1, 3)
        write_samples_csv(plan.trajectory, staging / SAMPLES_FILE, period=period, units=plan.chain.units)
        tell("files", 2, 3)
        write_joint_trajectory_json(plan.trajectory, staging / KNOTS_FILE)
        tell("files", 3, 3)
        stages = dict(plan.stages)
        stages["files"] = time.perf_counter() - start
        start = time.perf_counter()
        tell("report", 0, 1)
        figures, verdict = judge_files(plan, staging)
        tell("report", 1, 1)
        stages["report"] = time.perf_counter() - start
        if pictures:
            start = time.perf_counter()
            draw_plan(plan, staging, progress=lambda done, total: tell("pictures", done, total))
            stages["pictures"] = time.perf_counter() - start
        report = Report(figures, verdict, plan, stages, period)
        if plan.trajectory.executable and not report.executable:  # else the message says no already
            write_joint_trajectory_json(plan.trajectory, staging / KNOTS_FILE, executable=False)
        data = report.to_dict() | hashes(staging, FILES)
        (staging / REPORT_FILE).write_text(json.dumps(data, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    return report
