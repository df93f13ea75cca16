"""The report must notice: every figure changes when the file it is taken from does."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import qparm
from conftest import cell_data, few_rows
from qparm.verify import measure, read_knots, read_samples, read_waypoints, verify_motion
from qparm.verify.motion import motion_of_knots

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> tuple[qparm.Cell, Path]:
    """Return an executable plan's cell and folder."""
    data = few_rows()
    folder = tmp_path_factory.mktemp("good")
    plan = qparm.plan(data)
    assert qparm.write(plan, folder, pictures=False).executable
    return plan.cell, folder


def tables(folder: Path):
    return (
        read_waypoints(folder / "joint_path.csv"),
        read_samples(folder / "trajectory.csv"),
        read_knots(folder / "trajectory.json"),
    )


def test_the_unaltered_files_pass(good: tuple[qparm.Cell, Path]) -> None:
    figures = measure(good[0], *tables(good[1]))
    assert figures.findings(verify_motion(motion_of_knots(tables(good[1])[2]), good[0]), good[0].process) == ()
    assert figures.reached == figures.points == 33
    assert figures.columns_consistent
    assert figures.waypoint_deviation < 1e-9


def test_a_waypoint_off_by_a_hair_is_not_reached(good: tuple[qparm.Cell, Path]) -> None:
    waypoints, samples, knots = tables(good[1])
    q = waypoints.q.copy()
    q[5, 3] += 1e-5
    figures = measure(good[0], replace(waypoints, q=q), samples, knots)
    assert figures.reached == 32
    assert figures.unreached[0].reason == "beyond tolerance"
    assert figures.position_error_max > 1e-6
    motion = verify_motion(motion_of_knots(knots), good[0])
    assert [
        (one.code, one.amount) for one in figures.findings(motion, good[0].process) if one.subject == "joint path"
    ] == [("files-differ", 1)]


def test_a_missing_waypoint_is_not_reached(good: tuple[qparm.Cell, Path]) -> None:
    waypoints, samples, knots = tables(good[1])
    keep = waypoints.index != 6
    fewer = replace(
        waypoints, index=waypoints.index[keep], row=waypoints.row[keep], kind=waypoints.kind[keep],
        status=waypoints.status[keep], s=waypoints.s[keep], q=waypoints.q[keep],
    )  # fmt: skip
    figures = measure(good[0], fewer, samples, knots)
    assert [point.index for point in figures.unreached] == [6]
    few = np.unique(np.linspace(0, len(knots.t) - 1, len(waypoints.q) - 1).astype(int))
    with pytest.raises(qparm.InvalidInput, match="do not belong together"):
        measure(good[0], waypoints, samples, replace(knots, t=knots.t[few], derivatives=knots.derivatives[:, few]))


@pytest.mark.parametrize("joint", range(8))
@pytest.mark.parametrize("order", [0, 1, 2])
def test_a_sample_beyond_what_the_jerk_limits_allow_is_noticed(
    good: tuple[qparm.Cell, Path], order: int, joint: int
) -> None:
    """A sample is proved wrong if no motion within the jerk limit passes through it and its neighbours."""
    waypoints, samples, knots = tables(good[1])
    derivatives = samples.derivatives.copy()
    h, J = 0.02, good[0].arm.joints[joint].jerk
    least = (0.07 * h**3 * J, 0.5 * h**2 * J, 2.1 * h * J)[order]
    middle = derivatives.shape[1] // 2
    derivatives[order, middle, joint] += least
    assert not measure(good[0], waypoints, replace(samples, derivatives=derivatives), knots).columns_consistent


