"""A motion from a file: the unaltered one passes in every format and at every period, what is off by 1 % does not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import qparm
from conftest import few_rows
from qparm.cli import cli
from qparm.export import FORMATS, export_trajectory
from qparm.robot.motion_limits import MotionLimits
from qparm.verify import MotionReport, MotionTable, read_motion, verify_motion
from qparm.verify.clearance import LINKS_NOT_CHECKED
from qparm.verify.columns import silent_columns

UNITS = ("m", *["rad"] * 7)
ENDINGS = {"csv": ".csv", "npz": ".npz", "stream": ".csv", "json": ".json", "yaml": ".yaml"}


@pytest.fixture(scope="module")
def plan() -> qparm.Plan:
    return qparm.plan(few_rows())


@pytest.fixture(scope="module")
def ruckig_plan() -> qparm.Plan:
    return qparm.plan(few_rows(), timing="ruckig")


@pytest.fixture(scope="module")
def read(plan: qparm.Plan, tmp_path_factory: pytest.TempPathFactory) -> Callable[..., MotionTable]:
    """Return what gives the motion as a file of a format has it, written and read once."""
    folder, known = tmp_path_factory.mktemp("motions"), {}

    def table(to: str, period: float | None = None) -> MotionTable:
        if (to, period) not in known:
            file = folder / f"{to}-{period}{ENDINGS[to]}"
            export_trajectory(plan.trajectory, file, to=to, units=UNITS, period=period)
            known[to, period] = read_motion(file, plan.cell)
        return known[to, period]

    return table


# --- unaltered ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("period", [0.001, 0.002, 0.004, 0.008, 0.01, 0.02])
@pytest.mark.parametrize("to", ["csv", "npz", "stream"])
@pytest.mark.slow
def test_samples_pass_at_every_period(
    plan: qparm.Plan, read: Callable[..., MotionTable], to: str, period: float
) -> None:
    report = verify_motion(read(to, period), plan.cell)
    assert report.problems() == ()
    assert report.period == pytest.approx(period)
    checks = {check.name: check for check in report.checks}
    assert checks["points of the path passed in order"].worst == plan.tool_path.point_count
    # rounded positions prove means over longer times only, which are less than the largest jerk
    assert checks["jerk, positions differentiated"].worst > (0.75 if to == "csv" else 0.99)
    assert checks["least clearance where the tool travels"].worst >= 0.0199


@pytest.mark.parametrize("period", [None, 0.008, 0.02])
@pytest.mark.parametrize("to", ["json", "yaml"])
@pytest.mark.slow
def test_points_of_quintics_pass_and_so_do_their_samples(
    plan: qparm.Plan, read: Callable[..., MotionTable], to: str, period: float | None
) -> None:
    report = verify_motion(read(to, period), plan.cell)
    assert report.problems() == ()
    assert np.isnan(report.period) == (period is None)


@pytest.mark.parametrize("period", [None, 0.001, 0.004, 0.02])
def test_profiles_pass_too(ruckig_plan: qparm.Plan, tmp_path: Path, period: float | None) -> None:
    to = "json" if period is None else "csv"
    file = tmp_path / f"motion{ENDINGS[to]}"
    export_trajectory(ruckig_plan.trajectory, file, to=to, units=UNITS, period=period)
    assert verify_motion(read_motion(file, ruckig_plan.cell), ruckig_plan.cell).problems() == ()


@pytest.mark.parametrize("to", ["csv", "json", "stream"])
@pytest.mark.slow
def test_an_export_for_a_cell_says_what_the_command_prints(plan: qparm.Plan, tmp_path: Path, to: str) -> None:
    file, cell_file = tmp_path / f"motion{ENDINGS[to]}", tmp_path / "cell.toml"
    plan.cell.save(cell_file)
    for trajectory, kept in ((plan.trajectory, True), (quicker(plan.trajectory), False)):
        done = export_trajectory(trajectory, file, to=to, units=UNITS, cell=plan.cell)
        assert done.report is not None
        assert done.report.kept == kept
        command = CliRunner().invoke(cli, ["verify", str(file), "--cell", str(cell_file)], standalone_mode=False)
        assert command.output == f"{done.report.text()}\n{LINKS_NOT_CHECKED}\n"
        assert command.return_value == (0 if kept else 3)
    assert export_trajectory(plan.trajectory, file, to=to, units=UNITS).report is None


def quicker(trajectory: qparm.Trajectory) -> qparm.Trajectory:
    """Return a trajectory in 0.99 of its time, which says that it may be executed."""
    return replace(trajectory.scaled(0.99), executable=True, reasons=())


@pytest.mark.parametrize("timing", ["quintic", "ruckig"])
@pytest.mark.slow
def test_a_motion_that_flows_from_row_to_row_passes(tmp_path: Path, timing: Any) -> None:
    """No row end is a stop, so the feed is to be kept up to them, and points are passed on the turns' curve."""
    flowing = qparm.plan(few_rows(self_motion={"row_end": "flow"}), timing=timing)
    for to, period in (("json", None), ("csv", 0.001), ("csv", 0.02), ("stream", 0.004), ("stream", 0.02)):
        file = tmp_path / f"{to}-{period}{ENDINGS[to]}"
        export_trajectory(flowing.trajectory, file, to=to, units=UNITS, period=period)
        table = read_motion(file, flowing.cell)
        report = verify_motion(table, flowing.cell)
        assert report.problems() == (), (to, period)
        checks = {check.name: check for check in report.checks}
        assert checks["points of the path passed in order"].worst == flowing.tool_path.point_count
        assert checks["tool off its path on transitions"].worst > 0
        # the turn is judged, not only the rows
        turned = replace(table, q=table.q + 1e-4 * on_transitions(table, flowing)[:, None])
        assert not verify_motion(turned, flowing.cell).kept


