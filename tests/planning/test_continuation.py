"""Breaks inside rows: none where the arm can be followed from one end to the other, and a true reason for the rest."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from comparisons.soak.cells import generate
from scipy.spatial.transform import Rotation

import qparm
from conftest import ROOT
from planning.test_filling import upright
from qparm.planning import ReverseStatistics, joined_rows, problem_of
from qparm.planning.search.continuity import edge_is_continuous


def beside_a_singularity(lean: float, limit: str) -> qparm.Plan:
    """Return a row of 0.2 m along which the wrist passes its singularity at an angle (rad): a4 swings half a turn."""
    data = upright(((0.45, 0.05), (0.47, 0.05)))
    chain = qparm.Cell.load(data).chain()
    T = chain.forward(np.array([[0.2, -1.0, 1.4, 0.3, 0.0, 0.5]]))[0]
    across, along = np.array([np.cos(0.2), np.sin(0.2), 0.0]), np.array([-np.sin(0.2), np.cos(0.2), 0.0])
    x, y, z, w = (Rotation.from_rotvec(lean * across) * Rotation.from_matrix(T[:3, :3])).as_quat()
    places = T[:3, 3] + np.linspace(-0.1, 0.1, 9)[:, None] * along
    lines = "".join(f"{p[0]:.9f},{p[1]:.9f},{p[2]:.9f},{w:.12f},{x:.12f},{y:.12f},{z:.12f}\n" for p in places)
    data["workpiece"]["poses"] = "x,y,z,qw,qx,qy,qz\n" + lines
    for joint in data["arm"]["joints"]:
        joint["position"] = [f"-{limit}", limit]
    return qparm.plan(data)


def test_a_swing_of_the_wrist_within_its_limits_is_driven() -> None:
    plan = beside_a_singularity(0.002, "3.1 rad")
    assert plan.solution.reconfigurations(plan.tool_path) == (0, 0)
    assert plan.row_length_not_worked < 1e-9
    # far from one point to the next, and yet a motion: the curve keeps its path all the way
    assert np.abs(np.diff(plan.solution.q, axis=0)).max() > plan.cell.process.jump
    deviations = plan.joint_path.deviations
    assert deviations is not None
    assert deviations.exact(5e-6, 20e-6).all()
    assert np.abs(np.diff(plan.joint_path.q[plan.joint_path.row >= 0], axis=0)).max() < plan.cell.process.jump


def test_a_swing_beyond_the_limits_is_a_break_that_names_limit_and_singularity() -> None:
    plan = beside_a_singularity(0.002, "2 rad")
    (inside,) = (motion for motion in plan.breaks if motion.place == "row")
    number = r"near a singularity \(smallest singular value 0\.00\d+\)"
    reason = rf"the arm is stopped at point \d+(, [\d.]+ mm on,)? by the limits of [a\d, ]*a[46], {number}"
    assert re.fullmatch(
        rf"going on from point {inside.first} {reason}; coming back from point {inside.last} {reason}", inside.why
    )
    assert plan.search is not None
    assert (plan.search.inside, plan.search.row_ends) == plan.solution.reconfigurations(plan.tool_path) == (1, 0)
    # one gap of nine points is not worked, and the summary says so
    assert plan.row_length_not_worked == pytest.approx(plan.row_length / 8, rel=1e-3)
    text = qparm.report(plan).text()
    assert "0.025 m of 0.2 m of rows not worked" in text
    assert qparm.report(plan).to_dict()["row_length_not_worked"] == plan.row_length_not_worked


def test_a_row_that_was_torn_for_nothing_is_joined_again() -> None:
    """Half of a row on another branch: following it from either side leads to the other end."""
    plan = qparm.plan(upright(tuple((0.45 + 0.02 * k, 0.05) for k in range(6))))
    chain, path, solution = plan.chain, plan.tool_path, plan.solution
    assert solution.driven.all()
    q = solution.q.copy()
    # the wrist turned over: the same pose
    q[3:, 3] -= np.pi * np.sign(q[3:, 3])
    q[3:, 4] *= -1
    q[3:, 5] -= np.pi * np.sign(q[3:, 5])
    np.testing.assert_allclose(chain.forward(q), path.poses, atol=1e-6)
    torn = replace(solution, q=q, driven=np.array([True, True, False, True, True]))
    problem = problem_of(plan.cell)
    assert not edge_is_continuous(problem, torn, 2)
    joined = joined_rows(problem, torn)
    assert joined.driven.all()
    assert all(edge_is_continuous(problem, joined, k) for k in range(5))
    np.testing.assert_allclose(chain.forward(joined.q), path.poses, atol=1e-8)


@pytest.mark.slow
def test_a_six_axis_arm_with_a_free_spin_drives_its_rows_within_its_limits() -> None:
    import tomllib

    data = tomllib.loads((ROOT / "examples" / "six_axis.toml").read_text(encoding="utf-8"))
    data["workpiece"] |= {"radius": "300 mm", "elevation": ["20 deg", "70 deg"], "azimuth": ["-40 deg", "40 deg"]}
    data["workpiece"]["pose"] = {"position": ["0 mm", "1100 mm", "200 mm"]}
    data["process"] |= {"rows": 7, "points": 25, "feed": "50 mm/s", "tool_spin": "free"}
    plan = qparm.plan(data)
    inside, at_ends = plan.solution.reconfigurations(plan.tool_path)
    assert inside == 0
    assert at_ends <= 1
    assert plan.search is not None
    assert (plan.search.inside, plan.search.row_ends) == (inside, at_ends)
    # theta6 rests at its limit on a part of row 5, where the spin gives way
    assert plan.trajectory.reasons == ()


@pytest.mark.parametrize("number", [9, 22])
@pytest.mark.slow
def test_reverse_breaks_no_row_that_can_be_followed(number: int) -> None:
    """Cells on which it left 7 and 14 breaks inside rows, all of which one way along the row does without."""
    document, options = generate(number)
    plan = qparm.plan(document, strategy="reverse", seed=options["seed"])
    assert plan.solution.reconfigurations(plan.tool_path)[0] == 0
    assert plan.trajectory.executable
    assert isinstance(plan.search, ReverseStatistics)
    # what the strategy itself met is told as it was
    assert len(plan.search.jumps) > 0
