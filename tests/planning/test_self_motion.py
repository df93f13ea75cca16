"""Self-motion: the tool stays where it is, the limits hold, and the configuration gets as near as it can."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import qparm
from qparm.ik import make_solver, solve_poses
from qparm.planning.paper.self_motion import draw_near

TOLERANCES = {"position_tolerance": 1e-9, "rotation_tolerance": 1e-9}


@pytest.fixture(scope="module")
def solutions(dome: qparm.Cell) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return one pose of the dome and solutions of it."""
    target = dome.tool_path().poses[450]
    batch = solve_poses(dome.chain(), target[None], restarts=60, every_start=True, rng=np.random.default_rng(7))
    return target, batch.q[0][batch.reached[0]][:12]


@pytest.mark.parametrize("solver", [None, "proxqp"])
def test_the_pose_and_the_limits_are_held(
    chain: qparm.SerialChain, solutions: tuple[NDArray[np.float64], NDArray[np.float64]], solver: str | None
) -> None:
    target, Q = solutions
    options: dict[str, Any] = TOLERANCES | ({} if solver is None else {"solver": make_solver(solver, chain.n)})
    for q, towards in zip(Q, Q[::-1], strict=True):
        near, held, counts = draw_near(chain, target, q, towards, **options)
        assert held
        assert counts.total > 0
        assert counts.failed == 0
        assert counts.fallback == 0
        e = chain.pose_error(chain.forward(near), target)
        assert np.linalg.norm(e[:3]) <= 1e-9
        assert np.linalg.norm(e[3:]) <= 1e-9
        assert chain.within_limits(near).all()
        before, after = (np.linalg.norm((one - towards) / chain.scale) for one in (q, near))
        assert after <= before + 1e-6


def test_a_displaced_configuration_is_brought_back(
    chain: qparm.SerialChain, solutions: tuple[NDArray[np.float64], NDArray[np.float64]]
) -> None:
    """Out by self-motion and back again: the same connected piece, so the way back is found."""
    target, Q = solutions
    moved = 0
    for q, towards in zip(Q, Q[::-1], strict=True):
        out, _, _ = draw_near(chain, target, q, towards, box=(q - 0.2, q + 0.2), **TOLERANCES)
        assert (np.abs(out - q) <= 0.2 + 1e-12).all()
        back, _, _ = draw_near(chain, target, out, q, **TOLERANCES)
        moved += np.abs(out - q).max() > 0.1
        np.testing.assert_allclose(back, q, atol=2e-3)
    assert moved >= 6


def test_it_rests_at_a_stationary_point(
    chain: qparm.SerialChain, solutions: tuple[NDArray[np.float64], NDArray[np.float64]]
) -> None:
    """What is left of the way to the goal has no part in the null space of the free joints."""
    target, Q = solutions
    checked = 0
    for q, towards in zip(Q, Q[::-1], strict=True):
        near, _, _ = draw_near(chain, target, q, towards, **TOLERANCES)
        if not chain.within_limits(near, tolerance=-1e-6).all():
            continue
        H = (towards - near) / chain.scale
        _, sigma, Vt = np.linalg.svd(chain.scaled_jacobian(near))
        if sigma[5] < 0.05 or np.linalg.norm(H) < 1e-6:
            continue
        checked += 1
        assert np.linalg.norm(Vt[6:] @ H) <= 1e-3 * max(1.0, float(np.linalg.norm(H)))
    assert checked >= 2
