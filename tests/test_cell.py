"""The cell file: what it holds, and everything that can be wrong with it, reported with its key."""

from __future__ import annotations

import math
from collections.abc import Callable
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import qparm
from conftest import DOME, cell_data

Edit = Callable[[dict[str, Any]], object]


def problems(data: dict[str, Any]) -> dict[str, str]:
    """Return the problems of a cell by key; each key may have one only."""
    with pytest.raises(qparm.CellError) as caught:
        qparm.Cell.load(data)
    found = dict(caught.value.problems)
    assert len(found) == len(caught.value.problems)
    for key, sentence in found.items():
        assert f"{key}: {sentence}" in str(caught.value)
    return found


def edited(edit: Edit) -> dict[str, Any]:
    data = cell_data()
    edit(data)
    return data


def joint(data: dict[str, Any], number: int) -> dict[str, Any]:
    return data["arm"]["joints"][number]


# --- what a cell holds ------------------------------------------------------------------------------


def test_the_dome_is_what_its_file_says(dome: qparm.Cell) -> None:
    assert dome.name == "dome"
    assert dome.arm.convention == "modified"
    assert [j.name for j in dome.arm.joints] == ["d1", *(f"theta{k}" for k in range(2, 9))]
    assert [j.type for j in dome.arm.joints] == ["prismatic", *["revolute"] * 7]
    assert dome.arm.lengths == {"L1": 0.48, "L2": 0.4, "L3": 0.418, "L4": 0.12}
    assert dome.arm.joints[0].position == (0.0, 0.8)
    assert dome.arm.joints[0].jerk == 6.0
    assert dome.arm.joints[1].position == (math.radians(-170), math.radians(170))
    assert dome.arm.joints[1].dh.a == "L1"
    assert dome.workpiece.radius == 0.6
    assert dome.workpiece.elevation == (math.radians(-10), math.radians(60))
    assert dome.workpiece.pose.position == (0.0, 1.5, 0.36)
    assert (dome.process.rows, dome.process.points, dome.process.feed) == (15, 61, 0.02)
    assert (dome.process.position_tolerance, dome.process.rotation_tolerance) == (1e-6, 1e-5)


def test_path_string_dictionary_and_cell_load_the_same(dome: qparm.Cell) -> None:
    assert qparm.Cell.load(DOME) == dome
    assert qparm.Cell.load(str(DOME)) == dome
    assert qparm.Cell.load(cell_data()) == dome
    assert qparm.Cell.load(dome) is dome


def test_defaults_are_filled_in() -> None:
    data = cell_data()
    del data["name"], data["arm"]["name"], data["arm"]["characteristic_length"]
    for key in ("stand_off", "position_tolerance", "rotation_tolerance", "jump", "self_motion"):
        del data["process"][key]
    cell = qparm.Cell.load(data)
    assert (cell.name, cell.arm.name, cell.arm.characteristic_length) == ("cell", "arm", 0.4)
    assert np.array_equal(cell.arm.base.matrix(), np.eye(4))
    assert np.array_equal(cell.arm.tool.matrix(), np.eye(4))
    process = cell.process
    assert (process.stand_off, process.position_tolerance, process.rotation_tolerance) == (0.0, 1e-6, 1e-5)
    assert (process.jump, process.jump_prismatic) == (math.radians(50), None)
    motion = process.self_motion
    assert (motion.points, motion.transition, motion.lift) == (0, "follow", 0.0)


def test_the_written_file_does_not_leave_its_defaults_to_chance(dome: qparm.Cell) -> None:
    written = dome.to_dict()
    assert written["schema"] == 1
    assert written["arm"]["tool"]["position"] == ["0.0 m", "0.0 m", "0.0 m"]
    assert written["process"]["self_motion"] == {
        "points": 0, "transition": "follow", "lift": "0.0 m", "row_end": "stop", "overrun": "0.01 m"
    }  # fmt: skip
    assert written["process"]["feed"] == "0.02 m/s"
    assert written["arm"]["joints"][0]["acceleration"] == "0.6 m/s^2"
    assert written["arm"]["joints"][1]["dh"]["a"] == "L1"
    assert "jump_prismatic" not in written["process"]


