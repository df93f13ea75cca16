"""The turn beyond the rows' ends: on the surface, by arc length, without a corner where it meets the rows."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest

import qparm
from conftest import cell_data, speeds_along
from qparm.path import ToolPath
from qparm.surface import SphericalZone, TurnCurve, serpentine_raster

ZONE = SphericalZone(radius=0.6, elevation=np.radians((-10.0, 60.0)), azimuth=np.radians((-60.0, 60.0)))  # pyright: ignore[reportArgumentType]


def raster(**options: Any) -> ToolPath:
    given: dict[str, Any] = {"row_end": "flow"} | options
    return serpentine_raster(ZONE, rows=8, points=31, pose_base_workpiece=np.eye(4), **given)


@pytest.mark.parametrize("overrun", [0.004, 0.01, 0.05, 1.0])
def test_it_leads_from_row_to_row_on_the_surface_as_far_out_as_asked(overrun: float) -> None:
    path = raster(overrun=overrun)
    for k, turn in enumerate(path.transitions):
        assert turn.flows
        s = np.linspace(0.0, turn.length, 2001)
        poses = turn.curve(s)
        np.testing.assert_allclose(poses[[0, -1]], [path.rows[k].poses[-1], path.rows[k + 1].poses[0]], atol=1e-12)
        np.testing.assert_allclose(ZONE.distance(poses[:, :3, 3]), 0.0, atol=1e-12)
        azimuth = np.arctan2(poses[:, 0, 3], -poses[:, 1, 3])
        beyond = np.hypot(poses[:, 0, 3], poses[:, 1, 3]) * (np.abs(azimuth) - np.radians(60.0))
        assert beyond.min() > -1e-9
        distance = ZONE.column_length(0.0, 1.0 / 7)
        assert beyond.max() == pytest.approx(min(overrun, distance / 2), rel=1e-2)


@pytest.mark.parametrize("options", [{}, {"stand_off": 0.05}, {"overrun": 0.03}, {"transition": "lift", "lift": 0.03}])
def test_its_parameter_is_the_arc_length_of_the_tool_point(options: dict[str, Any]) -> None:
    turn = raster(**options).transitions[2]
    np.testing.assert_allclose(speeds_along(turn.curve, turn.length), 1.0, rtol=0, atol=1e-9)


@pytest.mark.parametrize("options", [{}, {"stand_off": 0.05}, {"transition": "lift", "lift": 0.03}])
def test_it_joins_the_rows_with_continuous_derivatives(options: dict[str, Any]) -> None:
    """One-sided derivatives of the pose at both ends; of the fourth no more is seen than that it does not step far."""
    path = raster(overrun=0.05, **options)
    x = 2e-3 * (0.5 - 0.5 * np.cos(np.pi * np.arange(13) / 12))
    for k in (0, 3, 6):
        row, turn, following = path.rows[k], path.transitions[k], path.rows[k + 1]
        joints = (
            (row.curve(row.length - x), turn.curve(x)),
            (turn.curve(turn.length - x), following.curve(x)),
        )
        for before, after in joints:
            for component in ((0, 3), (1, 3), (2, 3), (0, 0), (2, 2)):
                left, right = (np.polynomial.Polynomial.fit(x, f[:, *component], 10) for f in (before, after))
                assert left(0.0) == pytest.approx(right(0.0), abs=1e-12)
                for order, slack in ((1, 1e-9), (2, 1e-6), (3, 0.05), (4, 300.0)):
                    there = left.deriv(order)(0.0) * (-1.0) ** order
                    assert there == pytest.approx(right.deriv(order)(0.0), abs=slack), (component, order)


def test_it_pickles_and_its_waypoints_lie_in_order_on_it() -> None:
    path = pickle.loads(pickle.dumps(raster()))
    for turn in path.transitions:
        assert (np.diff(np.concatenate([[0.0], turn.s, [turn.length]])) > 0).all()
        np.testing.assert_array_equal(turn.poses, turn.curve(turn.s))


def test_the_narrowest_turn_has_no_line_between_its_corners() -> None:
    turn = TurnCurve(ZONE, 1.0, 0.0, 0.1, overrun=1.0)
    assert turn.overrun == pytest.approx(ZONE.column_length(0.0, 0.1) / 2)
    assert turn.length < 2.0 * ZONE.column_length(0.0, 0.1)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"row_end": "go"}, "process.self_motion.row_end"),
        ({"overrun": "0 mm"}, "process.self_motion.overrun"),
        ({"overrun": 10}, "process.self_motion.overrun: 10 has no unit"),
    ],
)
def test_a_cell_with_a_bad_key_is_refused(changes: dict[str, object], words: str) -> None:
    data = cell_data()
    data["process"]["self_motion"] |= changes
    with pytest.raises(qparm.CellError, match=words):
        qparm.Cell.load(data)


def test_a_pose_list_has_no_surface_to_turn_on() -> None:
    data = cell_data()
    lines = [f"{0.01 * k},{0.05 * row},0,1,0,0,0,{row}" for row in range(2) for k in range(4)]
    data["workpiece"] = {"shape": "pose list", "poses": "\n".join(["x,y,z,qw,qx,qy,qz,row", *lines]) + "\n"}
    del data["process"]["rows"], data["process"]["points"]
    qparm.Cell.load(data)
    data["process"]["self_motion"]["row_end"] = "flow"
    with pytest.raises(qparm.CellError, match="a pose list has no surface to turn on"):
        qparm.Cell.load(data)


@pytest.mark.parametrize(("key", "value"), [("row_end", "go"), ("overrun", 0.0), ("overrun", np.nan)])
def test_a_raster_with_a_bad_option_is_refused(key: str, value: object) -> None:
    with pytest.raises(qparm.InvalidInput, match=key):
        raster(**{key: value})
