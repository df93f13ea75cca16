"""Every format: written, read back, equal to the trajectory within what its digits say."""

from __future__ import annotations

import csv
import json
import math
import re
import sqlite3
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.interpolate import PPoly

from made_trajectory import RAIL_AND_SEVEN, RAIL_AND_SIX, cell_of, made_trajectory, units_of
from qparm.cell import Cell
from qparm.errors import InvalidInput, OutputError, PackageMissing
from qparm.export import FORMATS, export_trajectory
from qparm.path import SegmentKind, TimedSegment, Trajectory
from qparm.verify.motion import MotionTable
from qparm.verify.readers import read_motion

Array = NDArray[np.float64]

EXTENSIONS = {name: format_.extension or ".bag" for name, format_ in FORMATS.items()}
PERIODS = (0.001, 0.004, 0.008, 0.02)
TABLES, MESSAGES, PROGRAMS = ("csv", "npz", "parquet"), ("json", "yaml", "mcap", "rosbag2"), ("krl", "rapid")
EXACT = ("npz", "parquet", *MESSAGES)
RAIL = Cell.load(cell_of(RAIL_AND_SIX))


@pytest.fixture(scope="module")
def trajectory() -> Trajectory:
    """Return a trajectory of an arm that every format takes."""
    return made_trajectory(RAIL_AND_SIX)


def written(trajectory: Trajectory, to: str, folder: Path, **options: Any) -> Path:
    file = folder / f"motion{EXTENSIONS[to]}"
    export_trajectory(trajectory, file, to=to, units=units_of(trajectory.joint_names), **options)
    return file


def twelve_digits(values: Array) -> Array:
    """Return half a unit of the twelfth digit of every value."""
    exponents = np.floor(np.log10(np.where(values == 0, 1.0, np.abs(values))))
    return 0.5000001 * 10.0 ** (exponents - 11)


def check_values(table: MotionTable, to: str, trajectory: Trajectory, at: Array) -> None:
    """Check positions and derivatives against the trajectory at the times that the format should have."""
    values = {0: table.q, 1: table.velocity, 2: table.acceleration, 3: table.jerk}
    orders = {"stream": 1, "krl": 1, "rapid": 1}.get(to, 3 if to in MESSAGES else 4)
    for order, read in values.items():
        if order >= orders:
            assert read is None
            continue
        assert read is not None
        source = trajectory(at, order)[:, [trajectory.joint_names.index(name) for name in table.joints]]
        off = np.abs(read - source)
        if to in EXACT:
            assert off.max() == 0.0
        elif to in PROGRAMS:
            length = np.array([name == "d1" for name in table.joints])
            assert (off <= np.where(length, 0.5001e-7, math.radians(0.50001e-5))).all()
        else:
            assert (off <= twelve_digits(source)).all()
        if order == 0:
            assert (off.max(axis=0) <= table.position_rounding * (1 + 1e-6) + 1e-17).all()
            allowed = {"krl": 1e-7, "rapid": 1e-7}.get(to, 0.0 if to in TABLES[1:] else 1e-11)
            assert (table.position_rounding <= allowed).all()


def every(period: float, trajectory: Trajectory) -> Array:
    return np.append(period * np.arange(math.ceil(trajectory.duration / period)), trajectory.duration).round(9)


# --- there and back -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("to", "period"),
    [(to, period) for to in (*TABLES, *MESSAGES) for period in PERIODS if (to, period) != ("yaml", 0.001)],  # slow
)
@pytest.mark.slow
def test_samples_at_a_period_read_back_equal(to: str, period: float, trajectory: Trajectory, tmp_path: Path) -> None:
    table = read_motion(written(trajectory, to, tmp_path, period=period), RAIL)
    at = every(period, trajectory)
    assert (table.format, table.joints) == (to, RAIL_AND_SIX)
    assert table.t == pytest.approx(at, abs=1e-12)
    assert table.time_rounding <= 0.5e-9
    check_values(table, to, trajectory, at)


