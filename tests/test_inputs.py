"""Files as others write them are read as they are meant; what is broken or hostile is refused, named and in time."""

from __future__ import annotations

import io
import json
import math
import os
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import qparm
from conftest import cell_data
from made_arm import URDF, elsewhere_data, pose_list, row_of_poses
from made_trajectory import RAIL_AND_SIX, cell_of, made_trajectory, units_of
from qparm.cli import cli
from qparm.errors import CellError, InvalidInput
from qparm.export import export_trajectory
from qparm.reading import guarded, number, parse_json, parse_toml, parse_yaml, read_bytes, whole_number
from qparm.surface import read_pose_list, wide_gaps
from qparm.units import parse_quantity
from qparm.verify import MotionTable, verify_motion
from qparm.verify.readers import read_motion
from qparm.waypoint_file import read_limits, read_waypoint_table

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


# --- motions as others write them ---------------------------------------------------------------------


@pytest.mark.parametrize(
    "text",
    [
        f"{HEAD}\n{BODY}",
        f"\ufeff{HEAD}\n{BODY}",
        f"# {HEAD}\n{BODY}",
        f"# recorded on Monday\n#\n# {HEAD}\n{BODY}",
        f"# recorded on Monday\n{HEAD}\n# begins here\n{BODY}",
        f"{HEAD}\n{BODY}".replace("t,", "time (s),"),
        f"{HEAD}\n{BODY}".replace("\n", "\r\n"),
        f"{HEAD}\n{BODY}".replace("t,", "__time,"),
        "\n".join(",".join(f'"{word}"' for word in line.split(",")) for line in f"{HEAD}\n{BODY}".split("\n")[:-1])
        + "\n",
        f"index,{HEAD}\n" + "".join(f"{k},{line}\n" for k, line in enumerate(BODY.splitlines())),
        f",{HEAD}\n" + "".join(f"{k},{line}\n" for k, line in enumerate(BODY.splitlines())),
    ],
)
def test_a_table_is_read_whoever_wrote_it(text: str, tmp_path: Path) -> None:
    read = read_motion(saved(tmp_path / "m.csv", text), SMALL)
    assert read.t.tolist() == [0.0, 0.1, 0.2]
    assert read.q.tolist() == [[0, 0, 0], [0.1, 0.2, 0.3], [0.2, 0.1, 0]]


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (f"{HEAD}\n{BODY}".replace(",", ";"), "separated by semicolons; commas are expected"),
        (f"t{'[' * 50_000}\n0\n", r"column 1 is 't\[{59}\.\.\.'"),
        (f"{HEAD}\n{BODY}".replace("0.1,0.1", "0_1,0.1"), "'0_1' is no number"),
        (f"{HEAD}\n{BODY}".replace("0.1,0.1", "0.1,1e200"), "the position of joint 'd1' is 1e.200, beyond"),
        (f"{HEAD}\n{BODY}".replace("0.2,0.2", "1e7,0.2"), "3 samples over 1e.07 s are too few to tell the motion"),
        (f"{HEAD}\n{BODY}".replace("0.2,0.2", "9000,0.2"), "3 samples over 9000 s are too few to tell the motion"),
        (f"{HEAD}\n{BODY}".replace("0.1,0.1", "1e-300,0.1"), "does not come after"),
        (f"{HEAD},row\n" + "".join(f"{line},\u00b2\n" for line in BODY.splitlines()), "the row '\u00b2' is no whole"),
        (f"{HEAD}\n{BODY}"[:-1], "does not end; the file is cut short, or else lacks a line break"),
        (f'{HEAD}\n{BODY}0.3,"1,5",0,0\n', "line 5: the value '1,5' has a comma inside its quotes"),
    ],
)
def test_a_table_that_cannot_be_meant_is_refused(text: str, sentence: str, tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match=sentence):
        read_motion(saved(tmp_path / "m.csv", text), SMALL)


def test_a_joint_may_be_called_like_a_column_of_ours(tmp_path: Path) -> None:
    data = cell_of(THREE)
    data["arm"]["joints"][0]["name"], data["arm"]["joints"][1]["name"] = "t", "row"
    cell = qparm.Cell.load(data)
    file = tmp_path / "m.csv"
    made = made_trajectory(("t", "row", "theta3"))
    export_trajectory(made, file, to="csv", units=("m", "rad", "rad"))
    read = read_motion(file, cell)
    assert read.joints == ("t", "row", "theta3")
    np.testing.assert_allclose(read.q, made(read.t), atol=1e-9)
    assert read.row is not None


