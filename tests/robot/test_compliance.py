"""How far the tool gives way: against springs written out, beams of many small hinges, and textbook formulas."""

from __future__ import annotations

import numpy as np
import pytest

import qparm
from qparm.errors import InvalidInput
from qparm.robot import DHRow, chain_from_dh
from qparm.robot.compliance import Elasticity, tool_compliance
from qparm.verify.kinematics import joint_transforms


def elastic(chain: qparm.SerialChain, rng: np.random.Generator) -> np.ndarray:
    return np.where(chain.prismatic, 1e7, 1e5) * rng.uniform(0.3, 3.0, chain.n)


def directions(rng: np.random.Generator, count: int) -> np.ndarray:
    n = rng.standard_normal((count, 3))
    return n / np.linalg.norm(n, axis=1, keepdims=True)


def place(dome: qparm.Cell, q: np.ndarray) -> np.ndarray:
    """Return the tool's place with the kinematics of the measuring side."""
    return joint_transforms(dome, q[None])[0][0, :3, 3]


def test_springs_written_out(dome: qparm.Cell, chain: qparm.SerialChain, rng: np.random.Generator) -> None:
    """The work of 1 N over a small joint motion is the torque; each joint gives way by it over its stiffness."""
    k, step = elastic(chain, rng), 1e-6
    Q, n = chain.random(rng, 20), directions(rng, 20)
    told = tool_compliance(chain, Q, n, Elasticity(k))
    for q, along, value in zip(Q, n, told, strict=True):
        torque = np.array(
            [along @ (place(dome, q + step * e) - place(dome, q - step * e)) / (2 * step) for e in np.eye(chain.n)]
        )
        moved = torque / k
        share = 1e-6 / np.abs(moved).max()
        given_way = along @ (place(dome, q + share * moved) - place(dome, q - share * moved)) / (2 * share)
        assert value == pytest.approx(given_way, rel=1e-6)


def two_links(a: float = 0.5, b: float = 0.3) -> qparm.SerialChain:
    """Return a planar arm of two links, the tool at the end of the second."""
    limits = {"position": (-3.0, 3.0), "velocity": 1.0, "acceleration": 1.0, "jerk": 1.0}
    rows = [
        DHRow(name=f"q{i}", kind="revolute", alpha=0.0, a=length, d=0.0, theta=0.0, **limits)
        for i, length in enumerate((0.0, a))
    ]
    tool = np.eye(4)
    tool[0, 3] = b
    return chain_from_dh(rows, convention="modified", name="two links", transform_tool=tool)


def test_a_planar_arm_by_hand() -> None:
    arm, k = two_links(), np.array([2e4, 1e4])
    n = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    told = tool_compliance(arm, np.zeros((3, 2)), n, Elasticity(k))
    np.testing.assert_allclose(told, [0.8**2 / 2e4 + 0.3**2 / 1e4, 0.0, 0.0], rtol=1e-12, atol=1e-20)
    bent = tool_compliance(arm, [[0.0, np.pi / 2]], [[1.0, 0.0, 0.0]], Elasticity(k))
    np.testing.assert_allclose(bent, 0.3**2 * (1 / 2e4 + 1 / 1e4), rtol=1e-12)


def test_a_straight_arm_is_a_cantilever() -> None:
    stiff = np.full(2, 1e30)
    for n in ([0.0, 1.0, 0.0], [0.0, 0.0, 1.0]):
        told = tool_compliance(two_links(), np.zeros((1, 2)), [n], Elasticity(stiff, 5e4))
        np.testing.assert_allclose(told, 0.8**3 / (3 * 5e4), rtol=1e-12)
    along = tool_compliance(two_links(), np.zeros((1, 2)), [[1.0, 0.0, 0.0]], Elasticity(stiff, 5e4))
    assert along[0] < 1e-25


def test_links_bend_as_chains_of_small_hinges(chain: qparm.SerialChain, rng: np.random.Generator) -> None:
    EI, pieces = 3e4, 4000
    Q, n = chain.random(rng, 5), directions(rng, 5)
    told = tool_compliance(chain, Q, n, Elasticity(np.full(chain.n, 1e30), EI))
    for q, along, value in zip(Q, n, told, strict=True):
        frames = chain.frames(q)
        given_way, tool = 0.0, frames[-1, :3, 3]
        for start, end in zip(frames[1:-1, :3, 3], frames[2:, :3, 3], strict=True):
            length = np.linalg.norm(end - start)
            if length < 1e-12:
                continue
            x = start + (end - start) * ((np.arange(pieces) + 0.5) / pieces)[:, None]
            moment = np.cross(tool - x, along)
            axis = (end - start) / length
            turned = (moment - np.outer(moment @ axis, axis)) / EI * (length / pieces)
            given_way += float((np.cross(turned, tool - x) @ along).sum())
        assert value == pytest.approx(given_way, rel=1e-6)


def test_a_slide_gives_way_along_itself(chain: qparm.SerialChain, rng: np.random.Generator) -> None:
    assert chain.prismatic[0]
    k = np.full(chain.n, 1e30)
    k[0] = 2e6
    axis = chain.frames(np.zeros(chain.n))[1, :3, 2]
    told = tool_compliance(chain, chain.random(rng, 3), np.tile(axis, (3, 1)), Elasticity(k))
    np.testing.assert_allclose(told, 1 / 2e6, rtol=1e-12)


def test_what_is_not_usable_is_refused(chain: qparm.SerialChain) -> None:
    with pytest.raises(InvalidInput, match="must be positive"):
        Elasticity(np.array([1.0, 0.0]))
    with pytest.raises(InvalidInput, match="of 2 joints, the arm has 8"):
        tool_compliance(chain, np.zeros((1, 8)), [[0, 0, 1.0]], Elasticity(np.ones(2)))
    with pytest.raises(InvalidInput, match="directions must be"):
        tool_compliance(chain, np.zeros((1, 8)), [[0, 0, np.nan]], Elasticity(np.ones(8)))
