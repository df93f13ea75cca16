"""Breaks as motions: the tool leaves the surface, keeps away from it, and comes back; or a sentence says why not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from comparisons.soak.cells import generate

import qparm
from conftest import ROOT
from qparm.path import joint_curve
from qparm.planning import Motion, MotionFailure, plan_motion, problem_of
from qparm.planning.moves import escape
from qparm.planning.moves.clearance import ToolDistance, stays_clear
from qparm.verify.kinematics import joint_transforms

CLEARANCE = 0.02
RECONFIGURATION = ROOT / "examples" / "reconfiguration.toml"

Distance = Callable[[np.ndarray], np.ndarray]


def of_tool(cell: qparm.Cell) -> ToolDistance:
    return ToolDistance(cell.chain(), distance_of(cell))


def distance_of(cell: qparm.Cell) -> Distance:
    T, surface = cell.workpiece.pose.matrix(), cell.workpiece.surface()
    return lambda points: surface.distance((points - T[:3, 3]) @ T[:3, :3])


def solutions(cell: qparm.Cell, points: list[int], rng: np.random.Generator, count: int = 8) -> list[np.ndarray]:
    batch = qparm.solve_poses(
        cell.chain(), cell.tool_path().poses[points], restarts=count, rng=rng, every_start=True
    )  # fmt: skip
    return [q[reached] for q, reached in zip(batch.q, batch.reached, strict=True)]


def pairs(cell: qparm.Cell, count: int, seed: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return configurations of the same point or of neighbouring points, unrelated to each other."""
    rng = np.random.default_rng(seed)
    first = rng.integers(cell.tool_path().point_count - 1, size=count)
    a, b = solutions(cell, first.tolist(), rng), solutions(cell, (first + rng.integers(2, size=count)).tolist(), rng)
    return [(p[0], q[-1]) for p, q in zip(a, b, strict=True) if len(p) and len(q)]


def dense(chain: qparm.SerialChain, motion: Motion, k: int, count: int = 2000) -> np.ndarray:
    piece, s = motion.pieces[k], motion.parameters[k]
    u = np.linspace(0, 1, count)
    if len(piece) == 2:
        return piece[0] + u[:, None] * (piece[1] - piece[0])
    return np.asarray(joint_curve(s, piece)(u * s[-1]))


def assert_safe(cell: qparm.Cell, motion: Motion, q_from: np.ndarray, q_to: np.ndarray, clearance: float) -> None:
    """Check a motion with the verification's own kinematics, far more densely than the planner does."""
    chain, distance = cell.chain(), distance_of(cell)
    np.testing.assert_array_equal(motion.pieces[0][0], q_from)
    np.testing.assert_array_equal(motion.pieces[-1][-1], q_to)
    for a, b in pairwise(motion.pieces):
        np.testing.assert_array_equal(a[-1], b[0])
    least = np.inf
    for k, role in enumerate(motion.roles):
        Q = dense(chain, motion, k)
        assert chain.within_limits(Q, tolerance=1e-12).all()
        d = distance(joint_transforms(cell, Q)[0][:, :3, 3])
        if role == "travel":
            assert d.min() >= clearance
            least = min(least, d.min())
        else:
            rising = d if role == "leave" else d[::-1]
            assert (np.diff(rising) >= -1e-8).all()
            assert rising.min() >= -1e-6
            # of several the outermost
            beside = motion.roles[k + 1 if role == "leave" else k - 1]
            assert rising[-1] >= clearance or beside == role
    assert motion.least_clearance == pytest.approx(least, abs=1e-3)


@pytest.mark.parametrize("file", ["dome.toml", "reconfiguration.toml"])
@pytest.mark.slow
def test_unrelated_configurations_are_joined_by_a_safe_motion(file: str) -> None:
    cell = qparm.Cell.load(ROOT / "examples" / file)
    chain, kinds = cell.chain(), set()
    for q_from, q_to in pairs(cell, 40, 3):
        motion = plan_motion(
            chain, q_from, q_to, distance=of_tool(cell), clearance=CLEARANCE, from_surface=True, to_surface=True,
            rng=np.random.default_rng(0),
        )  # fmt: skip
        assert isinstance(motion, Motion), motion
        assert_safe(cell, motion, q_from, q_to, CLEARANCE)
        assert motion.roles[0] == "leave"
        assert motion.roles[-1] == "return"
        kinds |= set(motion.escape.split(" / "))
    assert {"normal lift", "rail retreat"} <= kinds


