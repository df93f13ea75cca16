"""Joint paths and trajectories as data: what they refuse, and how they are called."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.interpolate import PPoly

from qparm.errors import InvalidInput
from qparm.path import JointPath, Segment, SegmentKind, TimedSegment, Trajectory

Array = NDArray[np.float64]

APPROACH, ROW, TRANSITION = SegmentKind.APPROACH, SegmentKind.ROW, SegmentKind.TRANSITION
BREAK, RETRACT = SegmentKind.BREAK, SegmentKind.RETRACT


# --- joint paths ------------------------------------------------------------------------------------------


def joint_path(**changes: Any) -> JointPath:
    """Return home, a row with a gap, and home again."""
    values: dict[str, Any] = {
        "joint_names": ("rail", "elbow"),
        "q": np.arange(14.0).reshape(7, 2),
        "point": np.array([-1, 0, 1, 3, 4, 5, -1]),
        "row": np.array([-1, 0, 0, 0, 0, 0, -1]),
        "kind": (APPROACH, ROW, ROW, BREAK, ROW, ROW, RETRACT),
        "status": ("reached", "reached", "reached", "after gap", "reached", "reached", "reached"),
        "s": np.array([0.0, 0.0, 0.1, 0.3, 0.4, 0.5, 0.0]),
        "segments": (
            Segment(APPROACH, -1, 0, 1),
            Segment(ROW, 0, 1, 2),
            Segment(BREAK, 0, 2, 3),
            Segment(ROW, 0, 3, 5),
            Segment(RETRACT, -1, 5, 6),
        ),
    }
    return JointPath(**values | changes)


def test_a_joint_path_knows_its_joints_and_breaks() -> None:
    path = joint_path()
    assert path.n == 2
    assert path.breaks == (Segment(BREAK, 0, 2, 3),)
    assert replace(path, segments=(Segment(ROW, 0, 0, 6),), parameters=()).breaks == ()


def test_a_joint_path_may_have_no_segments_yet() -> None:
    assert joint_path(segments=()).segments == ()


def test_the_process_is_on_in_rows_alone() -> None:
    on = [kind for kind in SegmentKind if Segment(kind, 0, 0, 1).process_on]
    assert on == [ROW]
    assert [kind for kind in SegmentKind if TimedSegment(kind, 0, 0.0, 1.0).process_on] == [ROW]


@pytest.mark.parametrize("name", ["point", "row", "kind", "status", "s"])
@pytest.mark.parametrize("count", [0, 6, 8])
def test_an_entry_that_is_not_one_a_waypoint_is_refused_by_name(name: str, count: int) -> None:
    value: Any = count * ("reached",) if name in ("kind", "status") else np.zeros(count, dtype=int)
    with pytest.raises(InvalidInput, match=rf"^{name} must have 7 entries, .* not {count}$"):
        joint_path(**{name: value})


@pytest.mark.parametrize("shape", [(7,), (7, 1), (7, 3), (7, 2, 1)])
def test_configurations_of_the_wrong_shape_are_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(InvalidInput, match=r"^q must be \(N, 2\), not "):
        joint_path(q=np.zeros(shape))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_waypoint_that_is_not_finite_is_named(bad: float) -> None:
    q = np.zeros((7, 2))
    q[4, 1] = q[5, 0] = bad
    with pytest.raises(InvalidInput, match="waypoint 4 "):
        joint_path(q=q)


@pytest.mark.parametrize(
    "ends",
    [
        [(1, 6)],
        [(0, 5)],
        [(0, 7)],
        [(0, 2), (3, 6)],
        [(0, 3), (2, 6)],
        [(3, 6), (0, 3)],
        [(0, 3), (3, 3), (3, 6)],
        [(0, 4), (4, 2), (2, 6)],
        [(0, 3), (3, 6), (6, 6)],
        [(-1, 3), (3, 6)],
    ],
    ids=str,
)
def test_segments_that_are_not_chained_are_refused(ends: list[tuple[int, int]]) -> None:
    segments = tuple(Segment(ROW, 0, first, last) for first, last in ends)
    with pytest.raises(InvalidInput, match="segments must follow each other"):
        joint_path(segments=segments)


def test_kinds_are_told_by_their_names() -> None:
    assert [str(kind) for kind in SegmentKind] == ["approach", "row", "transition", "break", "retract"]


# --- trajectories --------------------------------------------------------------------------------------------

KNOTS = np.array([0.0, 0.5, 1.25, 2.0])


def trajectory(**changes: Any) -> Trajectory:
    """Return two joints: a quintic through three intervals, and a cubic with breaks of its own."""
    rng = np.random.default_rng(11)
    # value and two derivatives continuous at the knots, the third not: its coefficients are drawn anew
    coefficients, state = np.empty((6, 3)), rng.normal(size=3)
    for k, h in enumerate(np.diff(KNOTS)):
        coefficients[:, k] = [*rng.normal(size=3), state[2] / 2, state[1], state[0]]
        polynomial = np.poly1d(coefficients[:, k])
        state = np.array([polynomial(h), polynomial.deriv()(h), polynomial.deriv(2)(h)])
    cubic = PPoly(np.array([[1.0, 2.0], [0.5, 3.5], [0.0, 4.0], [-1.0, 0.5]]), np.array([0.0, 1.0, 2.0]))
    values: dict[str, Any] = {
        "joint_names": ("rail", "elbow"),
        "polynomials": (PPoly(coefficients, KNOTS), cubic),
        "knots": KNOTS,
        "segments": (
            TimedSegment(APPROACH, -1, 0.0, 0.5),
            TimedSegment(ROW, 3, 0.5, 1.25),
            TimedSegment(RETRACT, -1, 1.25, 2.0),
        ),
        "timing": "quintic",
        "executable": True,
        "reasons": (),
    }
    return Trajectory(**values | changes)


def test_a_trajectory_is_called_with_a_time_or_many() -> None:
    motion = trajectory()
    assert motion.duration == 2.0
    t = np.linspace(0, 2, 7)
    for order in range(4):
        assert motion(0.3, order).shape == (2,)
        assert motion(t, order).shape == (7, 2)
        np.testing.assert_array_equal(motion(t, order)[3], motion(t[3], order))
    assert motion([]).shape == (0, 2)
    np.testing.assert_array_equal(motion(1), motion(1.0))


def test_the_order_of_a_call_is_that_of_the_derivative() -> None:
    """The second joint on its first interval is t^3 + t^2/2 - 1."""
    t = np.array([0.0, 0.25, 0.9])
    motion = trajectory()
    for order, expected in enumerate((t**3 + t**2 / 2 - 1, 3 * t**2 + t, 6 * t + 1, 0 * t + 6)):
        np.testing.assert_allclose(motion(t, order)[:, 1], expected, rtol=0, atol=1e-14)
    np.testing.assert_array_equal(motion(t), motion(t, 0))


@pytest.mark.parametrize("order", [1, 2, 3])
def test_each_order_is_the_derivative_of_the_one_before(order: int) -> None:
    motion, h = trajectory(), 1e-4
    t = np.concatenate([np.linspace(a + 0.01, b - 0.01, 20) for a, b in ((0, 0.5), (0.5, 1), (1, 1.25), (1.25, 2))])
    before = [motion(t + k * h, order - 1) for k in (-2, -1, 1, 2)]
    slope = (before[0] - 8 * before[1] + 8 * before[2] - before[3]) / (12 * h)
    np.testing.assert_allclose(motion(t, order), slope, rtol=0, atol=1e-8)


def test_a_derivative_that_steps_has_the_value_after_the_step() -> None:
    motion = trajectory()
    elbow_jerk = [motion(t, 3)[1] for t in (1.0 - 1e-9, 1.0, 1.0 + 1e-9)]
    assert elbow_jerk == [6.0, 12.0, 12.0]
    rail_jerk = motion([0.5 - 1e-9, 0.5, 0.5 + 1e-9], 3)[:, 0]
    assert rail_jerk[1] == pytest.approx(rail_jerk[2], abs=1e-6)
    assert abs(rail_jerk[1] - rail_jerk[0]) > 0.1


def test_the_end_belongs_to_the_trajectory() -> None:
    """The value at the very end is the last polynomial's."""
    motion = trajectory()
    np.testing.assert_allclose(motion(2.0)[1], 2 + 3.5 + 4 + 0.5, rtol=1e-15)
    assert motion(2.0, 3)[1] == 12.0


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_time_that_is_not_finite_is_refused(bad: float) -> None:
    for t in (bad, [0.0, bad, 1.0]):
        with pytest.raises(InvalidInput, match="not finite"):
            trajectory()(t)


