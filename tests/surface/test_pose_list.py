"""Pose lists: the quaternion by its columns' names, arc length, the curve through the poses, what is refused."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

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
    ("a value empty", HEADER + ONE + "0,0,,1,0,0,0\n", "line 3 of the pose list: z is no number: ''"),
    ("nan", HEADER + ONE + "0,nan,1,1,0,0,0\n", "line 3 of the pose list: y is not finite: 'nan'"),
    ("inf", HEADER + ONE + "0,0,1,inf,0,0,0\n", "line 3 of the pose list: qw is not finite: 'inf'"),
    ("a unit", HEADER + ONE + "0,0,1 m,1,0,0,0\n", "line 3 of the pose list: z is no number: '1 m'"),
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


def test_s_ascends_and_the_tool_is_never_faster_than_s(rng: np.random.Generator) -> None:
    poses = row_of_poses(80, turn=4.0)
    poses[:, :3, 3] += np.cumsum(rng.normal(scale=2e-3, size=(80, 3)), axis=0)
    row = path_of(pose_list(poses)).rows[0]
    assert np.diff(row.s).min() > 0
    way = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    assert (np.diff(row.s) >= way - 1e-12).all()
    assert (np.diff(row.s) >= 0.1 * 4.0 / 79 - 1e-12).all()


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
