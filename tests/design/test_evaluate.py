"""One design, level by level: against reach that is known otherwise, and against definitions written out here."""

import numpy as np
import pytest

import qparm
from design.made_cells import small
from qparm import Cell, check_reach
from qparm.design.attainable import attainable_measures, soft_minimum
from qparm.design.coverage import point_weights, screened
from qparm.design.evaluate import ATTAINED, LEVELS, Evaluation, evaluate
from qparm.design.space import DesignSpace
from qparm.reach import reach_of_designs
from qparm.robot.reach import reach_excess

FULL = ("singularity_margin", "singularities")


@pytest.fixture(scope="module")
def space():
    return DesignSpace.of(small())


@pytest.mark.parametrize(("x", "missed"), [((0.48, 0.418), 0), ((0.5, 0.4), 0), ((0.46, 0.4), 2), ((0.44, 0.38), 12)])
def test_the_dome_is_covered_where_the_facts_say_so(x, missed):
    found = evaluate(DesignSpace.of("examples/dome.toml"), x, level=2)
    assert found.missed == missed
    assert found.valid == (missed == 0)
    assert found.measures["length"] == pytest.approx(sum(x) + 0.52, abs=1e-12)


def test_a_design_that_fails_goes_no_further(space):
    found = evaluate(space, (0.3, 0.3), level=4, names=FULL)
    assert LEVELS[found.level] == "screen"
    assert not found.valid
    assert 0 < found.coverage < 1
    assert "out of the links' reach" in found.reason
    assert set(found.measures) == {"length"}


def test_the_violation_is_graded_by_what_is_missed(space):
    by_length = [evaluate(space, (L, L), level=2).violation for L in (0.3, 0.31, 0.32, 0.36)]
    assert by_length == sorted(by_length, reverse=True)
    assert by_length[0] > by_length[1] > 0
    assert by_length[-1] == 0


def test_what_is_proved_out_of_reach_no_start_reaches(space, rng):
    cell = space.cell_at((0.3, 0.3))
    tool_path = cell.tool_path()
    coverage = screened(cell.chain(), tool_path, cell.relaxation())
    out = np.flatnonzero(~coverage.reached)
    assert len(out)
    verdicts = check_reach(cell.chain(), tool_path.poses[out], rng=rng, starts=30)
    assert all(verdict.reason != "within reach" for verdict in verdicts)


@pytest.mark.slow
def test_a_design_that_needs_the_tool_to_lean_is_valid_and_can_be_planned():
    data = small()
    x = (0.335, 0.335)
    assert not evaluate(DesignSpace.of(data), x, level=2).valid
    data["process"]["tool_tilt"] = "15 deg"
    space = DesignSpace.of(data)
    assert evaluate(space, x, level=2).valid
    planned = qparm.plan(space.cell_at(x), seed=0)
    assert not len(planned.record.unreached)
    stands = planned.chain.forward(planned.solution.q)[:, :3, :3]
    axis = (stands[:, :, 2] * planned.tool_path.poses[:, :3, 2]).sum(axis=1)
    assert np.arccos(axis.clip(-1, 1)).max() <= np.radians(15.0) + 1e-6


@pytest.mark.slow
def test_the_screen_refuses_nothing_that_a_leaning_tool_reaches():
    data = small()
    data["process"] |= {"tool_tilt": "15 deg", "tool_spin": "free"}
    space = DesignSpace.of(data)
    for L in (0.3, 0.31, 0.32, 0.33):
        cell = space.cell_at((L, L))
        tool_path, relaxation = cell.tool_path(), cell.relaxation()
        proved = ~screened(cell.chain(), tool_path, relaxation).reached
        found = reach_of_designs([cell.chain()], tool_path.poses, relaxation=relaxation, restarts=60, seed=5)
        assert not (found.reached[0] & proved).any()
        # every lean that the proof speaks of, tried with the bound of a tool that does not lean
        for rho in relaxation.random(np.random.default_rng(1), 200):
            turned = relaxation.targets(tool_path.poses, np.tile(rho, (len(proved), 1)))
            assert (np.maximum(*reach_excess(cell.chain(), turned))[proved] > 0).all()