def on_transitions(table: MotionTable, plan: qparm.Plan) -> np.ndarray:
    turn = next(one for one in plan.trajectory.segments if one.kind.value == "transition")
    share = np.clip((table.t - turn.start) / (turn.end - turn.start), 0.0, 1.0)
    return np.sin(np.pi * share) ** 4


@pytest.mark.slow
def test_a_motion_with_breaks_passes() -> None:
    cell = qparm.Cell.load(Path(__file__).parents[2] / "examples" / "reconfiguration.toml")
    plan = qparm.plan(cell)
    t, (q, v, a, j) = plan.trajectory.sample(0.01)
    table = MotionTable("test", plan.chain.names, t, q, v, a, j, np.zeros(8), 0.0)
    report = verify_motion(table, cell)
    assert report.problems() == ()
    # what says that there are breaks is the tool alone
    assert len(plan.joint_path.breaks) >= 2


def test_the_order_of_the_columns_does_not_matter(plan: qparm.Plan, read: Callable[..., MotionTable]) -> None:
    table, back = read("csv", 0.01), slice(None, None, -1)
    columns = {key: getattr(table, key)[:, back] for key in ("q", "velocity", "acceleration", "jerk")}
    assert verify_motion(replace(table, joints=table.joints[back], **columns), plan.cell).kept


# --- altered by one per cent --------------------------------------------------------------------------

Altered = tuple[MotionTable, qparm.Cell]


def changed(cell: qparm.Cell, change: Callable[[dict[str, Any]], None]) -> qparm.Cell:
    data = cell.to_dict()
    change(data)
    return qparm.Cell.load(data)


def times(text: str, factor: float) -> str:
    value, unit = text.split(" ", 1)
    return f"{float(value) * factor!r} {unit}"


def at_its_limit(plan: qparm.Plan, key: str) -> int:
    """Return the revolute joint that comes nearest to its limit."""
    order = ("velocity", "acceleration", "jerk").index(key)
    shares = plan.trajectory.verify(MotionLimits.of(plan.chain)).shares[order]
    joint = int(np.where(plan.chain.prismatic, 0.0, shares).argmax())
    assert shares[joint] > 0.995, "else one per cent less would be kept"
    return joint


