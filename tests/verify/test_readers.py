"""Readers of motions: files that are not ours, and files that are broken, each with a sentence that names the place."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from made_trajectory import RAIL_AND_SIX, cell_of, made_trajectory, units_of
from qparm.cell import Cell
from qparm.errors import InvalidInput
from qparm.export import FORMATS, export_trajectory
from qparm.verify.readers import read_motion
from qparm.verify.readers.table import _decimal, time_rounding, value_rounding

CELL = Cell.load(cell_of(RAIL_AND_SIX))
THREE = ("d1", "theta2", "theta3")
SMALL = Cell.load(cell_of(THREE))


def table(tmp_path: Path, text: str, name: str = "motion.csv") -> Path:
    file = tmp_path / name
    file.write_text(text, encoding="utf-8")
    return file


# --- what the digits of a text leave open ---------------------------------------------------------------


@given(st.floats(allow_nan=False, allow_infinity=False, allow_subnormal=False))
def test_the_digits_of_a_number_are_those_of_its_decimal(value: float) -> None:
    decimal = Decimal(repr(value)).normalize()
    expected = (1, 0) if value == 0 else (len(decimal.as_tuple().digits), decimal.adjusted())
    assert _decimal(value) == expected


@given(st.integers(0, 10**6), st.floats(1e-3, 1e3), st.integers(6, 12), st.sampled_from(["f", "g"]))
def test_the_rounding_found_is_the_rounding_made(seed: int, size: float, digits: int, kind: str) -> None:
    exact = np.random.default_rng(seed).uniform(-size, size, (50, 3))
    read = np.array([[float(f"{x:.{digits}{kind}}") for x in row] for row in exact])
    made = 0.5 * 10.0**-digits if kind == "f" else 0.5 * 10.0 ** (math.floor(math.log10(size)) + 1 - digits)
    rounding = value_rounding(read)
    assert (np.abs(read - exact).max(axis=0) <= rounding + 4e-16 * size).all() or made > 1e-5
    assert (rounding <= 10 * made).all()  # ten where the largest value was rounded up to a power of ten


def test_few_digits_get_no_slack() -> None:
    assert value_rounding(np.array([[0.5, 0.0], [1.0, 0.0]])).tolist() == [1e-5, 1e-5]
    assert time_rounding(np.array([0.0, 0.4, 0.9, 1.3])) == 1e-6


def test_times_on_a_grid_are_exact_and_the_last_may_be_off_it() -> None:
    assert time_rounding(0.004 * np.arange(500)) == 0.0
    assert time_rounding(np.append(0.004 * np.arange(500), 1.998123456)) == pytest.approx(0.5e-9)
    assert time_rounding(np.array([0.0, 0.0041234, 0.0082345, 0.0123456])) == pytest.approx(0.5e-7)


# --- files that are not ours ----------------------------------------------------------------------------


def test_a_table_of_time_and_positions_in_any_order_and_unit(tmp_path: Path) -> None:
    lines = [f"{0.01 * k:.2f}, {10 * k}, {100 * k}.0, {k}.5\n" for k in range(5)]
    read = read_motion(table(tmp_path, "Time [s], theta3[deg], q_d1[mm], theta2 [deg]\n\n" + "".join(lines)), SMALL)
    assert read.joints == ("theta3", "d1", "theta2")
    assert read.velocity is None
    assert read.row is None
    assert read.q[4] == pytest.approx([math.radians(40), 0.4, math.radians(4.5)])
    assert read.format == "stream"


def test_a_clock_that_starts_anywhere_becomes_the_time_from_the_start(tmp_path: Path) -> None:
    text = "timestamp,d1,theta2,theta3\n" + "".join(f"{1700000000 + 0.5 * k},0,0,{k}\n" for k in range(4))
    assert read_motion(table(tmp_path, text), SMALL).t.tolist() == [0.0, 0.5, 1.0, 1.5]


def test_derivatives_by_other_names(tmp_path: Path) -> None:
    names = [f"{order}{joint}" for order in ("pos_", "vel_", "acc_", "jerk_") for joint in THREE]
    values = ",".join(str(10 * order + joint) for order in range(4) for joint in range(3))
    text = ",".join(["t", *names]) + "\n" + "".join(f"{k},{values}\n" for k in range(3))
    read = read_motion(table(tmp_path, text), SMALL)
    assert read.velocity is not None
    assert read.jerk is not None
    assert (read.q[0].tolist(), read.velocity[0].tolist(), read.jerk[2].tolist()) == (
        [0, 1, 2],
        [10, 11, 12],
        [30, 31, 32],
    )


def message(**changes: Any) -> dict[str, Any]:
    points = [
        {"positions": [k + 0.1, k + 0.2, k + 0.3], "time_from_start": {"sec": k, "nanosec": 500_000_000}}
        for k in range(3)
    ]
    return {"joint_names": ["theta3", "d1", "theta2"], "points": points} | changes


def test_a_message_of_positions_only_with_joints_in_another_order(tmp_path: Path) -> None:
    read = read_motion(table(tmp_path, json.dumps(message()), "m.json"), SMALL)
    assert read.joints == ("theta3", "d1", "theta2")
    assert (read.velocity, read.acceleration) == (None, None)
    assert read.q[1].tolist() == [1.1, 1.2, 1.3]
    # from its start as the message counts it, which may be before its first point
    assert read.t.tolist() == [0.5, 1.5, 2.5]


def test_a_message_of_ros_1_and_empty_lists(tmp_path: Path) -> None:
    text = """joint_names: [d1, theta2, theta3]
