"""Whole studies on a small cell: what they find, that nothing but time depends on workers, and what survives."""

import contextlib
import csv
import dataclasses
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import qparm
from conftest import ROOT
from design.made_cells import small
from qparm.design.evaluate import evaluate
from qparm.design.journal import Journal, problem_hash
from qparm.design.report import on_bounds, study_data, study_text
from qparm.design.space import DesignSpace
from qparm.design.study import design
from qparm.design.workers import Order, WorkersLost, _jobs, evaluate_all
from qparm.errors import InvalidInput
from qparm.export.designs_csv import write_designs_csv
from qparm.reports.check import check_cell

pytestmark = pytest.mark.slow

# 25 designs of the map, 80 for the border, 4 beside the recommended one and the cell's own
MAP = {"method": "grid", "budget": 110, "border": 80, "workers": 1, "plans": 0}
ORDER = Order(2, (), 0)


def save(path, **design_table):
    import tomli_w

    path.write_text(tomli_w.dumps(small(**design_table)))
    return path


@pytest.fixture(scope="module")
def the_map():
    return design(small(), **MAP)


@pytest.fixture(scope="module")
def space():
    return DesignSpace.of(small())


def designs(space, count):
    lower, upper = (space.problem(("length",)).lower, space.problem(("length",)).upper)
    return [tuple((lower + (k / (count - 1)) * (upper - lower)).tolist()) for k in range(count)]


def test_the_map_finds_the_shortest_design_that_covers(the_map, space):
    least = the_map.evaluations[the_map.least]
    assert evaluate(space, least.x, level=2).valid
    # half a millimetre shorter, in any split of the two, misses points
    for k in range(11):
        L1 = 0.3 + 0.03 * k
        L3 = least.measures["length"] - 0.52 - 0.0005 - L1
        if 0.3 <= L3 <= 0.5:
            assert not evaluate(space, (L1, L3), level=2).valid
    assert [(key, side) for key, side, _ in on_bounds(the_map, least.x)] == [("arm.lengths.L1", "lower")]
    assert any(bound.variable == "arm.lengths.L1" and bound.side == "lower" for bound in the_map.active)


@pytest.mark.parametrize("method", ["hybrid", "paper"])
def test_a_search_agrees_with_the_map(method, the_map):
    found = design(small(), method=method, level="measures", budget=61, border=40, workers=1, plans=0)
    least, whole = (s.evaluations[s.least].measures["length"] for s in (found, the_map))
    assert least == pytest.approx(whole, abs=0.001)
    assert found.chosen in found.best
    assert method == "paper" or found.best == found.front
    assert all(found.violation(found.evaluations[k]) == 0 for k in (*found.front, *found.best))


def test_of_the_papers_method_what_the_border_beats_is_not_recommended():
    found = design(small(), method="paper", budget=55, border=40, workers=1, plans=0)
    assert found.least not in found.front
    assert found.least in found.best
    signed = {k: (one.measures["length"], one.measures["singularities"]) for k, one in enumerate(found.evaluations)
              if "singularities" in one.measures}  # fmt: skip
    assert not any(
        all(a <= b for a, b in zip(other, signed[found.chosen], strict=True)) and other != signed[found.chosen]
        for other in signed.values()
    )
    text = study_text(found)
    assert "no design of the swarm's own search beats" in text
    assert "the followed border leads to a design that the search did not find" in text
    beaten = sum(all(a <= b for a, b in zip(signed[found.least], signed[k], strict=True)) for k in found.front)
    assert f"it beats {beaten or 'none'} of" in text


def test_the_shortest_design_is_said_to_have_no_reserve():
    found = design(small(objectives=["length"]), **MAP)
    assert found.chosen == found.least
    assert found.grounds == "only"
    assert "1 mm less of" in found.beyond_reach
    text = study_text(found)
    assert "no reserve: it lies on the border of reach (1 mm less of" in text
    border = len(found.evaluations) - 25
    assert 0 < border < 80
    assert (
        f"110 designs: 25 to search, {border} to follow the border of the valid designs to the shortest, 4 beside the"
        f" recommended design, to see whether it has reserve, 1 the cell's own, {80 - border} not needed" in text
    )