@pytest.mark.parametrize(
    "edit",
    [
        lambda data: None,
        lambda data: data["process"].update(jump_prismatic="100 mm", jump="33.3 deg"),
        lambda data: data["process"].update(self_motion={"points": 3, "transition": "lift", "lift": "7.7 mm"}),
        lambda data: data["arm"].update(tool={"position": ["1 mm", "0.1 in", "3 um"], "rpy": ["1 deg"] * 3}),
        lambda data: data.update(name="dôme 半球"),
    ],
)
def test_dictionary_and_file_round_trips_are_equal(edit: Edit, tmp_path: Path) -> None:
    cell = qparm.Cell.load(edited(edit))
    assert qparm.Cell.load(cell.to_dict()) == cell
    cell.save(tmp_path / "again.toml")
    again = qparm.Cell.load(tmp_path / "again.toml")
    assert again == cell
    assert again.to_dict() == cell.to_dict()


def test_a_cell_is_frozen(dome: qparm.Cell) -> None:
    with pytest.raises(ValueError, match="frozen"):
        dome.process.rows = 3  # type: ignore[misc]
    assert dome.process.rows == 15


def test_home_is_in_si() -> None:
    data = cell_data()
    data["arm"]["home"] = ["250 mm", "90 deg", "-0.5 rad", "0 deg", "30 deg", "0 deg", "1 mrad", "0 deg"]
    expected = [0.25, math.pi / 2, -0.5, 0.0, math.radians(30), 0.0, 1e-3, 0.0]
    assert qparm.Cell.load(data).home().tolist() == expected


def test_the_jump_of_the_rail_follows_from_the_speeds(dome: qparm.Cell) -> None:
    # 50 deg at 60 deg/s take 5/6 s, in which the rail travels 200 mm/s * 5/6 s = 166.67 mm
    assert dome.jump() == pytest.approx([0.5 / 3, *[math.radians(50)] * 7], rel=1e-15)


def test_the_jump_of_the_rail_follows_the_slowest_revolute_joint() -> None:
    data = edited(lambda data: joint(data, 4).update(velocity="30 deg/s"))
    assert qparm.Cell.load(data).jump()[0] == pytest.approx(1.0 / 3, rel=1e-15)


def test_the_jump_of_the_rail_may_be_given() -> None:
    data = edited(lambda data: data["process"].update(jump_prismatic="100 mm"))
    assert qparm.Cell.load(data).jump().tolist() == [0.1, *[math.radians(50)] * 7]


def test_lengths_by_name_and_by_value_give_the_same_arm(dome: qparm.Cell) -> None:
    data = cell_data()
    for entry in data["arm"]["joints"]:
        for key in ("a", "d"):
            entry["dh"][key] = data["arm"]["lengths"].get(entry["dh"][key], entry["dh"][key])
    del data["arm"]["lengths"], data["design"]
    q = np.array([0.3, 0.1, -0.4, 0.7, 1.1, -0.2, 0.5, 0.9])
    assert np.array_equal(qparm.Cell.load(data).chain().forward(q), dome.chain().forward(q))


@pytest.mark.slow
def test_the_template_loads_and_plans_executable() -> None:
    with as_file(files("qparm.cell").joinpath("new_cell.toml")) as path:
        cell = qparm.Cell.load(path)
    plan = qparm.plan(cell)
    report = qparm.report(plan)
    assert report.executable, report.reasons
    assert report.figures.reached == report.figures.points == cell.process.rows * cell.process.points
    assert report.figures.jumps == ()
    assert plan.trajectory.executable


# --- one thing wrong --------------------------------------------------------------------------------

