"""Compliance as a measure of designs: against every solution there is, in the cell, and through the command."""

from __future__ import annotations

import csv
import json
from typing import Any

import numpy as np
import pytest
import tomli_w
from click.testing import CliRunner

import qparm
from conftest import ROOT, cell_data
from design.made_cells import small
from made_arm import elsewhere_data
from qparm.cli import cli
from qparm.design.attainable import attainable_measures
from qparm.design.best_of_points import best_of_points
from qparm.design.study import design
from qparm.errors import CellError
from qparm.planning.search.sampling import Layer
from qparm.robot.compliance import tool_compliance

STIFFNESS = {
    "revolute": "60 kN m/rad",
    "prismatic": "30 kN/mm",
    "joints": {"theta2": "150 kN m/rad", "theta4": "90 kN m/rad"},
    "links": "400 kN m^2",
}


def elastic(data: dict[str, Any], stiffness: dict[str, Any] = STIFFNESS) -> dict[str, Any]:
    data["arm"]["stiffness"] = stiffness
    return data


def test_a_cell_tells_what_gives_way() -> None:
    cell = qparm.Cell.load(elastic(cell_data()))
    found = cell.elasticity()
    assert found is not None
    np.testing.assert_array_equal(found.joints, [3e7, 1.5e5, 6e4, 9e4, 6e4, 6e4, 6e4, 6e4])
    assert found.links == 4e5
    assert qparm.Cell.load(cell.to_dict()) == cell
    assert qparm.Cell.load(cell_data()).elasticity() is None
    rigid = {"revolute": "1 N m/rad", "prismatic": "1 N/m"}
    found = qparm.Cell.load(elastic(cell_data(), rigid)).elasticity()
    assert found is not None
    assert found.links == np.inf


def test_so_does_an_arm_from_a_urdf() -> None:
    data = elastic(elsewhere_data(), {"revolute": "5 kN m/rad", "joints": {"a4": "7 kN m/rad"}})
    found = qparm.Cell.load(data).elasticity()
    assert found is not None
    assert found.joints.tolist() == [5e3, 5e3, 5e3, 7e3, 5e3, 5e3, 5e3]


@pytest.mark.parametrize(
    ("stiffness", "key", "words"),
    [
        ({"revolute": "50 kN m"}, "arm.stiffness.revolute", "'kN m' is not a unit of torsional stiffness"),
        ({"revolute": "0 N m/rad"}, "arm.stiffness.revolute", "must be greater than zero"),
        ({"joints": {"theta9": "5 kN m/rad"}}, "arm.stiffness.joints.theta9", "its joints are d1, theta2"),
        ({"joints": {"d1": "5 kN m/rad"}}, "arm.stiffness.joints.d1", "is not a unit of linear stiffness"),
        ({"joints": {"theta2": "-5 kN m/rad"}}, "arm.stiffness.joints.theta2", "must be greater than zero"),
        ({"rotary": "50 kN m/rad"}, "arm.stiffness.rotary", "unknown key"),
    ],
)
def test_stiffnesses_that_are_none_are_refused_by_key(stiffness: dict[str, Any], key: str, words: str) -> None:
    with pytest.raises(CellError) as error:
        qparm.Cell.load(elastic(cell_data(), stiffness))
    (problem,) = error.value.problems
    assert problem[0] == key
    assert words in problem[1]


@pytest.mark.parametrize("asked", [{"objectives": ["compliance"]}, {"limits": {"compliance": "2 um/N"}}])
def test_who_asks_for_the_compliance_must_give_stiffnesses(asked: dict[str, Any]) -> None:
    data = small(**asked)
    with pytest.raises(CellError) as error:
        qparm.Cell.load(data)
    ((key, sentence),) = error.value.problems
    assert key == f"design.{next(iter(asked))}"
    assert "arm.stiffness.prismatic" in sentence
    assert "arm.stiffness.revolute" in sentence
    data["arm"]["stiffness"] = {"revolute": "50 kN m/rad"}
    with pytest.raises(CellError, match=r"arm\.stiffness\.prismatic.* for d1$"):
        qparm.Cell.load(data)
    qparm.Cell.load(elastic(data))


def attained(cell: qparm.Cell) -> float:
    return attainable_measures(cell, cell.tool_path(), seed=0, names=["compliance"])["compliance"]


def test_of_an_arm_with_few_solutions_it_is_the_best_of_them() -> None:
    """A six-axis arm has at most eight at a pose: all are found by many starts."""
    data = elastic(cell_data(ROOT / "examples" / "six_axis.toml"), {"revolute": "60 kN m/rad", "links": "400 kN m^2"})
    data["process"] |= {"rows": 2, "points": 4}
    cell = qparm.Cell.load(data)
    chain, poses, elasticity = cell.chain(), cell.tool_path().poses, cell.elasticity()
    assert elasticity is not None
    k = [0, 3, 4, 7]  # the rows' ends are among the points that are looked at; the others thin out
    batch = qparm.solve_poses(chain, poses[k], restarts=300, rng=np.random.default_rng(0), every_start=True)
    least = []
    for pose, q, reached in zip(poses[k], batch.q, batch.reached, strict=True):
        n = np.tile(pose[:3, 2], (int(reached.sum()), 1))
        least.append(tool_compliance(chain, q[reached], n, elasticity).min())
    assert attained(cell) == pytest.approx(max(least), rel=1e-4)