@pytest.mark.parametrize("to", MESSAGES)
def test_a_message_has_the_knots_unless_a_period_is_asked_for(to: str, trajectory: Trajectory, tmp_path: Path) -> None:
    table = read_motion(written(trajectory, to, tmp_path), RAIL)
    at = trajectory.knots.round(9)
    assert table.t == pytest.approx(at, abs=1e-12)
    check_values(table, to, trajectory, at)


@pytest.mark.parametrize("to", TABLES)
def test_tables_tell_the_segments(to: str, trajectory: Trajectory, tmp_path: Path) -> None:
    table = read_motion(written(trajectory, to, tmp_path), RAIL)
    assert table.t[1] == pytest.approx(0.004, abs=1e-15)
    expected = [next(s for s in reversed(trajectory.segments) if s.start <= t + 1e-12) for t in table.t]
    assert table.segment is not None
    assert table.row is not None
    assert table.segment.tolist() == [segment.kind.value for segment in expected]
    assert table.row.tolist() == [segment.row for segment in expected]


@pytest.mark.parametrize("period", PERIODS)
def test_a_stream_is_periodic_to_its_end_and_holds_it(period: float, trajectory: Trajectory, tmp_path: Path) -> None:
    file = written(trajectory, "stream", tmp_path, period=period)
    table = read_motion(file, RAIL)
    ticks = math.ceil(trajectory.duration / period)
    assert trajectory.duration / period % 1 > 0.01
    assert table.format == "stream"
    assert table.t == pytest.approx(np.arange(ticks + 1) * period, abs=1e-12)
    assert table.time_rounding == 0.0
    check_values(table, "stream", trajectory, np.minimum(np.arange(ticks + 1) * period, trajectory.duration))
    last = file.read_text(encoding="utf-8").splitlines()[-1].split(",")
    assert [float(x) for x in last[1:]] == pytest.approx(trajectory(trajectory.duration), rel=1e-11)


def test_a_stream_of_whole_periods_gets_no_tick_more(trajectory: Trajectory, tmp_path: Path) -> None:
    whole = trajectory.scaled(2.8 / trajectory.duration)
    table = read_motion(written(whole, "stream", tmp_path, period=0.008), RAIL)
    assert (len(table.t), table.t[-1]) == (351, pytest.approx(2.8, abs=1e-12))


@pytest.mark.parametrize("period", [None, 0.02, 0.1])
@pytest.mark.parametrize("to", PROGRAMS)
def test_programs_read_back_equal(to: str, period: float | None, trajectory: Trajectory, tmp_path: Path) -> None:
    table = read_motion(written(trajectory, to, tmp_path, period=period), RAIL)
    step = 0.05 if period is None else period
    ends = [0.0]
    for segment in trajectory.segments:
        count = math.ceil(round(segment.end - segment.start, 9) / step - 1e-9)
        ends += np.linspace(segment.start, segment.end, count + 1)[1:].tolist()
    assert table.joints == (*RAIL_AND_SIX[1:], "d1")
    assert table.t == pytest.approx(np.array(ends), abs=0.6e-6)
    assert table.time_rounding == 0.5e-6
    check_values(table, to, trajectory, np.array(ends).round(9))


@pytest.mark.parametrize("to", PROGRAMS)
def test_an_arm_without_a_rail_has_no_external_axis(to: str, tmp_path: Path) -> None:
    six = RAIL_AND_SIX[1:]
    trajectory = made_trajectory(six)
    file = written(trajectory, to, tmp_path)
    table = read_motion(file, Cell.load(cell_of(six)))
    assert table.joints == six
    assert "E1" not in file.read_text(encoding="ascii")
    with pytest.raises(InvalidInput, match=r"line [0-9]+: 6 axes for the 7 joints of the cell"):
        read_motion(file, RAIL)


# --- read by others -------------------------------------------------------------------------------------


