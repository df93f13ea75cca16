"""Windings: whole turns are taken only where the path asks for them, and nearest home."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import qparm
from made_arm import URDF, elsewhere_data, pose_list
from qparm.path import SegmentKind
from qparm.planning import PathProblem, PathSolution, endless, wound
from qparm.robot import SerialChain

TURN = 2 * np.pi
UR5 = {"a": [0, -0.425, -0.39225, 0, 0, 0], "alpha": [90, 0, 0, 90, -90, 0],
       "d": [0.089159, 0, 0, 0.10915, 0.09465, 0.0823]}  # fmt: skip
HOME = (0, -90, -90, -90, 90, 0)


def ur5(poses: str, *, turns: float = 1.0) -> dict[str, Any]:
    """Return a cell of a UR5 by its maker's table, each joint with so many turns either way."""
    return {
        "schema": 1,
        "name": "ur5",
        "arm": {
            "name": "ur5",
            "convention": "standard",
            "home": [f"{angle} deg" for angle in HOME],
            "joints": [
                {
                    "name": f"j{k}", "type": "revolute",
                    "dh": {"a": f"{UR5['a'][k]} m", "alpha": f"{UR5['alpha'][k]} deg", "d": f"{UR5['d'][k]} m",
                           "theta": "0 deg"},
                    "position": [f"{-360 * turns} deg", f"{360 * turns} deg"],
                    "velocity": "180 deg/s", "acceleration": "600 deg/s^2", "jerk": "6000 deg/s^3",
                } for k in range(6)
            ],
        },
        "workpiece": {"shape": "pose list", "poses": poses},
        "process": {"feed": "50 mm/s"},
    }  # fmt: skip


def three_poses() -> str:
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, :3, :3] = np.diag([1.0, -1.0, -1.0])
    poses[:, :3, 3] = np.column_stack([np.full(3, -0.45), [-0.10, -0.12, -0.14], np.full(3, 0.2)])
    return pose_list(poses)


def ring(turns: float, *, a_turn: int = 60) -> str:
    """Return poses on a circle, the tool down and turning with it."""
    angle = np.linspace(0.0, TURN * turns, int(a_turn * turns) + 1)
    poses = np.tile(np.eye(4), (len(angle), 1, 1))
    down, z = Rotation.from_rotvec([np.pi, 0, 0]), np.array([0.0, 0.0, 1.0])
    poses[:, :3, :3] = (Rotation.from_rotvec(angle[:, None] * z) * down).as_matrix()
    x, y = 0.55 + 0.12 * np.cos(angle), 0.05 + 0.12 * np.sin(angle)
    poses[:, :3, 3] = np.column_stack([x, y, np.full(len(angle), 0.15)])
    return pose_list(poses)


@pytest.mark.parametrize(("seed", "turns"), [(1, 1.0), (2, 1.0), (3, 1.0), (1, 28.6)])
def test_wide_limits_invite_no_turns(seed: int, turns: float) -> None:
    """The last: limits in degrees where radians are meant."""
    plan = qparm.plan(ur5(three_poses(), turns=turns), seed=seed)
    report = qparm.report(plan)
    assert report.executable, report.reasons
    away = np.abs(plan.joint_path.q - np.radians(HOME)).max(axis=0)
    assert (away <= np.pi + 0.1).all(), np.degrees(away)


@pytest.mark.slow
def test_a_continuous_joint_turns_as_often_as_the_path_does() -> None:
    data = elsewhere_data()
    data["workpiece"]["poses"] = ring(20, a_turn=24)
    data["process"]["feed"] = "200 mm/s"
    plan = qparm.plan(data)
    assert plan.record.unreached.size == 0
    assert plan.solution.reconfigurations(plan.tool_path) == (0, 0)
    q = plan.joint_path.q
    assert np.ptp(q, axis=0).max() > 19 * TURN
    approach = plan.joint_path.segments[0]
    assert approach.kind is SegmentKind.APPROACH
    assert np.ptp(q[approach.first : approach.last + 1], axis=0).max() < TURN
    assert qparm.report(plan).executable


