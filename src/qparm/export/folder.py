"""All files of a plan in one folder: either whole or absent."""

from __future__ import annotations

import contextlib
import json
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from qparm.errors import OutputError
from qparm.export.joint_path_csv import write_joint_path_csv
from qparm.export.joint_trajectory_json import write_joint_trajectory_json
from qparm.export.trajectory_csv import write_samples_csv
from qparm.plan_report import JOINT_PATH_FILE, KNOTS_FILE, SAMPLES_FILE, Report, judge_files
from qparm.view import PICTURES, draw_plan

if TYPE_CHECKING:
    from qparm.pipeline import Plan

__all__ = ["FILES", "REPORT_FILE", "require_writable", "staged", "write"]

REPORT_FILE = "report.json"
FILES = (JOINT_PATH_FILE, SAMPLES_FILE, KNOTS_FILE, REPORT_FILE, *PICTURES)
_STAGING = ".qparm-unfinished-"


def require_writable(folder: str | Path) -> Path:
    """Make a folder and return it, or raise OutputError if nothing can be written there."""
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise OutputError(folder, error.strerror or str(error)) from None
    return folder


@contextlib.contextmanager
def staged(folder: str | Path) -> Iterator[Path]:
    """Give a hidden folder to write in; its files are moved to ``folder`` at the end, or vanish on any error.

    Each file is moved in one step, so whoever looks sees a whole file or none; if one cannot be moved, the
    files of an earlier run come back.
    """
    folder = require_writable(folder)
    try:
        staging = Path(tempfile.mkdtemp(prefix=_STAGING, dir=folder))
    except OSError as error:
        raise OutputError(folder, error.strerror or str(error)) from None
    try:
        try:
            yield staging
            _move_all(staging, folder)
        except OSError as error:
            if isinstance(error, OutputError):
                raise
            raise OutputError(folder, error.strerror or str(error)) from error
    finally:
        shutil.rmtree(staging, ignore_errors=True)


def _move_all(staging: Path, folder: Path) -> None:
    """Move all files of a folder into another; on any error put back what they replaced."""
    files = sorted(file for file in staging.iterdir() if file.is_file())
    for file in files:
        if (folder / file.name).is_dir():
            raise OutputError(folder, f"{file.name!r} is a folder there")
    replaced = Path(tempfile.mkdtemp(prefix="replaced-", dir=staging))
    moved: list[Path] = []
    try:
        for file in files:
            target = folder / file.name
            moved.append(target)
            if target.exists():
                target.rename(replaced / file.name)
            file.rename(target)
    except BaseException:  # an interruption too
        for target in moved:
            old = replaced / target.name
            if old.exists():
                old.replace(target)
            elif not (staging / target.name).exists():
                target.unlink(missing_ok=True)
        raise


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
        Made if it does not exist; files of these names in it are replaced.
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
        If the folder cannot be written to. No file is left half written, and none is replaced unless all
        were written.
    """

    def tell(stage: str, done: int, total: int) -> None:
        if progress is not None:
            progress(stage, done, total)

    with staged(folder) as staging:
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
        (staging / REPORT_FILE).write_text(
            json.dumps(report.to_dict(), indent=1, allow_nan=False) + "\n", encoding="utf-8"
        )
    return report