def test_csv_is_what_the_csv_module_reads(trajectory: Trajectory, tmp_path: Path) -> None:
    with written(trajectory, "csv", tmp_path, period=0.02).open(newline="", encoding="utf-8") as file:
        header, *lines = csv.reader(file)
    assert header[0] == "t[s]"
    assert header[1:8] == ["q_d1[m]", *(f"q_{name}[rad]" for name in RAIL_AND_SIX[1:])]
    assert header[8] == "qd_d1[m/s]"
    assert header[-3:] == ["row", "segment", "process_on"]
    on = {line[-2] for line in lines if line[-1] == "1"}
    assert on == {"row"}


def test_parquet_is_what_arrow_reads(trajectory: Trajectory, tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    table = parquet.read_table(written(trajectory, "parquet", tmp_path, period=0.02))
    assert table.column_names[1] == "q_d1[m]"
    assert str(table.schema.field("q_d1[m]").type) == "double"
    said = json.loads(table.schema.metadata[b"qparm"])
    assert said == {"joint_names": list(RAIL_AND_SIX), "units": ["m"] + ["rad"] * 6, "executable": True}


def test_yaml_is_what_another_parser_reads(trajectory: Trajectory, tmp_path: Path) -> None:
    ruamel = pytest.importorskip("ruamel.yaml")
    text = written(trajectory, "yaml", tmp_path).read_text(encoding="utf-8")
    message = ruamel.YAML(typ="safe", pure=True).load(text)
    assert message == json.loads(written(trajectory, "json", tmp_path).read_text(encoding="utf-8"))


def plain(message: Any) -> list[Any]:
    points = [
        (list(p.positions), list(p.velocities), list(p.accelerations), p.time_from_start.sec, p.time_from_start.nanosec)
        for p in message.points
    ]
    return [list(message.joint_names), points]


def expected_message(trajectory: Trajectory) -> list[Any]:
    at = trajectory.knots.round(9)
    orders = [trajectory(at, order).tolist() for order in range(3)]
    times = [divmod(round(t * 1e9), 10**9) for t in at]
    return [list(trajectory.joint_names), [(*rows, *time) for *rows, time in zip(*orders, times, strict=True)]]


def test_rosbags_decodes_what_the_mcap_file_holds(trajectory: Trajectory, tmp_path: Path) -> None:
    reader, typesys = pytest.importorskip("mcap.reader"), pytest.importorskip("rosbags.typesys")
    with written(trajectory, "mcap", tmp_path).open("rb") as file:
        ((schema, channel, message),) = reader.make_reader(file).iter_messages()
    assert (schema.name, schema.encoding, channel.topic) == (
        "trajectory_msgs/msg/JointTrajectory",
        "ros2msg",
        "/joint_trajectory",
    )
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    assert plain(store.deserialize_cdr(message.data, schema.name)) == expected_message(trajectory)


def test_mcap_decodes_what_the_bag_holds(trajectory: Trajectory, tmp_path: Path) -> None:
    decoder, records = pytest.importorskip("mcap_ros2.decoder"), pytest.importorskip("mcap.records")
    from qparm.export.joint_trajectory_mcap import _DEFINITION

    bag = written(trajectory, "rosbag2", tmp_path)
    assert {entry.name for entry in bag.iterdir()} == {"metadata.yaml", "motion.bag.db3"}
    with sqlite3.connect(bag / "motion.bag.db3") as database:
        ((topic, kind),) = database.execute("select name, type from topics").fetchall()
        ((data,),) = database.execute("select data from messages").fetchall()
    database.close()
    assert (topic, kind) == ("/joint_trajectory", "trajectory_msgs/msg/JointTrajectory")
    schema = records.Schema(1, _DEFINITION.encode(), "ros2msg", kind)
    decode = decoder.DecoderFactory().decoder_for("cdr", schema)
    assert decode is not None
    assert plain(decode(data)) == expected_message(trajectory)


def test_a_krl_program_as_a_controller_sees_it(trajectory: Trajectory, tmp_path: Path) -> None:
    file = written(trajectory, "krl", tmp_path, period=0.1)
    source, data = file.read_bytes(), file.with_suffix(".dat").read_bytes()
    assert source.count(b"\r\n") == source.count(b"\n")
    lines, points = source.decode("ascii").split("\r\n"), data.decode("ascii").split("\r\n")
    assert lines[:2] == ["&ACCESS RVP", "DEF motion()"]
    assert lines[-2:] == ["END", ""]
    assert "; A1 = theta2 [deg], A2 = theta3 [deg]" in lines[3]
    assert lines[3].endswith("E1 = d1 [mm]")
    assert points[1] == "DEFDAT motion"
    assert points[-2:] == ["ENDDAT", ""]
    start = trajectory(0.0)
    axes = ",".join(f"A{k} {math.degrees(start[k]):.5f}" for k in range(1, 7))
    assert f"Q[1]={{{axes},E1 {start[0] * 1e3:.4f}}}" in points
    count = sum(line.startswith("Q[") for line in points)
    assert f"DECL E6AXIS Q[{count}]" in points
    # a block for each run from rest to rest: percents of its time, and the time
    blocks = re.findall(r"PTP_SPLINE(.*?)ENDSPLINE", source.decode(), re.S)
    assert len(blocks) == len(trajectory.segments)
    for block, segment in zip(blocks, trajectory.segments, strict=True):
        shares = [float(x) for x in re.findall(r"PART=(\S+)", block)]
        assert sum(shares) == pytest.approx(100.0, abs=1e-5)
        (seconds,) = re.findall(r"END=(\S+)", block)
        assert float(seconds) == pytest.approx(segment.end - segment.start, abs=1.1e-6)


def test_a_rapid_module_as_a_controller_sees_it(trajectory: Trajectory, tmp_path: Path) -> None:
    text = written(trajectory, "rapid", tmp_path, period=0.1).read_bytes().decode("ascii")
    lines = text.split("\r\n")
    assert lines[0] == "MODULE motion"
    assert lines[-2:] == ["ENDMODULE", ""]
    start = trajectory(0.0)
    robax = ",".join(f"{math.degrees(x):.5f}" for x in start[1:])
    first = f"    MoveAbsJ [[{robax}],[{start[0] * 1e3:.4f},9E+09,9E+09,9E+09,9E+09,9E+09]]\\NoEOffs,v100,fine,tool0;"
    assert first in lines
    assert text.count("PROC ") == text.count("ENDPROC") == len(trajectory.segments) + 1
    # the arm stops where the trajectory does, and nowhere else
    assert text.count(",fine,") == len(trajectory.segments) + 1
    times = [float(x) for x in re.findall(r"\\T:=([0-9.]+),", text)]
    assert sum(times) == pytest.approx(trajectory.duration, abs=0.6e-6)


def test_a_row_end_that_flows_through_is_no_stop(trajectory: Trajectory, tmp_path: Path) -> None:
    # two segments cut where the arm moves
    cut = float(trajectory.knots[2])
    first, second, *others = trajectory.segments
    flowing = replace(
        trajectory, segments=(first, replace(second, end=cut), replace(second, start=cut, row=7), *others)
    )
    text = written(flowing, "rapid", tmp_path).read_text(encoding="ascii")
    assert text.count("ENDPROC") == len(trajectory.segments) + 1
    assert "! row 0, row 7: " in text


# --- what is refused ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("names", "sentence"),
    [
        (RAIL_AND_SEVEN, "this arm has 7 revolute and 1 prismatic: .* theta2, .*; no place for theta8"),
        (RAIL_AND_SIX[:-1], "this arm has 5 revolute and 1 prismatic: .*; no joint for (A6|rax_6)"),
        ((*RAIL_AND_SIX, "d9"), "no place for d9"),
    ],
)
@pytest.mark.parametrize("to", PROGRAMS)
def test_an_arm_that_does_not_fit_a_program_is_refused(
    to: str, names: tuple[str, ...], sentence: str, tmp_path: Path
) -> None:
    with pytest.raises(InvalidInput, match=sentence):
        written(made_trajectory(names), to, tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["1st", "my-part", "a" * 25, "Teil_ä", "else", "While", ""])