def test_of_a_redundant_arm_no_solution_is_stiffer_by_more_than_little() -> None:
    data = elastic(small())
    data["process"] |= {"rows": 1, "points": 2}
    cell = qparm.Cell.load({key: table for key, table in data.items() if key != "design"})
    chain, poses, elasticity = cell.chain(), cell.tool_path().poses, cell.elasticity()
    assert elasticity is not None
    batch = qparm.solve_poses(chain, poses, restarts=3000, rng=np.random.default_rng(0), every_start=True)
    least = []
    for pose, q, reached in zip(poses, batch.q, batch.reached, strict=True):
        n = np.tile(pose[:3, 2], (int(reached.sum()), 1))
        least.append(tool_compliance(chain, q[reached], n, elasticity).min())
    told = [attainable_measures(cell, cell.tool_path(), seed=s, names=["compliance"])["compliance"] for s in range(3)]
    # random solutions are a bound from above
    assert max(told) < 1.03 * max(least)
    assert max(told) < 1.03 * min(told), "other draws tell nearly the same"


@pytest.mark.parametrize(("design", "least"), [((0.56, 0.45), 3.239e-6), ((0.58, 0.48), 3.401e-6)])
@pytest.mark.slow
def test_it_is_of_the_design_and_not_of_the_draws(design: tuple[float, float], least: float) -> None:
    """``least``: a search by itself, 180 starts at each point and four climbs of each, from neighbours too."""
    links = {"revolute": "50 kN m/rad", "prismatic": "50 kN/mm", "links": "500 kN m^2"}
    links |= {"joints": {"theta2": "150 kN m/rad", "theta3": "150 kN m/rad", "theta4": "100 kN m/rad"}}
    data = elastic(cell_data(ROOT / "examples" / "dome.toml"), links)
    data.pop("design", None)
    cell = qparm.Cell.load(data).with_values({f"arm.lengths.{k}": v for k, v in zip(("L1", "L3"), design, strict=True)})
    told = [attainable_measures(cell, cell.tool_path(), seed=s, names=["compliance"])["compliance"] for s in range(3)]
    assert max(told) == pytest.approx(least, rel=0.005)
    assert min(told) == pytest.approx(least, rel=0.005)


def test_worst_points_are_searched_from_many_starts() -> None:
    """From a single solution of each point, and be it a poor one, what thousands of solutions have is found."""
    cell = qparm.Cell.load(elastic({key: table for key, table in small().items() if key != "design"}))
    chain, poses, elasticity = cell.chain(), cell.tool_path().poses[:3], cell.elasticity()
    assert elasticity is not None
    batch = qparm.solve_poses(chain, poses, restarts=1500, rng=np.random.default_rng(0), every_start=True)
    layers, least = [], []
    for pose, q, reached in zip(poses, batch.q, batch.reached, strict=True):
        told = tool_compliance(chain, q[reached], np.tile(pose[:3, 2], (int(reached.sum()), 1)), elasticity)
        layers.append(Layer(q[reached][[told.argmax()]], np.zeros((1, 3))))
        least.append(told.min())
    found = best_of_points(
        chain, poses, layers, lambda chain, q, n: -tool_compliance(chain, q, n, elasticity), cell.relaxation(),
        np.random.default_rng(0),
    )  # fmt: skip
    assert (-found <= 1.01 * np.array(least)).all()


def test_stiffer_joints_give_way_in_proportion() -> None:
    soft = elastic(small(), {"revolute": "30 kN m/rad", "prismatic": "10 kN/mm", "links": "100 kN m^2"})
    stiff = elastic(small(), {"revolute": "60 kN m/rad", "prismatic": "20 kN/mm", "links": "200 kN m^2"})
    first, second = (attained(qparm.Cell.load(data)) for data in (soft, stiff))
    assert first == pytest.approx(2 * second, rel=1e-9)


@pytest.mark.slow
def test_the_command_takes_it_as_the_structural_objective(tmp_path: Any) -> None:
    data = elastic(small(objectives=["compliance", "singularity_margin"], limits={"compliance": "60 um/N"}))
    (tmp_path / "cell.toml").write_text(tomli_w.dumps(data))
    out = tmp_path / "out"
    arguments = ["design", str(tmp_path / "cell.toml"), "--out", str(out), "--budget", "10", "--plans", "0",
                 "--workers", "1", "--method", "sobol"]  # fmt: skip
    found = CliRunner().invoke(cli, arguments, standalone_mode=False)
    assert found.exception is None
    assert found.return_value == 0
    assert "um/N" in found.output
    assert "any shorter arm in these ranges" not in found.output, (
        "the border is followed to the shortest for its length only"
    )
    rows = list(csv.DictReader((out / "designs.csv").read_text(encoding="utf-8").splitlines()))
    known = [row for row in rows if row["compliance[m/N]"]]
    assert known
    told = json.loads((out / "design.json").read_text(encoding="utf-8"))
    assert [one["name"] for one in told["objectives"]] == ["compliance", "singularity_margin"]
    front = [row for row in rows if row["front"] == "1"]
    valid = [float(row["compliance[m/N]"]) for row in known if row["valid"] == "1"]
    assert valid
    assert min(float(row["compliance[m/N]"]) for row in front) == min(valid)
    assert max(valid) <= 60e-6
    for row in front[:1]:
        x = {key: float(row[f"{key}[m]"]) for key in data["design"]["variables"]}
        assert attained(qparm.Cell.load(data).with_values(x)) == float(row["compliance[m/N]"])


@pytest.mark.slow
def test_a_cell_without_stiffnesses_has_no_such_column() -> None:
    found = design(small(), method="sobol", budget=4, workers=1, plans=0)
    assert all("compliance" not in one.measures for one in found.evaluations)
    with_it = design(elastic(small()), method="sobol", budget=4, workers=1, plans=0)
    assert all("compliance" in with_it.evaluations[k].measures for k in with_it.front)
    same = ("length", "singularity_margin", "limit_margin", "lever")
    for before, after in zip(found.evaluations, with_it.evaluations, strict=True):
        assert all(before.measures.get(name) == after.measures.get(name) for name in same)