ONE_PROBLEM: list[tuple[str, Edit, str, str]] = [
    # what, edit, key, part of the sentence
    ("unknown key", lambda d: d["process"].update(row=3), "process.row", "did you mean 'rows'"),
    ("unknown key, top", lambda d: d.update(workpeice=1), "workpeice", "did you mean 'workpiece'"),
    (
        "unknown key, joint",
        lambda d: joint(d, 2).update(velocty="1 deg/s"),
        "arm.joints[2].velocty",
        "did you mean 'velocity'",
    ),
    (
        "unknown key, rail",
        lambda d: joint(d, 0).update(jrek="1 mm/s^3"),
        "arm.joints[0].jrek",
        "did you mean 'jerk'",
    ),
    (
        "unknown key, table",
        lambda d: joint(d, 1)["dh"].update(alhpa="0 deg"),
        "arm.joints[1].dh.alhpa",
        "did you mean 'alpha'",
    ),
    (
        "unknown key, pose",
        lambda d: d["workpiece"]["pose"].update(positon="0 mm"),
        "workpiece.pose.positon",
        "did you mean 'position'",
    ),
    (
        "unknown key, row ends",
        lambda d: d["process"]["self_motion"].update(point=1),
        "process.self_motion.point",
        "did you mean 'points'",
    ),
    (
        "unknown key without a near one",
        lambda d: d["process"].update(zzz=1),
        "process.zzz",
        "known here: rows, points, feed",
    ),
    ("unknown key called prismatic", lambda d: d.update(prismatic=1), "prismatic", "unknown key"),
    ("unknown key called revolute", lambda d: d["arm"].update(revolute=1), "arm.revolute", "unknown key"),
    (
        "length called revolute",
        lambda d: d["arm"]["lengths"].update(revolute="5"),
        "arm.lengths.revolute",
        "no unit",
    ),
    (
        "wrong unit",
        lambda d: d["workpiece"].update(radius="600 deg"),
        "workpiece.radius",
        "'deg' is not a unit of length",
    ),
    (
        "wrong unit, velocity",
        lambda d: joint(d, 3).update(velocity="60 deg"),
        "arm.joints[3].velocity",
        "'deg' is not a unit of angular velocity",
    ),
    (
        "wrong unit, rail",
        lambda d: joint(d, 0).update(acceleration="600 deg/s^2"),
        "arm.joints[0].acceleration",
        "is not a unit of linear acceleration",
    ),
    (
        "missing unit, number",
        lambda d: d["process"].update(feed=0.02),
        "process.feed",
        'no unit; write a linear velocity as a string such as "20 mm/s"',
    ),
    ("missing unit, string", lambda d: d["process"].update(feed="20"), "process.feed", "'20' has no unit"),
    (
        "missing unit in a pair",
        lambda d: joint(d, 1).update(position=["-170 deg", 170]),
        "arm.joints[1].position[1]",
        "170 has no unit",
    ),
    (
        "missing unit in a length",
        lambda d: d["arm"]["lengths"].update(L2="400"),
        "arm.lengths.L2",
        "has no unit",
    ),
    (
        "limits reversed",
        lambda d: joint(d, 1).update(position=["170 deg", "-170 deg"]),
        "arm.joints[1].position",
        "reversed or equal",
    ),
    (
        "limits reversed, rail",
        lambda d: joint(d, 0).update(position=["800 mm", "0 mm"]),
        "arm.joints[0].position",
        "0.8 to 0",
    ),
    (
        "limits equal",
        lambda d: joint(d, 0).update(position=["0 mm", "0 mm"]),
        "arm.joints[0].position",
        "reversed or equal",
    ),
    (
        "elevation reversed",
        lambda d: d["workpiece"].update(elevation=["60 deg", "-10 deg"]),
        "workpiece.elevation",
        "reversed or equal",
    ),
    (
        "azimuth reversed",
        lambda d: d["workpiece"].update(azimuth=["60 deg", "-60 deg"]),
        "workpiece.azimuth",
        "reversed or equal",
    ),
    (
        "elevation over the pole",
        lambda d: d["workpiece"].update(elevation=["0 deg", "95 deg"]),
        "workpiece.elevation",
        "-90 deg and 90 deg",
    ),
    (
        "azimuth over a turn",
        lambda d: d["workpiece"].update(azimuth=["-181 deg", "180 deg"]),
        "workpiece.azimuth",
        "360 deg",
    ),
    ("zero rows", lambda d: d["process"].update(rows=0), "process.rows", "must be at least 1, not 0"),
    ("one point", lambda d: d["process"].update(points=1), "process.points", "must be at least 2, not 1"),
    (
        "rows with a fraction",
        lambda d: d["process"].update(rows=1.5),
        "process.rows",
        "must be a whole number, not 1.5",
    ),
    ("rows as a string", lambda d: d["process"].update(rows="15"), "process.rows", "must be a whole number, not '15'"),
    ("rows true", lambda d: d["process"].update(rows=True), "process.rows", "must be a whole number, not true"),
    ("rows nan", lambda d: d["process"].update(rows=math.nan), "process.rows", "must be a whole number, not nan"),
    ("nan", lambda d: d["workpiece"].update(radius="nan mm"), "workpiece.radius", "not finite"),
    ("bare nan", lambda d: d["workpiece"].update(radius=math.nan), "workpiece.radius", "no unit"),
    ("infinite", lambda d: d["process"].update(feed="inf mm/s"), "process.feed", "not finite"),
    ("nan in the home", lambda d: d["arm"]["home"].__setitem__(1, "nan deg"), "arm.home", "not finite"),
    (
        "too few home values",
        lambda d: d["arm"].update(home=["0 mm", *["0 deg"] * 6]),
        "arm.home",
        "the arm has 8 joints, home has 7 values",
    ),
    (
        "too many home values",
        lambda d: d["arm"]["home"].append("0 deg"),
        "arm.home",
        "the arm has 8 joints, home has 9 values",
    ),
    (
        "home outside limits",
        lambda d: d["arm"]["home"].__setitem__(2, "121 deg"),
        "arm.home",
        "value 2 (theta3): 121 deg lies outside its limits",
    ),
    (
        "rail's home outside limits",
        lambda d: d["arm"]["home"].__setitem__(0, "801 mm"),
        "arm.home",
        "value 0 (d1): 801 mm lies outside its limits 0 to 0.8",
    ),
    (
        "home in the wrong unit",
        lambda d: d["arm"]["home"].__setitem__(0, "0 deg"),
        "arm.home",
        "value 0 (d1): 'deg' is not a unit of length",
    ),
    (
        "home without unit",
        lambda d: d["arm"]["home"].__setitem__(1, "0"),
        "arm.home",
        "value 1 (theta2): '0' has no unit",
    ),
    (
        "home as a number",
        lambda d: d["arm"]["home"].__setitem__(1, 0),
        "arm.home",
        "value 1 (theta2): 0 has no unit; write an angle",
    ),
    (
        "unknown length",
        lambda d: joint(d, 1)["dh"].update(a="L9"),
        "arm.joints[1].dh.a",
        "'L9' is neither a length with a unit nor a name in arm.lengths (known: L1, L2, L3, L4)",
    ),
    (
        "wrong convention",
        lambda d: d["arm"].update(convention="craig"),
        "arm.convention",
        "must be 'modified' or 'standard', not 'craig'",
    ),
    ("repeated name", lambda d: joint(d, 2).update(name="theta2"), "arm.joints", "repeated: theta2"),
    ("empty name", lambda d: joint(d, 2).update(name=""), "arm.joints[2].name", "at least 1 character"),
    (
        "wrong type",
        lambda d: joint(d, 3).update(type="spherical"),
        "arm.joints[3].type",
        "must be 'prismatic' or 'revolute', not 'spherical'",
    ),
    ("no type", lambda d: joint(d, 3).pop("type"), "arm.joints[3].type", "is missing"),
    ("no joints", lambda d: d["arm"].update(joints=[], home=[]), "arm.joints", "must have at least 1 entry, not 0"),
    ("joints as a number", lambda d: d["arm"].update(joints=3), "arm.joints", "must be a list, not 3"),
    ("arm as a string", lambda d: d.update(arm="KUKA"), "arm", "must be a table, not 'KUKA'"),
    ("missing key", lambda d: d["process"].pop("feed"), "process.feed", "is missing"),
    ("missing table", lambda d: d.pop("workpiece"), "workpiece", "is missing"),
    ("missing convention", lambda d: d["arm"].pop("convention"), "arm.convention", "is missing"),
    ("missing jerk", lambda d: joint(d, 5).pop("jerk"), "arm.joints[5].jerk", "is missing"),
    ("missing table row", lambda d: joint(d, 5)["dh"].pop("d"), "arm.joints[5].dh.d", "is missing"),
    ("missing schema", lambda d: d.pop("schema"), "schema", "is missing"),
    ("schema of the future", lambda d: d.update(schema=2), "schema", "must be 1, not 2"),
    ("schema as a truth", lambda d: d.update(schema=True), "schema", "must be the whole number 1, not true"),
    ("schema with a point", lambda d: d.update(schema=1.0), "schema", "must be the whole number 1, not 1.0"),
    (
        "one limit",
        lambda d: joint(d, 1).update(position=["0 deg"]),
        "arm.joints[1].position",
        "must have 2 values, not 1",
    ),
    (
        "three limits",
        lambda d: joint(d, 1).update(position=["0 deg", "1 deg", "2 deg"]),
        "arm.joints[1].position",
        "must have 2 values, not 3",
    ),
    (
        "velocity zero",
        lambda d: joint(d, 1).update(velocity="0 deg/s"),
        "arm.joints[1].velocity",
        "greater than zero",
    ),
    (
        "jerk negative",
        lambda d: joint(d, 0).update(jerk="-1 mm/s^3"),
        "arm.joints[0].jerk",
        "greater than zero",
    ),
    ("feed zero", lambda d: d["process"].update(feed="0 mm/s"), "process.feed", "greater than zero"),
    ("radius negative", lambda d: d["workpiece"].update(radius="-1 mm"), "workpiece.radius", "greater than"),
    (
        "jump of the rail zero",
        lambda d: d["process"].update(jump_prismatic="0 mm"),
        "process.jump_prismatic",
        "greater than zero",
    ),
    ("shape", lambda d: d["workpiece"].update(shape="cube"), "workpiece.shape", "must be 'sphere zone'"),
    (
        "row ends longer than rows",
        lambda d: d["process"]["self_motion"].update(points=31),
        "process.self_motion",
        "more than half of a row of 61 points",
    ),
    (
        "lift without height",
        lambda d: d["process"]["self_motion"].update(transition="lift"),
        "process.self_motion",
        "needs a lift",
    ),
    (
        "lift negative",
        lambda d: d["process"]["self_motion"].update(lift="-1 mm"),
        "process.self_motion.lift",
        "negative",
    ),
    (
        "two coordinates",
        lambda d: d["workpiece"]["pose"].update(position=["0 m", "1 m"]),
        "workpiece.pose.position",
        "must have 3 values, not 2",
    ),
    (
        "a pair as a string",
        lambda d: d["workpiece"].update(azimuth="60 deg"),
        "workpiece.azimuth",
        "must be a list of 2 values, not '60 deg'",
    ),
    ("home as a string", lambda d: d["arm"].update(home="0 deg"), "arm.home", "must be a list, not '0 deg'"),
    ("joint as a number", lambda d: d["arm"]["joints"].__setitem__(7, 3), "arm.joints[7]", "must be a table, not 3"),
    ("joints as a table", lambda d: d["arm"].update(joints={}), "arm.joints", "must be a list, not a table"),
    ("name as a number", lambda d: d.update(name=3), "name", "must be a string, not 3"),
    ("name as a list", lambda d: d.update(name=["a"]), "name", "must be a string, not a list"),
    ("no name", lambda d: d.update(name=""), "name", "must have at least 1 character"),
    ("type as a number", lambda d: joint(d, 3).update(type=3), "arm.joints[3].type", "or 'revolute', not 3"),
    (
        "row ends below zero",
        lambda d: d["process"]["self_motion"].update(points=-1),
        "process.self_motion.points",
        "must be at least 0, not -1",
    ),
    (
        "a million rows",
        lambda d: d["process"].update(rows=10**7),
        "process.rows",
        "must be at most 5000, not 10000000",
    ),
    ("key that is none", lambda d: d["arm"]["lengths"].update({1: "1 m"}), "arm.lengths[1]", "a key must be a string"),
    ("key that is none, top", lambda d: d.update({1: 1}), "[1]", "a key must be a string"),
    ("schema by its inner name", lambda d: d.update(schema_version=1), "schema_version", "did you mean 'schema'"),
    ("stand-off negative", lambda d: d["process"].update(stand_off="-1 mm"), "process.stand_off", "not be negative"),
    ("feed of a snail", lambda d: d["process"].update(feed="0.9 um/s"), "process.feed", "0.001 mm/s and 100 m/s"),
    ("feed of a shell", lambda d: d["process"].update(feed="101 m/s"), "process.feed", "0.001 mm/s and 100 m/s"),
    *(
        (
            f"{what} {value}",
            lambda d, k=f"{what}_tolerance", v=value: d["process"].update({k: v}),
            f"process.{what}_tolerance",
            words,
        )
        for what, value, words in [
            ("position", "11 mm", "0.001 um and 10 mm"),
            ("position", "0.0009 um", "0.001 um and 10 mm"),
            ("position", "0 um", "greater than zero"),
            ("rotation", "11 deg", "0.001 urad and 10 deg"),
            ("rotation", "0.0009 urad", "0.001 urad and 10 deg"),
        ]
    ),
    ("jump of turns", lambda d: d["process"].update(jump="1001 rad"), "process.jump", "more than 1000 rad"),
    (
        "many turns",
        lambda d: joint(d, 2)["dh"].update(theta="-6e4 deg"),
        "arm.joints[2].dh.theta",
        "more than 1000 rad",
    ),
]