@pytest.mark.parametrize(("order", "name"), [(1, "velocity"), (2, "acceleration"), (3, "jerk")])
def test_a_share_over_the_limit_is_a_problem(good: tuple[qparm.Cell, Path], order: int, name: str) -> None:
    waypoints, samples, knots = tables(good[1])
    derivatives = samples.derivatives.copy()
    limit = getattr(good[0].arm.joints[2], name)
    derivatives[order, 10, 2] = -1.01 * limit
    figures = measure(good[0], waypoints, replace(samples, derivatives=derivatives), knots)
    assert getattr(figures.joints[2], f"{name}_share") == pytest.approx(1.01)
    motion = verify_motion(motion_of_knots(knots), good[0])
    assert f"joint 'theta3': {name} in the files 101.00%, allowed 100.0000%" in [
        one.sentence() for one in figures.findings(motion, good[0].process)
    ]


def test_a_position_or_velocity_column_off_by_a_percent_is_noticed(good: tuple[qparm.Cell, Path]) -> None:
    waypoints, samples, knots = tables(good[1])
    for order in (0, 1):
        derivatives = samples.derivatives.copy()
        derivatives[order] *= 1.01
        figures = measure(good[0], waypoints, replace(samples, derivatives=derivatives), knots)
        assert any(one.code == "files-differ" for one in figures.findings(None, good[0].process)), order


def test_a_position_outside_its_limits_is_a_problem(good: tuple[qparm.Cell, Path]) -> None:
    waypoints, samples, knots = tables(good[1])
    derivatives = samples.derivatives.copy()
    derivatives[0, 20, 0] = -1e-4
    figures = measure(good[0], waypoints, replace(samples, derivatives=derivatives), knots)
    assert figures.joints[0].limit_distance_trajectory == pytest.approx(-1e-4)
    motion = verify_motion(motion_of_knots(knots), good[0])
    assert ("position", "joint 'd1'") in [(one.code, one.subject) for one in figures.findings(motion, good[0].process)]


def test_a_knot_beside_its_waypoint_is_a_problem(good: tuple[qparm.Cell, Path]) -> None:
    waypoints, samples, knots = tables(good[1])
    derivatives = knots.derivatives.copy()
    # not every knot passes a waypoint
    derivatives[0, int(np.abs(derivatives[0] - waypoints.q[4]).max(axis=1).argmin()), 1] += 1e-4
    figures = measure(good[0], waypoints, samples, replace(knots, derivatives=derivatives))
    assert any("misses a waypoint" in one.what for one in figures.findings(None, good[0].process))


def test_files_of_another_arm_are_refused(good: tuple[qparm.Cell, Path]) -> None:
    data = good[0].to_dict()
    data["arm"]["joints"][0]["name"] = "rail"
    with pytest.raises(qparm.InvalidInput, match="joints d1"):
        measure(qparm.Cell.load(data), *tables(good[1]))


def test_the_report_in_memory_is_the_report_of_the_files(dome_plan: qparm.Plan, tmp_path: Path) -> None:
    in_memory, of_files = qparm.report(dome_plan).figures, qparm.write(dome_plan, tmp_path, pictures=False).figures
    assert in_memory.reached == of_files.reached
    assert in_memory.jumps == of_files.jumps
    assert in_memory.unreached == of_files.unreached
    for a, b in zip(in_memory.joints, of_files.joints, strict=True):
        assert a.velocity_share == pytest.approx(b.velocity_share, rel=1e-9)
        assert a.jerk_share == pytest.approx(b.jerk_share, rel=1e-9)
    assert in_memory.position_error_max == pytest.approx(of_files.position_error_max)
    assert in_memory.surface_deviation == pytest.approx(of_files.surface_deviation, rel=1e-6)


# --- what a consumer of the message makes of it ---------------------------------------------------------


