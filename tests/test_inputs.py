"""Files as others write them are read as they are meant; what is broken or hostile is refused, named and in time."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import qparm
from conftest import cell_data
from made_arm import URDF, elsewhere_data, pose_list, row_of_poses
from made_trajectory import RAIL_AND_SIX, cell_of
from qparm.cli import cli
from qparm.errors import CellError, InvalidInput
from qparm.files.reading import guarded, number, parse_json, parse_toml, parse_yaml, read_bytes, whole_number
from qparm.surface import read_pose_list, wide_gaps
from qparm.timing.waypoint_files import read_limits, read_waypoint_table
from qparm.units import parse_quantity
from qparm.verify import MotionTable, verify_motion
from qparm.verify.readers import read_motion

THREE = ("d1", "theta2", "theta3")
SMALL = qparm.Cell.load(cell_of(THREE))
CELL = qparm.Cell.load(cell_of(RAIL_AND_SIX))
HEAD = "t,d1,theta2,theta3"
BODY = "0,0,0,0\n0.1,0.1,0.2,0.3\n0.2,0.2,0.1,0\n"


def saved(file: Path, content: str | bytes) -> Path:
    file.write_bytes(content.encode() if isinstance(content, str) else content)
    return file


# --- one way to open, one guard -----------------------------------------------------------------------


def test_only_regular_files_of_a_fair_size_are_read(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for file, kind in ((tmp_path, "a folder"), (tmp_path / "pipe", "a pipe"), (Path("/dev/zero"), "a device")):
        with pytest.raises(InvalidInput, match=f"^{file.name} cannot be read: it is {kind}"):
            read_bytes(file)
    with pytest.raises(InvalidInput, match="large has 2 MiB; a file of this kind is read up to 1 MiB"):
        read_bytes(saved(tmp_path / "large", b"x" * 2**21), largest=2**20)
    with pytest.raises(InvalidInput, match=r"n{60}\.\.\. cannot be read: File name too long"):
        read_bytes(tmp_path / ("n" * 300))


@pytest.mark.parametrize(
    "error",
    [OSError(5, "broken"), RecursionError(), MemoryError(), OverflowError("large"), EOFError(), ValueError("no")],
)
def test_the_guard_names_the_file(error: Exception) -> None:
    with pytest.raises(InvalidInput, match=r"^some\.csv "), guarded("folder/some.csv"):
        raise error


def test_the_guard_lets_faults_of_qparm_itself_through() -> None:
    with pytest.raises(ZeroDivisionError), guarded("some.csv"):
        raise ZeroDivisionError


def test_depth_repetition_and_digits_are_bounded() -> None:
    for parse, text in (
        (parse_json, "[" * 100_000),
        (parse_json, "1" * 5000),
        (parse_toml, "a=" + "[" * 100_000),
        (parse_toml, ".".join("a" * 50_000) + "=1"),
        (parse_yaml, "[" * 100_000),
        (parse_yaml, "- " * 100_000 + "a"),
        (parse_yaml, "a: !!int ''"),
        (parse_yaml, "a: &b [*b]"),
        (
            parse_yaml,
            "a0: &a0 [0]\n" + "".join(f"a{k}: &a{k} [{','.join([f'*a{k - 1}'] * 9)}]\n" for k in range(1, 10)),
        ),
    ):
        with pytest.raises(InvalidInput, match=r"^file\.x "):
            parse(text, "file.x")
    assert parse_yaml("a: &b [1, 2]\nc: *b\n", "file.x") == {"a": [1, 2], "c": [1, 2]}


@pytest.mark.parametrize("text", ["1_0", "\u0663", "\u00b2", "--5", "0x10", "1,5", "1" * 500, "", "e5", "1e", "one"])
def test_what_is_no_number_everywhere_is_none(text: str) -> None:
    assert number(text) is None
    assert whole_number(text) is None


def test_numbers_are_read_as_they_are_written() -> None:
    assert [number(text) for text in ("-1.5e-3", " +2. ", ".5", "1e400")] == [-0.0015, 2.0, 0.5, math.inf]
    assert math.isnan(number("NaN") or 0.0)
    assert [whole_number(value) for value in ("-3", 4, 5.0, 5.5, math.inf, True, "9" * 20, None)] == [
        -3, 4, 5, None, None, None, None, None,
    ]  # fmt: skip


# --- waypoints and limits -----------------------------------------------------------------------------


def test_units_of_waypoints_are_never_dropped(tmp_path: Path) -> None:
    names, q = read_waypoint_table(saved(tmp_path / "w.csv", "time (s),a[rad],b (m)\n0,1,2\n1,2,3\n"))
    assert (names, q.tolist()) == (("a", "b"), [[1, 2], [2, 3]])
    for unit in ("[deg]", "(mm)", "[\u00b0]"):
        with pytest.raises(InvalidInput, match="write waypoints in rad and m and their limits in rad/s and m/s"):
            read_waypoint_table(saved(tmp_path / "w.csv", f"a{unit},b\n0,1\n1,2\n"))


@pytest.mark.parametrize("first", ["index,t,a,b", ",time,a,b", "# index,__time,a,b"])
def test_columns_that_count_are_left_out(first: str, tmp_path: Path) -> None:
    names, q = read_waypoint_table(saved(tmp_path / "w.csv", f"{first}\n0,0,1,2\n1,0.5,2,3\n"))
    assert (names, q.tolist()) == (("a", "b"), [[1, 2], [2, 3]])


def test_limits_by_joint_are_put_in_the_order_of_the_waypoints(tmp_path: Path) -> None:
    pytest.importorskip("yaml")
    text = "joint_limits:\n" + "".join(
        f"  {name}: {{has_velocity_limits: true, max_velocity: {v}, max_acceleration: {v + 1}, max_jerk: {v + 2}}}\n"
        for name, v in (("b", 1.0), ("a", 2.0), ("c", 3.0))
    )
    file = saved(tmp_path / "joint_limits.yaml", text)
    assert read_limits(file, ("a", "b")).table.tolist() == [[2, 1], [3, 2], [4, 3]]
    with pytest.raises(InvalidInput, match="no limits of joint 'd'; it has those of b, a, c"):
        read_limits(file, ("a", "d"))
    with pytest.raises(InvalidInput, match="the waypoints need a first line with these names"):
        read_limits(file)
    with pytest.raises(InvalidInput, match="no max_jerk of joint 'b'"):
        read_limits(saved(tmp_path / "l.yaml", text.replace(", max_jerk: 3.0", "")), ("a", "b"))


@pytest.mark.parametrize("table", ["0,0\n1e9,1\n", "0,0\n1e-320,1e-320\n", "0,0\n1e308,1\n", "0\n1\n"])
def test_waypoints_that_no_motion_passes_are_refused(table: str, tmp_path: Path) -> None:
    limits = saved(tmp_path / "l.json", b'\xef\xbb\xbf{"velocity":[1,1],"acceleration":[1,1],"jerk":[9,9]}')
    waypoints = saved(tmp_path / "w.csv", table)
    arguments = ["time", str(waypoints), "--limits", str(limits), "--out", str(tmp_path / "o.csv")]
    run = CliRunner().invoke(cli, arguments, standalone_mode=False)
    assert isinstance(run.exception, InvalidInput)
    assert not (tmp_path / "o.csv").exists()


# --- cells, arms, lists -------------------------------------------------------------------------------


def problem(data: dict[str, Any] | Path) -> str:
    with pytest.raises(CellError) as caught:
        qparm.Cell.load(data)
    return str(caught.value)


def test_a_cell_may_begin_with_a_mark_and_has_no_decimal_commas(tmp_path: Path) -> None:
    import tomli_w

    text = tomli_w.dumps(cell_data())
    assert qparm.Cell.load(saved(tmp_path / "c.toml", f"\ufeff{text}")) == qparm.Cell.load(cell_data())
    with pytest.raises(ValueError, match=r"'360,5 mm' has a decimal comma; write \"360\.5 mm\""):
        parse_quantity("360,5 mm", "length")
    with pytest.raises(ValueError, match="is not a number"):
        parse_quantity("\u0663 mm", "length")


@pytest.mark.parametrize("size", [{"rows": 20_000}, {"points": 20_000_000}, {"rows": 5000, "points": 5000}])
def test_a_raster_that_cannot_be_planned_is_refused_with_the_limit(size: dict[str, int]) -> None:
    data = cell_data()
    data["process"].update(size)
    assert any(limit in problem(data) for limit in ("at most 5000", "at most 200000", "more than 200,000 in all"))


def test_poses_in_millimetres_are_told_and_can_be_read() -> None:
    metres = row_of_poses(4)
    text = pose_list(metres)
    data = elsewhere_data()
    lines = [line.split(",") for line in text.splitlines()]
    at = [lines[0].index(name) for name in "xyz"]
    for line in lines[1:]:
        for k in at:
            line[k] = repr(float(line[k]) * 1000)
    wrong = "\n".join(map(",".join, lines)) + "\n"
    data["workpiece"]["poses"] = wrong
    assert "if it is in millimetres, name its columns x[mm],y[mm],z[mm]" in problem(data)
    for k in at:
        lines[0][k] += "[mm]"
    np.testing.assert_allclose(read_pose_list("\n".join(map(",".join, lines)) + "\n").poses, metres, atol=1e-12)
    lines[0][at[0]] = "x[ft]"
    with pytest.raises(InvalidInput, match=r"'x\[ft\]' must be in m or mm"):
        read_pose_list("\n".join(map(",".join, lines)) + "\n")


def test_repeated_poses_are_told_together() -> None:
    lines = pose_list(row_of_poses(5)).splitlines()
    text = "\n".join([*lines[:2], lines[1], *lines[2:4], lines[3], lines[3], *lines[4:]]) + "\n"
    with pytest.raises(InvalidInput, match=r"3 lines repeat the one before them, leave them out: 3, 6, 7$"):
        read_pose_list(text)


def test_a_gap_much_wider_than_the_others_is_found() -> None:
    poses = np.concatenate([row_of_poses(6, length=0.05), row_of_poses(6, length=0.05) + _moved(0.2)])
    ((before, after, width, times),) = wide_gaps(read_pose_list(pose_list(poses)))
    assert (before, after) == (7, 8)
    assert width == pytest.approx(0.15)
    assert times == pytest.approx(15.0)
    assert wide_gaps(read_pose_list(pose_list(row_of_poses(12)))) == []


def _moved(y: float) -> np.ndarray:
    shift = np.zeros((4, 4))
    shift[1, 3] = y
    return shift


@pytest.mark.parametrize("rows", [3, 40])
def test_rows_of_a_list_are_those_of_its_column(rows: int) -> None:
    path = read_pose_list(pose_list(*(row_of_poses(3, z=0.2 + 0.001 * k) for k in range(rows))))
    assert path.row.tolist() == np.repeat(np.arange(rows), 3).tolist()


def test_prefixes_need_no_declaration_and_xacro_is_named() -> None:
    data = elsewhere_data()
    data["arm"]["urdf"] = URDF.replace("<limit lower", '<limit drake:acceleration="2.5" lower', 1)
    assert qparm.Cell.load(data).chain().n == 7
    data["arm"]["urdf"] = URDF.replace("</robot>", '<xacro:property name="a" value="1"/></robot>')
    assert "the URDF is xacro, which is yet to be expanded" in problem(data)


def test_missing_limits_of_a_urdf_are_told_with_their_keys() -> None:
    data = elsewhere_data()
    del data["arm"]["limits"]
    said = problem(data)
    assert "no limit of acceleration and jerk" in said
    assert "arm.limits.revolute.acceleration, arm.limits.revolute.jerk" in said


# --- from Python --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "q",
    [
        "x",
        [[0.0], [1.0, 2.0]],
        1j * np.ones(8),
        np.ma.masked_equal(np.arange(8.0), 3.0),
        [None] * 8,
        np.array(["1"] * 8),
    ],
)
def test_a_configuration_that_is_no_array_of_numbers(q: Any, chain: qparm.SerialChain) -> None:
    with pytest.raises(InvalidInput, match=r"^q "):
        chain.forward(q)
    with pytest.raises(InvalidInput):
        qparm.solve_pose(chain, chain.forward(np.zeros(8)), q_start=q)


@pytest.mark.parametrize("pose", ["x", [[1.0], [1.0, 2.0]], 1j * np.eye(4), np.ma.masked_equal(np.eye(4), 0.0), None])
def test_a_pose_that_is_no_array_of_numbers(pose: Any, chain: qparm.SerialChain) -> None:
    with pytest.raises(InvalidInput, match="target"):
        qparm.solve_pose(chain, pose)


def test_options_of_other_kinds(chain: qparm.SerialChain, tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="solver must be a name"):
        qparm.solve_pose(chain, np.eye(4), solver=None)  # pyright: ignore[reportArgumentType]
    with pytest.raises(InvalidInput, match="smooth must be True or False, not 'yes'"):
        qparm.plan(cell_data(), smooth="yes")  # pyright: ignore[reportArgumentType]
    with pytest.raises(InvalidInput, match="read_motion takes a Cell beside the file, not str"):
        read_motion(tmp_path / "m.csv", "cell.toml")  # pyright: ignore[reportArgumentType]
    with pytest.raises(InvalidInput, match="write takes a Plan"):
        qparm.write("x", tmp_path)  # pyright: ignore[reportArgumentType]


def test_a_motion_of_the_callers_own_is_bounded_too() -> None:
    t, q = np.array([0.0, 1.0, 2.0]), np.zeros((3, 3))
    for column in (q, None):
        for place, values in ((1, (1.0, 1e200, 1.0)), (2, (0.0, 0.0, math.nan))):
            wrong = q.copy()
            wrong[:, 1] = values
            velocity = wrong if column is not None else None
            table = MotionTable("own", THREE, t, wrong if column is None else q, velocity, None, None, np.zeros(3), 0.0)
            with pytest.raises(InvalidInput, match=rf"sample {place}: the (position|velocity) of joint 'theta2'"):
                verify_motion(table, SMALL)
