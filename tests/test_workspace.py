"""The reachable region against volumes in closed form, the working space, coverage, files and refusals."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
from collections import Counter
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest

import qparm
from conftest import DOME, ROOT, cell_data
from qparm.errors import InvalidInput
from qparm.reach import ReachReason
from qparm.reach.coverage import coverage
from qparm.reach.region import lattice, reach_box, reaches_points
from qparm.reach.workspace import Workspace, find_workspace
from qparm.reports.workspace import workspace_text
from qparm.robot import DHRow, SerialChain, chain_from_dh

SIX = ROOT / "examples" / "six_axis.toml"


def hollow_sphere(elbow: float = np.pi) -> SerialChain:
    """Return a waist, a shoulder and an elbow in one point 0.5 m and 0.3 m apart: a sphere with a hollow."""
    rows = [
        DHRow("waist", "revolute", 0, 0, 0, 0, (-np.pi, np.pi), 1, 1, 1),
        DHRow("shoulder", "revolute", np.pi / 2, 0, 0, 0, (-np.pi, np.pi), 1, 1, 1),
        DHRow("elbow", "revolute", 0, 0.5, 0, 0, (-elbow, elbow), 1, 1, 1),
    ]
    tool = np.eye(4)
    tool[0, 3] = 0.3
    return chain_from_dh(rows, convention="modified", transform_tool=tool)


@pytest.mark.parametrize(("elbow", "hollow"), [(np.pi, 0.2), (2.0, np.sqrt(0.34 + 0.3 * np.cos(2.0)))])
def test_every_point_of_a_hollow_sphere_is_judged_right(elbow: float, hollow: float) -> None:
    """With the elbow limited to 2 rad the hollow is as large as the law of cosines says."""
    arm = hollow_sphere(elbow)
    low, high = reach_box(arm)
    np.testing.assert_allclose([low, high], [[-0.8] * 3, [0.8] * 3], atol=1e-6)
    points, shape = lattice(low, high, 0.1)
    assert shape == (16, 16, 16)
    radius = np.linalg.norm(points, axis=1)
    inside = (radius >= hollow) & (radius <= 0.8)
    clear = (np.abs(radius - hollow) > 1e-3) & (np.abs(radius - 0.8) > 1e-3)
    np.testing.assert_array_equal(reaches_points(arm, points)[clear], inside[clear])


def test_the_reference_arms_region_is_a_capsule(chain: SerialChain) -> None:
    """A ball of upper arm, forearm and tool around the shoulder, swept along the rail; on the level of the shoulder."""
    x, y = np.meshgrid(np.linspace(-1.2, 1.2, 25), np.linspace(-1.2, 2.0, 33), indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, 0.480)])
    distance = np.hypot(points[:, 0], points[:, 1] - np.clip(points[:, 1], 0.0, 0.8))
    expected = distance <= 0.938
    clear = np.abs(distance - 0.938) > 1e-3
    np.testing.assert_array_equal(reaches_points(chain, points)[clear], expected[clear])


def test_the_same_region_on_any_number_of_threads_and_for_any_seed(chain: SerialChain) -> None:
    points, _ = lattice(*reach_box(chain), 0.25)
    first = reaches_points(chain, points, threads=1)
    np.testing.assert_array_equal(first, reaches_points(chain, points, threads=2))
    assert (first != reaches_points(chain, points, seed=1)).mean() < 0.002


def test_coverage_gives_the_reasons_of_check_reach() -> None:
    data = cell_data()
    data["arm"]["lengths"].update(L1="300 mm", L3="480 mm")
    cell = qparm.Cell.load(data)
    poses = cell.tool_path().poses
    found = coverage(cell.chain(), poses)
    assert found == qparm.check_reach(cell.chain(), poses, rng=np.random.default_rng(0))
    assert set(Counter(verdict.reason for verdict in found)) == {
        ReachReason.WITHIN_REACH, ReachReason.TOO_FAR, ReachReason.LIMITS,
    }  # fmt: skip


def test_coverage_tells_orientation_from_position() -> None:
    arm = hollow_sphere()
    pose = arm.forward([0.3, 0.4, 0.5])
    turned = pose.copy()
    turned[:3, :3] = pose[:3, :3] @ np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]], dtype=float)
    reasons = [verdict.reason for verdict in coverage(arm, np.stack([pose, turned]))]
    assert reasons == [ReachReason.WITHIN_REACH, ReachReason.ORIENTATION]


@pytest.fixture(scope="module")
def found() -> Workspace:
    return find_workspace(qparm.Cell.load(DOME), spacing=0.15)


def test_the_volume_is_the_capsules(found: Workspace) -> None:
    """Of the ball around the shoulder, swept along the rail; nothing of it is missed, for the elbow folds."""
    capsule = 4 / 3 * np.pi * 0.938**3 + np.pi * 0.938**2 * 0.8
    assert found.volume == pytest.approx(capsule, rel=0.06)
    assert found.all_reached
    assert np.isfinite(found.margin).all()
    assert found.rim.any()
    assert not found.rim.all()


def test_the_working_space_is_the_shell_over_the_dome(found: Workspace) -> None:
    """Between radii 0.6 and 0.7 m over the zone, and beyond its edges a quarter of a torus."""
    solid_angle = np.radians(120) * (np.sin(np.radians(60)) - np.sin(np.radians(-10)))
    shell = solid_angle * (0.7**3 - 0.6**3) / 3
    edge = 0.6 * (np.radians(70) * 2 + np.radians(120) * (np.cos(np.radians(60)) + np.cos(np.radians(10))))
    assert found.used_volume == pytest.approx(shell + edge * np.pi * 0.1**2 / 4, rel=0.08)
    assert found.share_used == found.used_volume / found.volume


def test_the_text_names_what_is_missed() -> None:
    data = cell_data()
    data["arm"]["lengths"].update(L1="300 mm", L3="480 mm")
    data["process"].update(rows=4, points=13)
    missing = find_workspace(qparm.Cell.load(data), spacing=0.3)
    text = workspace_text([missing])
    assert not missing.all_reached
    assert "missed: too far" in text or "missed: limits" in text
    assert missing.numbers()["points_by_verdict"]["within reach"] == missing.reasons[ReachReason.WITHIN_REACH]


@pytest.mark.parametrize(("option", "value"), [("spacing", 0.0), ("depth", -1.0), ("spacing", np.nan)])
def test_lengths_that_are_none_are_refused(option: str, value: float) -> None:
    with pytest.raises(InvalidInput, match=option):
        find_workspace(qparm.Cell.load(DOME), **{option: value})  # type: ignore[arg-type]


def test_a_lattice_that_is_too_fine_is_refused() -> None:
    with pytest.raises(InvalidInput, match="make it wider"):
        find_workspace(qparm.Cell.load(DOME), spacing=0.001)
    with pytest.raises(InvalidInput, match=r"\(N, 3\)"):
        reaches_points(hollow_sphere(), np.zeros(3))


@pytest.mark.slow
def test_the_command_writes_numbers_and_pictures_of_both_arms(tmp_path: Path) -> None:
    run = subprocess.run(
        [sys.executable, "-m", "qparm.cli", "workspace", str(DOME), "--against", str(SIX), "--spacing", "200 mm",
         "--out", str(tmp_path / "out")],
        capture_output=True, text=True, timeout=240, check=False,
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    files = {file.name for file in (tmp_path / "out").iterdir()}
    assert files == {"workspace.json", "coverage.csv", "region.csv", "workspace.png", "coverage.png"}
    numbers = json.loads((tmp_path / "out" / "workspace.json").read_text(encoding="utf-8"))
    assert [arm["joints"] for arm in numbers["arms"]] == [8, 6]
    assert [arm["points_by_verdict"] for arm in numbers["arms"]] == [{"within reach": 915}] * 2
    rail, six = (arm["share_used"] for arm in numbers["arms"])
    assert rail > 1.5 * six, "the paper's claim: a rail makes more of the region useful"
    with (tmp_path / "out" / "coverage.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert Counter(row["arm"] for row in rows) == {"0": 915, "1": 915}
    for name in ("workspace.png", "coverage.png"):
        picture = matplotlib.image.imread(tmp_path / "out" / name)
        assert picture.shape[0] > 400
        assert picture[..., :3].std() > 0.05


def test_a_wrong_length_is_refused_by_the_command(tmp_path: Path) -> None:
    for arguments, said in ((["--spacing", "50"], "--spacing"), (["--depth", "0 mm"], "--depth")):
        run = subprocess.run(
            [sys.executable, "-m", "qparm.cli", "workspace", str(DOME), *arguments, "--out", str(tmp_path / "out")],
            capture_output=True, text=True, timeout=240, check=False,
        )  # fmt: skip
        assert run.returncode == 2
        assert said in run.stderr
        assert not (tmp_path / "out").exists()