points:
- positions: [0.0, 1, 2.5]
  velocities: []
  accelerations: []
  time_from_start: {secs: 0, nsecs: 0}
- positions: [1e-3, 2, 3]
  velocities: []
  accelerations: []
  time_from_start: {secs: 1, nsecs: 1}
"""
    with pytest.raises(InvalidInput, match="point 1, positions of joint 'd1': '1e-3' is not a number"):
        read_motion(table(tmp_path, text, "m.yaml"), SMALL)  # YAML 1.1 wants 1.0e-3
    read = read_motion(table(tmp_path, text.replace("1e-3", "1.0e-3"), "m.yaml"), SMALL)
    assert read.velocity is None
    assert read.t.tolist() == [0.0, 1.000000001]


def test_arrays_in_single_precision_say_what_they_leave_open(tmp_path: Path) -> None:
    q = np.linspace([0.1, 0.2, -3.0], [0.5, 1.0, 2.0], 9)
    np.savez(tmp_path / "m.npz", t=np.arange(9) * 0.1, q=q.astype(np.float32), joint_names=np.array(THREE))
    read = read_motion(tmp_path / "m.npz", SMALL)
    assert (np.abs(read.q - q).max(axis=0) <= read.position_rounding).all()
    assert read.position_rounding == pytest.approx([0.5 * 2**-24, 2**-24, 3 * 2**-24], rel=1e-6)


def test_programs_that_others_wrote(tmp_path: Path) -> None:
    six = Cell.load(cell_of(RAIL_AND_SIX[1:]))
    krl = """DEF part()
PTP {A1 0,A2 -90,A3 90,A4 0,A5 0,A6 0} ; start
PTP_SPLINE
 SPTP {A1 10,A2 -90,A3 90,A4 0,A5 0,A6 0}
 TIME_BLOCK PART = 1
 SPTP XP7
 TIME_BLOCK PART = 3
 TIME_BLOCK END = 8