def limit(key: str) -> Callable[[MotionTable, qparm.Plan], Altered]:
    def alter(table: MotionTable, plan: qparm.Plan) -> Altered:
        def change(data: dict[str, Any]) -> None:
            joint = data["arm"]["joints"][at_its_limit(plan, key)]
            joint[key] = times(joint[key], 0.99)

        return table, changed(plan.cell, change)

    return alter


def limited(key: str) -> Callable[[qparm.Plan], str]:
    return lambda plan: f"joint {plan.chain.names[at_its_limit(plan, key)]!r}"


def farthest(plan: qparm.Plan) -> int:
    """Return the revolute joint that turns farthest, forwards."""
    return int(np.where(plan.chain.prismatic, 0.0, plan.joint_path.q.max(axis=0)).argmax())


def position_limit(table: MotionTable, plan: qparm.Plan) -> Altered:
    """One per cent below what a joint reaches."""
    k = farthest(plan)

    def change(data: dict[str, Any]) -> None:
        joint = data["arm"]["joints"][k]
        joint["position"] = [joint["position"][0], f"{0.99 * float(table.q[:, k].max())!r} rad"]

    return table, changed(plan.cell, change)


def process(key: str, factor: float) -> Callable[[MotionTable, qparm.Plan], Altered]:
    return lambda table, plan: (
        table,
        changed(plan.cell, lambda data: data["process"].update({key: times(data["process"][key], factor)})),
    )


def fastest(plan: qparm.Plan) -> int:
    """Return the joint that is nearest to its velocity limit where the approach is altered."""
    approach = [one for one in plan.trajectory.segments if one.kind.value == "approach"][-1]
    t = approach.start + 0.37 * (approach.end - approach.start)
    return int((np.abs(plan.trajectory(t, 1)) / plan.chain.velocity).argmax())


def value(
    order: str, joint: int | Callable[[qparm.Plan], int] | None, where: str, share: float = 0.37
) -> Callable[[MotionTable, qparm.Plan], Altered]:
    """Of one sample, at a share of the last segment of a kind: of one joint, or of all."""

    def alter(table: MotionTable, plan: qparm.Plan) -> Altered:
        segment = [one for one in plan.trajectory.segments if one.kind.value == where][-1]
        k = int(np.searchsorted(table.t, segment.start + share * (segment.end - segment.start)))
        column = getattr(table, order).copy()
        column[k, slice(None) if joint is None else joint(plan) if callable(joint) else joint] *= 1.01
        return replace(table, **{order: column}), plan.cell

    return alter


def waypoint(table: MotionTable, plan: qparm.Plan) -> Altered:
    """Alter the sample or point nearest to the passing of a raster point."""
    at = int(np.flatnonzero(plan.joint_path.point == 16)[0])
    k = int(np.abs(table.t - plan.trajectory.knots[at]).argmin())
    q = table.q.copy()
    q[k, 5] *= 1.01
    return replace(table, q=q), plan.cell


def column(order: str, joint: int) -> Callable[[MotionTable, qparm.Plan], Altered]:
    def alter(table: MotionTable, plan: qparm.Plan) -> Altered:
        values = getattr(table, order).copy()
        values[:, joint] *= 1.01
        return replace(table, **{order: values}), plan.cell

    return alter


def all_times(factor: float) -> Callable[[MotionTable, qparm.Plan], Altered]:
    return lambda table, plan: (replace(table, t=table.t * factor), plan.cell)


def one_time(table: MotionTable, plan: qparm.Plan) -> Altered:
    """One per cent of the interval before it."""
    t = table.t.copy()
    k = len(t) // 2
    t[k] += 0.01 * (t[k] - t[k - 1])
    return replace(table, t=t), plan.cell


def geometry(table: MotionTable, plan: qparm.Plan) -> Altered:
    return table, changed(plan.cell, lambda d: d["arm"]["lengths"].update(L1=times(d["arm"]["lengths"]["L1"], 1.01)))


