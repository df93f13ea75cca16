"""The curve through waypoints: it passes them, and is smooth to its fourth derivative."""

from __future__ import annotations

import numpy as np
import pytest

import qparm
from qparm.path import JointPath, Segment, SegmentKind, joint_curve

pytestmark = pytest.mark.slow


def waypoints(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    return np.cumsum(rng.uniform(0.5, 1.5, count)), np.cumsum(rng.standard_normal((count, 3)), axis=0)


@pytest.mark.parametrize("count", [2, 3, 4, 5, 6, 7, 40])
def test_it_passes_every_waypoint(rng: np.random.Generator, count: int) -> None:
    s, q = waypoints(rng, count)
    np.testing.assert_allclose(joint_curve(s, q)(s), q, atol=1e-11)


@pytest.mark.parametrize("count", [7, 40])
def test_four_derivatives_are_continuous_and_the_fifth_is_not(rng: np.random.Generator, count: int) -> None:
    s, q = waypoints(rng, count)
    curve = joint_curve(s, q)
    inside = np.unique(curve.t)[1:-1]
    h = 1e-9
    for order in range(6):
        derivative = curve.derivative(order) if order else curve
        jump = np.abs(derivative(inside + h) - derivative(inside - h)).max()
        size = np.abs(derivative(np.linspace(s[0], s[-1], 500))).max()
        if order < 5:
            assert jump < 1e-6 * size
        elif count > 7:
            assert jump > 1e-3 * size


def test_few_waypoints_give_the_polynomial_through_them(rng: np.random.Generator) -> None:
    for count in (2, 3, 4, 5, 6):
        s, q = waypoints(rng, count)
        polynomial = np.polyfit(s, q, count - 1)
        at = np.linspace(s[0], s[-1], 30)
        expected = sum(polynomial[k] * at[:, None] ** (count - 1 - k) for k in range(count))
        np.testing.assert_allclose(joint_curve(s, q)(at), expected, atol=1e-8)


def test_a_quintic_is_met_exactly() -> None:
    s = np.linspace(0, 1, 12) ** 1.3
    c = np.array([1.0, -2.0, 0.5, 3.0, -1.0, 0.7])
    at = np.linspace(0, 1, 101)
    curve = joint_curve(s, np.polyval(c, s)[:, None])
    np.testing.assert_allclose(curve(at)[:, 0], np.polyval(c, at), atol=1e-12)
    np.testing.assert_allclose(curve.derivative(3)(at)[:, 0], np.polyval(np.polyder(c, 3), at), atol=1e-7)


@pytest.mark.parametrize(
    ("s", "words"),
    [([0.0], "at least two"), ([], "at least two"), ([0.0, 1.0, 1.0], "waypoint 2 does not come after 1"),
     ([0.0, 2.0, 1.0], "waypoint 2 does not come after 1"), ([0.0, float("nan"), 1.0], "waypoint 1")],
)  # fmt: skip
def test_a_parameter_that_does_not_ascend_is_refused(s: list[float], words: str) -> None:
    with pytest.raises(qparm.InvalidInput, match=words):
        joint_curve(np.array(s), np.zeros((len(s), 2)))


def made_path(q: np.ndarray, s: np.ndarray) -> JointPath:
    N, at = len(q), (0, 4, len(q) - 1)
    segments = tuple(Segment(SegmentKind.ROW, k, at[k], at[k + 1]) for k in range(2))
    return JointPath(
        joint_names=("a", "b", "c"), q=q, point=np.arange(N), row=np.zeros(N, dtype=int),
        kind=(SegmentKind.ROW,) * N, status=("reached",) * N, s=s, segments=segments,
        parameters=(s[:5] - s[0], s[4:]),
    )  # fmt: skip


def test_a_joint_path_has_a_curve_for_each_segment(rng: np.random.Generator) -> None:
    s, q = waypoints(rng, 20)
    path = made_path(q, s)
    np.testing.assert_allclose(path.curve(0)(s[:5] - s[0]), q[:5], atol=1e-11)
    np.testing.assert_allclose(path.curve(1)(s[4:]), q[4:], atol=1e-11)
    for wrong in (-1, 2):
        with pytest.raises(qparm.InvalidInput, match="segment must lie between 0 and 1"):
            path.curve(wrong)


def test_parameters_belong_to_waypoints(rng: np.random.Generator) -> None:
    s, q = waypoints(rng, 20)
    path = made_path(q, s)
    from dataclasses import replace

    with pytest.raises(qparm.InvalidInput, match="one parameter for each"):
        replace(path, parameters=(s[:4], s[4:]))
    counted = replace(path, parameters=())
    np.testing.assert_array_equal(counted.parameters[1], np.arange(16))


def test_a_planned_path_follows_the_rows_between_its_points(dome_plan: qparm.Plan) -> None:
    """The curve of every row leads the tool over the surface curve, at places of the test's own."""
    path, chain = dome_plan.joint_path, dome_plan.chain
    rows = [k for k, segment in enumerate(path.segments) if segment.kind is SegmentKind.ROW]
    assert len(rows) == 15
    for k in rows[::5]:
        s = np.linspace(0.0, path.parameters[k][-1], 1001)
        E = chain.pose_error(chain.forward(path.curve(k)(s)), dome_plan.tool_path.pose(path.segments[k].row, s))
        assert np.linalg.norm(E[:, :3], axis=1).max() <= dome_plan.cell.process.position_between
        assert np.linalg.norm(E[:, 3:], axis=1).max() <= dome_plan.cell.process.rotation_between
