"""The report: quality figures of a plan, recomputed from what is handed over."""

from __future__ import annotations

import platform
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from qparm.reports.warnings import limit_warnings
from qparm.verify import Figures, KnotTable, SampleTable, Verdict, WaypointTable, measure, verify_motion
from qparm.verify.clearance import LINKS_NOT_CHECKED
from qparm.verify.files import read_knots, read_samples, read_waypoints
from qparm.verify.motion import motion_of_knots, motion_of_trajectory, same_motion

if TYPE_CHECKING:
    from qparm.path import Corner
    from qparm.pipeline import Plan
    from qparm.planning import GraphRecord, ReverseStatistics

__all__ = ["JOINT_PATH_FILE", "KNOTS_FILE", "SAMPLES_FILE", "Report", "judge_files", "report"]

JOINT_PATH_FILE, SAMPLES_FILE, KNOTS_FILE = "joint_path.csv", "trajectory.csv", "trajectory.json"
_PACKAGES = (
    "qparm",
    "numpy",
    "scipy",
    "numba",
    "proxsuite",
    "osqp",
    "qpsolvers",
    "ruckig",
    "pydantic",
    "matplotlib",
)


@dataclass(frozen=True, eq=False)
class Report:
    """A plan's figures, and what the planner says of its work.

    Attributes
    ----------
    figures : Figures
        Measured on the files or tables, with a kinematics of their own.
    verdict : Verdict
        What speaks against executing the trajectory, judged on the same files or tables.
    plan : Plan
        Cell, options, and what only the planner can know: how steps were answered, where iterations ended.
    stages : dict of str to float
        Seconds spent in each stage, writing included.
    period : float
        Seconds between the samples that were measured.
    """

    figures: Figures
    verdict: Verdict
    plan: Plan
    stages: dict[str, float]
    period: float

    def __repr__(self) -> str:
        figures = self.figures
        return (
            f"Report({self.plan.cell.name!r}: {figures.reached} of {figures.points} points reached,"
            f" {figures.duration:.6g} s)"
        )

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why the trajectory must not be executed; empty if it may."""
        return self.verdict.reasons

    @property
    def executable(self) -> bool:
        """Whether nothing speaks against execution."""
        return self.verdict.executable

    @property
    def off_path(self) -> tuple[float, float]:
        """How far the tool is off its path on rows and transitions (m, rad); NaN where it follows none."""
        motion = self.verdict.motion
        return (float("nan"), float("nan")) if motion is None else motion.off_path

    @property
    def warnings(self) -> tuple[str, ...]:
        """What does not speak against execution here, but may stop the program in another setup."""
        return limit_warnings(self.figures, self.plan)

    def to_dict(self) -> dict[str, Any]:
        """Return the report as plain data for JSON; SI units, None for what does not exist."""
        plan, figures = self.plan, self.figures
        measured = asdict(figures)
        unreached = measured.pop("unreached")
        joints = measured.pop("joints")
        for point in unreached:
            index = point["index"]
            record = plan.record.points[index]
            reach = plan.reach.get(index)
            point["place_in_row"] = int(index - np.searchsorted(plan.tool_path.row_of_point, point["row"]))
            point["status"] = record.status.value
            point["active_limits"] = list(record.active_limits)
            point["position_error"] = record.position_error
            point["rotation_error"] = record.rotation_error
            point["reach"] = None if reach is None else str(reach)
        data = {
            "executable": self.executable,
            "reasons": list(self.reasons),
            "findings": [asdict(finding) for finding in self.verdict.findings],
            "warnings": list(self.warnings),
            "not_checked": [LINKS_NOT_CHECKED],
            "measured": measured,
            "joints": joints,
            "unreached": unreached,
            "corners": [_corner(plan, corner) for corner in plan.tool_path.corners],
            "jump_criterion": dict(zip(plan.chain.names, plan.cell.jump().tolist(), strict=True)),
            "search": None if plan.search is None else _search(plan.search),
            "smoothing": None if plan.smoothing is None else asdict(plan.smoothing),
            "row_length": plan.row_length,
            "row_length_not_worked": plan.row_length_not_worked,
            "motions": [asdict(motion) | {"kind": motion.kind.value} for motion in plan.breaks],
            "timing": self._timing(),
            "steps": asdict(plan.record.counts),
            "start_solutions": plan.record.start_solutions,
            "segments": [
                {"name": s.name, "kind": s.kind.value, "row": s.row, "start": s.start, "end": s.end}
                for s in plan.trajectory.segments
            ],
            "stages": self.stages,
            "options": asdict(plan.options) | {"period": self.period},
            "cell": plan.cell.to_dict(),
            "versions": versions(),
        }
        return _json_ready(data)

    def _timing(self) -> dict[str, Any]:
        trajectory = self.plan.trajectory
        position, rotation = self.off_path
        return {
            "form": trajectory.timing,
            "waypoints": len(self.plan.joint_path.q),
            "intervals": len(trajectory.boundaries) - 1,
            "polynomials": trajectory.piece_count,
            "tool_deviation": position,
            "tool_rotation": rotation,
            "feed_lost": self.plan.feed_lost,
        }

    def text(self) -> str:
        """Return the readable summary."""
        from qparm.reports.summary import summary

        return "\n".join(summary(self))


def report(plan: Plan, *, period: float = 0.02) -> Report:
    """Return the report of a plan, measured on the tables that would be written; no files.

    Parameters
    ----------
    plan : Plan
    period : float
        Seconds between the samples of the trajectory.
    """
    path, trajectory = plan.joint_path, plan.trajectory
    waypoints = WaypointTable(
        joints=path.joint_names,
        index=path.point,
        row=path.row,
        kind=np.array([kind.value for kind in path.kind]),
        status=np.array(path.status),
        s=path.s,
        q=path.q,
    )
    t = trajectory.sample_times(period)
    at = trajectory.segment_at(t)
    segments = trajectory.segments
    samples = SampleTable(
        joints=path.joint_names,
        t=t,
        derivatives=np.stack([trajectory(t, order) for order in range(4)]),
        row=np.array([segment.row for segment in segments])[at],
        segment=np.array([segment.kind.value for segment in segments])[at],
        process_on=np.array([segment.process_on for segment in segments])[at],
    )
    knots = KnotTable(
        joints=path.joint_names,
        t=trajectory.boundaries,
        derivatives=np.stack([trajectory(trajectory.boundaries, order) for order in range(3)]),
    )
    figures = measure(plan.cell, waypoints, samples, knots)
    motion = plan.verdict.motion
    verdict = Verdict((*plan.verdict.own, *figures.findings(motion, plan.cell.process)), motion)
    return Report(figures, verdict, plan, dict(plan.stages), period)


def judge_files(plan: Plan, folder: Path) -> tuple[Figures, Verdict]:
    """Return the figures of the files in a folder and the verdict on them.

    Nothing is taken from the plan but its cell, and motions for which no safe way was found.
    """
    knots = read_knots(folder / KNOTS_FILE)
    figures = measure(plan.cell, read_waypoints(folder / JOINT_PATH_FILE), read_samples(folder / SAMPLES_FILE), knots)
    written, planned = motion_of_knots(knots), motion_of_trajectory(plan.trajectory)
    motion = plan.verdict.motion
    # what was judged when it was planned is in the file to the last bit, or the file is judged anew
    if len(knots.t) > 1 and not same_motion(written, planned):
        motion = verify_motion(written, plan.cell)
    return figures, Verdict((*plan.verdict.own, *figures.findings(motion, plan.cell.process)), motion)


def versions() -> dict[str, str]:
    """Return the versions of Python and of the packages a plan depends on."""
    found = {"python": platform.python_version()}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not installed"
    return found


def _json_ready(data: Any) -> Any:
    if isinstance(data, dict):
        return {key: _json_ready(value) for key, value in data.items()}
    if isinstance(data, (list, tuple)):
        return [_json_ready(value) for value in data]
    if isinstance(data, float) and not np.isfinite(data):
        return None
    return data


def _corner(plan: Plan, corner: Corner) -> dict[str, Any]:
    position = (plan.tool_path.pose_base_workpiece @ corner.pose)[:3, 3]
    point = int(np.searchsorted(plan.tool_path.row_of_point, corner.row))
    return {"row": corner.row, "point": point, "line": corner.line, "position": position.tolist(),
            "angle": corner.angle, "what": corner.what}  # fmt: skip


def _search(search: GraphRecord | ReverseStatistics) -> dict[str, Any]:
    """Return what a strategy says of its work as plain data."""
    return asdict(search)