@pytest.mark.parametrize("to", PROGRAMS)
def test_a_name_that_cannot_be_a_program_is_refused(to: str, name: str, trajectory: Trajectory, tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match=r"cannot be one in|must be named"):
        export_trajectory(trajectory, tmp_path / f"{name}{EXTENSIONS[to]}", to=to, units=units_of(RAIL_AND_SIX))


def test_options_that_do_not_fit_are_refused(trajectory: Trajectory, tmp_path: Path) -> None:
    units = units_of(RAIL_AND_SIX)
    with pytest.raises(InvalidInput, match="there is no format 'pdf'; there are csv, npz"):
        export_trajectory(trajectory, tmp_path / "x.pdf", to="pdf", units=units)
    with pytest.raises(InvalidInput, match=r"format npz must be named \*.npz, not 'x.csv'"):
        export_trajectory(trajectory, tmp_path / "x.csv", to="npz", units=units)
    with pytest.raises(InvalidInput, match="units must be 'm' or 'rad' for each of 7 joints"):
        export_trajectory(trajectory, tmp_path / "x.csv", to="csv", units=("mm", *units[1:]))
    for period in (0.0, -1.0, math.nan, math.inf, 1e-9):
        for to in FORMATS:
            with pytest.raises(InvalidInput, match=r"period|samples"):
                written(trajectory, to, tmp_path, period=period)
    assert list(tmp_path.iterdir()) == []


