"""The zone of a sphere and the serpentine raster over it."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import qparm
from conftest import speeds_along
from qparm.errors import InvalidInput
from qparm.path import ToolPath
from qparm.surface import SphericalZone, serpentine_raster, tool_frames

Array = NDArray[np.float64]

CENTRE = np.array([0.0, 1.5, 0.36])


@pytest.fixture(scope="module")
def zone() -> SphericalZone:
    """Return the reference cell's: 600 mm, -10 to 60 deg, +-60 deg."""
    return SphericalZone(0.6, (np.radians(-10), np.radians(60)), (np.radians(-60), np.radians(60)))


def raster(zone: SphericalZone, **changes: Any) -> ToolPath:
    T = np.eye(4)
    T[:3, 3] = CENTRE
    values: dict[str, Any] = {"rows": 15, "points": 61, "pose_base_workpiece": T}
    return serpentine_raster(zone, **values | changes)


@pytest.fixture(scope="module")
def path(zone: SphericalZone) -> ToolPath:
    return raster(zone)


def grid(count: int = 9) -> tuple[Array, Array]:
    u, v = np.meshgrid(np.linspace(0, 1, count), np.linspace(0, 1, count))
    return u, v


# --- the zone -------------------------------------------------------------------------------------


def test_points_lie_on_the_sphere_and_normals_point_outward(zone: SphericalZone) -> None:
    point, normal = zone.point(*grid()), zone.normal(*grid())
    np.testing.assert_allclose(np.linalg.norm(point, axis=-1), 0.6, rtol=1e-15)
    np.testing.assert_allclose(np.linalg.norm(normal, axis=-1), 1.0, rtol=1e-15)
    np.testing.assert_allclose(point, 0.6 * normal, rtol=1e-15)
    np.testing.assert_allclose(zone.distance(point), 0.0, atol=1e-15)
    np.testing.assert_allclose(zone.distance(point + 0.05 * normal), 0.05, rtol=1e-12)
    np.testing.assert_allclose(zone.distance(point - 0.05 * normal), -0.05, rtol=1e-12)


@pytest.mark.parametrize(
    ("azimuth", "elevation", "normal"),
    [
        (0, 0, (0, -1, 0)),
        (60, 0, (np.sqrt(0.75), -0.5, 0)),
        (-60, 0, (-np.sqrt(0.75), -0.5, 0)),
        (0, 60, (0, -0.5, np.sqrt(0.75))),
        (60, 60, (np.sqrt(3) / 4, -0.25, np.sqrt(0.75))),
        (0, -10, (0, -np.cos(np.radians(10)), -np.sin(np.radians(10)))),
    ],
)
def test_azimuth_zero_faces_minus_y_and_grows_towards_plus_x(
    zone: SphericalZone, azimuth: float, elevation: float, normal: tuple[float, float, float]
) -> None:
    np.testing.assert_allclose(zone.normal((azimuth + 60) / 120, (elevation + 10) / 70), normal, rtol=0, atol=1e-15)


def test_area(zone: SphericalZone) -> None:
    assert zone.area == pytest.approx(0.78, abs=0.005)
    # the same by summing up the patches of a fine grid
    middle = (np.arange(400) + 0.5) / 400
    strips = [zone.row_length(v) * zone.column_length(0, 1 / 400) for v in middle]
    assert zone.area == pytest.approx(sum(strips), rel=1e-5)
    whole = SphericalZone(2.0, (-np.pi / 2, np.pi / 2), (-np.pi, np.pi))
    assert whole.area == pytest.approx(4 * np.pi * 4)


def test_the_tangent_is_that_of_growing_azimuth(zone: SphericalZone) -> None:
    u, v = grid()
    along, h = zone.along(u, v), 1e-5
    slope = (zone.point(u + h, v) - zone.point(u - h, v)) / (2 * h)
    np.testing.assert_allclose(along, slope / np.linalg.norm(slope, axis=-1, keepdims=True), atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(along, axis=-1), 1.0, rtol=1e-15)
    np.testing.assert_allclose((along * zone.normal(u, v)).sum(axis=-1), 0.0, atol=1e-15)


def test_the_tangent_is_defined_at_the_pole() -> None:
    cap = SphericalZone(0.6, (0.0, np.pi / 2), (-1.0, 1.0))
    np.testing.assert_allclose(np.linalg.norm(cap.along([0.0, 0.5, 1.0], 1.0), axis=-1), 1.0, rtol=1e-15)


