"""Waypoints from elsewhere: cleaned, fitted inside a band, timed, and the command that does it."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.interpolate import make_interp_spline

import qparm
from qparm.cli import cli
from qparm.path import JointPath, Segment, SegmentKind
from qparm.robot import MotionLimits
from qparm.timing import (
    find_kinks,
    fit_band,
    largest_bulge,
    quintic_form,
    rounded_to,
    ruckig_form,
    straight_duration,
    straight_motion,
    time_waypoints,
)
from qparm.timing.path_speed import SpeedProfile
from qparm.timing.waypoint_files import read_limits, read_waypoint_table
from qparm.verify import read_samples

pytestmark = pytest.mark.slow

LIMITS = MotionLimits([1.0, 2.0], [3.0, 4.0], [30.0, 40.0])
FORMS = {"quintic": quintic_form, "ruckig": ruckig_form}


def walk(count: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    knots = np.cumsum(rng.normal(size=(12, 2)), axis=0)
    return make_interp_spline(np.arange(12.0), knots, k=5)(np.linspace(0.0, 11.0, count))


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("corners", ["smooth", "stop"])
@pytest.mark.parametrize("count", [2, 3, 5, 6, 60])
def test_waypoints_are_passed_within_limits_at_rest_at_the_ends(form: str, corners: str, count: int) -> None:
    q = walk(count)
    timing = time_waypoints(q, LIMITS, corners=corners)  # pyright: ignore[reportArgumentType]
    trajectory = FORMS[form](timing)
    assert trajectory.verify(LIMITS, path=timing.path).problems(share=1 + 1e-4) == ()
    np.testing.assert_array_equal(timing.path.q, q)
    for order in (1, 2):
        np.testing.assert_allclose(trajectory([0.0, trajectory.duration], order), 0.0, atol=1e-6)


def test_repeated_waypoints_change_nothing() -> None:
    q = walk(20)
    plain = time_waypoints(q, LIMITS)
    repeated = time_waypoints(np.repeat(q, 3, axis=0), LIMITS)
    np.testing.assert_array_equal(repeated.path.q, q)
    assert repeated.duration == pytest.approx(plain.duration, rel=1e-9)


@pytest.mark.parametrize("distance", [1e-4, 1e-5, 2e-6, 1e-7, 1e-9, 1e-12])
@pytest.mark.parametrize("band", [0.0, 1e-3])
def test_nearly_equal_waypoints_cost_no_time_in_either_form(distance: float, band: float) -> None:
    """A curve turns with both; nearer than waypoints are passed, they are one."""
    q = np.array([[0, 0], [1, 1], [1, 1 + distance], [2, 0], [3, 0.5]])
    limits = MotionLimits([1, 1], [2, 2], [10, 10])
    plain, timing = time_waypoints(np.delete(q, 2, axis=0), limits, band=band), time_waypoints(q, limits, band=band)
    # without a band both are passed, and what lies between them is a corner
    longest = 1.6 if distance > 1e-6 and not band else 1.0 + 1e-3
    assert timing.duration < longest * plain.duration
    assert len(timing.path.q) == (5 if distance > 1e-6 else 4)
    for form in FORMS.values():
        trajectory = form(timing)
        assert trajectory.verify(limits, path=timing.path).problems(share=1 + 1e-4) == ()
        assert trajectory.duration == pytest.approx(timing.duration, rel=1e-5)


def test_waypoints_are_dropped_by_their_distance_from_those_kept() -> None:
    q = np.array([[0.0, 0.0], [1.0, 1.0], *([1.0, 1.0 + k * 6e-7] for k in range(1, 7)), [2.0, 3.0], [2.0, 3.0 + 1e-7]])
    kept = time_waypoints(q, LIMITS, corners="stop").path.q
    # six of 0.6 um follow each other: every second is farther than 1 um from the one kept before; the end stays
    np.testing.assert_array_equal(kept, q[[0, 1, 3, 5, 7, 9]])
    within = time_waypoints(q, LIMITS, band=1e-5).path.q
    assert all(np.abs(within - row).max(axis=1).min() <= 1e-5 for row in q)
    # a small path keeps its shape, and so does one of many waypoints
    for fine in (1e-6 * walk(20), 1e-3 * walk(3000)):
        np.testing.assert_array_equal(time_waypoints(fine, LIMITS).path.q, fine)


def test_a_kink_and_a_reversal_are_passed() -> None:
    for q in ([[0, 0], [1, 0], [1, 1]], [[0, 0], [1, 1], [0, 0]], [[0, 0], [1, 0], [0.99, 0.01], [2, 3]]):
        timing = time_waypoints(q, LIMITS)
        assert quintic_form(timing).verify(LIMITS, path=timing.path).problems() == ()


def test_at_a_kink_between_close_waypoints_it_stops_where_that_is_quicker() -> None:
    """A rectangle sampled finely: round its corners a smooth curve would need bends of a hundredth of its size."""
    x = np.linspace(0.0, 1.0, 101)[1:]
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    q = np.concatenate([corners[:1], *(a + (b - a) * x[:, None] for a, b in pairwise(corners))])
    assert find_kinks(q / LIMITS.velocity).tolist() == [100, 200]
    timing = time_waypoints(q, LIMITS)
    assert [(segment.first, segment.last) for segment in timing.path.segments] == [(0, 100), (100, 200), (200, 300)]
    sides = sum(straight_motion(a, b, LIMITS).duration for a, b in pairwise(corners))
    assert timing.duration == pytest.approx(sides, rel=5e-3)
    for form in FORMS.values():
        trajectory = form(timing)
        assert trajectory.verify(LIMITS, path=timing.path).problems() == ()
        np.testing.assert_allclose(trajectory(trajectory.knots[[100, 200]], 1), 0.0, atol=1e-7)
    # in a band the corners stay, and what lies between is fitted
    noisy = q + 1e-4 * np.random.default_rng(0).normal(size=q.shape)
    within = time_waypoints(noisy, LIMITS, band=5e-4)
    np.testing.assert_array_equal(within.path.q[[0, 100, 200, 300]], noisy[[0, 100, 200, 300]])
    assert within.duration < 1.1 * timing.duration
    # and a round path has none, nor one whose waypoints are its corners
    assert not len(find_kinks(walk(200)))
    assert not len(find_kinks(corners[[0, 1, 2, 3, 0, 1]]))


def test_a_curve_that_swings_wide_is_told() -> None:
    q = np.array([[0, 0], [1, 0], [1.3, 0.2], [1.5, 0.4], [1.6, 0.7]])
    distance, after = largest_bulge(time_waypoints(q, LIMITS).path)
    assert after == 0
    assert distance > 0.05
    # and not done where stopping is quicker
    q = np.array([[0, 0], [1, 0], [1.01, 0.01], [1.02, 0.04], [1.03, 0.09], [1.04, 0.16], [1.05, 0.25]])
    timing = time_waypoints(q, LIMITS)
    assert [(segment.first, segment.last) for segment in timing.path.segments] == [(0, 1), (1, 6)]
    assert largest_bulge(timing.path)[0] < 0.01
    assert largest_bulge(time_waypoints(q, LIMITS, corners="stop").path) == (0.0, 0)


@pytest.mark.parametrize("form", FORMS.values(), ids=FORMS.keys())
def test_waypoints_at_all_distances_are_passed_within_the_limits(form: Any) -> None:
    """Chords from a micrometre to a metre beside each other: a curve would swing, so it stops where it would."""
    stops = 0
    for seed in range(25):
        rng = np.random.default_rng(seed)
        way = rng.standard_normal((int(rng.integers(5, 40)), 2))
        way *= (10.0 ** rng.uniform(-6, 0, len(way)) / np.linalg.norm(way, axis=1))[:, None]
        timing = time_waypoints(np.concatenate([np.zeros((1, 2)), np.cumsum(way, axis=0)]), LIMITS)
        stops += len(timing.path.segments) - 1
        assert form(timing).verify(LIMITS, path=timing.path).problems() == ()
        # not much longer than from rest to rest at each of them, if at all: a curve took up to a thousand times as long
        assert timing.duration <= time_waypoints(timing.path.q, LIMITS, corners="stop").duration * 1.5
    assert stops > 100


@pytest.mark.parametrize("band", [0.0, 1e-3])
@pytest.mark.parametrize("direction", [[1.0, 1.0], [1.0, 0.0], [0.3, -2.0]])
def test_a_way_that_turns_back_stops_there_and_does_not_swing_beyond(direction: list[float], band: float) -> None:
    q = np.outer([0.0, 1.0, 0.0, 1.0, 0.0], direction)
    limits = MotionLimits([3.0, 3.0], [4.0, 4.0], [40.0, 40.0])
    timing = time_waypoints(q, limits, band=band)
    assert timing.duration == time_waypoints(q, limits, corners="stop").duration
    assert [segment.last for segment in timing.path.segments] == [1, 2, 3, 4]
    positions = quintic_form(timing)(np.linspace(0.0, timing.duration, 2001))
    assert (positions >= q.min(axis=0) - 1e-9).all()
    assert (positions <= q.max(axis=0) + 1e-9).all()
    if direction == [1.0, 1.0]:
        assert timing.duration == pytest.approx(4.42, abs=5e-3)


def test_a_way_that_turns_back_between_close_waypoints_stops_there_too() -> None:
    there = np.linspace(0.0, 1.0, 30)[:, None] * [1.0, 0.5]
    timing = time_waypoints(np.concatenate([there, there[-2::-1]]), LIMITS)
    assert [segment.last for segment in timing.path.segments] == [29, 58]
    assert largest_bulge(timing.path)[0] < 1e-8


@pytest.mark.parametrize("seed", range(6))
def test_stopping_everywhere_is_among_the_candidates(seed: int) -> None:
    q = np.random.default_rng(seed).normal(size=(7, 2))
    stopped = time_waypoints(q, LIMITS, corners="stop")
    assert time_waypoints(q, LIMITS).duration <= stopped.duration
    assert straight_duration(np.diff(q, axis=0), LIMITS) == pytest.approx(stopped.duration, rel=1e-9)


@pytest.mark.parametrize("step", [1e-6, 1e-3, 0.02, 0.3, 5.0, 80.0])
def test_the_time_of_straight_lines_is_that_of_the_motions(step: float) -> None:
    steps = np.array([[step, 0.0], [0.0, 0.0], [-0.5 * step, step]])
    motions = sum(straight_motion(np.zeros(2), one, LIMITS).duration for one in steps if one.any())
    assert straight_duration(steps, LIMITS) == pytest.approx(motions, rel=1e-6)


def one_curve(q: np.ndarray) -> JointPath:
    """Return one curve through waypoints, stopping nowhere between its ends."""
    N = len(q)
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(q, axis=0), axis=1))])
    return JointPath(
        joint_names=("a", "b"), q=q, point=np.arange(N), row=np.zeros(N, dtype=np.int64), kind=(SegmentKind.ROW,) * N,
        status=("reached",) * N, s=s, segments=(Segment(SegmentKind.ROW, 0, 0, N - 1),), parameters=(s,),
    )  # fmt: skip


@pytest.mark.parametrize("turn", [0.0, 0.4, 1.2])
def test_how_far_a_curve_leaves_the_lines_is_a_distance(turn: float) -> None:
    q = np.array([[0.0, 0.0], [1.0, 1.0], [0.0, 0.0], [1.0, 1.0], [0.0, 0.0]])
    q[:, 1] += turn * np.arange(5.0)
    path = one_curve(q)
    distance, after = largest_bulge(path)
    # measured by hand: the nearest of many points of the line, by the joint that differs most
    line = q[after] + np.linspace(0.0, 1.0, 4001)[:, None] * (q[after + 1] - q[after])
    curve = path.run_curve(path.runs[0])(path.s[after] + np.diff(path.s)[after] * np.arange(1, 16) / 16)
    nearest = np.abs(curve[:, None] - line).max(axis=2).min(axis=1)
    assert distance == pytest.approx(nearest.max(), abs=1e-3)
    if turn == 0.0:
        # all in one line: no farther than the curve goes beyond its ends
        beyond = path.run_curve(path.runs[0])(np.linspace(0.0, path.s[-1], 20_001))
        assert distance == pytest.approx(max(beyond.max() - 1.0, -beyond.min()), abs=2e-3)


def sines(count: int, digits: int) -> np.ndarray:
    t, rng = np.linspace(0.0, 6.0, count)[:, None, None], np.random.default_rng(4)
    waves = rng.uniform(0.1, 0.5, (2, 3)) * np.sin(2 * np.pi * np.array([0.05, 0.11, 0.23]) * t)
    return np.round(waves.sum(axis=2), digits)


@pytest.mark.parametrize("digits", [4, 5, 6])
def test_waypoints_that_were_rounded_are_seen(digits: int) -> None:
    assert rounded_to(sines(10_000, digits)) == digits


@pytest.mark.parametrize(
    "q",
    [
        sines(300, 12),
        sines(30, 5),
        np.round(walk(60), 2),
        np.round(np.random.default_rng(0).normal(size=(100, 2)), 3),
        np.linspace(0.0, 1.0, 101)[:, None].round(2) * [1.0, 2.0],
        np.tile([[0.0, 0.0], [1.0, 1.0]], (50, 1)),
    ],
    ids=["not rounded", "far apart", "few", "a rough way", "a straight line", "back and forth"],
)
def test_waypoints_whose_rounding_does_not_matter_are_left_alone(q: np.ndarray) -> None:
    assert rounded_to(q) is None


def test_the_command_says_that_rounding_bends_the_curve(tmp_path: Path) -> None:
    options = files(tmp_path, "\n".join(f"{a:.5f},{b:.5f}" for a, b in sines(1000, 5)) + "\n")
    rough = CliRunner().invoke(cli, options)
    assert "rounded to 1e-5 (m or rad)" in rough.output
    assert "try --band 1e-5" in rough.output
    smooth = CliRunner().invoke(cli, [*options, "--band", "1e-5"])
    assert "rounded" not in smooth.output

    def seconds(output: str) -> float:
        return float(output.split(" s,")[0].split()[-1])

    assert seconds(smooth.output) < 0.5 * seconds(rough.output)


def circle(count: int) -> np.ndarray:
    angle = np.linspace(0.0, 6.0, count)
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize(
    ("q", "jerk"),
    [
        (circle(10_000), 20.0),
        *((np.random.default_rng(1).normal(size=(12, 3)), jerk) for jerk in (1e3, 1e6)),
    ],
    ids=["waypoints half a millisecond apart", "jerk 1e3", "jerk 1e6"],
)
def test_limits_are_kept_where_ruckig_cannot_make_up_for_what_it_misses(form: str, q: np.ndarray, jerk: float) -> None:
    n = q.shape[1]
    limits = MotionLimits(np.full(n, 1.0), np.full(n, 2.0), np.full(n, jerk))
    timing = time_waypoints(q, limits)
    trajectory = FORMS[form](timing)
    verified = trajectory.verify(limits, path=timing.path)
    assert verified.problems(share=1 + 1e-4, waypoint=1e-6) == ()
    assert trajectory.duration < 1.0015 * timing.duration
    assert (np.diff(trajectory.knots) > 0).all()
    assert trajectory.knots[-1] == pytest.approx(trajectory.polynomials[0].x[-1], abs=1e-9)


def test_a_motion_of_days_is_timed_in_both_forms() -> None:
    """Ruckig refuses more than 7,600 s."""
    slow = MotionLimits([1e-5, 1e-5], [1e-6, 1e-6], [1e-6, 1e-6])
    for corners in ("smooth", "stop"):
        timing = time_waypoints(walk(5), slow, corners=corners)  # pyright: ignore[reportArgumentType]
        assert timing.duration > 1e5
        for form in FORMS.values():
            trajectory = form(timing)
            assert trajectory.verify(slow, path=timing.path).problems() == ()
            assert trajectory.duration == pytest.approx(timing.duration, rel=1e-5)


@pytest.mark.parametrize(
    ("q", "words"),
    [
        ([[0, 0]], "at least two waypoints"),
        ([[1, 2], [1, 2]], "all waypoints are the same"),
        ([[0, 0], [1, np.nan]], "waypoint 1 has a value of joint 1 that is not finite"),
        ([[0, 0], [np.inf, 1]], "waypoint 1 has a value of joint 0"),
        ([[0, 0, 0], [1, 1, 1]], "of 2 joints"),
        ([[0, 0], [1]], "table of numbers"),
        ([[0, 0], [1e300, 1e9]], "waypoint 1 has 1e\\+300 for joint 0: numbers beyond 1e\\+09 do not hold positions"),
    ],
)
def test_bad_waypoints_are_refused_by_index(q: list, words: str) -> None:
    with pytest.raises(qparm.InvalidInput, match=words):
        time_waypoints(q, LIMITS)


@pytest.mark.parametrize("corners", ["smooth", "stop"])
@pytest.mark.parametrize("size", [1e-13, 1e-162, 1e-182, 1e-299, 5e-324])
def test_a_motion_too_small_for_any_number_to_hold_is_refused(size: float, corners: Any) -> None:
    with pytest.raises(qparm.InvalidInput, match="all waypoints are the same: no joint moves by more than 1e-12"):
        time_waypoints(size * np.array([[0, 0], [1, 0], [0, 1], [1, 1]]), LIMITS, corners=corners)


@pytest.mark.parametrize("form", FORMS.values(), ids=FORMS.keys())
def test_a_straight_motion_slowed_for_rounding_ends_once(form: Any) -> None:
    """Phases of a few microseconds, a thousand seconds on: digits of time and place ask for longer ones."""
    limits = MotionLimits([1.0, 2.0], [1e-5, 4.0], [30.0, 40.0])
    timing = time_waypoints([[0.243, 1.532], [-0.269, 1.792], [-0.288, -0.094], [1.889, 0.275]], limits, corners="stop")
    trajectory = form(timing)
    assert trajectory.duration > timing.duration
    assert (np.diff(trajectory.knots) > 0).all()
    assert trajectory.verify(limits, path=timing.path).problems() == ()


def test_a_motion_too_long_for_whole_nanoseconds_is_refused() -> None:
    with pytest.raises(qparm.InvalidInput, match="more than 4e\\+06 s: are the units"):
        time_waypoints([[0, 0], [0.5, 1e7], [1, 1]], LIMITS)


def test_bad_options_are_refused() -> None:
    q = walk(5)
    for extreme in (1e-300, 1e300):
        with pytest.raises(qparm.InvalidInput, match="the band must be 0 or lie between 1e-12 and 1e\\+09"):
            time_waypoints(q, LIMITS, band=extreme)
    with pytest.raises(qparm.InvalidInput, match="band"):
        time_waypoints(q, LIMITS, band=-1.0)
    with pytest.raises(qparm.InvalidInput, match="corners"):
        time_waypoints(q, LIMITS, corners="round")  # pyright: ignore[reportArgumentType]
    with pytest.raises(qparm.InvalidInput, match="3 joint names for 2"):
        time_waypoints(q, LIMITS, names=("a", "b", "c"))


def test_a_band_takes_the_noise_out() -> None:
    q = walk(3000)
    noisy = q + 1e-5 * np.random.default_rng(1).normal(size=q.shape)
    clean, without, within = (
        time_waypoints(x, LIMITS, band=band) for x, band in ((q, 0.0), (noisy, 0.0), (noisy, 1e-4))
    )
    assert without.duration > 1.3 * clean.duration
    assert within.duration < 1.1 * clean.duration
    assert np.abs(within.path.q - noisy).max() <= 1e-4
    np.testing.assert_array_equal(within.path.q[[0, -1]], noisy[[0, -1]])


def test_the_fit_is_the_least_third_difference_inside_the_band() -> None:
    cvxpy = pytest.importorskip("cvxpy")
    rng = np.random.default_rng(0)
    s = np.cumsum(rng.uniform(0.5, 1.5, size=25))
    q = np.sin(0.3 * s)[:, None] + 0.01 * rng.normal(size=(25, 1))
    fitted = fit_band(s - s[0], q, 0.01)

    def rough(x: np.ndarray) -> np.ndarray:
        third = []
        for k in range(22):
            t = s[k : k + 4]
            weights = [1 / np.prod([t[i] - t[j] for j in range(4) if j != i]) for i in range(4)]
            third.append(np.sqrt((t[3] - t[0]) / 3) * np.array(weights) @ np.eye(25)[k : k + 4])
        return np.array(third) @ x

    x = cvxpy.Variable(25)
    bounds = [cvxpy.abs(x - q[:, 0]) <= 0.01, x[0] == q[0, 0], x[-1] == q[-1, 0]]
    best = cvxpy.Problem(cvxpy.Minimize(cvxpy.sum_squares(rough(np.eye(25)) @ x)), bounds).solve(solver=cvxpy.CLARABEL)
    assert np.sum(rough(fitted[:, 0]) ** 2) == pytest.approx(best, rel=1e-3)


# --- files and the command ---------------------------------------------------------------------------


def files(
    folder: Path, table: str, limits: str = '{"velocity":[1,2],"acceleration":[3,4],"jerk":[30,40]}'
) -> list[str]:
    (folder / "q.csv").write_text(table)
    (folder / "limits.json").write_text(limits)
    return ["time", str(folder / "q.csv"), "--limits", str(folder / "limits.json"), "--out", str(folder / "o.csv")]


TABLE = "t,a,b\n0,0,0\n1,0.5,0.1\n2,1,1\n"


@pytest.mark.parametrize("form", FORMS)
def test_the_command_writes_samples_that_verify_reads(tmp_path: Path, form: str) -> None:
    run = CliRunner().invoke(cli, [*files(tmp_path, TABLE), "--timing", form], standalone_mode=False)
    assert (run.exception, run.return_value) == (None, 0)
    samples = read_samples(tmp_path / "o.csv")
    assert samples.joints == ("a", "b")
    np.testing.assert_allclose(samples.derivatives[0, [0, -1]], [[0, 0], [1, 1]], atol=1e-8)
    assert (np.abs(samples.derivatives[1:]) <= LIMITS.table[:, None] * 1.001).all()
    assert sorted(f.name for f in tmp_path.iterdir()) == ["limits.json", "o.csv", "q.csv"]


@pytest.mark.parametrize(
    "time", ["t", "T", "Time", "t[s]", "t [ms]", "Time (s)", "TIME( us )", "time (\u00b5s)", "t(min)"]
)
def test_times_are_no_joint(tmp_path: Path, time: str) -> None:
    (tmp_path / "q.csv").write_text(f"{time},a,b\n0,0,1\n1,2,3\n", encoding="utf-8")
    names, q = read_waypoint_table(tmp_path / "q.csv")
    assert names == ("a", "b")
    np.testing.assert_array_equal(q, [[0, 1], [2, 3]])


@pytest.mark.parametrize("joint", ["tilt", "t1", "timer[s]"])
def test_what_only_begins_as_time_is_a_joint(tmp_path: Path, joint: str) -> None:
    (tmp_path / "q.csv").write_text(f"{joint},b\n0,1\n2,3\n")
    assert read_waypoint_table(tmp_path / "q.csv")[1].shape == (2, 2)


def test_the_command_tells_what_it_left_out(tmp_path: Path) -> None:
    table = "a,b\n0,0\n0.5,0.1\n0.5,0.1000001\n1,1\n"
    run = CliRunner().invoke(cli, files(tmp_path, table), standalone_mode=False)
    assert "left out, as nearer than 1e-06 (m or rad) to a neighbour: 1 of 4 waypoints" in run.output
    assert "3 waypoints" in run.output


def test_limits_are_read_from_toml_and_a_table_needs_no_names(tmp_path: Path) -> None:
    (tmp_path / "l.toml").write_text("velocity = [1, 2]\nacceleration = [3, 4]\njerk = [30, 40]\n")
    np.testing.assert_array_equal(read_limits(tmp_path / "l.toml").table, LIMITS.table)
    (tmp_path / "q.csv").write_text("0,1\n2,3\n")
    names, q = read_waypoint_table(tmp_path / "q.csv")
    assert names == ()
    np.testing.assert_array_equal(q, [[0, 1], [2, 3]])


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ("", "empty"),
        ("a,b\n", "at least two waypoints"),
        ("a,b\n0,0\n", "at least two waypoints"),
        ("a,b\n0,0\n1\n", "line 3 has 1 values"),
        ("a,b\n0,0\n1,x\n", "line 3, column 2: 'x' is not a number"),
        ("a,b\n0,0\n1,nan\n", "line 3, column 2: nan is not finite"),
        ("t,a,b\n0,0,0\n2,1,1\n1,2,2\n", "line 4: time runs backwards"),
        ("Time (ms),a,b\n0,0,0\n2,1,1\n1,2,2\n", "line 4: time runs backwards"),
        ("t[rad],a,b\n0,0,0\n1,1,1\n", "'t[rad]', has no unit of time (s, ms"),
        ("a,a\n0,0\n1,1\n", "joint names must differ"),
        ("a,b,c\n0,0,0\n1,1,1\n", "of 2 joints"),
    ],
)
def test_a_bad_table_is_refused_with_its_line(tmp_path: Path, table: str, words: str) -> None:
    run = CliRunner().invoke(cli, files(tmp_path, table), standalone_mode=False)
    assert isinstance(run.exception, qparm.InvalidInput)
    assert words in str(run.exception)
    assert not (tmp_path / "o.csv").exists()


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        ("{", "is not whole JSON, it may be cut short"),
        ('{"velocity":[1,1]}', "missing: acceleration, jerk"),
        ('{"velocity":[1,0],"acceleration":[1,1],"jerk":[1,1]}', "velocity limit of joint 1"),
        ('{"velocity":[1],"acceleration":[1,1],"jerk":[1,1]}', "must be as many"),
        (
            '{"velocity":[true,1],"acceleration":[1,1],"jerk":[1,1]}',
            "velocity limit of joint 0 must be a number, not true",
        ),
        (
            '{"velocity":[1,1],"acceleration":[1,1],"jerk":[10,"10"]}',
            "jerk limit of joint 1 must be a number, not '10'",
        ),
        ('{"velocity":"fast","acceleration":[1,1],"jerk":[1,1]}', "list of numbers"),
    ],
)
def test_bad_limits_are_refused(tmp_path: Path, limits: str, words: str) -> None:
    run = CliRunner().invoke(cli, files(tmp_path, TABLE, limits), standalone_mode=False)
    assert isinstance(run.exception, qparm.InvalidInput)
    assert words in str(run.exception)


@pytest.mark.slow
def test_a_hundred_thousand_waypoints_take_work_that_is_linear_in_them() -> None:
    """A step of the law is banded, so linear in its intervals; how many seconds that is, comparisons.timings tells."""
    work, pieces = [], []
    for count in (20_000, 100_000):
        rng = np.random.default_rng(0)
        knots = np.cumsum(rng.normal(size=(count // 100, 2)), axis=0)
        q = make_interp_spline(np.arange(len(knots)), knots, k=5)(np.linspace(0, len(knots) - 1, count))
        timing = time_waypoints(q, LIMITS)
        profiles = [motion for motion in timing.motions if isinstance(motion, SpeedProfile)]
        work.append(sum(one.newton_steps * len(one.knots) for one in profiles))
        pieces.append(quintic_form(timing).piece_count)
    assert 0 < work[1] < 10 * work[0]
    assert pieces[1] < 6 * pieces[0]