def test_a_stream_must_end_at_rest(trajectory: Trajectory, tmp_path: Path) -> None:
    cut = float(trajectory.knots[2])
    knots = trajectory.knots[:3]
    first, second, *_ = trajectory.segments
    moving = replace(trajectory, knots=knots, segments=(first, replace(second, end=cut)))
    with pytest.raises(InvalidInput, match="does not end at rest"):
        written(moving, "stream", tmp_path)


def test_a_trajectory_that_must_not_be_executed_is_marked_or_refused(tmp_path: Path) -> None:
    failed = made_trajectory(RAIL_AND_SIX, executable=False, reasons=("3 points were not reached",))
    for to in FORMATS:
        with pytest.raises(InvalidInput, match="must not be executed") as caught:
            written(failed, to, tmp_path)
        assert "3 points were not reached" in str(caught.value)
    for to in ("csv", "stream", "krl", "rapid"):
        with pytest.raises(InvalidInput, match=f"{to} has no place to say so"):
            written(failed, to, tmp_path, allow_failures=True)
    assert list(tmp_path.iterdir()) == []
    marks = {
        "npz": lambda file: not np.load(file)["executable"],
        "parquet": lambda file: b'"executable": false' in file.read_bytes(),
        "json": lambda file: json.loads(file.read_text()).get("executable") is False,
        "yaml": lambda file: "\nexecutable: false\n" in file.read_text(),
        "mcap": lambda file: b"/joint_trajectory_not_executable" in file.read_bytes(),
        "rosbag2": lambda bag: "/joint_trajectory_not_executable" in (bag / "metadata.yaml").read_text(),
    }
    assert set(marks) == {to for to in FORMATS if FORMATS[to].verdict}
    for to, marked in marks.items():
        assert marked(written(failed, to, tmp_path, allow_failures=True)), to
        assert not marked(written(made_trajectory(RAIL_AND_SIX), to, tmp_path)), to
        read_motion(tmp_path / f"motion{EXTENSIONS[to]}", RAIL)


