"""Pose lists that turn sharply, turn on the spot or come back: planned, at the tool's own feed, and verified."""

from __future__ import annotations

import json
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import qparm
from conftest import cell_data
from made_arm import pose_list, row_of_poses
from qparm.reports.check import check_cell, check_text
from qparm.verify.readers import read_motion


def listed(poses: np.ndarray, feed: str = "50 mm/s") -> qparm.Cell:
    """Return a cell of the template's arm and one row of poses."""
    data: dict[str, Any] = cell_data(files("qparm.cell").joinpath("new_cell.toml"))  # type: ignore[arg-type]
    data["workpiece"] = {"shape": "pose list", "poses": pose_list(poses)}
    data["process"] = {"feed": feed}
    return qparm.Cell.load(data)


def right_angle() -> np.ndarray:
    """Return poses 5 mm apart: 200 mm along y, then 200 mm along x."""
    poses = row_of_poses(81, z=0.25)
    k = np.arange(81)
    poses[:, 0, 3] = 0.55 + 0.005 * np.maximum(k - 40, 0)
    poses[:, 1, 3] = -0.1 + 0.005 * np.minimum(k, 40)
    return poses


@pytest.mark.parametrize("timing", ["quintic", "ruckig"])
@pytest.mark.slow
def test_a_right_angle_is_passed_at_the_feed_with_a_rest_at_its_corner(tmp_path: Path, timing: Any) -> None:
    cell = listed(right_angle())
    assert "rows 0 and 1 meet at line 42 (550, 100, 250 mm): the way turns by 90 deg" in check_text(check_cell(cell))
    plan = qparm.plan(cell, timing=timing)
    report = qparm.report(plan)
    assert report.executable, report.reasons
    assert "rows 0 and 1 meet at line 42 (550, 100, 250 mm): the way turns by 90 deg" in report.text()
    qparm.write(plan, tmp_path)
    (corner,) = json.loads((tmp_path / "report.json").read_text(encoding="utf-8"))["corners"]
    assert (corner["row"], corner["point"], corner["line"]) == (1, 41, 42)
    assert corner["position"] == pytest.approx([0.55, 0.1, 0.25], abs=1e-9)
    assert corner["angle"] == pytest.approx(np.pi / 2)
    t = np.linspace(0.0, plan.trajectory.duration, 60_001)[1:-1]
    ahead, behind = (plan.chain.forward(plan.trajectory(t + d))[:, :3, 3] for d in (5e-5, -5e-5))
    speed = np.linalg.norm(ahead - behind, axis=1) / 1e-4
    process_on = np.array([segment.process_on for segment in plan.trajectory.segments])
    on_rows = process_on[plan.trajectory.segment_at(t + 6e-5)] & process_on[plan.trajectory.segment_at(t - 6e-5)]
    assert speed[on_rows].max() < 0.05 * 1.001
    assert np.median(speed[on_rows]) == pytest.approx(0.05, rel=5e-4)
    for name in ("trajectory.csv", "trajectory.json"):
        assert qparm.verify_motion(read_motion(tmp_path / name, cell), cell).problems() == ()


def test_a_tool_that_turns_on_the_spot_and_comes_back_is_planned_and_verified(tmp_path: Path) -> None:
    angle = np.radians(np.concatenate([np.arange(0, 46, 2), np.arange(42, -46, -2), np.arange(-42, 2, 2)]))
    about = Rotation.from_rotvec(angle[:, None] * [0.0, 1.0, 0.0]) * Rotation.from_quat([1.0, 0.0, 0.0, 0.0])
    poses = row_of_poses(len(angle), z=0.3, length=0.0)
    poses[:, :3, :3], poses[:, 0, 3] = about.as_matrix(), 0.55
    cell = listed(poses)
    plan = qparm.plan(cell)
    report = qparm.report(plan)
    assert report.executable, report.reasons
    # 0.1 m a radian: it turns at half a radian a second, as far as the joints can
    assert [row.length for row in plan.tool_path.rows] == pytest.approx(0.1 * np.radians([44, 88, 44]))
    assert max(row.largest for row in report.figures.feed.rows) == pytest.approx(0.05, rel=1e-3)
    t = np.linspace(0.0, plan.trajectory.duration, 20_001)
    R = Rotation.from_matrix(plan.chain.forward(plan.trajectory(t))[:, :3, :3])
    turning = (R[:-1].inv() * R[1:]).magnitude() / np.diff(t)
    process_on = np.array([segment.process_on for segment in plan.trajectory.segments])
    on_rows = process_on[plan.trajectory.segment_at(t)]
    assert turning[on_rows[1:] & on_rows[:-1]].max() < 0.5 * 1.001
    qparm.write(plan, tmp_path)
    for name in ("trajectory.csv", "trajectory.json"):
        assert qparm.verify_motion(read_motion(tmp_path / name, cell), cell).problems() == ()