@pytest.mark.parametrize("method", ["hybrid", "mopso", "paper", "grid", "sobol"])
def test_a_budget_is_all_that_is_evaluated(method, tmp_path):
    for budget, border in ((24, None), (30, 0)):
        journal = tmp_path / f"{budget}"
        found = design(
            small(), method=method, budget=budget, border=border, workers=1, plans=0, journal=journal,
            level=None if method == "paper" else "reach",
        )  # fmt: skip
        designs = {tuple(json.loads(line)["x"]) for line in journal.read_text().splitlines()}
        stages = dict(found.stages)
        assert len(designs) <= sum(stages.values()) <= budget
        assert stages["search"] + stages["least length"] == len(found.evaluations)
        assert stages["search"] > budget // 2 or method == "grid"
        assert (stages["least length"] > 0) == (border != 0) or found.least is None
        assert f"{budget} designs: {stages['search']} to search" in study_text(found)
        assert {stage["name"]: stage["designs"] for stage in study_data(found)["stages"]} == stages


def test_what_a_spent_budget_leaves_open_is_said():
    cut = design(small(), method="sobol", level="reach", budget=16, workers=1, plans=0)
    assert cut.border == "cut short"
    assert cut.beyond_reach is None
    text = study_text(cut)
    assert "not followed to its end: the budget was spent" in text
    assert "whether it has reserve was not looked at" in text
    off = design(small(), method="sobol", level="reach", budget=16, border=0, workers=1, plans=0)
    assert off.border == "not followed"
    assert "none of the budget was kept for it" in study_text(off)
    with pytest.raises(InvalidInput, match="a budget of 10 leaves no design to search with"):
        design(small(), budget=10, border=9)


def test_a_design_with_reserve_is_not_said_to_lie_on_the_border():
    data = small(objectives=["singularity_margin"])
    data["workpiece"]["pose"]["position"] = ["0 mm", "1500 mm", "360 mm"]
    found = design(data, method="sobol", budget=28, border=15, workers=1, plans=0)
    assert found.chosen is not None
    assert found.beyond_reach == ""
    assert "no reserve" not in study_text(found)


def test_where_objectives_do_not_depend_on_the_variables_nothing_is_recommended():
    data = small(objectives=["length"])
    data["workpiece"]["pose"]["position"] = ["0 mm", "1500 mm", "360 mm"]
    data["design"]["variables"] = {"workpiece.pose.position[1]": {"range": ["1400 mm", "1500 mm"]}}
    found = design(data, **(MAP | {"budget": 88}))
    assert found.least is not None
    assert found.chosen is None
    assert found.unmoved == ("length",)
    text = study_text(found)
    assert "1 variable, method grid" in text
    assert "total length of the links: the same for all valid designs" in text
    assert "NO RECOMMENDATION" in text
    assert "NO VALID DESIGN" not in text


def test_a_narrower_range_holds_the_shortest_design_on_its_bound():
    found = design(small(), ranges={"arm.lengths.L1": ("480 mm", "600 mm")}, **MAP)
    least = found.evaluations[found.least]
    assert least.x[0] == pytest.approx(0.48, abs=1e-3)
    assert "L1 >= 480 mm" in study_text(found)


def test_a_bound_that_may_be_moved_is(the_map):
    ranges = small()["design"]["variables"] | {
        "arm.lengths.L1": {"range": ["400 mm", "600 mm"], "extend": ["200 mm", "600 mm"]}
    }
    found = design(small(variables=ranges, objectives=["length"]), method="hybrid", budget=100, workers=1, plans=0)
    assert found.problem.variables[0].lower < 0.4


