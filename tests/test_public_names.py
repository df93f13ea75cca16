"""What qparm shows of itself in Python: its names, its short descriptions, and what its pages show."""

from __future__ import annotations

import importlib
import pkgutil
import re
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import qparm
from conftest import ROOT, few_rows
from qparm.verify.files import read_samples

ROOMS = ["qparm", *sorted(room.name for room in pkgutil.walk_packages(qparm.__path__, "qparm.") if room.ispkg)]


@pytest.mark.parametrize("room", ROOMS)
def test_a_room_lists_its_public_names_and_no_others(room: str) -> None:
    module = importlib.import_module(room)
    assert dir(module) == sorted(module.__all__)
    assert all(getattr(module, name) is not None for name in module.__all__)


def test_no_name_of_a_room_hides_a_module_of_it() -> None:
    for module in pkgutil.walk_packages(qparm.__path__, "qparm."):
        if module.name.endswith("__main__"):
            continue
        importlib.import_module(module.name)
        room, _, name = module.name.rpartition(".")
        assert isinstance(getattr(importlib.import_module(room), name), ModuleType), module.name


def test_what_can_be_chosen_is_what_there_is() -> None:
    """The names that the command line offers, and the tables that the library looks them up in."""
    from qparm import choices, export, ik, planning, timing
    from qparm.design import engines

    assert list(choices.STRATEGIES) == list(planning.STRATEGIES)
    assert sorted(choices.METHODS) == sorted(ik.METHODS)
    assert list(choices.TIMING_FORMS) == list(timing.FORMS)
    assert list(choices.TRAJECTORY_FORMATS) == list(export.FORMATS)
    assert tuple(choices.DESIGN_METHODS) == engines.METHODS


def test_what_is_loaded_on_demand_is_listed() -> None:
    import qparm.ik
    import qparm.reach

    assert "DifferentialIK" in dir(qparm.ik)
    assert {"attainable_margin", "reach_of_designs"} <= set(dir(qparm.reach))


@pytest.fixture(scope="module")
def plan() -> qparm.Plan:
    return qparm.plan(few_rows(), feed="30 mm/s", tool_tilt="4 deg")


def test_the_big_objects_describe_themselves_in_a_line(plan: qparm.Plan) -> None:
    points = plan.tool_path.point_count
    said = {
        "Cell": repr(plan.cell),
        "SerialChain": repr(plan.chain),
        "ToolPath": repr(plan.tool_path),
        "JointPath": repr(plan.joint_path),
        "Trajectory": repr(plan.trajectory),
        "Plan": repr(plan),
        "Report": repr(qparm.report(plan)),
    }
    for name, text in said.items():
        assert text.startswith(f"{name}(")
        assert len(text) <= 240
        assert "array" not in text
    assert said["SerialChain"] == (
        "SerialChain('rail arm', 8 joints: d1, theta2, theta3, theta4, theta5, theta6, theta7, theta8)"
    )
    assert f"{points} points" in said["ToolPath"]
    assert ", 3 row, 2 transition, " in said["JointPath"]
    assert f"{plan.trajectory.duration:.6g} s of 8 joints" in said["Trajectory"]
    assert f"33 of {points} points reached, 0 breaks, Trajectory(" in said["Plan"]
    assert f"33 of {points} points" in said["Report"]


def test_what_the_command_changes_of_a_cell_can_be_changed_from_python(plan: qparm.Plan) -> None:
    assert plan.cell == qparm.Cell.load(few_rows(feed="30 mm/s", tool_tilt="4 deg"))
    assert plan.cell.process.feed == 0.03
    for wrong in ({"feed": "fast"}, {"feed": 0.05}, {"tool_spin": "loose"}, {"tool_tilt": "70 deg"}):
        (key,) = wrong
        with pytest.raises(qparm.CellError, match=f"process.{key}"):
            qparm.plan(few_rows(), **wrong)


def test_nothing_given_leaves_the_cell_as_it_is() -> None:
    cell = qparm.Cell.load(few_rows())
    assert cell.with_process({"feed": None, "tool_spin": None}) is cell


def test_the_page_on_timing_times_waypoints(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    page = (ROOT / "docs" / "timing.md").read_text(encoding="utf-8")
    (script,) = re.findall(r"```python\n(.*?)```", page, re.S)
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    exec(compile(script, "docs/timing.md", "exec"), names)
    assert capsys.readouterr().out.splitlines()[-1] == "()"
    trajectory, waypoints = names["trajectory"], names["waypoints"]
    np.testing.assert_allclose(trajectory(trajectory.knots), waypoints, atol=1e-9)
    samples = read_samples(tmp_path / "timed.csv")
    assert samples.joints == ("a1", "a2")
    np.testing.assert_allclose(samples.derivatives[0, [0, -1]], waypoints[[0, -1]], atol=1e-9)
    assert (np.abs(samples.derivatives[1]) <= 1.0 + 1e-6).all()