def test_home_is_left_and_reached_without_a_lift(dome: qparm.Cell) -> None:
    chain, home = dome.chain(), dome.home()
    for q in (p[0] for p in solutions(dome, [0, 300, 600, 914], np.random.default_rng(1))):
        there = plan_motion(
            chain, home, q, distance=of_tool(dome), clearance=CLEARANCE, from_surface=False, to_surface=True,
            rng=np.random.default_rng(0),
        )  # fmt: skip
        back = plan_motion(
            chain, q, home, distance=of_tool(dome), clearance=CLEARANCE, from_surface=True, to_surface=False,
            rng=np.random.default_rng(0),
        )  # fmt: skip
        assert isinstance(there, Motion)
        assert isinstance(back, Motion)
        assert there.roles[0] == "travel"
        assert back.roles[-1] == "travel"
        assert_safe(dome, there, home, q, CLEARANCE)
        assert_safe(dome, back, q, home, CLEARANCE)
        np.testing.assert_allclose(there.time, back.time, rtol=1e-9)


def test_a_straight_line_would_have_gone_through_the_workpiece(dome: qparm.Cell) -> None:
    """What makes the rest worth testing: most of the pairs cannot simply be joined."""
    chain, distance = dome.chain(), distance_of(dome)
    dips = [
        ToolDistance(chain, distance)(p + np.linspace(0, 1, 500)[:, None] * (q - p)).min() < -1e-3
        for p, q in pairs(dome, 40, 3)
    ]
    assert np.mean(dips) > 0.3


def test_the_bound_holds_and_the_proof_is_neither_false_nor_shy(dome: qparm.Cell, rng: np.random.Generator) -> None:
    chain, distance, least = dome.chain(), distance_of(dome), 0.05
    a, b = chain.random(rng, 4000), chain.random(rng, 4000)
    b = a + 10.0 ** rng.uniform(-3, 0, size=(4000, 1)) * (b - a)
    moved = np.linalg.norm(chain.forward(b)[:, :3, 3] - chain.forward(a)[:, :3, 3], axis=1)
    bound = np.abs(b - a) @ ToolDistance(chain, distance).levers
    assert (moved <= bound).all()
    assert (moved / bound).max() > 0.5
    proved = denied = 0
    for p, q in zip(a[:300], b[:300], strict=True):
        d = ToolDistance(chain, distance)(p + np.linspace(0, 1, 4000)[:, None] * (q - p)).min()
        verdict = stays_clear(p, q, distance=ToolDistance(chain, distance), least=least)
        if d < least:
            assert not verdict
            denied += 1
        elif d > least + 1e-3:
            assert verdict
            proved += 1
    assert min(proved, denied) > 20


def test_without_travel_on_the_rail_the_tool_is_lifted(dome: qparm.Cell) -> None:
    q = solutions(dome, [457], np.random.default_rng(2))[0]
    chain = dome.chain()
    joints = (replace(chain.joints[0], position=(q[0, 0] - 1e-4, q[0, 0] + 1e-4)), *chain.joints[1:])
    fixed = replace(chain, joints=joints)
    ways, refused = escape.escapes(fixed, q[0], distance=of_tool(dome), clearance=CLEARANCE)
    assert {way.kind for way in ways} <= {"normal lift", "tilted lift", "both"}
    assert refused[0].startswith(f"joint 'd1' at {q[0, 0] * 1e3:.0f} mm takes the tool no farther than")