@pytest.mark.parametrize("turns", [1, -2])
@pytest.mark.parametrize("to", ["csv", "npz", "json"])
def test_wrapped_angles_are_told_with_their_place(turns: int, to: str, tmp_path: Path) -> None:
    t = np.arange(20) * 0.01
    q = np.column_stack([0.0 * t, 0.5 * t, 3.1 + t])
    q[12:, 2] += 2 * math.pi * turns
    if to == "csv":
        text = f"{HEAD}\n" + "".join(
            ",".join(f"{x:.9f}" for x in (a, *row)) + "\n" for a, row in zip(t, q, strict=True)
        )
        file, place = saved(tmp_path / "m.csv", text), "line 14"
    elif to == "npz":
        file, place = tmp_path / "m.npz", "sample 12"
        np.savez(file, t=t, q=q, joint_names=np.array(THREE))
    else:
        points = [
            {"positions": row.tolist(), "time_from_start": {"sec": 0, "nanosec": k * 10**7}} for k, row in enumerate(q)
        ]
        file, place = saved(tmp_path / "m.json", json.dumps({"joint_names": THREE, "points": points})), "point 12"
    with pytest.raises(
        InvalidInput, match=rf"{place}: the angle of joint 'theta3' jumps by {'-7' if turns < 0 else '3'}.* deg.*unwrap"
    ):
        read_motion(file, SMALL)


def test_a_joint_that_turns_once_in_a_long_interval_is_not_wrapped(tmp_path: Path) -> None:
    text = f"{HEAD}\n0,0,0,-3.1415926\n100,0,0,3.1415926\n"
    assert read_motion(saved(tmp_path / "m.csv", text), SMALL).q[1, 2] == pytest.approx(math.pi)


def message(**changes: Any) -> dict[str, Any]:
    points = [{"positions": [0.1, 0.2, 0.3 * k], "time_from_start": {"sec": k, "nanosec": 0}} for k in range(3)]
    return {"joint_names": list(THREE), "points": points} | changes


@pytest.mark.parametrize(
    "wrap",
    [
        lambda m: {"joint_trajectory": m, "multi_dof_joint_trajectory": {"joint_names": [], "points": []}},
        lambda m: {"trajectory": m, "goal_time_tolerance": {"sec": 0, "nanosec": 0}},
        lambda m: {"goal_id": "a", "goal": {"trajectory": m}},
        lambda m: {"model_id": "arm", "trajectory": [{"joint_trajectory": m}]},
    ],
)
@pytest.mark.parametrize("executable", [True, False])
def test_a_message_inside_another_is_found(wrap: Callable[[Any], Any], executable: bool, tmp_path: Path) -> None:
    wrapped = wrap(message()) | ({} if executable else {"executable": False})
    read = read_motion(saved(tmp_path / "m.json", json.dumps(wrapped)), SMALL)
    assert read.q[:, 2].tolist() == [0.0, 0.3, 0.6]
    assert read.executable is executable


def test_what_ros2_topic_echo_prints_is_read(tmp_path: Path) -> None:
    text = json.dumps(message())
    assert len(read_motion(saved(tmp_path / "m.yaml", f"{text}\n---\n"), SMALL).t) == 3
    with pytest.raises(InvalidInput, match=r"m\.yaml holds 2 documents \(messages\); it must hold one"):
        read_motion(saved(tmp_path / "m.yaml", f"{text}\n---\n{text}\n---\n"), SMALL)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda m: m["points"][1].update(positions=3), "point 1: positions must be a list, not 3"),
        (lambda m: m["points"][1].update(positions=[]), "point 1 has no positions, though others have"),
        (lambda m: m["points"][1]["positions"].__setitem__(0, int("1" * 400)), "the position of joint 'd1' is inf"),
        (lambda m: m["points"][2]["time_from_start"].update(sec=10**400), "point 2 has no time_from_start"),
        (lambda m: m.update(joint_names=[1, 2, 3]), "name 0 of joint_names is 1, which is no text"),
        (lambda m: m.update(points="abc"), "has no list 'points'"),
    ],
)
def test_a_message_of_other_kinds_is_refused(change: Callable[[Any], Any], sentence: str, tmp_path: Path) -> None:
    made = message()
    change(made)
    with pytest.raises(InvalidInput, match=sentence):
        read_motion(saved(tmp_path / "m.json", json.dumps(made)), SMALL)


# --- archives and columns -----------------------------------------------------------------------------


def arrays(**changes: Any) -> dict[str, Any]:
    q = np.linspace([0.1, 0.2, -0.3], [0.2, 0.1, 0.3], 5)
    made = {"t": np.arange(5) * 0.1, "q": q, "joint_names": np.array(THREE)} | changes
    return {name: array for name, array in made.items() if array is not None}


