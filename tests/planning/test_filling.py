"""Points far apart: poses are put in between, searched and driven, and counted as no points."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import qparm
from conftest import cell_data
from qparm.planning import PathSolution, filled

# Poses along a line, with a gap as wide as fifteen others.
WIDE = ((0.5, -0.19), (0.5, -0.17), (0.5, -0.15), (0.5, 0.15), (0.5, 0.17), (0.5, 0.19))
# The same gap between two stretches that lie across it: a corner on either side.
JUMP_OVER = ((0.45, 0.05), (0.47, 0.05), (0.49, 0.05), (0.51, 0.35), (0.53, 0.35), (0.55, 0.35))


def upright(places: tuple[tuple[float, float], ...], **process: Any) -> dict[str, Any]:
    """Return a cell of an upright six-axis arm (axes z, y, y, y, z, y) over places at 0.2 m, the tool pointing down."""
    links = ((0, "0 m", "0.15 m"), (-90, "0 m", "0 m"), (0, "0.55 m", "0 m"), (0, "0.5 m", "0 m"),
             (-90, "0 m", "0 m"), (90, "0 m", "0.1 m"))  # fmt: skip
    joint = {"type": "revolute", "position": ["-3.1 rad", "3.1 rad"], "velocity": "60 deg/s",
             "acceleration": "180 deg/s^2", "jerk": "1800 deg/s^3"}  # fmt: skip
    joints = [
        {"name": f"a{i}", "dh": {"alpha": f"{alpha} deg", "a": a, "d": d, "theta": "0 deg"}} | joint
        for i, (alpha, a, d) in enumerate(links, 1)
    ]
    lines = "".join(f"{x},{y},0.2,0,1,0,0\n" for x, y in places)
    return {
        "schema": 1,
        "name": "upright",
        "arm": {"name": "upright", "convention": "modified", "joints": joints,
                "home": ["0 deg", "-90 deg", "90 deg", "0 deg", "90 deg", "0 deg"]},
        "workpiece": {"shape": "pose list", "poses": "x,y,z,qw,qx,qy,qz\n" + lines},
        "process": {"feed": "20 mm/s"} | process,
    }  # fmt: skip


@pytest.mark.parametrize("places", [WIDE, JUMP_OVER[2:4]], ids=["a wide gap", "two points"])
def test_points_far_apart_are_joined_on_the_path(places: tuple[tuple[float, float], ...]) -> None:
    plan = qparm.plan(upright(places))
    assert plan.joint_path.breaks == ()
    assert plan.solution.driven.all()
    assert plan.search is not None
    assert plan.search.proven
    # the points are those of the list, whatever lies between
    own = plan.joint_path.point[plan.joint_path.point >= 0]
    np.testing.assert_array_equal(own, np.arange(len(places)))
    assert len(plan.record.points) == len(plan.solution.q) == len(places)
    deviations = plan.joint_path.deviations
    assert deviations is not None
    assert deviations.exact(5e-6, 20e-6).all()


def test_a_gap_between_corners_is_driven_as_a_row_of_its_own() -> None:
    plan = qparm.plan(upright(JUMP_OVER))
    assert [corner.line for corner in plan.tool_path.corners] == [4, 5]
    assert [len(row.s) for row in plan.tool_path.rows] == [3, 2, 3]
    assert plan.joint_path.breaks == ()
    assert plan.trajectory.executable, plan.trajectory.reasons


def test_poses_are_put_in_where_points_are_far_apart_and_nowhere_else() -> None:
    cell = qparm.Cell.load(upright(WIDE))
    chain, tool_path = cell.chain(), cell.tool_path()
    path = filled(chain, tool_path)
    np.testing.assert_array_equal(path.poses[path.points], tool_path.poses)
    np.testing.assert_array_equal(path.s[path.points], tool_path.s)
    between = np.diff(path.points)
    assert (between[[0, 1, 3, 4]] == 1).all()
    assert between[2] > 2
    step = np.linalg.norm(np.diff(path.poses[:, :3, 3], axis=0), axis=1)
    assert step.max() < 0.25 * chain.characteristic_length


def test_a_dense_raster_is_left_as_it_is() -> None:
    cell = qparm.Cell.load(cell_data())
    path = filled(cell.chain(), cell.tool_path())
    assert path.rows == cell.tool_path().rows
    np.testing.assert_array_equal(path.points, np.arange(915))


def test_self_motion_areas_count_the_points_that_are_given() -> None:
    data = cell_data()
    data["process"] |= {"rows": 2, "points": 7, "self_motion": {"points": 2}}
    cell = qparm.Cell.load(data)
    tool_path = cell.tool_path()
    path = filled(cell.chain(), tool_path)
    assert path.point_count > tool_path.point_count
    np.testing.assert_array_equal(path.in_self_motion_area[path.points], tool_path.in_self_motion_area)
    first = slice(int(path.points[5]), int(path.points[6]) + 1)
    assert path.in_self_motion_area[first].all(), "what lies between two of its points belongs to it"
    assert not path.in_self_motion_area[path.points[4] : path.points[5]].any()


def test_where_a_gap_is_not_driven_its_points_are_neighbours_again() -> None:
    cell = qparm.Cell.load(upright(WIDE))
    path = filled(cell.chain(), cell.tool_path())
    K = path.point_count
    driven = np.ones(K - 1, dtype=bool)
    driven[path.points[2] + 1] = False
    solution = PathSolution(np.zeros((K, 6)), np.zeros((K, 3)), np.ones(K, dtype=bool), driven)
    trimmed, rest = path.trimmed(solution)
    np.testing.assert_array_equal(trimmed.points, np.arange(6))
    np.testing.assert_array_equal(rest.driven, [True, True, False, True, True])
    np.testing.assert_array_equal(path.of_points(solution).driven, rest.driven)
