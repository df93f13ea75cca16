"""The trajectory of a folder that ``qparm plan`` wrote."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from qparm.errors import InvalidInput
from qparm.files.manifest import REPORT_FILE, changed_files
from qparm.files.output import finish_interrupted
from qparm.files.reading import TEXT_BYTES, guarded, parse_json, read_text, shown, shown_value, whole_number
from qparm.names import wrong_joint_names
from qparm.path import SegmentKind, TimedSegment, Trajectory
from qparm.path.quintic import quintic_coefficients
from qparm.reports.plan import JOINT_PATH_FILE, KNOTS_FILE
from qparm.verify.files import read_knots
from qparm.verify.motion import unusable_numbers

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["SavedTrajectory", "load_trajectory"]

# The report has the segments' times to the last bit, trajectory.json in whole nanoseconds (s).
_ROUNDING = 2e-9
# Over a shorter time a quintic's jerk is made of the last digits of the positions (s).
_SHORT = 1e-4


@dataclass(frozen=True, eq=False)
class SavedTrajectory:
    """A trajectory, and what a file says beside it.

    Attributes
    ----------
    trajectory : Trajectory
    units : tuple of str
        ``"m"`` or ``"rad"`` for each joint.
    """

    trajectory: Trajectory
    units: tuple[str, ...]


def load_trajectory(folder: str | Path) -> SavedTrajectory:
    """Return the trajectory in a plan's folder: its knots interpolated quintically, its segments and its verdict.

    Parameters
    ----------
    folder : str or Path
        With ``trajectory.json``, ``joint_path.csv`` (for the units) and ``report.json``.

    Returns
    -------
    SavedTrajectory
        Its ``knots`` are all points of ``trajectory.json``.

    Raises
    ------
    InvalidInput
        If a file is missing, broken, or not of the same plan as the others.
    """
    folder = Path(folder)
    with guarded(folder):
        there, is_folder = folder.exists(), folder.is_dir()
    if not is_folder:
        what = "is a file" if there else "does not exist"
        raise InvalidInput(f"{str(folder)!r} {what}; give the folder that `qparm plan` wrote")
    finish_interrupted(folder)
    names = (KNOTS_FILE, JOINT_PATH_FILE, REPORT_FILE)
    missing = [name for name in names if not (folder / name).exists()]
    if missing:
        raise InvalidInput(f"{str(folder)!r} holds no {missing[0]}; give the folder that `qparm plan` wrote")
    knots = read_knots(folder / KNOTS_FILE)
    wrong = wrong_joint_names(knots.joints)
    if wrong:
        raise InvalidInput(f"{KNOTS_FILE}: {wrong}")
    report = _json(folder / REPORT_FILE)
    units = _units(folder / JOINT_PATH_FILE, knots.joints)
    # whatever is not where it should be, or not of its kind
    with guarded(folder / REPORT_FILE, what="a whole report", foreign=True):
        segments = [_segment(one) for one in report["segments"]]
        executable, reasons = report["executable"] is True, tuple(_text(reason) for reason in report["reasons"])
        timing = _text(report["options"]["timing"])
    if _json(folder / KNOTS_FILE).get("executable", True) is not True and executable:
        executable, reasons = False, (f"{KNOTS_FILE} says so",)
    changed = changed_files(folder, report, (KNOTS_FILE, JOINT_PATH_FILE)) if executable else []
    if changed:
        executable = False
        reasons = tuple(f"{name} is not the file that {REPORT_FILE} was written with" for name in changed)
    wrong = unusable_numbers(knots.t, tuple(knots.derivatives), knots.joints, lambda k: f"point {k}")
    if wrong:
        raise InvalidInput(f"{KNOTS_FILE} {wrong}")
    trajectory = Trajectory(
        joint_names=knots.joints,
        polynomials=_polynomials(knots.t, knots.derivatives),
        knots=knots.t,
        segments=_segments(segments, knots.t),
        timing=timing,
        executable=executable,
        reasons=reasons,
    )
    return SavedTrajectory(trajectory, units)


def _segment(told: Any) -> tuple[SegmentKind, int, float]:
    row, end = whole_number(told["row"]), told["end"]
    if row is None or isinstance(end, bool) or not isinstance(end, (int, float)) or not math.isfinite(end):
        raise ValueError(f"a segment has the row {shown_value(told['row'])} and ends at {shown_value(end)}")
    return SegmentKind(told["kind"]), row, float(end)


def _text(value: Any) -> str:
    if not isinstance(value, str) or not value.isprintable():
        raise ValueError(f"{shown_value(value)} is no text")
    return value


def _json(file: Path) -> dict[str, Any]:
    data = parse_json(read_text(file, largest=TEXT_BYTES), file)
    if not isinstance(data, dict):
        raise InvalidInput(f"{file.name} holds no fields")
    return data


def _units(file: Path, joints: tuple[str, ...]) -> tuple[str, ...]:
    first = read_text(file).partition("\n")[0]
    with guarded(file):
        header = next(csv.reader([first]), [])
    units = {name: unit.rstrip("]") for name, _, unit in (column.partition("[") for column in header[5:])}
    if tuple(units) != joints or not set(units.values()) <= {"m", "rad"}:
        there = shown(", ".join(header[5:]), longest=200)
        raise InvalidInput(f"{file.name} and {KNOTS_FILE} are not of the same joints: {there}")
    return tuple(units.values())


def _polynomials(t: NDArray[np.float64], derivatives: NDArray[np.float64]) -> tuple[Any, ...]:
    from scipy.interpolate import PPoly

    n = derivatives.shape[2]
    if len(t) < 2:  # a plan that goes nowhere
        breaks = np.array([t[0], t[0] + 1.0])
        return tuple(PPoly(derivatives[0, :1, i : i + 1], breaks) for i in range(n))
    h = np.diff(t)
    whole = quintic_coefficients(derivatives, h)
    short = h < _SHORT
    # there the jerk is constant, from the accelerations: off by less than any file's digits
    whole[:2, short] = 0.0
    whole[2, short] = np.diff(derivatives[2], axis=0)[short] / (6 * h[short, None])
    return tuple(PPoly(np.ascontiguousarray(whole[:, :, i]), t) for i in range(n))


def _segments(saved: list[tuple[SegmentKind, int, float]], t: NDArray[np.float64]) -> tuple[TimedSegment, ...]:
    """Return the segments between the knots at which they end."""
    segments, start = [], float(t[0])
    for kind, row, end in saved:
        near = float(t[int(np.abs(t - end).argmin())])
        if abs(near - end) > _ROUNDING:
            raise InvalidInput(f"{REPORT_FILE} and {KNOTS_FILE} are not of one plan: no point at {end:.9f} s")
        segments.append(TimedSegment(kind, row, start, near))
        start = near
    if not segments or start != float(t[-1]):
        raise InvalidInput(f"{REPORT_FILE} and {KNOTS_FILE} are not of one plan: they end at different times")
    return tuple(segments)
