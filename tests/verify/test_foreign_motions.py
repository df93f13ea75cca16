"""Motions as others write them are read as they are meant; broken and hostile ones are refused with their place."""

from __future__ import annotations

import io
import json
import math
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import qparm
from made_trajectory import RAIL_AND_SIX, cell_of, made_trajectory, units_of
from qparm.errors import InvalidInput
from qparm.export import export_trajectory
from qparm.verify.readers import read_motion

THREE = ("d1", "theta2", "theta3")
SMALL = qparm.Cell.load(cell_of(THREE))
CELL = qparm.Cell.load(cell_of(RAIL_AND_SIX))
HEAD = "t,d1,theta2,theta3"
BODY = "0,0,0,0\n0.1,0.1,0.2,0.3\n0.2,0.2,0.1,0\n"


def saved(file: Path, content: str | bytes) -> Path:
    file.write_bytes(content.encode() if isinstance(content, str) else content)
    return file


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
        (f"{HEAD}\n{BODY}".replace("0.1,0.1", "0_1,0.1"), "'0_1' is not a number"),
        (f"{HEAD}\n{BODY}".replace("0.1,0.1", "0.1,1e200"), "the position of joint 'd1' is 1e.200, beyond"),
        (f"{HEAD}\n{BODY}".replace("0.2,0.2", "1e7,0.2"), "3 samples over 1e.07 s are too few to tell the motion"),
        (f"{HEAD}\n{BODY}".replace("0.2,0.2", "9000,0.2"), "3 samples over 9000 s are too few to tell the motion"),
        (f"{HEAD}\n{BODY}".replace("0.1,0.1", "1e-300,0.1"), "does not come after"),
        (
            f"{HEAD},row\n" + "".join(f"{line},\u00b2\n" for line in BODY.splitlines()),
            "the row '\u00b2' is not an integer",
        ),
        (f"{HEAD}\n{BODY}"[:-1], "does not end; the file is cut short, or else lacks a line break"),
        (f'{HEAD}\n{BODY}0.3,"1,5",0,0\n', "line 5: the value '1,5' has a comma inside its quotes"),
    ],
)
def test_a_table_that_cannot_be_meant_is_refused(text: str, sentence: str, tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match=sentence):
        read_motion(saved(tmp_path / "m.csv", text), SMALL)


@pytest.mark.parametrize("name", ["t", "row", "time"])
def test_no_joint_is_called_like_a_column_of_the_tables(name: str) -> None:
    data = cell_of(THREE)
    data["arm"]["joints"][0]["name"] = name
    with pytest.raises(qparm.CellError, match=f"'{name}' cannot be a joint's name"):
        qparm.Cell.load(data)


@pytest.mark.parametrize("decimals", [6, 9, 12])
def test_degrees_made_of_rounded_radians_are_no_more_exact(decimals: int, tmp_path: Path) -> None:
    exact = np.random.default_rng(3).uniform(-2, 2, (30, 3))
    q = np.round(exact, decimals)
    degrees = np.column_stack([q[:, 0], np.degrees(q[:, 1:])])
    lines = [",".join(repr(float(x)) for x in (0.004 * k, *row)) + "\n" for k, row in enumerate(degrees)]
    read = read_motion(saved(tmp_path / "m.csv", "t,d1,theta2[deg],theta3[deg]\n" + "".join(lines)), SMALL)
    assert (np.abs(read.q - exact).max(axis=0) <= read.position_rounding + 1e-15).all()
    assert read.position_rounding == pytest.approx([0.5 * 10.0**-decimals] * 3)
    # degrees that were measured as such leave open what their own digits do
    lines = [",".join(f"{x:.12f}" for x in (0.004 * k, *row)) + "\n" for k, row in enumerate(np.degrees(exact) / 60)]
    read = read_motion(saved(tmp_path / "m.csv", "t,d1,theta2[deg],theta3[deg]\n" + "".join(lines)), SMALL)
    assert (read.position_rounding[1:] < 1e-13).all()


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
    for name in ("units", "joint_names"):
        np.savez_compressed(tmp_path / "m.npz", **arrays(**{name: np.zeros(10**6, dtype=np.int8)}))
        with pytest.raises(InvalidInput, match=f"'{name}' has 1,000,000 values, more than any arm has joints"):
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