@pytest.mark.parametrize(
    ("to", "module", "sentence"),
    [
        ("parquet", "pyarrow.parquet", r"'pyarrow' is not installed; use --to npz, or .*'qparm\[parquet\]'"),
        ("yaml", "yaml", r"'PyYAML' is not installed; use --to json, or .*'qparm\[ros\]'"),
        ("mcap", "mcap_ros2.writer", r"'mcap-ros2-support' is not installed; use --to json, or .*'qparm\[ros\]'"),
        ("rosbag2", "rosbags.rosbag2", r"'rosbags' is not installed; use --to mcap, or .*'qparm\[ros\]'"),
    ],
)
def test_a_missing_package_is_named_with_its_extra(
    to: str, module: str, sentence: str, trajectory: Trajectory, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = written(trajectory, to, tmp_path)
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(PackageMissing, match=sentence):
        written(trajectory, to, tmp_path)
    if to == "mcap":
        monkeypatch.setitem(sys.modules, "mcap_ros2.decoder", None)
    with pytest.raises(PackageMissing, match=module.partition(".")[0].replace("_ros2", "").replace("yaml", "YAML")):
        read_motion(file, RAIL)


# --- whole or not at all --------------------------------------------------------------------------------


@pytest.mark.parametrize("to", FORMATS)
def test_an_error_leaves_the_file_of_before(
    to: str, trajectory: Trajectory, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = written(trajectory, to, tmp_path)
    files = sorted(path for path in tmp_path.rglob("*") if path.is_file())
    before = {path: path.read_bytes() for path in files}

    def breaks(sampled: Any, at: Path) -> None:
        if FORMATS[to].extension:
            at.write_text("half", encoding="utf-8")
        else:
            at.mkdir()
            (at / "metadata.yaml").write_text("half", encoding="utf-8")
        raise OSError(28, "No space left on device")

    monkeypatch.setitem(FORMATS, to, replace(FORMATS[to], write=breaks))
    with pytest.raises(OutputError, match="No space left"):
        written(trajectory.scaled(2.0), to, tmp_path)
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before
    assert file.exists()
    with pytest.raises(OutputError):
        written(trajectory, to, tmp_path / "new")
    assert list((tmp_path / "new").rglob("*")) == []


def test_a_bag_replaces_an_earlier_one_and_nothing_else(trajectory: Trajectory, tmp_path: Path) -> None:
    bag = written(trajectory, "rosbag2", tmp_path)
    written(trajectory.scaled(2.0), "rosbag2", tmp_path)
    assert read_motion(bag, RAIL).t[-1] == pytest.approx(2 * trajectory.duration, abs=1e-8)
    (bag / "notes.txt").write_text("mine", encoding="utf-8")
    with pytest.raises(OutputError, match=r"holds 'notes.txt', which is no part of the export"):
        written(trajectory, "rosbag2", tmp_path)
    assert (bag / "notes.txt").read_text(encoding="utf-8") == "mine"
    with pytest.raises(OutputError, match="it is a file, not a folder"):
        export_trajectory(trajectory, bag / "notes.txt", to="rosbag2", units=units_of(RAIL_AND_SIX))


@pytest.mark.parametrize("to", FORMATS)
def test_a_trajectory_that_goes_nowhere_is_one_sample(to: str, tmp_path: Path) -> None:
    still = Trajectory(
        joint_names=RAIL_AND_SIX,
        polynomials=tuple(PPoly(np.array([[0.1 * k]]), np.array([0.0, 1e-3])) for k in range(7)),
        knots=np.zeros(1),
        segments=(TimedSegment(SegmentKind.APPROACH, -1, 0.0, 0.0),),
        timing="quintic",
        executable=True,
        reasons=(),
    )
    if to in PROGRAMS:
        with pytest.raises(InvalidInput, match="no motion that a program could do"):
            written(still, to, tmp_path)
        return
    table = read_motion(written(still, to, tmp_path), RAIL)
    assert table.t.tolist() == [0.0]
    assert table.q[0] == pytest.approx(0.1 * np.arange(7), rel=1e-11)


def test_the_same_trajectory_gives_the_same_bytes(trajectory: Trajectory, tmp_path: Path) -> None:
    for to in FORMATS:
        if to == "rosbag2":  # a database
            continue
        first = written(trajectory, to, tmp_path).read_bytes()
        assert written(trajectory, to, tmp_path / "again").read_bytes() == first, to