ALTERED: dict[str, tuple[Callable[[MotionTable, qparm.Plan], Altered], str | Callable[[qparm.Plan], str], str]] = {
    "velocity limit": (limit("velocity"), limited("velocity"), "velocity"),
    "acceleration limit": (limit("acceleration"), limited("acceleration"), "acceleration"),
    "jerk limit": (limit("jerk"), limited("jerk"), "jerk"),
    "position limit": (position_limit, lambda plan: f"joint {plan.chain.names[farthest(plan)]!r}", "position"),
    "feed lower": (process("feed", 0.99), "tool", "faster than the feed"),
    "feed higher": (process("feed", 1.01), "tool", "slow"),
    "length of a link": (geometry, "point 0 of row 0", "misses"),
    "position of a sample on a row": (value("q", 3, "row"), "tool", "off its path"),
    "position of a sample of the approach": (value("q", 3, "approach"), "joint 'theta4'", "jerk"),
    "all positions of a sample of a transition": (value("q", None, "transition"), "tool", "off its path"),
    "velocity of a sample of the approach": (
        value("velocity", fastest, "approach"),
        lambda plan: f"joint {plan.chain.names[fastest(plan)]!r}",
        "",
    ),
    "acceleration of a sample of the retract": (value("acceleration", 5, "retract", 0.04), "joint 'theta6'", ""),
    "a waypoint": (waypoint, "point 16 of row 1", "misses"),
    "position column": (column("q", 0), "joint 'd1'", "growth of the position"),
    "velocity column": (column("velocity", 7), "joint 'theta8'", "growth of the velocity"),
    "acceleration column": (column("acceleration", 2), "joint 'theta3'", "over what the acceleration says"),
    "jerk column": (column("jerk", 3), "joint 'theta4'", "growth of the acceleration over what the jerk says"),
    "all times slower": (all_times(1.01), "tool", "slower than the feed although no joint limit requires it"),
    "all times faster": (all_times(0.99), "tool", "faster than the feed"),
    "one time": (one_time, "time", "interval"),
}
NOT_IN = {
    "stream": ("velocity of", "acceleration of", "velocity column", "acceleration column", "jerk column"),
    # another velocity or acceleration of one point is another motion, which may keep everything
    "json": ("velocity of", "acceleration of", "jerk column", "one time"),
}


def cases() -> list[Any]:
    formats = (("csv", 0.004), ("csv", 0.02), ("npz", 0.01), ("stream", 0.004), ("stream", 0.02), ("json", None))
    return [
        pytest.param(to, period, name, id=f"{name}, {to} {period}")
        for to, period in formats
        for name in ALTERED
        if not name.startswith(NOT_IN.get(to, ("nothing",)))
    ]


def told(report: MotionReport, subject: str, what: str) -> bool:
    return any(one.subject == subject and what in one.what for one in report.findings)


@pytest.mark.parametrize(("to", "period", "name"), cases())
def test_one_per_cent_is_found_and_named(
    plan: qparm.Plan, read: Callable[..., MotionTable], to: str, period: float | None, name: str
) -> None:
    alter, subject, what = ALTERED[name]
    subject = subject if isinstance(subject, str) else subject(plan)
    report = verify_motion(*alter(read(to, period), plan))
    assert not report.kept
    assert told(report, subject, what) or (to == "stream" and "column" in name), report.problems()
    assert 1 <= len(report.problems()) <= 11
    assert "NOT kept" in report.text()


@pytest.mark.parametrize("joint", range(8))
@pytest.mark.parametrize("order", ["q", "velocity", "acceleration", "jerk"])
def test_every_column_of_every_joint_is_looked_at(
    plan: qparm.Plan, read: Callable[..., MotionTable], order: str, joint: int
) -> None:
    assert not verify_motion(*column(order, joint)(read("csv", 0.02), plan)).kept