@pytest.mark.parametrize("t", [-1e-6, 2.0 + 1e-6, -5.0, 100.0, [0.0, 2.1], [-0.1, 1.0]], ids=str)
def test_a_time_outside_is_refused(t: Any) -> None:
    with pytest.raises(InvalidInput, match=r"times must lie between 0 and 2\.000000 s"):
        trajectory()(t)


def test_times_outside_by_rounding_count_as_the_ends() -> None:
    motion = trajectory()
    np.testing.assert_array_equal(motion(-1e-12), motion(0.0))
    np.testing.assert_array_equal(motion(np.nextafter(2.0, 3.0), 1), motion(2.0, 1))


@pytest.mark.parametrize("order", [-1, 4, 1.5, "velocity", None])
def test_an_order_there_is_not_is_refused(order: Any) -> None:
    with pytest.raises(InvalidInput, match="order must be 0, 1, 2 or 3"):
        trajectory()(0.1, order)


# --- sample times ---------------------------------------------------------------------------------------------


def lasting(duration: float) -> Trajectory:
    return trajectory(knots=np.array([0.0, duration]))


@pytest.mark.parametrize("period", [0.1, 0.25, 1 / 3, 0.3, 0.7, 1.0, 1.9999999, 2.0, 2.5, 1e3, 1e-4])
@pytest.mark.parametrize("duration", [2.0, 2.1, np.pi, 0.3 * 7, 61.00000000000001, 0.004])
def test_samples_are_a_period_apart_and_include_the_end_exactly(duration: float, period: float) -> None:
    motion = lasting(duration)
    times = motion.sample_times(period)
    assert times[0] == 0.0
    assert times[-1] == duration
    steps = np.diff(times)
    np.testing.assert_allclose(steps[:-1], period, rtol=0, atol=1e-9)
    # the last step is what is left: not nothing, not more than a period
    assert 1e-10 < steps[-1] <= period + 1.1e-9
    np.testing.assert_allclose(times[:-1], np.arange(len(times) - 1) * period, rtol=1e-15)