def test_weights_share_the_rows_among_their_points(space):
    tool_path = space.cell.tool_path()
    assert point_weights(tool_path).sum() == pytest.approx(sum(row.length for row in tool_path.rows), rel=1e-9)


def test_a_design_at_which_the_cell_is_not_valid_is_the_worst():
    space = DesignSpace.of(small(), ranges={"arm.joints.d1.position[0]": ("-100 mm", "0 mm")})
    home_outside = evaluate(space, (*space.own[:2], 0.1), level=2)
    assert home_outside.violation > 1
    assert "not a valid cell: arm.home" in home_outside.reason


def test_an_evaluation_depends_on_the_design_alone(space):
    x = (0.45, 0.44)
    first = evaluate(space, x, level=3, names=FULL)
    for other in ((0.31, 0.31), (0.59, 0.49)):
        evaluate(space, other, level=3, names=FULL)
    assert evaluate(DesignSpace.of(small()), x, level=3, names=FULL) == first


def test_what_is_known_is_not_done_again_and_gives_the_same(space):
    x = (0.45, 0.44)
    reached = evaluate(space, x, level=2)
    on = evaluate(space, x, level=3, names=FULL, known=reached)
    assert on == evaluate(space, x, level=3, names=FULL)
    assert set(on.seconds) == {3}
    assert evaluate(space, x, level=2, known=on) is on


def test_it_survives_being_written_down(space):
    import json

    found = evaluate(space, (0.45, 0.44), level=3, names=FULL)
    again = Evaluation.from_dict(json.loads(json.dumps(found.to_dict())))
    assert again == found
    assert again.seconds == found.seconds


def test_no_configuration_is_farther_from_singularities_than_is_said_to_be_attainable(space, rng):
    """Against random starts and singular values of a Jacobian by differences, at one point."""
    cell = Cell.load(space.data | {"process": space.data["process"] | {"rows": 1, "points": 2}})
    chain, poses = cell.chain(), cell.tool_path().poses
    told = attainable_measures(cell, cell.tool_path(), seed=0)
    batch = qparm.solve_poses(chain, np.repeat(poses, 300, axis=0), rng=rng, restarts=1)
    best = []
    for k in range(2):
        rows = batch.q[300 * k : 300 * (k + 1)][batch.reached[300 * k : 300 * (k + 1)]]
        margins = []
        for q in rows:
            J = chain.jacobian(q) * np.where(chain.prismatic, chain.characteristic_length, 1.0)
            J[:3] /= chain.characteristic_length
            margins.append(np.linalg.svd(J, compute_uv=False)[-1])
        best.append(max(margins))
    # what is drawn at random is a bound from below, and near
    assert 0.999 * soft_minimum(np.array(best)) <= told["singularity_margin"] <= 1.1 * soft_minimum(np.array(best))


def test_attainable_measures_do_not_depend_on_luck(space):
    """The paper's count differs between draws as much as between designs; these do not."""
    cell = space.cell_at((0.58, 0.48))
    told = [attainable_measures(cell, cell.tool_path(), seed=seed) for seed in range(3)]
    margins = [one["singularity_margin"] for one in told]
    assert max(margins) - min(margins) < 0.01
    assert all(one["reconfigurations"] == 0 for one in told)
    assert set(told[0]) == set(ATTAINED) - {"compliance"}, "the cell has no stiffnesses"
    cell = space.cell_at((0.58, 0.48))
    asked = attainable_measures(cell, cell.tool_path(), seed=0, names=["limit_margin"])
    assert asked == {"limit_margin": told[0]["limit_margin"]}, "what else is asked for changes nothing"


def test_a_soft_minimum_is_near_the_least():
    values = np.array([0.3, 0.5, 0.9])
    assert 0.3 <= soft_minimum(values) <= 0.3 + 0.02 * np.log(3) + 1e-12
    assert soft_minimum(np.full(7, 0.4)) == pytest.approx(0.4, abs=1e-12)