def test_limits_on_measures_are_kept(tmp_path):
    plain = design(small(), method="sobol", budget=53, border=40, workers=1, plans=0)
    margins = sorted(
        one.measures["singularity_margin"] for one in plain.evaluations if "singularity_margin" in one.measures
    )
    limit = margins[len(margins) // 2]
    held = design(small(limits={"singularity_margin": limit}), method="sobol", budget=53, border=40, workers=1, plans=0)
    assert held.front
    assert all(held.evaluations[k].measures["singularity_margin"] >= limit for k in held.front)
    assert any(one.valid and held.violation(one) > 0 for one in held.evaluations)
    # the border is followed with the limit held, not to the shortest design that reaches
    shortest = held.evaluations[held.least]
    assert shortest.measures["singularity_margin"] >= limit
    assert shortest.measures["length"] > plain.evaluations[plain.least].measures["length"]
    # of the border too, what reaches is measured before it is called valid
    assert all("singularity_margin" in one.measures for one in held.evaluations if one.valid)
    write_designs_csv(held, tmp_path / "designs.csv")
    with (tmp_path / "designs.csv").open() as file:
        lines = list(csv.DictReader(file))
    for line in lines:
        kept = line["singularity_margin"] and float(line["singularity_margin"]) >= limit
        assert line["valid"] != "1" or kept


def test_limits_that_a_level_does_not_tell_are_refused_and_not_taken_as_kept():
    with pytest.raises(InvalidInput, match="a limit on singularity_margin is not known at level reach: take level mea"):
        design(small(limits={"singularity_margin": 0.1}), level="reach", **MAP)
    with pytest.raises(InvalidInput, match="objective singularities is not known at level reach"):
        design(small(), method="paper", level="reach")
    found = design(small(limits={"singularity_margin": 5.0}), **(MAP | {"budget": 89}))
    assert found.level == "measures"
    assert found.least is None
    assert "attainable distance from singularities is" in study_text(found)


def test_where_nothing_is_valid_the_nearest_design_and_its_misses_are_told():
    data = small()
    data["workpiece"]["pose"]["position"] = ["0 mm", "2300 mm", "360 mm"]
    found = design(data, **(MAP | {"budget": 94}))
    assert found.chosen is None
    assert found.nearest is not None
    assert found.nearest.x == (0.6, 0.5)
    assert found.nearest.checked == 33
    assert evaluate(DesignSpace.of(data), found.nearest.x, level=2).level < 2, "the ladder ends before all points"
    text = study_text(found)
    covered = found.space.cell_at(found.nearest.x)
    missed = sum(verdict.reason.name != "WITHIN_REACH" for verdict in check_cell(covered).reach)
    assert found.nearest.missed == missed
    assert f"; {missed} of 33 points are not reached" in text
    assert "NO VALID DESIGN" in text
    assert "too far: the wrist lies" in text
    json.dumps(study_data(found), allow_nan=False)


def test_the_shortest_design_of_a_leaning_tool_can_be_planned():
    """It lies on the border of reach: a tool that leans farther than plans let it would make it shorter."""
    data = small(objectives=["length"])
    data["process"]["tool_tilt"] = "15 deg"
    found = design(data, method="sobol", budget=60, workers=1, plans=0)
    assert found.least is not None
    planned = qparm.plan(found.space.cell_at(found.evaluations[found.least].x), seed=0)
    assert not len(planned.record.unreached)


def test_a_tool_that_may_lean_makes_more_designs_valid(the_map):
    data = small()
    data["process"]["tool_tilt"] = "15 deg"
    found = design(data, **MAP)
    assert "designs cover all 33 points, the tool free to lean by 15 deg" in study_text(found)
    assert "the tool free" not in study_text(the_map)
    before, after = ([one.valid for one in study.evaluations[:25]] for study in (the_map, found))
    assert sum(after) > sum(before)
    assert all(now for was, now in zip(before, after, strict=True) if was)


def test_bad_options_are_refused():
    for options, word in (
        ({"method": "genetic"}, "method must be one of hybrid"),
        ({"level": "coarse"}, "level must be"),
        ({"budget": 0}, "budget must be"),
        ({"seed": -1}, "seed must be"),
        ({"plans": 1.5}, "plans must be"),
    ):
        with pytest.raises(InvalidInput, match=word):
            design(small(), **options)


def same(a, b):
    return a.evaluations == b.evaluations and a.front == b.front and a.journal_hash == b.journal_hash


def test_any_number_of_workers_gives_the_same_bits(the_map):
    assert same(design(small(), **(MAP | {"workers": 2})), the_map)


def test_all_cores_are_used_unless_the_caller_says_otherwise():
    """By default joblib takes one worker, whatever its backend offers."""
    import joblib

    assert joblib.effective_n_jobs(_jobs(None)) == joblib.cpu_count()
    assert _jobs(3) == 3
    with joblib.parallel_config(n_jobs=5):
        assert joblib.effective_n_jobs(_jobs(None)) == 5


def test_a_study_goes_on_from_its_journal(tmp_path, the_map):
    journal = tmp_path / "journal"
    design(small(), journal=journal, **MAP)
    lines = journal.read_bytes().splitlines(keepends=True)
    journal.write_bytes(b"".join(lines[:10]) + lines[10][:30])
    again = design(small(), journal=journal, **MAP)
    assert same(again, the_map)
    assert again.level_seconds[0][0] == the_map.level_seconds[0][0] - 10


@pytest.mark.filterwarnings("ignore")
def test_a_killed_worker_loses_nothing(tmp_path, space):
    """SIGKILL to a worker of loky's in the middle: what it had not finished is done again."""
    asked = designs(space, 24)
    killed, finished = [], []

    def kill(evaluation):
        from joblib.externals.loky import get_reusable_executor

        finished.append(evaluation.x)
        if len(finished) == 4:
            pid = next(iter(get_reusable_executor(reuse=True)._processes))
            os.kill(pid, signal.SIGKILL)
            killed.append(pid)

    journal = Journal(problem_hash(space, 0), tmp_path / "journal")
    found = evaluate_all(space, asked, ORDER, journal, workers=2, finished=kill)
    assert killed
    assert found == [evaluate(space, x, level=2) for x in asked]
    kept = [json.loads(line)["x"] for line in (tmp_path / "journal").read_text().splitlines()]
    assert sorted(map(tuple, kept)) == sorted(asked), "every design is finished once"


@pytest.mark.filterwarnings("ignore")
def test_workers_that_die_again_and_again_end_the_study(space, monkeypatch):
    import qparm.design.workers as workers

    class TerminatedWorkerError(Exception):
        pass

    def dying(*_):
        raise TerminatedWorkerError("out of memory")
        yield

    monkeypatch.setattr(workers, "_run", dying)
    with pytest.raises(WorkersLost, match="died 3 times"):
        evaluate_all(space, designs(space, 3), ORDER, Journal("p"))


@pytest.mark.filterwarnings("ignore")
def test_a_dask_cluster_gives_the_same_bits_though_a_worker_is_killed(space):
    import distributed
    import joblib

    asked = designs(space, 24)
    finished = []
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, host="127.0.0.1"
        ) as cluster,
        distributed.Client(cluster),
        joblib.parallel_config(backend="dask"),
    ):

        def kill(evaluation):
            finished.append(evaluation.x)
            if len(finished) == 4:
                os.kill(cluster.workers[0].pid, signal.SIGKILL)

        found = evaluate_all(space, asked, ORDER, Journal(problem_hash(space, 0)), finished=kill)
    assert found == [evaluate(space, x, level=2) for x in asked]


