"""Pose lists: the quaternion by its columns' names, arc length, the curve through the poses, what is refused."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from conftest import speeds_along
from made_arm import pose_list, row_of_poses
from qparm.errors import InvalidInput
from qparm.path import ToolPath
from qparm.surface import pose_list_tool_path, read_pose_list

HEADER = "x,y,z,qw,qx,qy,qz\n"


def path_of(text: str, **options: float) -> ToolPath:
    return pose_list_tool_path(
        read_pose_list(text), **({"pose_base_workpiece": np.eye(4), "self_motion_points": 0} | options)
    )


def helix(count: int, *, radius: float = 0.6) -> np.ndarray:
    """Return poses on a helix of two turns, the frame turning with it."""
    angle = np.linspace(0, 4 * np.pi, count)
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3] = Rotation.from_rotvec(angle[:, None] * [0.0, 0.0, 1.0]).as_matrix()
    poses[:, :3, 3] = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), 0.05 * angle])
    return poses


# --- reading ----------------------------------------------------------------------------------------


def test_the_quaternion_is_read_by_the_names_of_its_columns() -> None:
    # a quarter turn about x; read in another order it would be one about another axis, or none
    w = repr(np.sqrt(0.5).item())
    first = f"x,y,z,qw,qx,qy,qz\n1,2,3,{w},{w},0,0\n1,2,4,{w},{w},0,0\n"
    other = f"qz,qx, qy ,qw,t,z,y,x\n0,{w},0,{w},ten,3,2,1\n0,{w},0,{w},,4,2,1\n"
    expected = np.array([[1, 0, 0, 1], [0, 0, -1, 2], [0, 1, 0, 3], [0, 0, 0, 1]], dtype=float)
    for text in (first, other, "# a remark\n\n" + first, first.replace("\n", "\r\n"), "\n" + first + "\n\n"):
        np.testing.assert_allclose(read_pose_list(text).poses[0], expected, atol=1e-15)


def test_what_is_written_is_read_again(rng: np.random.Generator, tmp_path: Path) -> None:
    poses = np.tile(np.eye(4), (30, 1, 1))
    steps = Rotation.from_rotvec(rng.normal(scale=0.3, size=(30, 3)))
    turned = [Rotation.identity()]
    for step in steps[1:]:
        turned.append(turned[-1] * step)
    poses[:, :3, :3] = Rotation.concatenate(turned).as_matrix()
    poses[:, :3, 3] = rng.normal(size=(30, 3))
    file = tmp_path / "poses.csv"
    file.write_text(pose_list(poses), encoding="utf-8")
    table = read_pose_list(file)
    np.testing.assert_allclose(table.poses, poses, atol=1e-14)
    np.testing.assert_array_equal(table.line, np.arange(2, 32))
    file.write_text(pose_list(poses), encoding="utf-8-sig")
    np.testing.assert_array_equal(read_pose_list(file).poses, table.poses)


def test_a_quaternion_a_little_off_is_brought_to_unit_length() -> None:
    table = read_pose_list(HEADER + "0,0,0,1.0009,0,0,0\n1,0,0,0.9991,0,0,0\n")
    np.testing.assert_allclose(table.poses[:, :3, :3], np.tile(np.eye(3), (2, 1, 1)), atol=1e-15)


def test_rows_are_split_where_their_column_changes() -> None:
    rows = [row_of_poses(5), row_of_poses(4, z=0.25)[::-1], row_of_poses(6, z=0.3)]
    path = path_of(pose_list(*rows))
    assert [len(row.s) for row in path.rows] == [5, 4, 6]
    np.testing.assert_allclose(path.poses, np.concatenate(rows), atol=1e-15)
    # labels need not ascend
    text = pose_list(*rows).replace(",0\n", ",7\n")
    np.testing.assert_array_equal(read_pose_list(text).row, path.row_of_point)


ONE = "0,0,0,1,0,0,0\n"
BAD: list[tuple[str, str, str]] = [
    ("nothing", "", "the pose list is empty"),
    ("blank", " \n\n", "the pose list is empty"),
    ("header alone", HEADER, "no line below its header"),
    ("one pose", HEADER + ONE, "the row of line 2 has one pose only"),
    ("cut in a number", HEADER + ONE + "0,0,1,1,0,0,0", "line 3 of the pose list does not end: the list is cut short"),
    ("a value missing", HEADER + ONE + "0,0,1,1,0,0\n", "line 3 of the pose list has 6 values, its header names 7"),
    ("a value empty", HEADER + ONE + "0,0,,1,0,0,0\n", "line 3 of the pose list: z is not a number: ''"),
    ("nan", HEADER + ONE + "0,nan,1,1,0,0,0\n", "line 3 of the pose list: y is not finite: 'nan'"),
    ("inf", HEADER + ONE + "0,0,1,inf,0,0,0\n", "line 3 of the pose list: qw is not finite: 'inf'"),
    ("a unit", HEADER + ONE + "0,0,1 m,1,0,0,0\n", "line 3 of the pose list: z is not a number: '1 m'"),
    ("long quaternion", HEADER + ONE + "0,0,1,1.0011,0,0,0\n", "line 3 of the pose list: its quaternion has length"),
    ("no quaternion", HEADER + ONE + "0,0,1,0,0,0,0\n", "line 3 of the pose list: its quaternion has length 0, not 1"),
    ("no header", ONE + ONE, "line 1 of the pose list holds numbers; its first line must name"),
    ("order not said", "x,y,z,q1,q2,q3,q4\n" + ONE, "names a column 'q1'; known are t, row, x, y, z, qw"),
    ("a column missing", "x,y,z,qw,qx,qy\n" + ONE, "must name the columns; missing: qz"),
    ("a column twice", "x,y,z,qw,qx,qy,qz,x\n" + ONE, "names the column 'x' twice"),
    ("the same pose", HEADER + ONE + "0,0,1,1,0,0,0\n" * 2, "line 4 of the pose list repeats the pose of line 3"),
    ("the same, other sign", HEADER + ONE + "0,0,0,-1,0,0,0\n", "line 3 of the pose list repeats the pose of line 2"),
    ("half a turn", HEADER + ONE + "0,0,1,0,1,0,0\n", "lines 2 and 3 of the pose list are turned by 180 deg"),
    ("row with a fraction", "row," + HEADER + "0," + ONE + "0.5," + ONE, "line 3 of the pose list: row must be"),
    ("row that comes back", "row," + HEADER + "".join(f"{r},0,0,{k},1,0,0,0\n" for k, r in enumerate((0, 0, 1, 1, 0))),
     "line 6 of the pose list comes back to row 0"),
    ("row of one pose", "row," + HEADER + "".join(f"{r},0,0,{k},1,0,0,0\n" for k, r in enumerate((0, 0, 1, 2, 2))),
     "the row of line 4 has one pose only"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "words"), [case[1:] for case in BAD], ids=[case[0] for case in BAD])
def test_what_cannot_be_used_is_refused_with_its_line(text: str, words: str, tmp_path: Path) -> None:
    file = tmp_path / "poses.csv"
    file.write_text(text, encoding="utf-8", newline="")
    with pytest.raises(InvalidInput) as caught:
        read_pose_list(file)
    assert words in str(caught.value)


def test_a_list_cut_short_inside_a_line_is_refused() -> None:
    text = pose_list(row_of_poses(4))
    ends = {k + 1 for k, letter in enumerate(text) if letter == "\n"}
    for end in range(len(text)):
        if end in ends and text[:end].count("\n") > 2:
            continue  # whole lines: nothing tells that there were more
        with pytest.raises(InvalidInput):
            read_pose_list(text[:end] or "\n")


@pytest.mark.parametrize(
    ("content", "words"), [(None, "there is no pose list"), (b"\xff\xfe,", "not UTF-8"), (b"", "empty")]
)
def test_a_file_that_cannot_be_read(tmp_path: Path, content: bytes | None, words: str) -> None:
    file = tmp_path / "poses.csv"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(InvalidInput, match=words):
        read_pose_list(file)
    for none in ("a\0b", tmp_path):
        with pytest.raises(InvalidInput, match="cannot be read"):
            read_pose_list(none)


# --- the path ---------------------------------------------------------------------------------------


def test_the_curve_passes_every_pose_and_follows_what_they_follow() -> None:
    coarse, fine = helix(81), helix(1601)
    row = path_of(pose_list(coarse)).rows[0]
    np.testing.assert_allclose(row.curve(row.s), coarse, atol=1e-12)
    # the helix is run through evenly
    between = row.curve(np.linspace(0, row.length, 1601))
    assert np.abs(between[:, :3, 3] - fine[:, :3, 3]).max() < 2e-4
    assert np.abs(between[40:-40, :3, 3] - fine[40:-40, :3, 3]).max() < 3e-6
    assert np.abs(between[40:-40, :3, :3] - fine[40:-40, :3, :3]).max() < 3e-6


def test_s_is_arc_length_where_the_tool_moves() -> None:
    row = path_of(pose_list(helix(401))).rows[0]
    np.testing.assert_allclose(row.s, np.linspace(0, 4 * np.pi * np.hypot(0.6, 0.05), 401), rtol=1e-6)
    straight = path_of(pose_list(row_of_poses(9))).rows[0]
    np.testing.assert_allclose(straight.s, np.linspace(0, 0.4, 9), atol=1e-14)


@pytest.mark.parametrize("radius", [0.1, 0.35])
def test_s_is_the_angle_times_the_turning_radius_where_it_turns_on_the_spot(radius: float) -> None:
    poses = row_of_poses(31, turn=3 * np.pi, length=0.0)
    row = path_of(pose_list(poses), turning_radius=radius).rows[0]
    np.testing.assert_allclose(row.s, np.linspace(0, 3 * np.pi * radius, 31), rtol=1e-9)
    half = row.curve(0.5 * (row.s[1:] + row.s[:-1]))
    expected = row_of_poses(61, turn=3 * np.pi, length=0.0)[1::2]
    np.testing.assert_allclose(half, expected, atol=1e-9)


def wavy(count: int, *, noise: float = 0.0) -> np.ndarray:
    """Return poses on a wave in space whose gaps differ up to 17 times, the tool turning on the way."""
    rng = np.random.default_rng(3)
    gaps = np.where(np.arange(count - 1) % 11 == 5, 17.0, 1.0) * rng.uniform(0.7, 1.3, count - 1)
    share = np.concatenate([[0.0], np.cumsum(gaps)]) / gaps.sum()
    poses = row_of_poses(count)
    poses[:, :3, :3] = Rotation.from_rotvec(np.stack([np.pi + 0 * share, 0.4 * share, share**2], axis=1)).as_matrix()
    poses[:, :3, 3] = np.column_stack([0.5 + 0.05 * np.sin(5 * share), 0.6 * share, 0.2 + 0.03 * np.cos(4 * share)])
    poses[:, :3, 3] += rng.normal(scale=noise or 1e-300, size=(count, 3))
    return poses


@pytest.mark.parametrize("noise", [0.0, 3e-5])
def test_the_tool_moves_by_a_metre_per_metre_of_s_everywhere(noise: float) -> None:
    path = path_of(pose_list(wavy(60, noise=noise)))
    (row,) = path.rows
    inner = row.s[:-1, None] + np.diff(row.s)[:, None] * np.array([0.03, 0.2, 0.5, 0.81, 0.97])
    np.testing.assert_allclose(speeds_along(row.curve, row.length, places=inner.ravel()), 1.0, rtol=0, atol=1e-9)
    np.testing.assert_allclose(row.curve(row.s), row.poses, rtol=0, atol=1e-12)


def test_a_gap_much_longer_than_the_others_does_not_make_the_curve_swing() -> None:
    inside = np.concatenate([np.linspace(0, 0.1, 11), np.linspace(0.27, 0.4, 14)])
    for angle, flatter in ((inside, 2e-5), (np.append(0.0, np.linspace(0.17, 0.3, 14)), 4e-4)):
        poses = row_of_poses(len(angle))
        poses[:, :3, 3] = 0.3 * np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
        (row,) = path_of(pose_list(poses)).rows
        between = row.curve(np.linspace(0, row.length, 4001))[:, :3, 3]
        # beside the circle by a share of the 1.1 mm by which its chord is; never beyond it
        assert np.linalg.norm(between, axis=1).max() < 0.3 + 2e-5
        assert np.linalg.norm(between, axis=1).min() > 0.3 - flatter


def polygon(*corners: tuple[float, ...], step: float = 0.005) -> np.ndarray:
    """Return poses along straight lines between corners (x, y), the tool down, each corner once."""
    points = [np.array([*corners[0], 0.25])]
    for corner in corners[1:]:
        way = np.array([*corner, 0.25]) - points[-1]
        count = round(np.linalg.norm(way) / step)
        points += [points[-1] + way * k / count for k in range(1, count)] + [np.array([*corner, 0.25])]
    poses = row_of_poses(len(points))
    poses[:, :3, 3] = points
    return poses


@pytest.mark.parametrize("step", [0.005, 0.1])
@pytest.mark.parametrize("angle", [30.0, 60.0, 90.0, 135.0, 179.0, 180.0])
def test_rows_are_parted_at_corners_and_do_not_swing(angle: float, step: float) -> None:
    end = 0.2 + 0.2 * np.cos(np.radians(angle)), 0.2 * np.sin(np.radians(angle))
    poses = polygon((0.0, 0.0), (0.2, 0.0), end, step=step)
    path = path_of(pose_list(poses))
    (corner,) = path.corners
    assert len(path.rows) == 2
    assert corner.row == 1
    assert corner.line == 2 + round(0.2 / step)
    assert corner.angle == pytest.approx(np.radians(angle), abs=1e-6)
    assert f"{angle:.0f} deg" in corner.what
    np.testing.assert_allclose(corner.pose[:3, 3], [0.2, 0.0, 0.25], atol=1e-12)
    np.testing.assert_array_equal(path.rows[0].poses[-1], path.rows[1].poses[0])
    assert path.transitions[0].length == 0.0
    assert [row.length for row in path.rows] == pytest.approx([0.2, 0.2], abs=1e-12)
    for row in path.rows:
        between = row.curve(np.linspace(0.0, row.length, 501))[:, :3, 3]
        a, b = row.poses[0, :3, 3], row.poses[-1, :3, 3]
        assert np.linalg.norm(np.cross(between - a, (b - a) / np.linalg.norm(b - a)), axis=1).max() < 1e-12


def test_a_coarse_circle_and_a_bend_over_several_poses_have_no_corner() -> None:
    for count in (6, 10, 40):
        angle = np.linspace(0.0, 2 * np.pi, count + 1)
        poses = row_of_poses(count + 1)
        poses[:, :3, 3] = 0.1 * np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
        assert path_of(pose_list(poses)).corners == ()
    # straight, round an eighth of a circle, straight
    turn = np.radians(np.clip(9.0 * np.arange(-9, 20), 0.0, 90.0))
    poses = row_of_poses(30)
    steps = 0.005 * np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    poses[1:, :3, 3] = poses[0, :3, 3] + np.cumsum(steps, axis=0)
    assert path_of(pose_list(poses)).corners == ()


def test_a_row_that_turns_at_every_pose_is_straight_between_them() -> None:
    poses = row_of_poses(6)
    poses[:, :3, 3] = [[0, 0, 0], [0.3, 0, 0], [0.3, 0.02, 0], [0, 0.02, 0], [0, 0.04, 0], [0.3, 0.04, 0]]
    path = path_of(pose_list(poses))
    assert [len(row.s) for row in path.rows] == [2] * 5
    assert [corner.line for corner in path.corners] == [3, 4, 5, 6]
    assert [row.length for row in path.rows] == pytest.approx([0.3, 0.02, 0.3, 0.02, 0.3])


def test_a_row_is_parted_where_the_tool_begins_and_ends_to_turn_on_the_spot() -> None:
    there, turned, away = row_of_poses(9), row_of_poses(9, turn=1.2, length=0.0), row_of_poses(9, length=0.2)
    turned[:, :3, 3] = there[-1, :3, 3]
    away[:, :3, :3] = turned[-1, :3, :3]
    away[:, :3, 3] += there[-1, :3, 3] - away[0, :3, 3]
    path = path_of(pose_list(np.concatenate([there, turned[1:], away[1:]])))
    assert [len(row.s) for row in path.rows] == [9, 9, 9]
    assert [row.length for row in path.rows] == pytest.approx([0.4, 0.12, 0.2])
    assert [row.turning_radius for row in path.rows] == [0.0, 0.1, 0.0]
    assert [corner.what for corner in path.corners] == [
        "the tool begins to turn on the spot", "the tool goes on after turning on the spot"]  # fmt: skip


def test_a_row_is_parted_where_the_tools_turning_changes_in_one_step() -> None:
    poses = row_of_poses(21)
    poses[11:, :3, :3] = poses[11:, :3, :3] @ Rotation.from_rotvec([0.0, 0.0, 0.7]).as_matrix()
    path = path_of(pose_list(poses))
    assert [len(row.s) for row in path.rows] == [11, 2, 10]
    assert "turning changes" in path.corners[0].what
    turned = [Rotation.from_matrix(row.curve(np.linspace(0, row.length, 99))[:, :3, :3]) for row in path.rows]
    assert max((R[0].inv() * R).magnitude().max() for R in (turned[0], turned[2])) < 1e-9


def test_corners_are_no_self_motion_areas_and_do_not_count_as_short_rows() -> None:
    rows = [polygon((0.0, 0.0), (0.02, 0.0), (0.02, 0.05)), polygon((0.0, 0.1), (0.05, 0.1))]
    path = path_of(pose_list(*rows), self_motion_points=5)
    assert [len(row.s) for row in path.rows] == [5, 11, 11]
    marks = np.split(path.in_self_motion_area, [5, 16])
    assert [mark.tolist() for mark in marks] == [[False] * 5, [False] * 6 + [True] * 5, [True] * 5 + [False] * 6]


def test_from_row_to_row_the_tool_goes_straight_and_turns_evenly() -> None:
    rows = [row_of_poses(5), row_of_poses(5, z=0.5)[::-1]]
    rows[1][:, :3, :3] = rows[1][:, :3, :3] @ Rotation.from_rotvec([0, 0, 0.8]).as_matrix()
    path = path_of(pose_list(*rows))
    (way,) = path.transitions
    assert way.length == pytest.approx(0.3)
    assert len(way.s) == 2  # points of rows are 100 mm apart
    assert not way.lifted
    ends = way.curve(np.array([0.0, way.length]))
    np.testing.assert_allclose(ends, [rows[0][-1], rows[1][0]], atol=1e-12)
    turns = Rotation.from_matrix(np.concatenate([ends[:1], way.poses, ends[1:]])[:, :3, :3])
    np.testing.assert_allclose((turns[:-1].inv() * turns[1:]).magnitude(), np.full(3, 0.8 / 3), atol=1e-9)
    np.testing.assert_allclose(way.poses[:, :3, 3], [[0.5, 0.2, 0.3], [0.5, 0.2, 0.4]], atol=1e-12)


def test_a_row_may_begin_where_the_one_before_ends() -> None:
    first, second = row_of_poses(5), row_of_poses(5)[::-1]
    (way,) = path_of(pose_list(first, second)).transitions
    assert way.length == 0.0
    np.testing.assert_allclose(way.poses, first[-1:], atol=1e-12)


def test_the_poses_stand_in_the_workpieces_frame() -> None:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_rotvec([0.3, -0.4, 0.5]).as_matrix(), (1.0, 2.0, 3.0)
    poses = row_of_poses(5)
    path = path_of(pose_list(poses), pose_base_workpiece=T)  # type: ignore[arg-type]
    np.testing.assert_allclose(path.poses, T @ poses, atol=1e-14)
    np.testing.assert_allclose(path.pose(0, 0.2), T @ poses[2], atol=1e-12)


def test_a_path_pickles() -> None:
    path = path_of(pose_list(row_of_poses(5, turn=1.0), row_of_poses(5, z=0.3)))
    again = pickle.loads(pickle.dumps(path))
    np.testing.assert_array_equal(again.pose(1, 0.123), path.pose(1, 0.123))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"turning_radius": 0.0}, "turning_radius must be finite and positive"),
        ({"turning_radius": np.nan}, "turning_radius must be finite and positive"),
        ({"self_motion_points": 3}, "between 0 and 2"),
    ],
)
def test_unusable_options_are_refused(options: dict, words: str) -> None:
    with pytest.raises(InvalidInput, match=words):
        path_of(pose_list(row_of_poses(5)), **options)