def test_row_and_column_lengths_are_arc_lengths(zone: SphericalZone) -> None:
    t = np.linspace(0, 1, 20001)
    for v in (0.0, 1 / 7, 0.6, 1.0):
        walked = np.linalg.norm(np.diff(zone.point(t, v), axis=0), axis=1).sum()
        assert zone.row_length(v) == pytest.approx(walked, rel=1e-8)
    for v0, v1 in ((0.0, 1.0), (0.9, 0.2), (0.4, 0.5)):
        walked = np.linalg.norm(np.diff(zone.point(0.3, v0 + t * (v1 - v0)), axis=0), axis=1).sum()
        assert zone.column_length(v0, v1) == pytest.approx(walked, rel=1e-8)


@pytest.mark.parametrize(
    ("radius", "elevation", "azimuth", "named"),
    [
        (0.0, (0, 1), (0, 1), "radius"),
        (-0.6, (0, 1), (0, 1), "radius"),
        (np.nan, (0, 1), (0, 1), "radius"),
        (np.inf, (0, 1), (0, 1), "radius"),
        (0.6, (1, 0), (0, 1), "elevation"),
        (0.6, (0.5, 0.5), (0, 1), "elevation"),
        (0.6, (-1.6, 0), (0, 1), "elevation"),
        (0.6, (0, 1.6), (0, 1), "elevation"),
        (0.6, (np.nan, 1), (0, 1), "elevation"),
        (0.6, (0, np.nan), (0, 1), "elevation"),
        (0.6, (0, 1), (1, 0), "azimuth"),
        (0.6, (0, 1), (1, 1), "azimuth"),
        (0.6, (0, 1), (0, 6.3), "azimuth"),
        (0.6, (0, 1), (np.nan, 1), "azimuth"),
        (0.6, (0, 1), (-np.inf, np.inf), "azimuth"),
    ],
)
def test_a_zone_that_is_none_is_refused_by_name(
    radius: float, elevation: tuple[float, float], azimuth: tuple[float, float], named: str
) -> None:
    with pytest.raises(InvalidInput, match=f"^{named}"):
        SphericalZone(radius, elevation, azimuth)


# --- the raster's points --------------------------------------------------------------------------