@pytest.mark.parametrize(
    ("edit", "key", "part"), [case[1:] for case in ONE_PROBLEM], ids=[case[0] for case in ONE_PROBLEM]
)
def test_a_problem_is_reported_with_its_key(edit: Edit, key: str, part: str) -> None:
    found = problems(edited(edit))
    assert list(found) == [key]
    assert part in found[key]


@pytest.mark.parametrize(
    "process",
    [
        {"feed": "0.001 mm/s", "position_tolerance": "10 mm", "rotation_tolerance": "10 deg", "stand_off": "0 mm"},
        {"feed": "100 m/s", "position_tolerance": "0.001 um", "rotation_tolerance": "0.001 urad", "jump": "1000 rad"},
    ],
)
def test_the_limits_of_what_makes_sense_are_included(process: dict[str, str]) -> None:
    cell = qparm.Cell.load(edited(lambda data: data["process"].update(process)))
    assert cell.process.feed in (1e-6, 100.0)


@pytest.mark.parametrize("source", [None, 3, 1.5, b"cell.toml", ["cell.toml"], ""])
def test_what_is_no_cell_at_all_is_refused_with_a_sentence(source: Any) -> None:
    with pytest.raises(qparm.InvalidInput, match=r"^a cell is a TOML file, a dictionary or a Cell(, not|; the file's)"):
        qparm.Cell.load(source)


