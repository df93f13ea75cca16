"""Points that are passed more than once: in order, as many as can be, and rows in the least time."""

from __future__ import annotations

from dataclasses import replace
from importlib.resources import files
from itertools import pairwise, product
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import qparm
from conftest import cell_data
from made_arm import pose_list
from qparm.export import export_trajectory
from qparm.verify import MotionTable, read_motion, verify_motion
from qparm.verify.in_order import passed_in_order


def chosen(times: list[list[float]], row: list[int]) -> list[float | None]:
    """Return when each point is passed."""
    t = np.array([time for own in times for time in own])
    ends = np.cumsum([len(own) for own in times])
    groups = [np.arange(end - len(own), end) for own, end in zip(times, ends.tolist(), strict=True)]
    found = passed_in_order(groups, t, np.array(row))
    return [None if k < 0 else float(t[k]) for k in found]


@pytest.mark.parametrize(
    ("times", "row", "expected"),
    [
        ([[1.0], [2.0], [3.0]], [0, 0, 0], [1.0, 2.0, 3.0]),
        # to and fro over the same poses
        ([[1.0, 5.0], [2.0, 4.0], [3.0], [2.0, 4.0], [1.0, 5.0]], [0] * 5, [1.0, 2.0, 3.0, 4.0, 5.0]),
        # the way to the row passes its first point already
        ([[1.0, 7.0], [8.0]], [0, 0], [7.0, 8.0]),
        # and the way from row to row passes points of both
        ([[1.0], [2.0, 3.5], [3.0, 6.0], [7.0]], [0, 0, 1, 1], [1.0, 2.0, 6.0, 7.0]),
        # a point that is missed does not take the later pass for its own
        ([[1.0, 9.0], [8.0], [3.0, 7.0], [4.0, 6.0], [5.0]], [0] * 5, [1.0, None, 3.0, 4.0, 5.0]),
        ([[], [2.0], []], [0, 0, 1], [None, 2.0, None]),
        ([[], []], [0, 0], [None, None]),
    ],
)
def test_points_are_passed_in_order_and_rows_take_the_least_time(
    times: list[list[float]], row: list[int], expected: list[float | None]
) -> None:
    assert chosen(times, row) == expected


def best_of_all(times: list[list[float]], row: list[int]) -> tuple[int, float]:
    """Return how many points can be passed in order, and the least time of the rows then."""
    found = (-1, 0.0)
    for way in product(*([None, *own] for own in times)):
        passed = [(t, r) for t, r in zip(way, row, strict=True) if t is not None]
        if all(a[0] <= b[0] for a, b in pairwise(passed)):
            rows = [[t for t, r in passed if r == one] for one in set(row)]
            found = max(found, (len(passed), -sum(own[-1] - own[0] for own in rows if own)))
    return found


@pytest.mark.parametrize("seed", range(30))
def test_no_other_way_is_better(seed: int) -> None:
    rng = np.random.default_rng(seed)
    times = [sorted(rng.choice(8, rng.integers(0, 4), replace=False).astype(float).tolist()) for _ in range(6)]
    row = sorted(rng.integers(0, 3, 6).tolist())
    found = chosen(times, row)
    passed = [(t, r) for t, r in zip(found, row, strict=True) if t is not None]
    rows = [[t for t, r in passed if r == one] for one in set(row)]
    assert [t for t, _ in passed] == sorted(t for t, _ in passed)
    assert (len(passed), -sum(own[-1] - own[0] for own in rows if own)) == best_of_all(times, row)


# --- the tool turns on the spot, to and fro ---------------------------------------------------------------


def turns(*axis: float) -> NDArray[np.float64]:
    """Return poses (k, 4, 4) at one place, the tool down, turned about a fixed axis to 44 deg, to -44 deg and back."""
    degrees = [*range(0, 45, 2), *range(42, -45, -2), *range(-42, 1, 2)]
    poses = np.tile(np.eye(4), (len(degrees), 1, 1))
    down = Rotation.from_rotvec([np.pi, 0, 0])
    poses[:, :3, :3] = (Rotation.from_rotvec(np.radians(degrees)[:, None] * axis) * down).as_matrix()
    poses[:, :3, 3] = 0.55, 0.0, 0.3
    return poses


@pytest.fixture(scope="module")
def plan() -> qparm.Plan:
    data = cell_data(Path(str(files("qparm.cell") / "new_cell.toml")))
    data["workpiece"] = {"shape": "pose list", "poses": pose_list(turns(0, 0, 1))}
    data["process"] = {"feed": "50 mm/s"}
    return qparm.plan(data)


def read(plan: qparm.Plan, folder: Path, to: str) -> MotionTable:
    file = folder / f"motion.{to}"
    export_trajectory(plan.trajectory, file, to=to, units=plan.chain.units)
    return read_motion(file, plan.cell)


@pytest.mark.parametrize("to", ["json", "csv"])
def test_turns_to_and_fro_over_the_same_poses_are_kept(plan: qparm.Plan, to: str, tmp_path: Path) -> None:
    report = qparm.report(plan)
    assert report.executable, report.reasons
    assert verify_motion(read(plan, tmp_path, to), plan.cell).problems() == ()


def test_turns_that_fall_short_or_are_left_out_are_not(plan: qparm.Plan, tmp_path: Path) -> None:
    table = read(plan, tmp_path, "csv")
    row, back, _ = (segment for segment in plan.trajectory.segments if segment.kind.value == "row")
    inside = np.flatnonzero((table.t > row.start) & (table.t < row.end))
    q = table.q.copy()
    q[inside, 6] = q[inside[0], 6] + 0.999 * (q[inside, 6] - q[inside[0], 6])
    short = replace(table, q=q, velocity=None, acceleration=None, jerk=None)
    # every pose on the way is passed all the same, but the last one in a leap
    assert {one.code for one in verify_motion(short, plan.cell).findings} >= {"jerk", "acceleration"}
    # from the way back on it is not made: the poses are those passed before, but none is passed again
    there = table.t < back.end
    once = replace(short, t=table.t[: there.sum()], q=table.q[there], row=None, segment=None)
    assert any("point 88 of row 2" in one for one in verify_motion(once, plan.cell).problems(1000))
