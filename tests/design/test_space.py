"""The [design] table, variables named by their path, and what the cell is at a design."""

import numpy as np
import pytest

from conftest import DOME, cell_data
from qparm import Cell, CellError, InvalidInput
from qparm.cell.design import own_value
from qparm.design.space import DesignSpace, link_length

RANGE = {"range": ["300 mm", "600 mm"]}


def problems(design):
    data = cell_data()
    data["design"] = design
    with pytest.raises(CellError) as caught:
        Cell.load(data)
    return dict(caught.value.problems)


def test_the_reference_cell_says_what_the_paper_varies():
    space = DesignSpace.of(DOME)
    assert space.keys == ("arm.lengths.L1", "arm.lengths.L3")
    assert [(v.lower, v.upper) for v in space.variables] == [(0.3, 0.6), (0.3, 0.5)]
    assert space.own.tolist() == [0.48, 0.418]
    assert space.shown(space.own) == "L1 480 mm, L3 418 mm"


def test_a_cell_with_a_design_is_saved_and_read_back(tmp_path):
    cell = Cell.load(DOME)
    cell.save(tmp_path / "cell.toml")
    assert Cell.load(tmp_path / "cell.toml") == cell


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("arm.lengths.L2", 0.4),
        ("arm.joints.d1.position[1]", 0.8),
        ("arm.joints[0].position[1]", 0.8),
        ("arm.joints.theta2.velocity", np.radians(60)),
        ("workpiece.pose.position[1]", 1.5),
        ("workpiece.pose.rpy[0]", 0.0),
        ("arm.tool.position[2]", 0.0),
    ],
)
def test_any_quantity_is_a_variable(key, value):
    data = Cell.load(DOME).to_dict()
    found, dimension = own_value(data, key)
    assert found == pytest.approx(value, abs=1e-12)
    ends = {"length": ["1 m", "2 m"], "angle": ["1 deg", "2 deg"], "angular velocity": ["50 deg/s", "90 deg/s"]}
    space = DesignSpace.of(DOME, ranges={key: ends[dimension]})
    middle = 0.5 * (space.problem(("length",)).lower + space.problem(("length",)).upper)
    changed = space.cell_at(middle)
    assert own_value(changed.to_dict(), key)[0] == middle[-1]
    assert changed.design is None


def test_moving_the_workpiece_moves_every_pose():
    space = DesignSpace.of(DOME, ranges={"workpiece.pose.position[0]": ("-100 mm", "100 mm")})
    x = space.own + np.array([0.0, 0.0, 0.05])
    moved, before = space.cell_at(x).tool_path().poses, Cell.load(DOME).tool_path().poses
    assert np.allclose(moved[:, :3, 3] - before[:, :3, 3], [0.05, 0, 0], atol=1e-12)


def test_all_that_is_wrong_is_told_at_once_with_the_key():
    told = problems({
        "variables": {
            "arm.lengths.L9": RANGE,
            "arm.joints.d1.position": RANGE,
            "arm.joints.theta2.dh.a": RANGE,
            "process.rows": RANGE,
            "workpiece.radius": {"range": ["1 deg", "2 deg"]},
            "arm.joints.elbow.position[0]": RANGE,
            "a..b": RANGE,
        }
    })  # fmt: skip
    where = {key.removeprefix("design.variables."): sentence for key, sentence in told.items()}
    assert where['"arm.lengths.L9"'] == "there is no 'L9' in arm.lengths (known: L1, L2, L3, L4)"
    assert "name one of them, such as arm.joints.d1.position[0]" in where['"arm.joints.d1.position"']
    assert where['"arm.joints.theta2.dh.a"'] == "is the name 'L1'; vary arm.lengths.L1"
    assert "not a quantity" in where['"process.rows"']
    assert "must be a length" in where['"workpiece.radius".range']
    assert "there is no 'elbow' in arm.joints (known: d1, theta2" in where['"arm.joints.elbow.position[0]"']
    assert "is not a path" in where['"a..b"']