ENDSPLINE
END
"""
    position = "A1 20.0,A2 -90,A3 90,A4 0,A5 0,A6 0"
    table(tmp_path, f"DEFDAT part\nDECL E6AXIS XP7={{{position},E1 0,E2 0}}\nENDDAT\n", "part.dat")
    with pytest.raises(InvalidInput, match=r"part.src line 6: 7 axes for the 6 joints"):
        read_motion(table(tmp_path, krl, "part.src"), six)
    table(tmp_path, f"DEFDAT part\nXP7={{{position}}}\nENDDAT\n", "part.dat")
    read = read_motion(tmp_path / "part.src", six)
    assert read.t.tolist() == [0.0, 2.0, 8.0]
    assert np.degrees(read.q[:, 0]) == pytest.approx([0, 10, 20])
    rapid = """MODULE part
  CONST jointtarget there:=[[20,0,0,0,30,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  PROC main()
    MoveAbsJ [[0,0,0,0,30,0],[9E9,9E9,9E9,9E9,9E9,9E9]]\\NoEOffs, v100, fine, tool0; ! start
    MoveAbsJ there, v1000\\T:=2.5, z10, tool0\\WObj:=wobj0;
  ENDPROC
ENDMODULE
"""
    read = read_motion(table(tmp_path, rapid, "part.mod"), six)
    assert read.t.tolist() == [0.0, 2.5]
    assert np.degrees(read.q[1]) == pytest.approx([20, 0, 0, 0, 30, 0])


# --- broken files ---------------------------------------------------------------------------------------

HEAD = "t,d1,theta2,theta3\n"
GOOD = HEAD + "0,0,0,0\n0.1,1,2,3\n0.2,4,5,6\n"


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "motion.csv is empty"),
        (HEAD, "has no line below its header"),
        (GOOD[:-1], "line 4 does not end; the file is cut short"),
        (GOOD[:-3] + "\n", "line 4 has 3 values, the header 4"),
        ("0,0,0,0\n1,1,2,3\n", "line 1 holds numbers; it must name the columns"),
        (GOOD.replace("2", "nan", 1), "column 3 is 'thetanan', which is no joint of the cell"),
        (GOOD.replace("1,2,3", "1,nan,3"), "line 3: the position of joint 'theta2' is nan, not finite"),
        (GOOD.replace("1,2,3", "1,two,3"), r"line 3, column 3 \(theta2\): 'two' is not a number"),
        (GOOD.replace("0.1,", "inf,"), "line 3: the time is not finite"),
        (GOOD.replace("0.2,", "0.1,"), "line 4: the time 0.1 s does not come after the 0.1 s before it"),
        (GOOD.replace("0.2,", "0.05,"), "line 4: the time 0.05 s does not come after the 0.1 s"),
        (GOOD.replace("theta3", "theta4"), "column 4 is 'theta4', which is no joint of the cell"),
        (GOOD.replace("theta3", "theta2"), "two columns 'theta2'"),
        (GOOD.replace("theta3", "time"), "two columns of time, 't' and 'time'"),
        (GOOD.replace("t,d1", "k,d1"), "column 1 is 'k', which is no joint"),
        (GOOD.replace("t,d1", "qd_d1,d1"), "no column of time, such as t"),
        (GOOD.replace("theta3", "qd_theta2"), "no column of the position of joint 'theta3'"),
        (GOOD.replace("theta3", "theta3[m]"), "a revolute joint cannot be in m"),
        (GOOD.replace("d1", "d1[deg]"), "a prismatic joint cannot be in deg"),
        (GOOD.replace("d1", "d1[ft]"), "unit must be one of m, rad, mm, deg, not 'ft'"),
        (GOOD.replace("t,", "t[ms],"), r"the time must be in s, not ms"),
        (
            "t,d1,theta2,theta3,qd_theta2\n0,0,0,0,0\n1,0,0,0,1\n",
            "no column qd_d1, though it has those of other joints",
        ),
        ("t,d1,theta2,theta3,row\n0,0,0,0,x\n", "line 2: the row 'x' is not an integer"),
    ],
)
def test_a_broken_table_is_named_by_line_and_column(text: str, sentence: str, tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match=sentence) as caught:
        read_motion(table(tmp_path, text), SMALL)
    assert "motion.csv" in str(caught.value)


def changed(change: Callable[[dict[str, Any], list[Any]], object]) -> str:
    data = message()
    change(data, data["points"])
    return json.dumps(data)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (json.dumps(message())[:-9], "not whole JSON, it may be cut short"),
        ("[1, 2]", "not a JointTrajectory: it holds no fields"),
        ("{}", "no list 'joint_names'"),
        (changed(lambda m, p: m.update(points=[])), "holds no point"),
        (changed(lambda m, p: m.update(points=[1])), "point 0 has no time_from_start"),
        (changed(lambda m, p: p[1]["positions"].pop()), "point 1 has 2 positions for 3 joints"),
        (changed(lambda m, p: p[1].update(positions=[0, 1, "a"])), "point 1, positions of joint 'theta2': 'a' is no"),
        (changed(lambda m, p: p[1].update(positions=[math.nan, 1, 1])), "point 1: the position of joint 'theta3'"),
        (changed(lambda m, p: p[1].pop("positions")), "point 1 has no positions, though others have"),
        (changed(lambda m, p: p[2].update(velocities=[0, 0, 0])), "point 0 has no velocities, though others have"),
        (changed(lambda m, p: p[2].pop("time_from_start")), "point 2 has no time_from_start with sec and nanosec"),
        (changed(lambda m, p: p[2]["time_from_start"].update(sec=0)), "point 2: the time 0.5 s does not come after"),
        (changed(lambda m, p: p[0]["time_from_start"].update(sec=-2)), "point 0: the time -1.5 s is negative"),
        (changed(lambda m, p: m.update(joint_names=["d1", "theta2", "tehta3"])), "'tehta3' that .*; 'theta3' may be"),
        (changed(lambda m, p: m.update(joint_names=["d1", "theta2", "theta2"])), "joint 'theta2' more than once"),
        (
            changed(lambda m, p: m.update(joint_names=["d1"], points=[p[0] | {"positions": [1]}])),
            "lacks joints 'theta2', 'theta3' of the cell",
        ),
    ],
)
@pytest.mark.parametrize("name", ["m.json", "m.yaml"])
def test_a_broken_message_is_named_by_point_and_joint(name: str, text: str, sentence: str, tmp_path: Path) -> None:
    if name == "m.yaml":  # which JSON is a part of, but for NaN
        text = text.replace("NaN", ".nan")
        sentence = sentence.replace("JSON", "YAML")
    with pytest.raises(InvalidInput, match=sentence) as caught:
        read_motion(table(tmp_path, text, name), SMALL)
    assert name in str(caught.value)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"q": None}, "no array 'q'; it has t, joint_names"),
        ({"q": np.zeros((3, 4))}, r"'q' has the shape \(3, 4\), not \(3, 3\)"),
        ({"q": np.array([["a"] * 3] * 3)}, "'q' must hold numbers"),
        ({"q": np.full((3, 3), np.inf)}, "sample 0: the position of joint 'd1' is inf"),
        ({"t": np.array([0.0, 2.0, 1.0])}, "sample 2: the time 1 s does not come after"),
        ({"units": np.array(["m", "rad"])}, "units are 2, joints 3"),
        ({"row": np.zeros(7)}, "'row' has the shape"),
        ({"t": np.zeros(0), "q": np.zeros((0, 3))}, "holds no sample"),
    ],
)
def test_a_broken_archive_is_named_by_array(changes: dict[str, Any], sentence: str, tmp_path: Path) -> None:
    arrays = {"t": np.arange(3.0), "q": np.zeros((3, 3)), "joint_names": np.array(THREE)} | changes
    np.savez(tmp_path / "m.npz", **{name: array for name, array in arrays.items() if array is not None})
    with pytest.raises(InvalidInput, match=sentence):
        read_motion(tmp_path / "m.npz", SMALL)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("  TIME_BLOCK END", "; TIME_BLOCK END", "the block has no TIME_BLOCK END"),
        ("  TIME_BLOCK PART", "; TIME_BLOCK PART", "or a move of it no TIME_BLOCK PART"),
        ("PTP_SPLINE\n", "\n", "line [0-9]+: a move outside a spline block has no time"),
        ("PTP Q[1]", "", "a block before the first PTP"),
        ("SPTP Q[2]", "SPTP Q[9999]", r"line 12: the position Q\[9999\] is not in motion.dat"),
        ("\nEND\n", "\n", "motion.src does not end with END; it is cut short"),
        ("END=", "END=x", "'x0.4.*' is not a number"),
    ],
)
def test_a_broken_krl_program_is_named_by_line(old: str, new: str, sentence: str, tmp_path: Path) -> None:
    file = tmp_path / "motion.src"
    export_trajectory(made_trajectory(RAIL_AND_SIX), file, to="krl", units=units_of(RAIL_AND_SIX))
    text = file.read_text(encoding="ascii")
    assert old in text
    file.write_text(text.replace(old, new, 1), encoding="ascii")
    with pytest.raises(InvalidInput, match=sentence):
        read_motion(file, CELL)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("ENDMODULE", "", "does not end with ENDMODULE; it is cut short"),
        ("\\T:=", "\\X:=", r"line [0-9]+: the move has no \\T"),
        (",9E+09]]\\NoEOffs,v1000", "]]\\NoEOffs,v1000", "line [0-9]+: a jointtarget has six axes and six external"),
        (",9E+09]]\\NoEOffs,v1000", ",7]]\\NoEOffs,v1000", "eax_a is the only external axis"),
        (",tool0;", ",tool0", "does not end with a semicolon"),
    ],
)
def test_a_broken_rapid_module_is_named_by_line(old: str, new: str, sentence: str, tmp_path: Path) -> None:
    file = tmp_path / "motion.mod"
    export_trajectory(made_trajectory(RAIL_AND_SIX), file, to="rapid", units=units_of(RAIL_AND_SIX))
    text = file.read_text(encoding="ascii")
    assert old in text
    file.write_text(text.replace(old, new, 1), encoding="ascii")
    with pytest.raises(InvalidInput, match=sentence):
        read_motion(file, CELL)


@pytest.mark.parametrize("to", [name for name in FORMATS if name != "rosbag2"])
def test_a_file_cut_anywhere_is_refused_and_no_error_is_of_another_kind(to: str, tmp_path: Path) -> None:
    file = tmp_path / f"motion{FORMATS[to].extension}"
    export_trajectory(made_trajectory(RAIL_AND_SIX), file, to=to, units=units_of(RAIL_AND_SIX), period=0.1)
    whole = file.read_bytes()
    for share in np.linspace(0.0, 0.999, 40):
        part = whole[: int(share * len(whole))]
        # a table that ends with a whole line cannot be told from a shorter motion
        if to in ("csv", "stream") and part.endswith(b"\n"):
            continue
        file.write_bytes(part)
        with pytest.raises(InvalidInput, match="motion"):
            read_motion(file, CELL)


def test_a_broken_bag_is_refused(tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    export_trajectory(made_trajectory(RAIL_AND_SIX), bag, to="rosbag2", units=units_of(RAIL_AND_SIX))
    with pytest.raises(InvalidInput, match=r"bag.db3 is a part of a rosbag2; name its folder"):
        read_motion(bag / "bag.db3", CELL)
    data = (bag / "bag.db3").read_bytes()
    (bag / "bag.db3").write_bytes(data[: len(data) // 2])
    with pytest.raises(InvalidInput, match="bag is not a whole rosbag2"):
        read_motion(bag, CELL)
    (bag / "metadata.yaml").unlink()
    with pytest.raises(InvalidInput, match=r"is a folder, and no rosbag2: it holds no metadata.yaml"):
        read_motion(bag, CELL)


def test_a_bag_must_hold_one_trajectory(tmp_path: Path) -> None:
    rosbag2, typesys = pytest.importorskip("rosbags.rosbag2"), pytest.importorskip("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    kind = "std_msgs/msg/String"
    with rosbag2.Writer(tmp_path / "words", version=8) as writer:
        connection = writer.add_connection("/words", kind, typestore=store)
        writer.write(connection, 0, store.serialize_cdr(store.types[kind]("hello"), kind))
    with pytest.raises(InvalidInput, match="must hold one trajectory_msgs/msg/JointTrajectory; it holds none"):
        read_motion(tmp_path / "words", CELL)


def test_a_format_that_is_not_known_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match=r"m.xlsx: no format is known by this name; known are .csv, .txt"):
        read_motion(table(tmp_path, "hello", "m.xlsx"), CELL)
    with pytest.raises(InvalidInput, match=r"nothing.csv: there is no such file"):
        read_motion(tmp_path / "nothing.csv", CELL)
    (tmp_path / "m.csv").write_bytes(b"\xff\xfe\x00t")
    with pytest.raises(InvalidInput, match=r"m.csv is not text"):
        read_motion(tmp_path / "m.csv", CELL)


def test_a_format_is_found_from_how_a_file_begins(tmp_path: Path) -> None:
    for to in ("npz", "parquet", "mcap"):
        file = tmp_path / f"motion{FORMATS[to].extension}"
        export_trajectory(made_trajectory(RAIL_AND_SIX), file, to=to, units=units_of(RAIL_AND_SIX))
        assert read_motion(file.rename(tmp_path / f"{to}.csv"), CELL).format == to
