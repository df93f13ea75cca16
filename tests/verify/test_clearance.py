"""Off the rows: what dips, travels too near or turns back is found, between the knots too, and named."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import qparm
from conftest import cell_data
from qparm.planning import Motion, plan_motion
from qparm.planning.moves.clearance import ToolDistance
from qparm.verify.clearance import ClearanceFigures, judge_stretch, measure_clearance
from qparm.verify.files import KnotTable, WaypointTable
from qparm.verify.kinematics import joint_transforms


def measured(
    cell: qparm.Cell,
    q: list[np.ndarray],
    kind: list[str],
    *,
    row: list[int] | None = None,
    status: str = "after jump",
) -> ClearanceFigures:
    """Measure a path that rests at every waypoint: quintics from rest to rest, four seconds each."""
    count = len(q)
    index = np.cumsum([k == "row" for k in kind]) - 1
    waypoints = WaypointTable(
        joints=tuple(joint.name for joint in cell.arm.joints),
        index=np.where([k == "row" for k in kind], index, -1),
        row=np.array(row or [0] * count),
        kind=np.array(kind),
        status=np.array([status] * count),
        s=np.zeros(count),
        q=np.array(q),
    )
    t = 4.0 * np.arange(count)
    derivatives = np.zeros((3, count, len(q[0])))
    derivatives[0] = q
    return measure_clearance(cell, waypoints, KnotTable(waypoints.joints, t, derivatives), t)


def solved(cell: qparm.Cell, height: float, point: int = 457, near: np.ndarray | None = None) -> np.ndarray:
    """Return a configuration whose tool stands at a height over a point."""
    pose = cell.tool_path().poses[point].copy()
    pose[:3, 3] -= height * pose[:3, 2]
    rng = np.random.default_rng(0)
    return qparm.solve_pose(cell.chain(), pose, near, restarts=50, rng=rng).q


def test_a_planned_break_is_clear_and_its_figure_is_the_planners(dome: qparm.Cell) -> None:
    T, surface = dome.workpiece.pose.matrix(), dome.workpiece.surface()
    batch = qparm.solve_poses(
        dome.chain(), dome.tool_path().poses[[100]], restarts=20, rng=np.random.default_rng(3), every_start=True
    )
    a, b = batch.q[0][batch.reached[0]][[0, -1]]
    motion = plan_motion(
        dome.chain(), a, b, distance=ToolDistance(dome.chain(), lambda p: surface.distance((p - T[:3, 3]) @ T[:3, :3])),
        clearance=dome.process.clearance, from_surface=True, to_surface=True, rng=np.random.default_rng(0),
    )  # fmt: skip
    assert isinstance(motion, Motion)
    assert all(len(piece) == 2 for piece in motion.pieces)
    q = [motion.pieces[0][0], *(piece[-1] for piece in motion.pieces)]
    figures = measured(dome, q, ["row", *["break"] * (len(q) - 2), "row"])
    assert figures.faults == ()
    # the way off counts as soon as it is clear, so what is measured may be nearer than what travels
    assert dome.process.clearance - 1e-6 <= figures.least_clearance <= motion.least_clearance + 1e-3
    assert figures.least_distance == pytest.approx(0.0, abs=1e-8)
    straight = measured(dome, [a, b], ["row", "row"])
    Q = a + np.linspace(0, 1, 20_000)[:, None] * (b - a)
    depth = surface.distance((joint_transforms(dome, Q)[0][:, :3, 3] - T[:3, 3]) @ T[:3, :3]).min()
    assert depth < -0.01
    assert [fault.what for fault in straight.faults] == ["inside"]
    assert straight.least_distance == pytest.approx(depth, abs=1e-5)
    assert straight.faults[0].segment == "break in row 0"


def lifted(cell: qparm.Cell, *heights: float) -> list[np.ndarray]:
    q = [solved(cell, heights[0])]
    for height in heights[1:]:
        q.append(solved(cell, height, near=q[-1]))
    return q


@pytest.mark.parametrize(
    ("heights", "what", "distance"),
    [
        ((0.0, 0.03, 0.0), None, 0.03),
        ((0.0, 0.03, 0.025, 0.03, 0.0), None, 0.025),
        ((0.0, 0.019, 0.0), "too near", 0.019),
        ((0.0, 0.03, 0.015, 0.03, 0.0), "too near", 0.015),
        ((0.0, 0.012, 0.008, 0.03, 0.0), "turns back", 0.008),
        ((0.0, 0.03, 0.006, 0.011, 0.0), "turns back", 0.006),
        ((0.0, 0.03, -0.0005, 0.0), "inside", -0.0005),
    ],
)
def test_each_fault_is_found_where_it_is(
    dome: qparm.Cell, heights: tuple[float, ...], what: str | None, distance: float
) -> None:
    q = lifted(dome, *heights)
    figures = measured(dome, q, ["row", *["break"] * (len(q) - 2), "row"])
    if what is None:
        assert figures.faults == ()
        return
    assert [fault.what for fault in figures.faults] == [what]
    (fault,) = figures.faults
    assert fault.distance == pytest.approx(distance, abs=2e-4)
    assert fault.time == pytest.approx(4.0 * heights.index(distance), abs=0.6)
    assert fault.segment == "break in row 0"


def test_approach_and_retract_must_be_clear_from_home_on(dome: qparm.Cell) -> None:
    near_home, up, down = lifted(dome, 0.01, 0.03, 0.0)
    kinds = ["approach", "approach", "row", "row", "retract", "retract"]
    next_down = solved(dome, 0.0, 458, down)
    next_up = solved(dome, 0.03, 458, next_down)
    figures = measured(dome, [near_home, up, down, next_down, next_up, next_up + 1e-3], kinds, status="reached")
    assert [(fault.segment, fault.what) for fault in figures.faults] == [("approach", "too near")]
    assert figures.faults[0].time == pytest.approx(0.0, abs=0.1)
    clear = measured(dome, [up, up + 1e-3, down, next_down, next_up, next_up + 1e-3], kinds, status="reached")
    assert clear.faults == ()


def test_a_transition_may_touch_but_not_dip(dome: qparm.Cell) -> None:
    """Between its via poses, where no waypoint shows it."""
    T, surface, chain = dome.workpiece.pose.matrix(), dome.workpiece.surface(), dome.chain()
    starts = qparm.solve_poses(
        chain, dome.tool_path().poses[[60]], restarts=20, rng=np.random.default_rng(0), every_start=True
    )
    poses = [*dome.tool_path().transition_poses(0), dome.tool_path().poses[61]]
    depth, q = 0.0, []
    for start in starts.q[0][starts.reached[0]]:
        way = [start]
        for pose in poses:
            way.append(qparm.solve_pose(chain, pose, way[-1]).q)
        u = np.linspace(0, 1, 200)[:, None]
        Q = np.concatenate([a + u * (b - a) for a, b in pairwise(way)])
        least = surface.distance((joint_transforms(dome, Q)[0][:, :3, 3] - T[:3, 3]) @ T[:3, :3]).min()
        if least < depth:
            depth, q = least, way
    assert depth < -2e-5, "straight lines in joint space cut the corner"
    kinds = ["row", *["transition"] * (len(q) - 2), "row"]
    figures = measured(dome, q, kinds, row=[*[0] * (len(q) - 1), 1], status="reached")
    assert figures.least_distance == pytest.approx(depth, abs=1e-6)
    assert [(fault.segment, fault.what) for fault in figures.faults] == [("transition after row 0", "inside")]
    assert np.isnan(figures.least_clearance)


@pytest.mark.parametrize(("between", "depth"), [("26 um", 26e-6), ("5 um", 5e-6), ("1 um", 5e-6)])
def test_a_transition_may_be_as_deep_as_the_tool_may_be_off_its_path(between: str, depth: float) -> None:
    data = cell_data()
    data["process"]["position_between"] = between
    process = qparm.Cell.load(data).process
    t = np.linspace(0.0, 1.0, 5)
    for share, faults in ((0.99, 0), (1.01, 1)):
        d = np.array([0.0, 0.0, -share * depth, 0.0, 0.0])
        found = judge_stretch("transition", "transition after row 0", t, d, process)[2]
        assert [one.what for one in found] == ["inside"] * faults


@pytest.mark.slow
def test_the_report_refuses_what_dips_and_tells_how_near(tmp_path: Path) -> None:
    data = cell_data()
    data["process"] |= {"rows": 2, "points": 21}
    plan = qparm.plan(data)
    report = qparm.write(plan, tmp_path, pictures=False)
    figures = report.figures.clearance
    assert figures.faults == ()
    assert report.executable
    assert figures.required == 0.02
    strict = plan.cell.to_dict()
    strict["process"]["clearance"] = "5 m"
    refused = qparm.report(replace(plan, cell=qparm.Cell.load(strict)))
    assert any("clearance on the" in sentence and "allowed 5000 mm" in sentence for sentence in refused.reasons)
