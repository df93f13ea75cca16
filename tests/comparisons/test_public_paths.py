"""The public paths: nothing to do where they are not, and a verdict that can fail where they are."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from comparisons.public_paths import cell_of, judge

import qparm
from conftest import ROOT
from made_arm import URDF, pose_list, row_of_poses

PROBLEM = {"problem": "made_up", "urdf": "seven", "base": "floor", "tip": "tip"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder of the same form: the continuous joints written as +-pi, their types in the table."""
    folder = tmp_path_factory.mktemp("paths")
    (folder / "urdf").mkdir()
    (folder / "targets").mkdir()
    urdf = URDF.replace('type="continuous"', 'type="revolute"')
    urdf = urdf.replace("<limit velocity", '<limit lower="-3.1416" upper="3.1416" velocity')
    (folder / "urdf" / "seven.urdf").write_text(urdf, encoding="utf-8")
    (folder / "targets" / "made_up.csv").write_text(pose_list(row_of_poses(31)), encoding="utf-8")
    (folder / "problems.csv").write_text("problem,urdf,base,tip\nmade_up,seven,floor,tip\n", encoding="utf-8")
    joints = "".join(f"seven,a{k},{'continuous' if k % 2 else 'revolute'}\n" for k in range(1, 8))
    (folder / "joints.csv").write_text("urdf,joint,type\n" + joints, encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def plan(folder: Path) -> qparm.Plan:
    return qparm.plan(cell_of(folder, PROBLEM))


def test_types_come_from_the_table(folder: Path) -> None:
    np.testing.assert_array_equal(cell_of(folder, PROBLEM).chain().continuous, [True, False] * 3 + [True])


def test_a_good_path_is_valid(plan: qparm.Plan) -> None:
    verdict = judge(plan)
    assert verdict.reasons == verdict.unreachable == verdict.missed == ()
    assert verdict.met == 31
    steps = np.abs(np.diff(plan.joint_path.q[plan.joint_path.point >= 0], axis=0))
    assert verdict.length_revolute == pytest.approx(steps.sum())
    assert verdict.largest_revolute == pytest.approx(steps.max())


@pytest.mark.parametrize(
    ("joint", "change", "words"),
    [(6, 0.003, "1 poses not met"), (0, 0.3, "a step of 1"), (1, 4.0, "a joint beyond its limits")],
)
def test_a_path_with_one_wrong_configuration_is_not(plan: qparm.Plan, joint: int, change: float, words: str) -> None:
    q = plan.joint_path.q.copy()
    q[plan.joint_path.point == 14, joint] += change
    verdict = judge(replace(plan, joint_path=replace(plan.joint_path, q=q)))
    assert any(words in reason for reason in verdict.reasons)
    assert verdict.missed == (14,)


@pytest.mark.parametrize(("off", "met"), [(0.9e-4, 31), (1.1e-4, 0)])
def test_the_position_counts_by_itself(plan: qparm.Plan, off: float, met: int) -> None:
    T = np.eye(4)
    T[0, 3] = off
    assert judge(replace(plan, tool_path=replace(plan.tool_path, pose_base_workpiece=T))).met == met


def test_poses_out_of_reach_are_named(folder: Path) -> None:
    poses = row_of_poses(21)
    poses[7:11, 0, 3] = 2.0
    (folder / "targets" / "far.csv").write_text(pose_list(poses), encoding="utf-8")
    verdict = judge(qparm.plan(cell_of(folder, PROBLEM | {"problem": "far"})))
    assert verdict.unreachable == (7, 8, 9, 10)
    assert "poses not met" in verdict.reasons[0]
    assert verdict.gaps >= 1


@pytest.mark.slow
def test_the_script_prints_a_table_or_says_that_there_is_nothing(folder: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "comparisons.public_paths", "--out", str(tmp_path), "--data"]
    run = subprocess.run([*command, str(tmp_path)], cwd=ROOT, capture_output=True, text=True, check=False)
    assert (run.returncode, run.stdout.count("\n")) == (0, 1)
    assert "nothing to do" in run.stdout
    run = subprocess.run([*command, str(folder)], cwd=ROOT, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert "| made_up | seven | 31    | 31  | none        | yes " in run.stdout