@pytest.mark.filterwarnings("ignore")
def test_the_command_evaluates_on_a_cluster(tmp_path):
    """``--cluster`` with a scheduler and two workers of its own: the same table."""
    import distributed

    cell = save(tmp_path / "cell.toml")
    command = [
        sys.executable,
        "-m",
        "qparm.cli",
        "design",
        str(cell),
        "--method",
        "grid",
        "--budget",
        "9",
        "--plans",
        "0",
    ]
    here, there = tmp_path / "here", tmp_path / "there"
    subprocess.run([*command, "--workers", "1", "--out", str(here)], check=True, cwd=ROOT, timeout=240)
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, host="127.0.0.1"
    ) as cluster:
        address = cluster.scheduler_address
        subprocess.run([*command, "--cluster", address, "--out", str(there)], check=True, cwd=ROOT, timeout=240)
        with distributed.Client(cluster) as client:
            tasks = client.run(lambda: "qparm.design.evaluate" in sys.modules)
    assert any(tasks.values()), "the cluster's workers evaluated"
    assert (here / "designs.csv").read_bytes() == (there / "designs.csv").read_bytes()


def test_a_killed_command_goes_on_with_resume(tmp_path, the_map):
    """SIGKILL to the whole command once some designs are in the journal, then --resume: the same table."""
    cell = save(tmp_path / "cell.toml")
    command = [
        sys.executable, "-m", "qparm.cli", "design", str(cell), "--method", "grid", "--budget", "25", "--plans", "0",
        "--workers", "1", "--out",
    ]  # fmt: skip
    whole, broken = tmp_path / "whole", tmp_path / "broken"
    subprocess.run([*command, str(whole)], check=True, cwd=ROOT, capture_output=True, timeout=240)
    process = subprocess.Popen([*command, str(broken)], cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    journal = broken / "journal.jsonl"
    deadline = time.monotonic() + 120
    while time.monotonic() < deadline and (not journal.exists() or journal.read_bytes().count(b"\n") < 8):
        time.sleep(0.01)
    process.kill()
    process.wait()
    assert {entry.name for entry in broken.iterdir()} == {"journal.jsonl"}, "nothing half written"
    kept = journal.read_bytes().count(b"\n")
    assert 8 <= kept < (whole / "journal.jsonl").read_bytes().count(b"\n")
    subprocess.run([*command, str(broken), "--resume"], check=True, cwd=ROOT, capture_output=True, timeout=240)
    assert (broken / "designs.csv").read_bytes() == (whole / "designs.csv").read_bytes()
    first = [json.loads(line)["key"] for line in journal.read_text().splitlines()[:kept]]
    assert len({*first}) == kept


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="children of a process are found by /proc")
def test_workers_end_with_a_command_that_is_killed_before_they_have_work(tmp_path):
    cell = save(tmp_path / "cell.toml")
    process = subprocess.Popen(
        [sys.executable, "-m", "qparm.cli", "design", str(cell), "--method", "grid", "--budget", "25", "--plans", "0",
         "--workers", "2", "--out", str(tmp_path / "out"), "-q"],
        cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
    )  # fmt: skip

    def workers():
        try:
            tasks = Path(f"/proc/{process.pid}/task").iterdir()
            children = [pid for task in tasks for pid in (task / "children").read_text().split()]
            return [pid for pid in children if b"Loky" in Path(f"/proc/{pid}/cmdline").read_bytes()]
        except OSError:
            return []

    def is_there(pid):
        try:
            return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
        except OSError:
            return False

    deadline = time.monotonic() + 120
    while time.monotonic() < deadline and len(started := workers()) < 2:
        time.sleep(0.01)
    process.kill()
    process.wait()
    try:
        assert len(started) == 2
        while time.monotonic() < deadline and any(map(is_there, started)):
            time.sleep(0.1)
        assert not any(map(is_there, started))
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)


def test_a_study_is_data_that_can_be_compared(the_map):
    assert dataclasses.is_dataclass(the_map)
    data = study_data(the_map)
    assert data["shortest"]["coverage"] == 1.0
    assert data["seconds"]["levels"]["screen"]["runs"] >= 25