@pytest.mark.parametrize("joint", [0, 5, slice(None)])
@pytest.mark.parametrize(
    ("to", "order", "what"),
    [
        ("csv", "velocity", "velocity is zero while the position changes"),
        ("csv", "acceleration", "acceleration is zero while the velocity changes"),
        ("csv", "jerk", "jerk is zero while the acceleration changes"),
        ("json", "velocity", "velocity is zero while the position changes"),
        ("json", "acceleration", "acceleration is zero while the velocity changes"),
    ],
)
def test_a_column_of_zeros_is_refused(
    plan: qparm.Plan, read: Callable[..., MotionTable], to: str, order: str, what: str, joint: int | slice
) -> None:
    """No ratio can be taken to zero, and a jerk of zero contradicts no position."""
    table = read(to, 0.02 if to == "csv" else None)
    values = getattr(table, order).copy()
    values[:, joint] = 0.0
    report = verify_motion(replace(table, **{order: values}), plan.cell)
    for k in np.atleast_1d(np.arange(8)[joint]):
        assert told(report, f"joint {table.joints[k]!r}", what), report.problems()


def test_a_joint_that_rests_has_columns_of_zeros() -> None:
    t = np.linspace(0.0, 4.0, 201)
    moves = [np.sin(t), np.cos(t), -np.sin(t), -np.cos(t)]
    columns: list[np.ndarray | None] = [np.stack([x, np.zeros_like(t)], axis=1) for x in moves]
    columns[0] = np.stack([moves[0], np.full_like(t, 0.7)], axis=1)
    rounding = np.full((4, 2), 1e-12)
    assert silent_columns(columns, rounding) == []
    for order in (1, 2, 3):
        zeroed = [*columns]
        zeroed[order] = np.zeros((len(t), 2))
        assert [found[:2] for found in silent_columns(zeroed, rounding)] == [(order - 1, 0)]


def test_twenty_alterations() -> None:
    assert len(ALTERED) == 20


# --- other things that are wrong ----------------------------------------------------------------------


def test_a_motion_cut_short_does_not_end_at_home(plan: qparm.Plan, read: Callable[..., MotionTable]) -> None:
    table = read("stream", 0.004)
    report = verify_motion(replace(table, t=table.t[:-50], q=table.q[:-50]), plan.cell)
    assert any("distance from home at the end" in one.what for one in report.findings)


def test_a_point_left_out_is_missed(plan: qparm.Plan, read: Callable[..., MotionTable]) -> None:
    """A cell with one row more than the motion has."""
    more = changed(plan.cell, lambda data: data["process"].update(rows=4))
    report = verify_motion(read("csv", 0.01), more)
    missed = [one for one in report.findings if "misses" in one.what]
    assert len(missed) > 10
    assert len(report.problems()) == 11
    assert "more" in report.problems()[-1]


def test_rows_run_the_other_way_are_not_in_order(plan: qparm.Plan, read: Callable[..., MotionTable]) -> None:
    table = read("stream", 0.01)
    backwards = replace(table, q=np.ascontiguousarray(table.q[::-1]), t=table.t[-1] - table.t[::-1])
    assert not verify_motion(backwards, plan.cell).kept


def test_a_motion_that_lifts_off_too_low_is_refused(plan: qparm.Plan, read: Callable[..., MotionTable]) -> None:
    strict = changed(plan.cell, lambda data: data["process"].update(clearance="5 m"))
    report = verify_motion(read("csv", 0.01), strict)
    assert any(one.code == "clearance" and "clearance" in one.what for one in report.findings)


def test_the_rows_that_a_file_says_are_compared(plan: qparm.Plan, read: Callable[..., MotionTable]) -> None:
    table = read("csv", 0.01)
    assert table.row is not None
    other = np.flatnonzero(table.row == 2)
    report = verify_motion(replace(table, row=np.where(table.row == 2, 1, table.row)), plan.cell)
    (wrong,) = report.findings
    assert wrong.subject == "columns"
    # the first samples of a row may be either's
    (k,) = (k for k in other[1:8].tolist() if wrong.what == f"row of sample {k} in the file")
    assert wrong.time == pytest.approx(table.t[k])
    assert (wrong.amount, wrong.limit) == (1, 2)
    assert len(other) - 14 <= wrong.count <= len(other)