def test_a_way_off_ends_before_it_comes_near_to_something_else(dome: qparm.Cell) -> None:
    """A wall across the normal, 120 mm away: farther than half of that the distance falls again."""
    chain, distance, kinds = dome.chain(), distance_of(dome), set()
    for q in (p[0] for p in solutions(dome, list(range(0, 915, 60)), np.random.default_rng(4))):
        pose = chain.forward(q)

        def between(points: np.ndarray, pose: np.ndarray = pose) -> np.ndarray:
            return np.minimum(distance(points), 0.12 + (points - pose[:3, 3]) @ pose[:3, 2])

        ways, _ = escape.escapes(chain, q, distance=ToolDistance(chain, between), clearance=CLEARANCE)
        for way in ways:
            piece = way.pieces[0]
            s = escape.chord_parameter(chain, piece)
            u = np.linspace(0, 1, 1000)
            Q = joint_curve(s, piece)(u * s[-1]) if len(piece) > 2 else piece[0] + u[:, None] * (piece[1] - piece[0])
            assert (np.diff(ToolDistance(chain, between)(np.asarray(Q))) >= -1e-8).all()
            kinds.add(way.kind)
    assert {"normal lift", "rail retreat"} <= kinds


def test_a_lift_that_is_no_line_follows_the_normal_as_a_curve(
    dome: qparm.Cell, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(escape, "_STRAIGHT", 0.0)
    chain, distance, found = dome.chain(), distance_of(dome), 0
    for q in (p[0] for p in solutions(dome, list(range(0, 915, 60)), np.random.default_rng(4))):
        ways, _ = escape.escapes(chain, q, distance=ToolDistance(chain, distance), clearance=CLEARANCE)
        pose = chain.forward(q)
        for way in (way for way in ways if way.kind == "normal lift"):
            (piece,) = way.pieces
            s = escape.chord_parameter(chain, piece)
            assert len(piece) > 6
            p = chain.forward(np.asarray(joint_curve(s, piece)(np.linspace(0, s[-1], 500))))[:, :3, 3] - pose[:3, 3]
            assert np.abs(np.cross(p, pose[:3, 2])).max() < 2e-5
            found += 1
    assert found > 5


@pytest.mark.slow
def test_a_lift_whose_curve_would_leave_the_limits_is_strung_together_from_lines() -> None:
    """The configuration rests at two limits: a curve through the lift swings beyond one of them."""
    document, _ = generate(178)
    cell = qparm.Cell.load(document)
    problem = problem_of(cell)
    chain, distance = problem.chain, problem.distance
    q = np.array([0.07640107485093203, 0.34855057734039463, 0.899709994958357, 1.1564269261736038,
                  -0.37406926263817875, -2.448654856994241, -0.20986223463179424, 0.68276094215455])  # fmt: skip
    assert (np.minimum(q - chain.lower, chain.upper - q) < 1e-3).sum() == 2
    motion = plan_motion(
        chain, problem.home, q, distance=distance, clearance=cell.process.clearance, from_surface=False,
        to_surface=True, rng=np.random.default_rng(0),
    )  # fmt: skip
    assert isinstance(motion, Motion)
    assert "lift" in motion.escape
    assert len(motion.pieces) > 3
    for piece in motion.pieces:
        assert ((piece >= chain.lower) & (piece <= chain.upper)).all()
    assert motion.least_clearance >= cell.process.clearance


def test_failure_is_a_sentence_with_what_was_tried(dome: qparm.Cell) -> None:
    chain, distance = dome.chain(), distance_of(dome)
    q = solutions(dome, [457], np.random.default_rng(2))[0][0]

    def failure(a: np.ndarray, b: np.ndarray, **options: object) -> str:
        arguments = {
            "distance": ToolDistance(chain, distance),
            "clearance": CLEARANCE,
            "from_surface": True,
            "to_surface": True,
        }
        motion = plan_motion(chain, a, b, rng=np.random.default_rng(0), **(arguments | options))
        assert isinstance(motion, MotionFailure)
        return motion.reason

    far = failure(q, q, clearance=5.0)
    assert far.startswith("no way to leave the surface: joint 'd1' at ")
    assert "along the normal the arm lifts the tool no higher than" in far
    assert failure(q, dome.home(), from_surface=False).startswith(
        "at its free end the tool point lies 0.0 mm from the workpiece, within the clearance"
    )

    def cage(points: np.ndarray) -> np.ndarray:
        """Leave room for a lift of 60 mm and no way out of it."""
        away = np.linalg.norm(points - chain.forward(q)[:3, 3], axis=1)
        return np.minimum(distance(points), np.where(away > 0.06, 0.06 - away, 1.0))

    sentence = failure(q, dome.home(), distance=ToolDistance(chain, cage), to_surface=False)
    assert "no motion was found on which the tool keeps 20.0 mm away" in sentence or "free end" in sentence


def test_where_no_direct_line_is_clear_the_joints_go_another_way(dome: qparm.Cell) -> None:
    """A ball hangs in the middle of every direct motion."""
    chain, distance = dome.chain(), distance_of(dome)
    arguments = {"clearance": CLEARANCE, "from_surface": True, "to_surface": True}
    ways_around = 0
    for a, b in pairs(dome, 12, 8):
        direct = plan_motion(
            chain, a, b, distance=ToolDistance(chain, distance), rng=np.random.default_rng(0), **arguments
        )
        assert isinstance(direct, Motion)
        k = direct.roles.index("travel")
        middle = chain.forward(dense(chain, direct, k)[1000])[:3, 3]
        if distance(middle[None])[0] < 0.15:
            continue

        def with_ball(points: np.ndarray, centre: np.ndarray = middle) -> np.ndarray:
            return np.minimum(distance(points), np.linalg.norm(points - centre, axis=1) - 0.1)

        around = plan_motion(
            chain, a, b, distance=ToolDistance(chain, with_ball), rng=np.random.default_rng(0), **arguments
        )
        assert isinstance(around, Motion)
        ways_around += around.roles.count("travel") > 1
        for k, role in enumerate(around.roles):
            if role == "travel":
                assert ToolDistance(chain, with_ball)(dense(chain, around, k)).min() >= CLEARANCE
    assert ways_around > 0


def test_the_same_seed_gives_the_same_motion(dome: qparm.Cell) -> None:
    arguments = {
        "distance": of_tool(dome),
        "clearance": CLEARANCE,
        "from_surface": True,
        "to_surface": True,
    }
    for a, b in pairs(dome, 4, 9):
        first, again = (plan_motion(dome.chain(), a, b, rng=np.random.default_rng(6), **arguments) for _ in range(2))
        assert isinstance(first, Motion)
        assert isinstance(again, Motion)
        for p, q in zip(first.pieces, again.pieces, strict=True):
            np.testing.assert_array_equal(p, q)


def test_without_a_surface_the_tool_is_lifted_along_its_own_axis(dome: qparm.Cell) -> None:
    (a, b), chain = pairs(dome, 3, 10)[0], dome.chain()
    motion = plan_motion(
        chain, a, b, distance=None, clearance=CLEARANCE, from_surface=True, to_surface=True,
        rng=np.random.default_rng(0),
    )  # fmt: skip
    assert isinstance(motion, Motion)
    assert motion.roles == ("leave", "travel", "return")
    assert set(motion.escape.split(" / ")) <= {"tool axis lift", "tilted lift"}
    assert np.isnan(motion.least_clearance)
    pose = chain.forward(a)
    lifted = chain.forward(motion.pieces[0][-1])
    assert (pose[:3, 3] - lifted[:3, 3]) @ pose[:3, 2] >= CLEARANCE


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"q_from": np.full(8, np.nan)}, "not finite"),
        ({"q_to": np.full(8, 9.0)}, "q_to, joint 'd1': 9.0 lies outside its limits"),
        ({"q_to": np.zeros(7)}, "8 joints"),
        ({"clearance": -1.0}, "clearance"),
        ({"clearance": np.inf}, "clearance"),
        ({"rng": None}, "seeded"),
    ],
)
def test_unusable_input_is_refused_by_name(dome: qparm.Cell, change: dict, words: str) -> None:
    arguments = {
        "q_from": np.zeros(8), "q_to": np.zeros(8), "distance": None, "clearance": CLEARANCE, "from_surface": True,
        "to_surface": True, "rng": np.random.default_rng(0),
    }  # fmt: skip
    with pytest.raises(qparm.InvalidInput, match=words):
        plan_motion(dome.chain(), **(arguments | change))