def test_a_name_that_no_file_can_have() -> None:
    with pytest.raises(qparm.CellError, match="cannot be read"):
        qparm.Cell.load("a\0b")


@pytest.mark.parametrize("points", [10**15, 10**20])
def test_more_points_than_any_memory_holds_are_a_problem_of_the_process(points: int) -> None:
    (key,) = problems(edited(lambda data: data["process"].update(points=points)))
    assert key in ("process", "process.points")


# --- several things wrong ---------------------------------------------------------------------------


def test_everything_wrong_is_reported_together() -> None:
    data = cell_data()
    data["process"].update(rows=0, feed="20", row=1)
    data["workpiece"].update(radius="nan mm", azimuth=["60 deg", "-60 deg"])
    data["arm"].update(convention="craig")
    joint(data, 1)["dh"].update(a="L9")
    joint(data, 4).update(velocity="60 deg")
    joint(data, 6).pop("jerk")
    del data["schema"]
    assert set(problems(data)) == {
        "schema",
        "process.rows",
        "process.feed",
        "process.row",
        "workpiece.radius",
        "workpiece.azimuth",
        "arm.convention",
        "arm.joints[1].dh.a",
        "arm.joints[4].velocity",
        "arm.joints[6].jerk",
    }


def test_a_joint_at_fault_does_not_hide_a_home_of_the_wrong_length() -> None:
    data = edited(lambda data: joint(data, 1).update(velocity="60"))
    data["arm"]["home"].pop()
    found = problems(data)
    assert set(found) == {"arm.joints[1].velocity", "arm.home"}
    assert "8 joints, home has 7 values" in found["arm.home"]


