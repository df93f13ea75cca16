"""The graph strategy on small cells: what it covers, what it reports, and that threads do not matter."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import qparm
from conftest import ROOT, cell_data
from qparm.path.relaxation import EXACT, Relaxation
from qparm.planning import PathSolution, graph, largest_step, problem_of, row_end
from qparm.planning.search.bundle import follow_bundle
from qparm.planning.search.sampling import Layer
from qparm.planning.solution import knots, runs
from qparm.planning.why import why_broken
from qparm.reach import ReachReason
from qparm.robot.flips import flips
from qparm.verify.kinematics import tool_rotation_error


def four_rows(**process: Any) -> qparm.Cell:
    """Return four rows of 21 points, the whole width of the reference dome."""
    data = cell_data()
    data["workpiece"] |= {"elevation": ["-10 deg", "5 deg"]}
    data["process"] |= {"rows": 4, "points": 21} | process
    return qparm.Cell.load(data)


@pytest.fixture(scope="module")
def cell() -> qparm.Cell:
    return four_rows()


@pytest.fixture(scope="module")
def plan(cell: qparm.Cell) -> qparm.Plan:
    return qparm.plan(cell)


@pytest.fixture(scope="module")
def needing() -> qparm.Cell:
    return qparm.Cell.load(ROOT / "examples" / "reconfiguration.toml")


@pytest.fixture(scope="module")
def broken(needing: qparm.Cell) -> qparm.Plan:
    return qparm.plan(needing)


def test_four_rows_are_covered_in_one_piece(plan: qparm.Plan) -> None:
    assert plan.solution.reached.all()
    assert plan.solution.driven.all()
    search = plan.search
    assert isinstance(search, qparm.planning.GraphRecord)
    assert search.proven
    assert [count.density for count in search.counts] == [1]
    assert (search.counts[0].inside, search.counts[0].row_ends) == (0, 0)
    figures = qparm.report(plan).figures
    assert (figures.reached, figures.jumps, figures.reconfigurations) == (84, (), ())
    # refinement never makes the largest step larger
    assert (np.diff(search.largest_steps) <= 1e-12).all()


@pytest.mark.parametrize("seed", [0, 3])
@pytest.mark.slow
def test_threads_do_not_change_the_answer(cell: qparm.Cell, seed: int) -> None:
    chain, tool_path = cell.chain(), cell.tool_path()
    one, two = (graph(problem_of(cell, seed=seed, threads=threads)) for threads in (1, 2))
    assert len(one[0]) == len(two[0])
    for mine, other in zip(one[0], two[0], strict=True):
        np.testing.assert_array_equal(mine.q, other.q)
    assert one[1] == two[1] or one[1].counts == two[1].counts
    assert one[1].largest_steps == two[1].largest_steps
    E = chain.pose_error(chain.forward(one[0][0].q), tool_path.poses)
    assert np.linalg.norm(E[:, :3], axis=1).max() <= 1e-8
    assert chain.within_limits(one[0][0].q).all()
    assert largest_step(chain, one[0][0]) <= one[1].largest_steps[-1] + 1e-6


@pytest.mark.parametrize("feed", ["1 mm/s", "900 mm/s"])
@pytest.mark.slow
def test_the_feed_changes_nothing_about_the_path(plan: qparm.Plan, feed: str) -> None:
    other = qparm.plan(four_rows(feed=feed))
    np.testing.assert_array_equal(other.joint_path.q, plan.joint_path.q)
    assert other.joint_path.breaks == plan.joint_path.breaks == ()


@pytest.mark.parametrize("strategy", ["general", "reverse"])
@pytest.mark.slow
def test_what_the_papers_criterion_refuses_at_a_high_feed_is_followed_all_the_same(strategy: str) -> None:
    plan = qparm.plan(four_rows(feed="900 mm/s"), strategy=strategy)
    criteria = problem_of(plan.cell).criteria_by_feed
    inside = ~row_end(plan.tool_path) & plan.solution.reached[1:] & plan.solution.reached[:-1]
    small = (np.abs(np.diff(plan.solution.q, axis=0)) < np.radians(9)).all(axis=1)
    over = (np.abs(np.diff(plan.solution.q, axis=0)) > criteria).any(axis=1)
    assert (inside & small & over).any(), "the paper's criterion refuses steps that are small"
    assert plan.solution.driven[inside & small].all()


@pytest.mark.slow
def test_seeds_differ(cell: qparm.Cell, plan: qparm.Plan) -> None:
    other, mine = (graph(problem_of(cell, seed=seed))[0][0] for seed in (5, 0))
    assert not np.array_equal(other.q, mine.q)


@pytest.mark.slow
def test_smoothing_is_measured(plan: qparm.Plan) -> None:
    record = plan.smoothing
    assert record is not None
    assert record.objective[1] < record.objective[0]
    assert record.second_differences[1][0] < record.second_differences[0][0]
    scale = plan.chain.velocity / plan.chain.velocity[~plan.chain.prismatic].max()
    steps = np.abs(np.diff(plan.solution.q / scale, axis=0))
    assert record.largest_scaled_step[1] == pytest.approx(float(steps.max()), rel=1e-9)
    rough = qparm.plan(plan.cell, smooth=False)
    assert rough.smoothing is None
    assert record.largest_scaled_step[0] == pytest.approx(largest_step(plan.chain, rough.solution), rel=1e-9)


# --- what cannot be reached -------------------------------------------------------------------------


@pytest.mark.slow
def test_out_of_reach_leaves_the_rest_of_each_row_planned() -> None:
    data = cell_data()
    data["workpiece"] |= {"azimuth": ["-75 deg", "75 deg"]}
    data["process"] |= {"rows": 3, "points": 51}
    plan = qparm.plan(data)
    beyond = {k for k, verdict in plan.reach.items() if verdict.reason is ReachReason.TOO_FAR}
    assert beyond
    # what is missing is what cannot be had: every other point is reached
    assert set(np.flatnonzero(~plan.solution.reached).tolist()) == set(plan.reach)
    assert all(verdict.reason is not ReachReason.WITHIN_REACH for verdict in plan.reach.values())
    report = qparm.report(plan)
    assert not report.executable
    assert report.reasons[0].startswith(f"{len(plan.reach)} points are not reached: ")
    assert {point.index for point in report.figures.unreached} == set(plan.reach)
    rows = plan.tool_path.row_of_point
    assert all((plan.solution.reached & (rows == row)).any() for row in range(3))
    assert plan.joint_path.point.max() > 130


def test_nothing_in_reach_is_an_empty_answer() -> None:
    data = cell_data()
    data["workpiece"]["pose"]["position"][1] = "9 m"
    data["process"] |= {"rows": 2, "points": 4}
    plan = qparm.plan(data)
    assert not plan.solution.reached.any()
    assert not plan.solution.driven.any()
    assert plan.joint_path.segments == ()


# --- what needs reconfigurations --------------------------------------------------------------------


def test_exactly_one_inside_a_row_and_one_at_a_row_end(broken: qparm.Plan) -> None:
    assert broken.solution.reached.all()
    assert broken.solution.reconfigurations(broken.tool_path) == (1, 1)
    search = broken.search
    assert isinstance(search, qparm.planning.GraphRecord)
    assert not search.proven
    # looked for with twice the samples too; they gained nothing
    assert [count.density for count in search.counts] == [1, 2]
    samples = [count.samples for count in search.counts]
    assert samples[0] < samples[1]
    assert [(count.inside, count.row_ends) for count in search.counts][-1] == (1, 1)


def test_every_reconfiguration_is_a_motion_that_keeps_clear(broken: qparm.Plan) -> None:
    motions = [motion for motion in broken.breaks if motion.kind.value == "break"]
    assert sorted(motion.place for motion in motions) == ["row", "row end"]
    assert [motion.kind.value for motion in (broken.breaks[0], broken.breaks[-1])] == ["approach", "retract"]
    for motion in broken.breaks:
        assert motion.failure == ""
        assert motion.escape
        assert motion.clearance >= broken.cell.process.clearance - 1e-6
        assert motion.time > 0
    inside = next(motion for motion in motions if motion.place == "row")
    assert inside.row == 0
    assert inside.why
    figures = qparm.report(broken).figures
    assert sorted(jump.place for jump in figures.reconfigurations) == ["row", "row end"]
    assert figures.jumps == ()
    assert figures.clearance.least_clearance >= broken.cell.process.clearance - 1e-6
    assert not [fault for fault in figures.clearance.faults if not fault.segment.startswith("transition")]


@pytest.mark.slow
def test_the_reverse_strategy_needs_no_fewer(needing: qparm.Cell) -> None:
    plan = qparm.plan(needing, strategy="reverse")
    inside, ends = plan.solution.reconfigurations(plan.tool_path)
    assert plan.solution.reached.all()
    assert (inside >= 1, ends >= 1) == (True, True)
    report = qparm.report(plan)
    assert report.executable, report.reasons
    assert len(report.figures.reconfigurations) == inside + ends


def test_the_summary_says_where_and_why(broken: qparm.Plan) -> None:
    text = qparm.report(broken).text()
    assert "reconfigurations    1 inside rows, 1 at row ends, 0 across points not reached" in text
    assert "break inside row 0, from point" in text
    assert "going on from point" in text
    assert "solutions of 155 poses: 1 reconfiguration inside rows, 1 at row ends" in text


# --- why a row breaks -------------------------------------------------------------------------------


def test_a_limit_that_stops_the_arm_is_named(broken: qparm.Plan) -> None:
    """theta6 from 50 deg causes the break (the cell's head says so), and the sentence names limits."""
    inside = next(motion for motion in broken.breaks if motion.place == "row")
    assert inside.why.startswith(f"going on from point {inside.first} the arm is stopped at point")
    assert f"; coming back from point {inside.last} the arm is stopped at point" in inside.why
    assert "by the limits of" in inside.why
    assert any(name in inside.why for name in broken.chain.names)


def test_a_way_on_that_is_open_is_called_so(plan: qparm.Plan) -> None:
    """Between the last two points of row 1 nothing is in the way."""
    sentence = why_broken(problem_of(plan.cell), plan.solution, 40, 41)
    assert sentence.startswith("going on from point 40 the row can be followed to its end")


def stops(sentence: str) -> tuple[int, int]:
    """Return where the ways from before a break and from after it end."""
    words = sentence.split("; coming back")
    before, after = (re.search(r"is stopped at point (\d+)", one) for one in words[:2])
    return int(before[1]) if before else 10**6, int(after[1]) if after else -1


def test_the_ways_end_where_the_exhaustive_count_says_that_they_must(broken: qparm.Plan) -> None:
    """Row 0 breaks right before one of the points 10 to 15 (the cell's head): no way on leads beyond."""
    (inside,) = (motion for motion in broken.breaks if motion.place == "row")
    forwards, backwards = stops(inside.why)
    assert inside.first <= forwards <= 14
    assert 10 <= backwards <= inside.last


@pytest.mark.parametrize("relaxation", [Relaxation(tilt=np.radians(20.0)), Relaxation(spin=True)], ids=["tilt", "spin"])
def test_a_tool_that_is_free_is_followed_as_such(broken: qparm.Plan, relaxation: Relaxation) -> None:
    (inside,) = (motion for motion in broken.breaks if motion.place == "row")
    problem = replace(problem_of(broken.cell), relaxation=relaxation)
    sentence = why_broken(problem, broken.solution, inside.first, inside.last)
    assert sentence.endswith(f"; {relaxation.words}")
    held, free = stops(inside.why), stops(sentence)
    assert free[0] >= held[0]
    assert free[1] <= held[1]
    if relaxation.tilt:
        assert free[0] > held[0]
        assert ", the tool leaning as far as it may" in sentence


@pytest.mark.parametrize("relaxation", [EXACT, Relaxation(spin=True, tilt=np.radians(10.0))], ids=["exact", "relaxed"])
def test_every_way_of_a_bundle_is_one(plan: qparm.Plan, relaxation: Relaxation) -> None:
    chain, path = plan.chain, plan.tool_path
    cell = plan.cell
    if relaxation.free:
        cell = cell.with_process({"tool_spin": "free", "tool_tilt": "10 deg"})
    q, rho = plan.solution.q[:1], np.zeros((1, 3))
    bundle = follow_bundle(
        chain, lambda s: path.pose(0, s), path.s[:6], Layer(q, rho), relaxation=relaxation,
        rng=np.random.default_rng(0),
    )  # fmt: skip
    assert bundle.arrived
    assert len(bundle.layers[-1].q) == 32
    for k in range(1, 6):
        came, q = bundle.layers[k - 1].q[bundle.parents[k]], bundle.layers[k].q
        assert chain.within_limits(q).all()
        stands = chain.forward(q)
        assert np.abs(stands[:, :3, 3] - path.poses[k, :3, 3]).max() < 1e-8
        asked = np.broadcast_to(path.poses[k, :3, :3], (len(q), 3, 3))
        assert tool_rotation_error(cell, stands[:, :3, :3], asked).max() < 1e-8
        assert np.abs(q - came).max() < np.radians(60), "each comes from one before, in sixteen small steps at most"
    way, _ = bundle.way(0)
    np.testing.assert_array_equal(way[0], plan.solution.q[0])


# --- dense points, relaxed tools --------------------------------------------------------------------


@pytest.mark.slow
def test_dense_points_are_filled_in(cell: qparm.Cell) -> None:
    dense = four_rows(rows=2, points=1201)
    chain, tool_path = dense.chain(), dense.tool_path()
    at = knots(chain, tool_path)
    assert len(at) < 0.5 * tool_path.point_count
    assert {0, 1200, 1201, 2401} <= set(at.tolist())
    (solution, *_), record = graph(problem_of(dense))
    # what is unbroken at knots farther apart needs none nearer
    assert record.knots < 0.5 * len(at)
    assert solution.reached.all()
    assert solution.driven.all()
    E = chain.pose_error(chain.forward(solution.q), tool_path.poses)
    assert np.linalg.norm(E[:, :3], axis=1).max() <= 1e-8
    run = runs(tool_path, solution.reached, solution.driven)
    assert set(run.tolist()) == {0, 1}


def test_a_solution_counts_its_reconfigurations(cell: qparm.Cell) -> None:
    tool_path = cell.tool_path()
    reached, driven = np.ones(84, dtype=bool), np.ones(83, dtype=bool)
    reached[50] = False
    driven[[5, 20, 49, 50]] = False  # inside row 0, at its end, and about the missing point
    solution = PathSolution(np.zeros((84, 8)), np.zeros((84, 3)), reached, driven)
    assert solution.reconfigurations(tool_path) == (1, 1)
    run = runs(tool_path, reached, driven)
    assert run[50] == -1
    assert run[5] != run[6]
    assert len(set(run[run >= 0].tolist())) == 6


@pytest.mark.slow
def test_a_free_spin_through_the_command_line(tmp_path: Path, cell: qparm.Cell) -> None:
    import json
    import subprocess
    import sys

    cell.save(tmp_path / "cell.toml")
    command = [sys.executable, "-m", "qparm.cli", "plan", "cell.toml", "--out", "out", "--tool-spin", "free", "-q"]
    run = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    report = json.loads((tmp_path / "out" / "report.json").read_text(encoding="utf-8"))
    assert run.returncode in (0, 3), run.stderr
    assert report["cell"]["process"]["tool_spin"] == "free"
    assert report["measured"]["reached"] == 84
    assert report["measured"]["rotation_error_max"] <= 1e-5
    assert report["measured"]["reconfigurations"] == report["measured"]["jumps"] == []
    assert report["measured"]["between"]["off_gaps"] == 0


def test_a_relaxed_tool_is_for_the_graph_strategy_alone(cell: qparm.Cell) -> None:
    free = cell.with_process({"tool_spin": "free"})
    for strategy in ("general", "reverse"):
        with pytest.raises(qparm.InvalidInput, match="only the graph strategy uses a tool that may spin"):
            qparm.plan(free, strategy=strategy)  # type: ignore[arg-type]


class _Backwards:
    """A pool that serves its tasks from the last to the first."""

    def __init__(self, workers: int) -> None:
        pass

    def __enter__(self) -> _Backwards:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def map(self, function: Any, *items: Any) -> list[Any]:
        return [function(*item) for item in list(zip(*items, strict=True))[::-1]][::-1]


@pytest.mark.slow
def test_other_ways_do_not_depend_on_the_order_in_which_rows_are_served(monkeypatch: pytest.MonkeyPatch) -> None:
    from qparm.planning.search import row_classes

    data = cell_data()
    data["workpiece"] |= {"elevation": ["30 deg", "60 deg"]}  # rows with many ways through them
    data["process"] |= {"rows": 6, "points": 31}
    cell = qparm.Cell.load(data)
    problem = problem_of(cell, seed=3)
    seen: list[list[np.ndarray]] = []
    chosen = row_classes._chosen

    def noted(choices: Any, *rest: Any) -> Any:
        seen.append([way.q for ways in choices for way in ways])
        return chosen(choices, *rest)

    monkeypatch.setattr(row_classes, "_chosen", noted)
    graph(problem)
    count = len(seen)
    monkeypatch.setattr(row_classes, "ThreadPoolExecutor", _Backwards)
    graph(problem)
    assert len(seen) == 2 * count > 0
    assert len(seen[0]) > 6
    for one, other in zip(seen[0], seen[count], strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_row_end_that_leads_far_is_followed() -> None:
    data = cell_data()
    data["process"] |= {"rows": 2, "points": 21}
    plan = qparm.plan(qparm.Cell.load(data))
    path = plan.tool_path
    # what one step may be is not enough for the whole of it, and need not be: the tool goes on the surface
    across = np.abs(plan.solution.q[21] - plan.solution.q[20])
    assert path.transitions[0].length > 0.7
    assert (across > plan.cell.jump()).any()
    assert plan.solution.reconfigurations(path) == (0, 0)
    assert [motion.kind.value for motion in plan.breaks] == ["approach", "retract"]
    report = qparm.report(plan)
    assert report.executable
    assert not report.figures.jumps


def test_rows_of_two_points_are_driven_from_end_to_end() -> None:
    plan = qparm.plan(four_rows(rows=2, points=2))
    assert len(plan.record.unreached) == 0
    assert plan.solution.driven.all()
    assert not any(reason.startswith("the tool works nothing of row") for reason in plan.trajectory.reasons)


def test_rows_of_which_no_two_points_are_joined_are_not_called_worked() -> None:
    cell = four_rows(rows=2, points=2)
    q = qparm.plan(cell).solution.q.copy()
    chain = cell.chain()
    for k in (1, 3):
        # another piece of the same pose's self-motion set
        q[k] = next(way[0] for flip in flips(chain) if (way := flip.path(chain, q[k : k + 1])) is not None)

    def apart(*_: Any) -> np.ndarray:
        return q

    plan = qparm.plan(cell, strategy=apart)
    assert plan.solution.reached.all()
    assert not plan.solution.driven[[0, 2]].any()
    report = qparm.report(plan)
    assert not report.executable
    assert [one.subject for one in report.verdict.findings if one.code == "row-not-worked"] == ["row 0", "row 1"]
    assert "nan" not in report.text()
