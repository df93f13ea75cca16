"""What a file holds of a form is what the form was held to: judged from the text, on paths with short pieces."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import qparm
from qparm.export.joint_trajectory_json import write_joint_trajectory_json
from qparm.path import JointPath, Segment, SegmentKind
from qparm.robot import MotionLimits
from qparm.timing import quintic_form, ruckig_form, time_path
from qparm.verify.files import read_knots
from qparm.verify.interpolate import derivative_peaks

FORMS = {"quintic": quintic_form, "ruckig": ruckig_form}
# A millionth is what the digits of a file are given: half of it is kept free.
FREE = 1 - 5e-7


def shares(trajectory: qparm.Trajectory, limits: MotionLimits, folder: Path) -> np.ndarray:
    """Return the largest shares of velocity, acceleration and jerk limits, read back from a file, (3, n)."""
    file = folder / "trajectory.json"
    write_joint_trajectory_json(trajectory, file)
    return derivative_peaks(read_knots(file)) / limits.table


def walk(seed: int, *, gap: float, late: float = 0.0) -> tuple[JointPath, MotionLimits]:
    """Return a smooth path with waypoints at uneven distances, after a rest of ``late`` seconds' way."""
    rng = np.random.default_rng(seed)
    n, N = int(rng.integers(1, 7)), int(rng.integers(6, 40))
    s = np.cumsum(gap * rng.uniform(0.05, 1.0, size=N) ** 2)
    waves = rng.normal(size=(3, n)) / np.array([1.0, 3.0, 9.0])[:, None]
    q = rng.uniform(-3, 3, size=n) + np.einsum("kn,kN->Nn", waves, np.sin(np.arange(1, 4)[:, None] * 9 * s / s[-1]))
    if late:
        q = np.vstack([q[0] + 1e-3 * np.arange(3)[::-1, None] * late, q[1:]])
        s = np.concatenate([s[0] - gap * np.array([2 * late, late, 0.0]), s[1:]])
    N = len(q)
    limits = MotionLimits(*(size * rng.uniform(0.5, 2.0, size=n) for size in (1.5, 5.0, 40.0)))
    segments = (Segment(SegmentKind.ROW, 0, 0, 2), Segment(SegmentKind.ROW, 1, 2, N - 1)) if late else (
        Segment(SegmentKind.ROW, 0, 0, N - 1),)  # fmt: skip
    path = JointPath(
        joint_names=tuple(f"j{k}" for k in range(n)), q=q, point=np.arange(N), row=np.zeros(N, dtype=int),
        kind=(SegmentKind.ROW,) * N, status=("reached",) * N, s=s - s[0], segments=segments,
        parameters=tuple((s - s[0])[segment.first : segment.last + 1] for segment in segments),
    )  # fmt: skip
    return path, limits


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("gap", [1e-3, 0.05])
@pytest.mark.slow
def test_what_is_written_keeps_the_limits_and_comes_near_to_them(form: str, gap: float, tmp_path: Path) -> None:
    for seed in range(12):
        path, limits = walk(seed, gap=gap)
        timing = time_path(path, limits)
        trajectory = FORMS[form](timing)
        found = shares(trajectory, limits, tmp_path)
        assert found.max() <= FREE, seed
        assert found.max() >= 0.995, "as fast as the limits allow"
        assert trajectory.duration == pytest.approx(timing.duration, rel=1e-4)
        np.testing.assert_allclose(trajectory(trajectory.knots), path.q, rtol=0, atol=4e-7)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.slow
def test_hours_later_a_files_digits_are_fewer(form: str, tmp_path: Path) -> None:
    """After 9,000 s a number of seconds is told to 2e-12: on short pieces that is much of a jerk limit."""
    for seed in range(3):
        path, limits = walk(seed, gap=1e-2, late=1.0)
        trajectory = FORMS[form](time_path(path, limits, feed=1e-6 if seed else 2e-6))
        assert shares(trajectory, limits, tmp_path).max() <= FREE, seed