def test_all_that_is_wrong_at_home_is_told_with_index_and_joint() -> None:
    data = cell_data()
    data["arm"]["home"][0] = 0.1
    data["arm"]["home"][1] = "171 deg"
    data["arm"]["home"][3] = "0 mm"
    parts = problems(data)["arm.home"].split("; value ")
    assert [part.partition(":")[0] for part in parts] == ["value 0 (d1)", "1 (theta2)", "3 (theta4)"]
    assert '0.1 has no unit; write a length as a string such as "600 mm"' in parts[0]
    assert "171 deg lies outside its limits" in parts[1]
    assert "'mm' is not a unit of angle" in parts[2]


def test_joints_at_fault_do_not_hide_values_at_home_without_unit() -> None:
    data = edited(lambda data: joint(data, 1).update(velocity="60"))
    joint(data, 2)["type"] = "spherical"
    data["arm"]["home"][0] = "0 deg"
    data["arm"]["home"][2] = 3
    found = problems(data)
    assert set(found) == {"arm.joints[1].velocity", "arm.joints[2].type", "arm.home"}
    assert "value 0 (d1): 'deg' is not a unit of length" in found["arm.home"]
    assert "value 2 (theta3): 3 has no unit" in found["arm.home"]


def test_the_message_counts_the_problems_one_a_line() -> None:
    data = edited(lambda data: data["process"].update(rows=0, feed="20"))
    with pytest.raises(qparm.CellError) as caught:
        qparm.Cell.load(data)
    first, *lines = str(caught.value).splitlines()
    assert first == "cell has 2 problems"
    assert [line.split(":")[0] for line in lines] == ["  process.rows", "  process.feed"]
    with pytest.raises(qparm.CellError, match=r"^cell has 1 problem\n"):
        qparm.Cell.load(edited(lambda data: data["process"].update(rows=0)))