@pytest.mark.parametrize(
    ("said", "yes"),
    [(True, True), (1, True), ([True, True], True), (False, False), ([True, False], False), ([], False), (2, False),
     ("False", False), ("True", False), (np.datetime64("2001-01-01"), False), (float("nan"), False)],
)  # fmt: skip
def test_anything_but_a_true_yes_is_a_no_in_npz(said: Any, yes: bool, tmp_path: Path) -> None:
    np.savez(tmp_path / "m.npz", **arrays(executable=np.array(said)))
    assert read_motion(tmp_path / "m.npz", SMALL).executable is yes


@pytest.mark.parametrize(
    ("said", "yes"),
    [(b'{"executable": true}', True), (b"{}", True), (b'{"executable": "yes"}', False), (b"{", False), (b"[]", False),
     (b"null", False), (b"[" * 100_000, False), (b"\xff", False), (b"", False)],
)  # fmt: skip
def test_anything_but_a_true_yes_is_a_no_in_parquet(said: bytes, yes: bool, tmp_path: Path) -> None:
    pa, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    table = pa.table({"t": [0.0, 0.1], **{name: [0.0, 0.1] for name in THREE}})
    parquet.write_table(table.replace_schema_metadata({b"qparm": said}), tmp_path / "m.parquet")
    assert read_motion(tmp_path / "m.parquet", SMALL).executable is yes


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        (lambda pa: pa.array(range(2), pa.timestamp("ns")), r"column 't' must hold numbers, not timestamp\[ns\]"),
        (lambda pa: pa.array([{"a": 1}] * 2), "column 't' must hold numbers, not struct"),
        (lambda pa: pa.array([0.0, None]), "row 1: the time is not finite"),
    ],
)
def test_columns_of_other_types_are_refused(values: Callable[[Any], Any], sentence: str, tmp_path: Path) -> None:
    pa, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    table = pa.table({"t": values(pa), **{name: [0.0, 0.1] for name in THREE}})
    parquet.write_table(table, tmp_path / "m.parquet")
    with pytest.raises(InvalidInput, match=sentence):
        read_motion(tmp_path / "m.parquet", SMALL)


def test_only_arrays_that_are_asked_for_are_unpacked(tmp_path: Path) -> None:
    """The other member says that it unpacks to 3 GB; reading it would raise."""
    np.savez(tmp_path / "m.npz", **arrays())
    with zipfile.ZipFile(tmp_path / "m.npz", "a") as archive:
        archive.writestr("other.npy", b"no array at all")
    assert len(read_motion(tmp_path / "m.npz", SMALL).t) == 5


@pytest.mark.parametrize("shape", ["(10**30,)", "(1000000000,)", "(1,2", "(-5,)"])
def test_a_header_that_promises_what_is_not_there_is_refused(shape: str, tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "m.npz", "w") as archive:
        for name, array in arrays().items():
            out = io.BytesIO()
            np.save(out, array)
            data = out.getvalue()
            if name == "t":
                # the header keeps its length
                data = data.replace(b"(5,)", shape.encode(), 1).replace(b" " * (len(shape) - 4) + b"\n", b"\n", 1)
            archive.writestr(f"{name}.npy", data)
    with pytest.raises(InvalidInput, match=r"m\.npz"):
        read_motion(tmp_path / "m.npz", SMALL)


def test_rows_of_text_and_a_bare_array_are_named(tmp_path: Path) -> None:
    np.savez(tmp_path / "m.npz", **arrays(row=np.array(["a"] * 5)))
    with pytest.raises(InvalidInput, match="'row' must hold whole numbers"):
        read_motion(tmp_path / "m.npz", SMALL)
    np.save(tmp_path / "n.npy", np.zeros(3))
    with pytest.raises(InvalidInput, match=r"single array of numpy \(\.npy\)"):
        read_motion((tmp_path / "n.npy").rename(tmp_path / "n.npz"), SMALL)


def test_a_bag_names_no_file_outside_its_folder(tmp_path: Path) -> None:
    pytest.importorskip("rosbags.rosbag2")
    bag = tmp_path / "bag"
    export_trajectory(made_trajectory(RAIL_AND_SIX), bag, to="rosbag2", units=units_of(RAIL_AND_SIX))
    text = (bag / "metadata.yaml").read_text(encoding="utf-8")
    (tmp_path / "elsewhere.db3").write_bytes((bag / "bag.db3").read_bytes())
    for name in ("../elsewhere.db3", str(tmp_path / "elsewhere.db3")):
        (bag / "metadata.yaml").write_text(text.replace("bag.db3", name), encoding="utf-8")
        with pytest.raises(InvalidInput, match="which is no file of the folder"):
            read_motion(bag, CELL)


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