@pytest.mark.parametrize("timing", ["quintic", "ruckig"])
def test_the_message_interpolated_is_the_trajectory_within_all_limits(timing: str, tmp_path: Path) -> None:
    """A controller interpolates quintically between the points: it must get what the report speaks of."""
    data = few_rows()
    plan = qparm.plan(data, timing=timing)
    report = qparm.write(plan, tmp_path, pictures=False)
    assert report.executable
    knots = read_knots(tmp_path / "trajectory.json")
    assert (np.diff(knots.t) > 0).all()
    h = np.diff(knots.t)
    worst = 0.0
    for k in np.flatnonzero(h >= 1e-4):
        # the quintic from its six conditions, solved as they stand
        A = np.zeros((6, 6))
        for row, (x, order) in enumerate([(0, 0), (0, 1), (0, 2), (1, 0), (1, 1), (1, 2)]):
            for p in range(order, 6):
                A[row, p] = np.prod([p - m for m in range(order)]) * float(x) ** (p - order)
        states = [knots.derivatives[order, k + x] * h[k] ** order for x in (0, 1) for order in range(3)]
        c = np.linalg.solve(A, np.array(states))
        x = np.linspace(0, 1, 9)
        q = sum(c[p] * x[:, None] ** p for p in range(6))
        jerk = sum(p * (p - 1) * (p - 2) * c[p] * x[:, None] ** (p - 3) for p in range(3, 6)) / h[k] ** 3
        assert (np.abs(jerk) <= plan.chain.jerk * (1 + 1e-6)).all()
        worst = max(worst, float(np.abs(q - plan.trajectory(knots.t[k] + x * h[k])).max()))
    assert worst <= 1e-8


def test_the_message_says_no_whenever_the_report_does(tmp_path: Path) -> None:
    """Whatever the planner thinks, the message carries the verdict of the measurement."""
    import json

    data = few_rows()
    plan = qparm.plan(data)
    strict = plan.cell.to_dict()
    strict["arm"]["joints"][3]["jerk"] = "0.01 rad/s^3"
    doubted = replace(plan, cell=qparm.Cell.load(strict))
    assert plan.trajectory.executable
    assert not qparm.write(doubted, tmp_path, pictures=False).executable
    assert json.loads((tmp_path / "trajectory.json").read_text(encoding="utf-8"))["executable"] is False


def test_figures_do_not_depend_on_the_period(dome_plan: qparm.Plan) -> None:
    fine, coarse = (qparm.report(dome_plan, period=period).figures for period in (0.02, 5.0))
    for a, b in zip(fine.joints, coarse.joints, strict=True):
        assert (a.velocity_share, a.acceleration_share, a.jerk_share) == pytest.approx(
            (b.velocity_share, b.acceleration_share, b.jerk_share), rel=1e-4
        )
    assert fine.surface_deviation == coarse.surface_deviation
    assert fine.tool_speed_max == coarse.tool_speed_max


def test_a_jump_at_a_row_end_is_one_between_neighbouring_lines() -> None:
    """A large but gradual motion over via poses is no jump; both the planner and the measurement say so."""
    data = cell_data()
    data["workpiece"] |= {"elevation": ["20 deg", "40 deg"], "azimuth": ["-10 deg", "10 deg"]}
    data["process"] |= {"rows": 3, "points": 11, "jump": "6 deg"}
    data["process"]["self_motion"] |= {"transition": "lift", "lift": "200 mm"}
    plan = qparm.plan(data)
    report = qparm.report(plan)
    assert report.executable == plan.trajectory.executable
    assert bool(report.figures.reconfigurations) == bool(plan.joint_path.breaks)
    assert report.figures.jumps == ()


def test_positions_are_extreme_between_the_points_too() -> None:
    """From rest to rest with an acceleration half way: the quintics swing where no point lies."""
    from qparm.verify.files import KnotTable
    from qparm.verify.interpolate import position_extremes, positions_at

    derivatives = np.zeros((3, 3, 2))
    derivatives[2, 1] = -0.1, 0.2
    knots = KnotTable(("a", "b"), np.array([0.0, 0.5, 1.0]), derivatives)
    dense = positions_at(knots, np.linspace(0.0, 1.0, 100_001))
    extremes = position_extremes(knots)
    np.testing.assert_allclose(extremes, [dense.min(axis=0), dense.max(axis=0)], atol=1e-9)
    assert extremes[0, 0] < -1e-4 < extremes[1, 0] + 1e-3