def test_an_empty_cell_names_what_is_missing() -> None:
    assert problems({}) == dict.fromkeys(("schema", "arm", "workpiece", "process"), "is missing")


# --- files that are none ----------------------------------------------------------------------------


def file_problem(path: Path) -> str:
    with pytest.raises(qparm.CellError) as caught:
        qparm.Cell.load(path)
    assert caught.value.source == str(path)
    ((key, sentence),) = caught.value.problems
    assert key == ""
    return sentence


def test_a_missing_file(tmp_path: Path) -> None:
    assert "no such file" in file_problem(tmp_path / "none.toml")


def test_a_folder_is_no_cell(tmp_path: Path) -> None:
    assert "cannot be read" in file_problem(tmp_path)


def test_broken_toml_names_the_line(tmp_path: Path) -> None:
    path = tmp_path / "broken.toml"
    path.write_text('schema = 1\nname = "dome\n', encoding="utf-8")
    sentence = file_problem(path)
    assert "not valid TOML" in sentence
    assert "line 2" in sentence


def test_toml_cut_short(tmp_path: Path) -> None:
    path = tmp_path / "cut.toml"
    text = DOME.read_text(encoding="utf-8")
    path.write_text(text[: text.index('["0 mm", "800 mm"]') + 5], encoding="utf-8")
    assert "not valid TOML" in file_problem(path)


def test_a_file_that_is_not_utf8(tmp_path: Path) -> None:
    path = tmp_path / "latin.toml"
    path.write_bytes('schema = 1\nname = "d\u00f4me"\n'.encode("latin-1"))
    assert "not UTF-8" in file_problem(path)


def test_the_file_is_named_with_its_problems(tmp_path: Path) -> None:
    path = tmp_path / "cell.toml"
    text = DOME.read_text(encoding="utf-8")
    path.write_text(text.replace("rows = 15", "rows = 0"), encoding="utf-8")
    with pytest.raises(qparm.CellError) as caught:
        qparm.Cell.load(path)
    assert caught.value.source == str(path)
    assert str(caught.value).startswith(f"{path} has 1 problem\n  process.rows: ")