@pytest.mark.parametrize(
    ("variable", "word"),
    [
        ({"range": ["600 mm", "300 mm"]}, "reversed"),
        ({"range": ["300 mm", "300 mm"]}, "reversed or equal"),
        ({"range": [300, 600]}, "has no unit"),
        ({"range": ["300 mm", "60 deg"]}, "'60 deg' an angle"),
        ({"range": ["nan mm", "600 mm"]}, "not finite"),
        ({"range": ["300 mm"]}, "list of two"),
        ({"range": "300 mm"}, "list of two"),
        ({}, "is missing"),
        (RANGE | {"extend": ["350 mm", "700 mm"]}, "must include range"),
        (RANGE | {"extend": ["1 deg", "2 deg"]}, "must be a length like range"),
        (RANGE | {"rnge": 1}, "did you mean 'range'"),
    ],
)
def test_a_range_that_is_none_is_refused(variable, word):
    (sentence,) = problems({"variables": {"arm.lengths.L1": variable}}).values()
    assert word in sentence


def test_the_same_quantity_twice_is_refused():
    told = problems({"variables": {"arm.joints[0].position[1]": RANGE, "arm.joints.d1.position[1]": RANGE}})
    assert list(told.values()) == ["is the same quantity as arm.joints[0].position[1]"]


def test_a_bound_at_which_the_cell_is_not_valid_is_named():
    told = problems({"variables": {"arm.joints.d1.position[1]": {"range": ["-1 m", "1 m"]}}})
    assert list(told) == ['design.variables."arm.joints.d1.position[1]".range']
    assert "at -1 m the cell is not valid: arm.joints[0].position" in next(iter(told.values()))


def test_a_path_without_quotes_is_explained():
    told = problems({"variables": {"arm": {"lengths": {"L1": RANGE}}}})
    assert "in quotes" in told["design.variables"]


@pytest.mark.parametrize(
    ("more", "word"),
    [
        ({"objectives": []}, "at least 1"),
        ({"objectives": ["length", "lever", "limit_margin", "motion_time"]}, "at most 3 entries, not 4"),
        ({"objectives": ["length", "length"]}, "repeated: length"),
        ({"objectives": ["lenght"]}, "must be 'length'"),
        ({"limits": {"largest_stepp": "3 deg"}}, "did you mean 'largest_step'"),
        ({"limits": {"largest_step": 3}}, "has no unit"),
        ({"limits": {"reconfigurations": "3"}}, "must be a number"),
    ],
)
def test_objectives_and_limits_are_checked(more, word):
    (sentence,) = problems({"variables": {"arm.lengths.L1": RANGE}} | more).values()
    assert word in sentence


def test_a_cell_in_which_nothing_may_be_chosen_is_refused():
    data = cell_data()
    del data["design"]
    with pytest.raises(InvalidInput, match="nothing in it may be chosen"):
        DesignSpace.of(data)
    assert DesignSpace.of(data, ranges={"arm.lengths.L1": ("300 mm", "600 mm")}).keys == ("arm.lengths.L1",)


def test_values_that_cannot_be_are_refused():
    cell = Cell.load(DOME)
    with pytest.raises(InvalidInput, match="not finite"):
        cell.with_values({"arm.lengths.L1": float("nan")})
    with pytest.raises(InvalidInput, match="no 'L9'"):
        cell.with_values({"arm.lengths.L9": 0.4})


def test_length_is_the_sum_of_the_links_and_known_without_evaluation():
    space = DesignSpace.of(DOME)
    assert link_length(space.cell_at((0.48, 0.418)).chain()) == pytest.approx(0.48 + 0.4 + 0.418 + 0.12, abs=1e-12)
    exact = space.problem(("length",)).objectives[0].exact
    X = np.random.default_rng(0).uniform(0.3, 0.5, (5, 2))
    assert exact(X) == pytest.approx(X.sum(axis=1) + 0.52, abs=1e-12)


def test_length_that_is_not_affine_is_not_taken_for_known():
    data = cell_data()
    # two legs of one link: its length is the root of the sum of their squares
    data["arm"]["joints"][3]["dh"]["a"] = "200 mm"
    data["design"] = {"variables": {"arm.lengths.L2": RANGE}}
    assert DesignSpace.of(data).problem(("length",)).objectives[0].exact is None