@pytest.mark.slow
def test_turns_that_do_not_suffice_are_unwound_once() -> None:
    """Three turns and a half about a joint that has two to each side of zero: one way back."""
    data = elsewhere_data()
    data["arm"]["urdf"] = URDF.replace(
        '<joint name="a7" type="continuous">', '<joint name="a7" type="revolute">'
    ).replace('<axis xyz="0 0 1"/><limit velocity="3" effort="1"/>\n  </joint>\n  <joint name="flange"',
              '<axis xyz="0 0 1"/><limit lower="-6.6" upper="6.6" velocity="3" effort="1"/>\n  </joint>\n'
              '  <joint name="flange"')  # fmt: skip
    data["workpiece"]["poses"] = ring(3.5, a_turn=40)
    plan = qparm.plan(data)
    assert plan.record.unreached.size == 0
    assert sum(plan.solution.reconfigurations(plan.tool_path)) <= 1
    a7 = plan.joint_path.q[:, -1]
    assert np.abs(a7).max() <= 6.6


def arm(rng: np.random.Generator, n: int) -> SerialChain:
    from qparm.robot import Joint

    reach = rng.choice([0.9, 1.4, 2.0, 3.3], size=n) * np.pi
    lower = -reach * rng.uniform(0.9, 1.1, size=n)
    return SerialChain(
        "made", tuple(Joint(f"j{k}", "revolute", np.eye(4), (lower[k], reach[k]), 1.0, 1.0, 1.0) for k in range(n)),
        np.eye(4), np.eye(4),
    )  # fmt: skip


class Points:
    """A tool path of one row, as far as windings look at it."""

    def __init__(self, count: int) -> None:
        self.in_self_motion_area, self.row_of_point = np.zeros(count, dtype=bool), np.zeros(count, dtype=np.int64)


@pytest.mark.parametrize("seed", range(20))
def test_the_least_way_of_all_windings_is_found(seed: int) -> None:
    """Against all of them."""
    from itertools import product

    rng = np.random.default_rng(seed)
    chain, home = arm(rng, 2), rng.uniform(-2, 2, size=2)
    starts = rng.uniform(chain.lower, chain.upper, size=(3, 2))
    q = np.repeat(starts, 4, axis=0) + np.tile(np.linspace(-0.2, 0.2, 4)[:, None], (3, 2))
    q = np.clip(q, chain.lower, chain.upper)
    driven = np.ones(11, dtype=bool)
    driven[[3, 7]] = False
    solution = PathSolution(q, np.zeros((12, 3)), np.ones(12, dtype=bool), driven)
    found = wound(PathProblem(chain, Points(12), home, np.ones(2)), solution)  # type: ignore[arg-type]
    np.testing.assert_allclose(np.mod(found.q - q + 1.0, TURN), 1.0, atol=1e-9)
    assert (found.q >= chain.lower - 1e-9).all()
    assert (found.q <= chain.upper + 1e-9).all()
    np.testing.assert_array_equal(found.driven, driven)

    def way(q: np.ndarray) -> float:
        return sum(np.abs(b - a) for a, b in ((home[j], q[0]), (q[3], q[4]), (q[7], q[8]), (q[11], home[j])))

    for j in range(2):
        ways = []
        for shifts in product(range(-4, 5), repeat=3):
            moved = q[:, j] + TURN * np.repeat(shifts, 4)
            if moved.min() >= chain.lower[j] - 1e-9 and moved.max() <= chain.upper[j] + 1e-9:
                ways.append(way(moved))
        assert way(found.q[:, j]) <= min(ways) + 1e-2


def test_only_joints_of_two_turns_are_searched_as_endless(rng: np.random.Generator) -> None:
    for _ in range(10):
        chain = arm(rng, 4)
        wide = endless(chain).continuous
        np.testing.assert_array_equal(wide, chain.upper - chain.lower >= 4 * np.pi)
        drawn = chain.random(rng, 200)
        assert np.ptp(drawn[:, wide], axis=0).max(initial=0.0) <= TURN
        assert chain.within_limits(drawn).all()