def test_rows_and_points(path: ToolPath) -> None:
    assert len(path.rows) == 15
    assert len(path.transitions) == 14
    assert path.point_count == 915
    assert path.poses.shape == (915, 4, 4)
    assert path.s.shape == (915,)
    assert np.array_equal(path.row_of_point, np.arange(915) // 61)


def test_the_cells_path_is_this_one(dome: qparm.Cell, path: ToolPath) -> None:
    np.testing.assert_allclose(dome.tool_path().poses, path.poses, rtol=0, atol=1e-15)


def test_every_pose_is_a_right_handed_frame(path: ToolPath) -> None:
    R = path.poses[:, :3, :3]
    np.testing.assert_allclose(R @ R.transpose(0, 2, 1), np.tile(np.eye(3), (915, 1, 1)), atol=1e-15)
    np.testing.assert_allclose(np.linalg.det(R), 1.0, rtol=1e-14)
    assert np.array_equal(path.poses[:, 3], np.tile([0.0, 0.0, 0.0, 1.0], (915, 1)))


def test_the_tools_z_goes_into_the_surface_and_x_along_azimuth_on_every_row(path: ToolPath) -> None:
    """Also on the rows that run back: the tool does not turn round with the direction of travel."""
    for i in range(15):
        poses = path.poses[path.row_of_point == i]
        outward = (poses[:, :3, 3] - CENTRE) / 0.6
        np.testing.assert_allclose(poses[:, :3, 2], -outward, rtol=0, atol=1e-14)
        azimuth = np.arctan2(outward[:, 0], -outward[:, 1])
        x = np.column_stack([np.cos(azimuth), np.sin(azimuth), 0 * azimuth])
        np.testing.assert_allclose(poses[:, :3, 0], x, rtol=0, atol=1e-14)
        np.testing.assert_allclose(poses[:, :3, 1], np.cross(-outward, x), rtol=0, atol=1e-14)


def test_the_rows_are_a_serpentine(path: ToolPath) -> None:
    """Elevation rises by 5 deg a row; azimuth runs -60 to 60 deg by 2 deg and back in turn."""
    outward = (path.poses[:, :3, 3] - CENTRE) / 0.6
    elevation = np.degrees(np.arcsin(outward[:, 2])).reshape(15, 61)
    azimuth = np.degrees(np.arctan2(outward[:, 0], -outward[:, 1])).reshape(15, 61)
    np.testing.assert_allclose(elevation, np.tile(np.arange(-10, 61, 5)[:, None], (1, 61)), atol=1e-12)
    there = np.arange(-60, 61, 2)
    for i in range(15):
        np.testing.assert_allclose(azimuth[i], there if i % 2 == 0 else there[::-1], atol=1e-12)


def test_reversed_rows_have_the_same_poses_in_the_other_order(zone: SphericalZone, path: ToolPath) -> None:
    for i in (1, 2, 13):
        u = np.linspace(0, 1, 61)[:: 1 if i % 2 == 0 else -1]
        np.testing.assert_allclose(path.rows[i].poses, tool_frames(zone, u, i / 14), rtol=0, atol=1e-15)


def test_spacing_and_arc_length(path: ToolPath) -> None:
    """20.9 mm at the equator, 10.5 mm at the top, 52 mm between rows."""
    steps = []
    for i, row in enumerate(path.rows):
        elevation = np.radians(-10 + 5 * i)
        assert row.length == pytest.approx(0.6 * np.cos(elevation) * np.radians(120), rel=1e-14)
        np.testing.assert_allclose(row.s, np.linspace(0, row.length, 61), rtol=0, atol=1e-15)
        steps.append(row.s[1] - row.s[0])
        chords = np.linalg.norm(np.diff(row.poses[:, :3, 3], axis=0), axis=1)
        np.testing.assert_allclose(chords, steps[-1], rtol=1e-3)
    assert max(steps) == pytest.approx(0.0209, abs=5e-5)
    assert min(steps) == pytest.approx(0.0105, abs=5e-5)
    np.testing.assert_allclose([t.length for t in path.transitions], 0.6 * np.radians(5), rtol=1e-12)
    assert path.transitions[0].length == pytest.approx(0.052, abs=5e-4)


def test_a_single_row_runs_through_the_middle(zone: SphericalZone) -> None:
    path = raster(zone, rows=1, points=2)
    outward = (path.poses[:, :3, 3] - CENTRE) / 0.6
    np.testing.assert_allclose(np.degrees(np.arcsin(outward[:, 2])), 25.0, atol=1e-12)
    assert path.transitions == ()


@pytest.mark.parametrize("stand_off", [0.0, 0.03, -0.002])
def test_the_stand_off_is_along_the_normal(zone: SphericalZone, path: ToolPath, stand_off: float) -> None:
    moved = raster(zone, stand_off=stand_off)
    distance = zone.distance(moved.poses[:, :3, 3] - CENTRE)
    np.testing.assert_allclose(distance, stand_off, rtol=0, atol=1e-15)
    np.testing.assert_allclose(moved.poses[:, :3, :3], path.poses[:, :3, :3], rtol=0, atol=1e-15)
    expected = path.poses[:, :3, 3] - stand_off * path.poses[:, :3, 2]
    np.testing.assert_allclose(moved.poses[:, :3, 3], expected, rtol=0, atol=1e-15)
    # the arc length is the tool point's, which goes a longer or a shorter way than the surface's point below it
    np.testing.assert_allclose(moved.s, path.s * (0.6 + stand_off) / 0.6, rtol=1e-12)


@pytest.mark.parametrize("stand_off", [0.0, 0.03, -0.002])
@pytest.mark.parametrize("lift", [0.0, 0.03])
def test_the_parameter_of_rows_and_transitions_is_the_tool_points_arc_length(
    zone: SphericalZone, stand_off: float, lift: float
) -> None:
    path = raster(zone, stand_off=stand_off, lift=lift, transition="lift" if lift else "follow")
    for edge in (path.rows[0], path.rows[7], path.transitions[3]):
        np.testing.assert_allclose(speeds_along(edge.curve, edge.length), 1.0, rtol=0, atol=2e-9)
    assert path.transitions[3].length > 0.6 * np.radians(5) * (1 + stand_off / 0.6) - 1e-12


def test_the_workpieces_pose_moves_everything_with_it(zone: SphericalZone, path: ToolPath) -> None:
    T = np.array([[0, -1, 0, 0.3], [0, 0, -1, 0.2], [1, 0, 0, 0.1], [0, 0, 0, 1]], dtype=float)
    moved, still = raster(zone, pose_base_workpiece=T), raster(zone, pose_base_workpiece=np.eye(4))
    np.testing.assert_allclose(moved.poses, T @ still.poses, rtol=0, atol=1e-15)
    np.testing.assert_allclose(moved.pose(3, 0.2), T @ still.pose(3, 0.2), rtol=0, atol=1e-15)
    np.testing.assert_allclose(moved.transition_poses(3), T @ still.transition_poses(3), rtol=0, atol=1e-15)
    assert np.array_equal(moved.rows[4].poses, path.rows[4].poses)


# --- between the points ---------------------------------------------------------------------------


def test_the_continuous_pose_passes_through_the_points(path: ToolPath) -> None:
    for i, row in enumerate(path.rows):
        assert np.array_equal(path.pose(i, row.s), path.poses[path.row_of_point == i])
        np.testing.assert_allclose(path.pose(i, float(row.s[7])), path.poses[61 * i + 7], rtol=0, atol=1e-15)
    assert path.pose(0, 0.1).shape == (4, 4)
    assert path.pose(0, np.array([0.1])).shape == (1, 4, 4)


def test_arc_length_is_the_way_travelled(path: ToolPath) -> None:
    """The tool moves by 1 m per metre of s, towards growing azimuth on even rows, back on odd ones."""
    for i in (0, 1, 7, 14):
        s, h = np.linspace(0.01, path.rows[i].length - 0.01, 40), 1e-6
        velocity = (path.pose(i, s + h)[:, :3, 3] - path.pose(i, s - h)[:, :3, 3]) / (2 * h)
        direction = 1.0 if i % 2 == 0 else -1.0
        np.testing.assert_allclose(velocity, direction * path.pose(i, s)[:, :3, 0], rtol=0, atol=1e-9)


def test_the_continuous_pose_stays_on_the_surface(zone: SphericalZone, path: ToolPath) -> None:
    for i, row in enumerate(path.rows):
        position = path.pose(i, np.linspace(0, row.length, 333))[:, :3, 3]
        np.testing.assert_allclose(zone.distance(position - CENTRE), 0.0, atol=1e-15)


# --- transitions ----------------------------------------------------------------------------------


LIFTS = [("follow", 0.0), ("follow", 0.03), ("lift", 0.03), ("lift", 0.2)]


@pytest.mark.parametrize("stand_off", [0.0, 0.005])
@pytest.mark.parametrize(("transition", "lift"), LIFTS)
def test_transitions_lead_from_row_to_row_and_never_dip(
    zone: SphericalZone, transition: str, lift: float, stand_off: float
) -> None:
    path = raster(zone, transition=transition, lift=lift, stand_off=stand_off)
    rise = lift if transition == "lift" else 0.0
    for i, edge in enumerate(path.transitions):
        ends = edge.curve(np.array([0.0, edge.length]))
        np.testing.assert_allclose(ends[0], path.rows[i].poses[-1], rtol=0, atol=1e-15)
        np.testing.assert_allclose(ends[1], path.rows[i + 1].poses[0], rtol=0, atol=1e-15)
        poses = edge.curve(np.linspace(0, edge.length, 401))
        height = zone.distance(poses[:, :3, 3]) - stand_off
        assert height.min() > -1e-15
        assert height.max() == pytest.approx(rise, abs=1e-15)
        assert height[200] == pytest.approx(rise, abs=1e-15)
        # up and down once, and level with the surface at both ends
        assert (np.diff(height[:201]) >= -1e-15).all()
        np.testing.assert_allclose(height, height[::-1], rtol=0, atol=1e-14)
        assert height[1] <= 1e-2 * max(rise, 1e-9)
        if rise:
            assert edge.length > 1.9 * rise
        assert edge.lifted is (rise > 0)
        # at the row end's azimuth, in steps of the arc length
        azimuth = np.arctan2(poses[:, 0, 3], -poses[:, 1, 3])
        np.testing.assert_allclose(azimuth, np.radians(60 if i % 2 == 0 else -60), atol=1e-13)
        elevation = np.arcsin(-poses[:, 2, 2])
        assert (np.diff(elevation) > 0).all()
        if not rise:
            np.testing.assert_allclose(elevation, np.radians(-10 + 5 * i + 5 * np.linspace(0, 1, 401)), atol=1e-13)


@pytest.mark.parametrize(("transition", "lift"), LIFTS)
def test_via_poses_lie_on_the_transition(zone: SphericalZone, transition: str, lift: float) -> None:
    path = raster(zone, transition=transition, lift=lift)
    for i, edge in enumerate(path.transitions):
        assert len(edge.s) >= 1
        assert (np.diff([0.0, *edge.s, edge.length]) > 0).all()
        assert np.array_equal(edge.poses, edge.curve(edge.s))
        assert np.array_equal(path.transition_poses(i), path.pose_base_workpiece @ edge.poses)


@pytest.mark.parametrize("points", [13, 61, 241])
@pytest.mark.parametrize(("transition", "lift"), LIFTS)
def test_via_poses_are_no_farther_apart_than_the_points(
    zone: SphericalZone, transition: str, lift: float, points: int
) -> None:
    """Than those of the longest row, as long as there is one via pose at least."""
    path = raster(zone, transition=transition, lift=lift, points=points)
    spacing = max(row.s[1] for row in path.rows)
    for edge in path.transitions:
        if len(edge.s) == 1:
            continue
        position = edge.curve(np.array([0.0, *edge.s, edge.length]))[:, :3, 3]
        assert np.linalg.norm(np.diff(position, axis=0), axis=1).max() <= spacing * (1 + 1e-9)


# --- self-motion areas ----------------------------------------------------------------------------


@pytest.mark.parametrize("k", [0, 1, 3, 30])
def test_self_motion_points_mark_both_sides_of_every_row_end(zone: SphericalZone, k: int) -> None:
    """The first row's start and the last row's end are no row ends between rows."""
    marks = raster(zone, self_motion_points=k).in_self_motion_area
    expected = np.zeros((15, 61), dtype=bool)
    expected[1:, :k] = True
    expected[:-1, 61 - k :] = True
    assert np.array_equal(marks.reshape(15, 61), expected)
    assert marks.sum() == 2 * k * 14


def test_a_single_row_has_no_self_motion_area(zone: SphericalZone) -> None:
    assert not raster(zone, rows=1, self_motion_points=4).in_self_motion_area.any()


# --- data and refusals ----------------------------------------------------------------------------


@pytest.mark.parametrize("transition", ["follow", "lift"])
def test_a_path_pickles_with_its_curves(zone: SphericalZone, transition: str) -> None:
    path = raster(zone, transition=transition, lift=0.03, self_motion_points=2)
    copy = pickle.loads(pickle.dumps(path))
    assert np.array_equal(copy.poses, path.poses)
    assert np.array_equal(copy.pose(3, 0.123), path.pose(3, 0.123))
    assert np.array_equal(copy.transition_poses(5), path.transition_poses(5))
    assert np.array_equal(copy.transitions[5].curve(np.array([0.02])), path.transitions[5].curve(np.array([0.02])))
    assert np.array_equal(copy.in_self_motion_area, path.in_self_motion_area)


def test_a_path_keeps_its_own_copy_of_the_workpieces_pose(zone: SphericalZone) -> None:
    T = np.eye(4)
    path = raster(zone, pose_base_workpiece=T)
    T[0, 3] = 5.0
    assert np.abs(path.poses[:, 0, 3]).max() < 0.7


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"rows": 0}, "not 0 of 61"),
        ({"rows": -1}, "not -1 of 61"),
        ({"points": 1}, "not 15 of 1"),
        ({"self_motion_points": -1}, "self_motion_points must be between 0 and 30, not -1"),
        ({"self_motion_points": 31}, "self_motion_points must be between 0 and 30, not 31"),
        ({"stand_off": np.nan}, "stand_off"),
        ({"stand_off": np.inf}, "stand_off"),
        ({"lift": -0.01}, "lift"),
        ({"lift": np.nan}, "lift"),
        ({"transition": "hop"}, "transition"),
        ({"pose_base_workpiece": np.eye(3)}, "pose_base_workpiece"),
        ({"pose_base_workpiece": np.full((4, 4), np.nan)}, "pose_base_workpiece"),
        ({"pose_base_workpiece": 2 * np.eye(4)}, "pose_base_workpiece"),
    ],
    ids=lambda value: "-".join(map(str, value)) if isinstance(value, dict) else "",
)
def test_a_raster_that_is_none_is_refused_by_name(zone: SphericalZone, changes: dict[str, Any], named: str) -> None:
    with pytest.raises(InvalidInput, match=named):
        raster(zone, **changes)


@pytest.mark.parametrize("elevation", [(0.0, np.pi / 2), (-np.pi / 2, 0.0)])
def test_a_row_at_a_pole_is_refused_by_number(elevation: tuple[float, float]) -> None:
    with pytest.raises(InvalidInput, match=f"row {2 if elevation[1] else 0} has no length"):
        raster(SphericalZone(0.6, elevation, (-1.0, 1.0)), rows=3)