def test_samples_of_a_whole_number_of_periods_have_no_short_last_step() -> None:
    """Though 0.1 * 3 is not 0.3, and 2.1 / 0.3 is just below 7."""
    for duration, period, count in (
        (0.3, 0.1, 4),
        (2.1, 0.3, 8),
        (0.7, 0.1, 8),
        (1.1, 0.1, 12),
        (600.0, 0.004, 150001),
    ):
        times = lasting(duration).sample_times(period)
        assert len(times) == count
        assert times[-1] == duration


def test_samples_can_be_called() -> None:
    motion = trajectory()
    assert motion(motion.sample_times(0.3), 3).shape == (8, 2)


@pytest.mark.parametrize("period", [0.0, -0.1, np.nan, np.inf])
def test_a_period_that_is_none_is_refused(period: float) -> None:
    with pytest.raises(InvalidInput, match="period must be finite and positive"):
        trajectory().sample_times(period)


# --- segments over time ------------------------------------------------------------------------------------------


def test_a_boundary_belongs_to_the_segment_that_starts_there() -> None:
    motion = trajectory()
    before, after = np.nextafter([0.5, 1.25], 0.0), np.nextafter([0.5, 1.25], 2.0)
    assert motion.segment_at([0.0, 0.5, 1.25, 2.0]).tolist() == [0, 1, 2, 2]
    assert motion.segment_at(before).tolist() == [0, 1]
    assert motion.segment_at(after).tolist() == [1, 2]
    assert int(motion.segment_at(0.7)) == 1


def test_one_segment_holds_all_times() -> None:
    motion = trajectory(segments=(TimedSegment(ROW, 0, 0.0, 2.0),))
    assert motion.segment_at([0.0, 1.0, 2.0]).tolist() == [0, 0, 0]


def test_segments_are_named_by_kind_and_rows_by_number() -> None:
    assert [segment.name for segment in trajectory().segments] == ["approach", "row 3", "retract"]
    assert TimedSegment(TRANSITION, 3, 0.0, 1.0).name == "transition"
