"""The cell that needs reconfigurations: counted by a graph of the test's own, not by any strategy."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

import qparm
from conftest import ROOT

# one inside a row is worth more than all row ends together
IN_ROW, AT_ROW_END = 1000, 1


def poses_of(cell: qparm.Cell) -> tuple[np.ndarray, list[bool]]:
    """Return all poses in order, via poses of the transitions included, and which are via poses."""
    tool_path = cell.tool_path()
    poses, via = [], []
    for row in range(len(tool_path.rows)):
        of_row = tool_path.poses[tool_path.row_of_point == row]
        between = tool_path.transition_poses(row) if row < len(tool_path.transitions) else np.empty((0, 4, 4))
        poses += [*of_row, *between]
        via += [False] * len(of_row) + [True] * len(between)
    return np.stack(poses), via


def least_cost(samples: list[np.ndarray], via: list[bool], bound: np.ndarray) -> int:
    """Return the least sum of the prices of steps over the bound."""
    cost = np.zeros(len(samples[0]), dtype=np.int64)
    for (a, b), (via_a, via_b) in zip(pairwise(samples), pairwise(via), strict=True):
        price = AT_ROW_END if via_a or via_b else IN_ROW
        joined = (np.abs(b[:, None] - a[None]) <= bound).all(axis=2)
        cost = np.minimum(np.where(joined, cost, np.iinfo(np.int64).max).min(axis=1), cost.min() + price)
    return int(cost.min())


@pytest.mark.slow
def test_it_needs_one_reconfiguration_in_a_row_and_one_at_a_row_end() -> None:
    cell = qparm.Cell.load(ROOT / "examples" / "reconfiguration.toml")
    chain, (poses, via) = cell.chain(), poses_of(cell)
    batch = qparm.solve_poses(chain, poses, restarts=800, rng=np.random.default_rng(0), every_start=True)
    samples = [q[reached] for q, reached in zip(batch.q, batch.reached, strict=True)]
    assert min(map(len, samples)) > 50, "every pose can be reached"
    for factor in (1.0, 1.8):
        assert least_cost(samples, via, factor * cell.jump()) == IN_ROW + AT_ROW_END
    # the count falls where the limits are put back, so it is the limits that cause it
    data = cell.to_dict()
    data["arm"]["joints"][5]["position"][0] = "-170 deg"
    loose = qparm.Cell.load(data).chain()
    batch = qparm.solve_poses(loose, poses, restarts=400, rng=np.random.default_rng(0), every_start=True)
    samples = [q[reached] for q, reached in zip(batch.q, batch.reached, strict=True)]
    assert least_cost(samples, via, cell.jump()) == 0


@pytest.mark.slow
def test_a_break_between_points_of_a_self_motion_area_counts_as_at_the_row_end() -> None:
    data = qparm.Cell.load(ROOT / "examples" / "reconfiguration.toml").to_dict()
    data["process"]["self_motion"]["points"] = 3
    plan = qparm.plan(data)
    report = qparm.report(plan)
    places = [jump.place for jump in report.figures.reconfigurations]
    assert sorted(places) == ["row", "row end"]
    inside, ends = plan.solution.reconfigurations(plan.tool_path)
    assert (places.count("row"), places.count("row end")) == (inside, ends)
    breaks = [motion for motion in plan.breaks if motion.kind.value == "break"]
    assert [motion.place for motion in breaks] == places
    assert [bool(motion.why) for motion in breaks] == [place == "row" for place in places]
    # the times told are those driven, each from one row's last waypoint to where the work goes on
    driven: list[float] = []
    segments = plan.trajectory.segments
    for before, segment in pairwise(segments):
        if segment.kind.value == "break":
            driven = driven if before.kind.value == "break" else [*driven, 0.0]
            driven[-1] += segment.end - segment.start
    np.testing.assert_allclose([motion.time for motion in breaks], driven, rtol=1e-12)
    for motion in breaks:
        assert f"{motion.name}: {motion.escape}, {motion.time:.2f} s" in report.text()
