"""The relaxed tool: its rotations, their rates, the cone, and that the measuring side means the same."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import qparm
from qparm.path.relaxation import EXACT, Relaxation
from qparm.planning.search.projection import velocity_scale
from qparm.verify.kinematics import tool_rotation_error

TILT = np.radians(20.0)
ALL = [Relaxation(spin=True), Relaxation(tilt=TILT), Relaxation(spin=True, tilt=TILT)]


def relaxed_cell(dome: qparm.Cell, relaxation: Relaxation) -> qparm.Cell:
    spin = "free" if relaxation.spin else "fixed"
    return dome.with_process({"tool_spin": spin, "tool_tilt": f"{np.degrees(relaxation.tilt)} deg"})


def test_rotation_is_a_tilt_then_a_spin() -> None:
    rho = np.array([[0.1, -0.2, 0.7]])
    expected = Rotation.from_rotvec([0.1, -0.2, 0.0]) * Rotation.from_euler("z", 0.7)
    assert np.abs(Relaxation(spin=True, tilt=0.5).rotations(rho)[0] - expected.as_matrix()).max() < 1e-15


@pytest.mark.parametrize("relaxation", ALL, ids=["spin", "tilt", "both"])
def test_free_parameters(relaxation: Relaxation, rng: np.random.Generator) -> None:
    rho = relaxation.random(rng, 2000)
    assert (rho[0] == 0).all()
    assert np.hypot(rho[:, 0], rho[:, 1]).max() <= relaxation.tilt
    held = [i for i in range(3) if i not in relaxation.free]
    assert (rho[:, held] == 0).all()
    assert (np.abs(rho[1:, list(relaxation.free)]).max(axis=0) > 0).all()
    assert relaxation.freedom == len(relaxation.free) == 1 * relaxation.spin + 2 * (relaxation.tilt > 0)


def test_exact_changes_nothing(dome: qparm.Cell) -> None:
    poses = dome.tool_path().poses[:3]
    assert EXACT.targets(poses, np.zeros((3, 3))) is poses
    assert EXACT.free == ()


@pytest.mark.parametrize("relaxation", ALL, ids=["spin", "tilt", "both"])
def test_clipped_comes_back_into_the_cone(relaxation: Relaxation, rng: np.random.Generator) -> None:
    rho = rng.standard_normal((500, 3))
    out = relaxation.clipped(rho)
    assert np.hypot(out[:, 0], out[:, 1]).max() <= relaxation.tilt
    if relaxation.tilt:
        # in the same direction, and what is inside stays
        assert np.abs(np.cross(out[:, :2], rho[:, :2])).max() < 1e-12
        inside = np.hypot(rho[:, 0], rho[:, 1]) < 0.99 * relaxation.tilt
        assert inside.any()
        assert (out[inside, :2] == rho[inside, :2]).all()
    assert (out[:, 2] == (rho[:, 2] if relaxation.spin else 0)).all()


@pytest.mark.parametrize("relaxation", ALL, ids=["spin", "tilt", "both"])
def test_rows_against_finite_differences(
    chain: qparm.SerialChain, relaxation: Relaxation, rng: np.random.Generator
) -> None:
    """A step that keeps the task rows moves the tool along its own relaxed set, at the rates the free rows say."""
    D = velocity_scale(chain)
    q = chain.random(rng, 40)
    rho = relaxation.random(rng, 40)
    # nominal poses for which these configurations stand at these parameters
    poses = chain.forward(q)
    poses[:, :3, :3] = poses[:, :3, :3] @ relaxation.rotations(rho).transpose(0, 2, 1)
    task, error, free = relaxation.rows(chain, poses, q, rho, D)
    assert task.shape == (40, 6 - relaxation.freedom, 8)
    assert free.shape == (40, relaxation.freedom, 8)
    assert np.abs(error).max() < 1e-10
    h = 1e-5
    for k in range(40):
        null = np.linalg.svd(task[k])[2][6 - relaxation.freedom :]
        d = null.T @ rng.standard_normal(len(null))
        d /= np.linalg.norm(d)
        moved = np.zeros(3)
        moved[list(relaxation.free)] = free[k] @ d
        misses = []
        for step in (h, 10 * h):
            target = relaxation.targets(poses[k : k + 1], (rho[k] + step * moved)[None])
            E = chain.pose_error(chain.forward((q[k] + step * D * d)[None]), target)
            misses.append(float(np.abs(E).max()))
        # second order: a hundredth of what ten times the step misses
        assert misses[0] < 1e-8
        assert misses[0] < 0.02 * misses[1] + 1e-13


@pytest.mark.parametrize("relaxation", ALL, ids=["spin", "tilt", "both"])
def test_rows_bring_back_what_is_off(
    chain: qparm.SerialChain, relaxation: Relaxation, rng: np.random.Generator
) -> None:
    """One Newton step on rows and errors leaves an error of second order."""
    D = velocity_scale(chain)
    q = chain.random(rng, 30)
    rho = relaxation.random(rng, 30)
    poses = chain.forward(q)
    poses[:, :3, :3] = poses[:, :3, :3] @ relaxation.rotations(rho).transpose(0, 2, 1)
    off = q + 1e-4 * D * rng.standard_normal(q.shape)
    task, error, free = relaxation.rows(chain, poses, off, rho, D)
    d = np.einsum("kij,kj->ki", np.linalg.pinv(task), error)
    d_rho = np.zeros((30, 3))
    current = relaxation.rows(chain, poses, off, rho, D)[1]
    assert np.abs(current).max() > 1e-5
    d_rho[:, list(relaxation.free)] = np.einsum("kij,kj->ki", free, d)
    after = chain.forward(off + D * d)
    left = relaxation.rows(chain, poses, off + D * d, rho, D)[1]
    assert np.abs(left).max() < 1e-2 * np.abs(error).max()
    assert np.isfinite(after).all()


def test_cone_rows_keep_the_tilt_inside(chain: qparm.SerialChain, rng: np.random.Generator) -> None:
    """Whatever z keeps the strips keeps the axis within the cone."""
    relaxation = Relaxation(tilt=TILT)
    N, r = 200, 4
    rho = relaxation.random(rng, N)
    relaxed, basis, p = rng.standard_normal((N, 2, 8)), rng.standard_normal((N, 8, r)), np.zeros((N, 8))
    found = relaxation.cone(rho, relaxed, basis, p)
    assert found is not None
    rows, lo, hi = found
    assert rows.shape == (N, 8, r)
    z = 0.05 * rng.standard_normal((N, r))
    lean = rho[:, :2] + np.einsum("kij,kjl,kl->ki", relaxed, basis, z)
    value = np.einsum("kij,kj->ki", rows, z)
    kept = ((value >= lo) & (value <= hi)).all(axis=1)
    norm = np.linalg.norm(lean, axis=1)
    assert 10 < kept.sum() < N - 10
    assert norm[kept].max() <= TILT
    # and not much is given away: well inside, no strip is in the way
    assert kept[norm < 0.98 * TILT].all()
    assert Relaxation(spin=True).cone(rho, relaxed, basis, p) is None


@pytest.mark.parametrize("relaxation", [EXACT, *ALL], ids=["exact", "spin", "tilt", "both"])
def test_measured_error_is_zero_where_the_planner_may_stand(
    dome: qparm.Cell, relaxation: Relaxation, rng: np.random.Generator
) -> None:
    cell = relaxed_cell(dome, relaxation)
    R = Rotation.random(300, random_state=3).as_matrix()
    poses = np.tile(np.eye(4), (300, 1, 1))
    poses[:, :3, :3] = R
    stands = relaxation.targets(poses, relaxation.random(rng, 300))
    assert tool_rotation_error(cell, stands[:, :3, :3], R).max() < 1e-7


@pytest.mark.parametrize("excess", [1e-6, 1e-3, 0.1])
def test_measured_error_outside(dome: qparm.Cell, excess: float, rng: np.random.Generator) -> None:
    """By so much beyond what is free, in each way of being beyond it."""
    R = Rotation.random(50, random_state=3).as_matrix()
    angle = rng.uniform(0, 2 * np.pi, 50)
    axis = np.stack([np.cos(angle), np.sin(angle), np.zeros(50)], axis=1)
    spin = Rotation.from_rotvec(np.outer(rng.uniform(-3, 3, 50), [0, 0, 1]))
    lean = Rotation.from_rotvec((TILT + excess) * axis)
    small = Rotation.from_rotvec(excess * axis)
    within = Rotation.from_rotvec(0.7 * TILT * axis)
    turned = Rotation.from_rotvec([0, 0, excess])
    for relaxation, offset in (
        (EXACT, small),
        (EXACT, Rotation.from_rotvec(np.outer(np.ones(50), [0, 0, excess]))),
        (ALL[0], small * spin),
        (ALL[1], lean),
        (ALL[1], within * turned),
        (ALL[2], lean * spin),
    ):
        cell = relaxed_cell(dome, relaxation)
        error = tool_rotation_error(cell, R @ offset.as_matrix(), R)
        assert error == pytest.approx(np.full(50, excess), rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("tilt", [-0.1, 1.1, float("nan")])
def test_tilt_out_of_range_is_refused(tilt: float) -> None:
    with pytest.raises(qparm.InvalidInput, match="tilt must lie between"):
        Relaxation(tilt=tilt)


def test_relaxations_are_data() -> None:
    assert replace(Relaxation(spin=True), spin=False) == EXACT