def test_the_kinds_of_segment_that_a_file_says_are_compared(plan: qparm.Plan, read: Callable[..., MotionTable]) -> None:
    table = read("csv", 0.01)
    assert table.segment is not None
    assert table.row is not None
    k = int(np.flatnonzero(table.row == 1)[20])
    segment = table.segment.astype(object)
    segment[k : k + 3] = "transition"
    report = verify_motion(replace(table, segment=segment.astype(str)), plan.cell)
    (sentence,) = report.problems()
    assert sentence == (
        f"{table.t[k]:.4f} s: columns: the file calls sample {k} 'transition', the tool follows row 1; samples of the"
        " kind 3, allowed 0"
    )


@pytest.mark.parametrize("to", ["json", "yaml", "npz", "parquet", "mcap", "rosbag2"])
def test_a_file_that_says_it_must_not_be_executed_is_not_kept(plan: qparm.Plan, tmp_path: Path, to: str) -> None:
    """Whatever its motion is worth: every format that can say so is asked."""
    for module in {"parquet": ["pyarrow"], "mcap": ["mcap_ros2"], "rosbag2": ["rosbags"]}.get(to, []):
        pytest.importorskip(module)
    assert FORMATS[to].verdict
    for executable in (True, False):
        trajectory = replace(plan.trajectory, executable=executable, reasons=() if executable else ("a reason",))
        file = tmp_path / f"{executable}{FORMATS[to].extension}"
        export_trajectory(trajectory, file, to=to, units=UNITS, allow_failures=True)
        table = read_motion(file, plan.cell)
        assert table.executable is executable
        problems = verify_motion(table, plan.cell).problems()
        assert problems == (() if executable else ("0.0000 s: file: marked executable false, allowed true",))


def test_every_format_with_a_verdict_is_among_them() -> None:
    assert {name for name, one in FORMATS.items() if one.verdict} == {
        "json", "yaml", "npz", "parquet", "mcap", "rosbag2",
    }  # fmt: skip


def test_what_is_no_motion_is_refused(plan: qparm.Plan, read: Callable[..., MotionTable]) -> None:
    table = read("stream", 0.01)
    other = replace(table, joints=("rail", *table.joints[1:]))
    with pytest.raises(qparm.InvalidInput, match="joints rail"):
        verify_motion(other, plan.cell)
    with pytest.raises(qparm.InvalidInput, match="single sample"):
        verify_motion(replace(table, t=table.t[:1], q=table.q[:1]), plan.cell)
    q = table.q.copy()
    q[7, 2] = np.nan
    with pytest.raises(qparm.InvalidInput, match=r"sample 7: the position of joint .* is nan, not finite"):
        verify_motion(replace(table, q=q), plan.cell)
    with pytest.raises(qparm.InvalidInput, match=r"sample 1: the time .* does not come after"):
        verify_motion(replace(table, t=table.t[::-1]), plan.cell)
    # positions every 0.2 s tell nothing of the tool between them
    with pytest.raises(qparm.InvalidInput, match="take a shorter period"):
        verify_motion(replace(table, t=table.t[::20], q=table.q[::20]), plan.cell)


def test_points_between_which_a_joint_leaves_its_limits_are_refused() -> None:
    """The rail rests at its end and is pushed beyond it half way: no point is outside, the motion is."""
    cell = qparm.Cell.load(few_rows())
    n = len(cell.home())
    q, acceleration = np.tile(cell.home(), (3, 1)), np.zeros((3, n))
    acceleration[1, 0] = -0.1
    names = tuple(joint.name for joint in cell.arm.joints)
    t, none = np.array([0.0, 0.4, 1.0]), np.zeros((3, n))
    table = MotionTable("json", names, t, q, none, acceleration, None, np.zeros(n), 0.0)
    said = [str(one) for one in verify_motion(table, cell).findings]
    assert any("'d1'" in one and "position of the quintics" in one for one in said)
