"""Corners: a row begins in the pose in which the one before ends, and the arm rests there or moves in place."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import qparm
from made_arm import elsewhere_data, pose_list, row_of_poses
from qparm.export import export_trajectory
from qparm.path import SegmentKind
from qparm.planning import PathSolution, problem_of, rest_at_corners
from qparm.planning.search.projection import velocity_scale
from qparm.verify import read_motion, verify_motion


def corner_data() -> dict[str, Any]:
    """Return a cell whose rows go out, up and back: two corners."""
    out = row_of_poses(11)
    up = np.tile(out[-1], (6, 1, 1))
    up[:, 2, 3] += np.linspace(0.0, 0.1, 6)
    back = out[::-1].copy()
    back[:, 2, 3] += 0.1
    data = elsewhere_data()
    data["workpiece"]["poses"] = pose_list(out, up, back)
    return data


@pytest.fixture(scope="module")
def unsmoothed() -> qparm.Plan:
    """Return a plan whose arm moves at a corner, the tool standing."""
    return qparm.plan(corner_data(), smooth=False, seed=1)


@pytest.mark.parametrize(
    ("strategy", "smooth", "timing"),
    [("general", False, "quintic"), ("general", False, "ruckig"), ("reverse", False, "quintic"),
     ("reverse", True, "quintic"), ("graph", True, "quintic"), ("graph", True, "ruckig")],
)  # fmt: skip
@pytest.mark.slow
def test_the_arm_stays_on_the_path_at_a_corner(tmp_path: Path, strategy: Any, smooth: bool, timing: Any) -> None:
    plan = qparm.plan(corner_data(), strategy=strategy, smooth=smooth, timing=timing)
    report = qparm.report(plan)
    assert report.executable, report.reasons
    assert [motion.kind.value for motion in plan.breaks] == ["approach", "retract"]
    assert plan.solution.reconfigurations(plan.tool_path) == (0, 0)
    assert not report.figures.reconfigurations
    for to, period in (("csv", 0.02), ("csv", 0.001), ("json", None)):
        file = tmp_path / f"{period}.{to}"
        export_trajectory(plan.trajectory, file, to=to, units=["rad"] * plan.chain.n, period=period)
        assert verify_motion(read_motion(file, plan.cell), plan.cell).problems() == ()


def test_where_the_configuration_is_the_same_the_arm_rests_a_millisecond() -> None:
    plan = qparm.plan(corner_data(), strategy="general")
    path, knots = plan.joint_path, plan.trajectory.knots
    corners = [segment for segment in path.segments if segment.kind is SegmentKind.TRANSITION]
    assert len(corners) == 2
    for segment in corners:
        assert segment.last == segment.first + 1
        np.testing.assert_array_equal(path.q[segment.first], path.q[segment.last])
        assert path.point[segment.last] == path.point[segment.first] + 1
        assert knots[segment.last] - knots[segment.first] == pytest.approx(1e-3)
        np.testing.assert_array_equal(plan.trajectory(knots[segment.first : segment.last + 1], 1), 0.0)


@pytest.mark.parametrize("period", [0.001, 0.008, 0.02])
def test_samples_of_an_arm_that_moves_while_the_tool_stands_belong_to_either(
    unsmoothed: qparm.Plan, tmp_path: Path, period: float
) -> None:
    plan = unsmoothed
    moves = [
        plan.trajectory.knots[segment.last] - plan.trajectory.knots[segment.first]
        for segment in plan.joint_path.segments
        if segment.kind is SegmentKind.TRANSITION
    ]
    assert max(moves) > 0.02, "it takes several samples"
    file = tmp_path / "motion.csv"
    export_trajectory(plan.trajectory, file, to="csv", units=["rad"] * plan.chain.n, period=period)
    assert verify_motion(read_motion(file, plan.cell), plan.cell).problems() == ()


def meeting(plan: qparm.Plan, apart: float, *, turns: float = 0.0) -> tuple[PathSolution, int, np.ndarray]:
    """Return a solution whose configurations at the first corner are so far apart, the corner, and what they were."""
    q, rho = plan.solution.q.copy(), plan.solution.rho.copy()
    k = len(plan.tool_path.rows[0].s) - 1
    q[k + 1] = q[k] + apart * velocity_scale(plan.chain)
    rho[k + 1 :, 2] += turns
    return PathSolution(q, rho, plan.solution.reached, plan.solution.driven), k, q


def test_only_what_is_nearly_one_configuration_becomes_one(unsmoothed: qparm.Plan) -> None:
    plan, P = unsmoothed, unsmoothed.tool_path.point_count
    wide = np.full((P - 1, plan.chain.n), 1.0)
    for apart, joined in ((9e-5, True), (1.1e-4, False)):
        solution, k, q = meeting(plan, apart)
        found = rest_at_corners(replace(problem_of(plan.cell), jump=wide), solution)
        assert np.array_equal(found.q[k + 1], found.q[k]) == joined
        np.testing.assert_array_equal(np.delete(found.q, k + 1, axis=0)[: k + 2], np.delete(q, k + 1, axis=0)[: k + 2])


def test_a_step_that_would_be_too_large_is_not_made_larger(unsmoothed: qparm.Plan) -> None:
    plan, P = unsmoothed, unsmoothed.tool_path.point_count
    solution, k, q = meeting(plan, 9e-5)
    steps = np.abs(np.diff(q, axis=0))
    tight = np.full((P - 1, plan.chain.n), 1.0)
    tight[k + 1] = steps[k + 1]
    found = rest_at_corners(replace(problem_of(plan.cell), jump=tight), solution)
    np.testing.assert_array_equal(found.q[k + 1], q[k + 1])
    np.testing.assert_array_equal(found.q[k], q[k + 1])
    tight[k - 1] = steps[k - 1]
    found = rest_at_corners(replace(problem_of(plan.cell), jump=tight), solution)
    np.testing.assert_array_equal(found.q, q)


def test_the_spin_of_a_row_does_not_leap_by_a_turn(unsmoothed: qparm.Plan) -> None:
    plan, P = unsmoothed, unsmoothed.tool_path.point_count
    solution, k, _ = meeting(plan, 9e-5, turns=2 * np.pi)
    found = rest_at_corners(replace(problem_of(plan.cell), jump=np.full((P - 1, plan.chain.n), 1.0)), solution)
    assert found.rho[k + 1, 2] == pytest.approx(found.rho[k, 2] + 2 * np.pi)
