"""Samples of self-motion sets: on their poses, within the limits, apart, and the same every time."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

import qparm
from qparm.path.relaxation import EXACT, Relaxation
from qparm.planning.search.projection import velocity_scale
from qparm.planning.search.sampling import Layer, Sampling, sample_block
from qparm.reach.relaxed_bound import relaxed_excess

FEW = Sampling(spacing=np.radians(30.0), starts=100, fresh=4, fresh_where_empty=20, most=300)


@pytest.fixture(scope="module")
def targets(dome: qparm.Cell) -> np.ndarray:
    return dome.tool_path().poses[400:408]


@pytest.fixture(scope="module")
def layers(chain: qparm.SerialChain, targets: np.ndarray) -> list[Layer]:
    return sample_block(chain, targets, rng=np.random.default_rng(5), sampling=FEW, relaxation=EXACT)


def test_every_sample_is_on_its_pose_and_within_limits(
    chain: qparm.SerialChain, targets: np.ndarray, layers: list[Layer]
) -> None:
    assert len(layers) == len(targets)
    for layer, target in zip(layers, targets, strict=True):
        assert 20 < len(layer.q) <= FEW.most
        E = chain.pose_error(chain.forward(layer.q), np.broadcast_to(target, (len(layer.q), 4, 4)))
        assert np.abs(E).max() < 1e-6
        assert chain.within_limits(layer.q).all()
        assert (layer.rho == 0).all()


def test_samples_are_apart(chain: qparm.SerialChain, layers: list[Layer]) -> None:
    for layer in layers:
        u = layer.q / velocity_scale(chain)
        apart = np.abs(u[:, None] - u[None]).max(axis=2)
        np.fill_diagonal(apart, np.inf)
        assert apart.min() > FEW.spacing


def test_neighbours_are_near(chain: qparm.SerialChain, layers: list[Layer]) -> None:
    """Solutions are carried along: most have one within the spacing at the pose before."""
    for a, b in pairwise(layers):
        u, v = a.q / velocity_scale(chain), b.q / velocity_scale(chain)
        nearest = np.abs(u[:, None] - v[None]).max(axis=2).min(axis=0)
        assert np.median(nearest) < FEW.spacing


def test_same_seed_same_samples(chain: qparm.SerialChain, targets: np.ndarray, layers: list[Layer]) -> None:
    again = sample_block(chain, targets, rng=np.random.default_rng(5), sampling=FEW, relaxation=EXACT)
    other = sample_block(chain, targets, rng=np.random.default_rng(6), sampling=FEW, relaxation=EXACT)
    assert all(np.array_equal(a.q, b.q) for a, b in zip(layers, again, strict=True))
    assert not np.array_equal(layers[0].q, other[0].q)


def test_a_finer_sampling_has_more(chain: qparm.SerialChain, targets: np.ndarray, layers: list[Layer]) -> None:
    finer = sample_block(chain, targets, rng=np.random.default_rng(5), sampling=FEW.finer(4), relaxation=EXACT)
    assert min(len(layer.q) for layer in finer) > 1.5 * max(len(layer.q) for layer in layers)


def test_unreachable_pose_is_an_empty_layer(chain: qparm.SerialChain, targets: np.ndarray) -> None:
    out_of_reach = targets.copy()
    out_of_reach[3, 2, 3] += 5.0
    layers = sample_block(chain, out_of_reach, rng=np.random.default_rng(5), sampling=FEW, relaxation=EXACT)
    counts = [len(layer.q) for layer in layers]
    assert counts[3] == 0
    # what lies behind is found all the same
    assert min(count for k, count in enumerate(counts) if k != 3) > 5


def test_nothing_in_reach_is_empty_throughout(chain: qparm.SerialChain, targets: np.ndarray) -> None:
    far = targets[:2].copy()
    far[:, 0, 3] += 9.0
    layers = sample_block(chain, far, rng=np.random.default_rng(0), sampling=FEW, relaxation=EXACT)
    assert [len(layer.q) for layer in layers] == [0, 0]


def test_one_pose_alone(chain: qparm.SerialChain, targets: np.ndarray) -> None:
    (layer,) = sample_block(chain, targets[:1], rng=np.random.default_rng(0), sampling=FEW, relaxation=EXACT)
    assert len(layer.q) > 10


def test_seeds_are_carried_along(chain: qparm.SerialChain, targets: np.ndarray, layers: list[Layer]) -> None:
    none = Sampling(spacing=FEW.spacing, starts=1, fresh=0, fresh_where_empty=1, copies=0.0, most=300)
    seeded = sample_block(
        chain, targets, rng=np.random.default_rng(1), sampling=Sampling(spacing=FEW.spacing, starts=len(layers[0].q)),
        relaxation=EXACT, seeds=layers[0],
    )  # fmt: skip
    bare = sample_block(chain, targets, rng=np.random.default_rng(1), sampling=none, relaxation=EXACT)
    assert len(seeded[-1].q) > 5 + len(bare[-1].q)


def test_relaxed_tool_stands_where_its_parameters_say(chain: qparm.SerialChain, targets: np.ndarray) -> None:
    relaxation = Relaxation(spin=True, tilt=np.radians(10.0))
    layers = sample_block(chain, targets[:3], rng=np.random.default_rng(5), sampling=FEW, relaxation=relaxation)
    for layer, target in zip(layers, targets[:3], strict=True):
        turned = relaxation.targets(np.broadcast_to(target, (len(layer.q), 4, 4)), layer.rho)
        assert np.abs(chain.pose_error(chain.forward(layer.q), turned)).max() < 1e-6
        assert np.hypot(layer.rho[:, 0], layer.rho[:, 1]).max() <= relaxation.tilt
        assert np.abs(layer.rho[:, 2]).max() > 0.5


def test_where_no_drawn_turn_leads_to_a_solution_arm_and_tool_are_moved_together(chain: qparm.SerialChain) -> None:
    """A pose beyond reach by all but the last degree of the cone, as the reach bound tells."""
    relaxation = Relaxation(tilt=np.radians(20.0))
    nominal = np.eye(4)
    nominal[:3, :3] = np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]])  # the tool looks away, along +y
    nominal[:3, 3] = 0.0, 0.0, 0.5
    border = relaxed_border(chain, nominal, Relaxation(tilt=relaxation.inner))
    nominal[1, 3] = border - 1e-5
    (layer,) = sample_block(chain, nominal[None], rng=np.random.default_rng(0), sampling=FEW, relaxation=relaxation)
    assert len(layer.q)
    turned = relaxation.targets(np.broadcast_to(nominal, (len(layer.q), 4, 4)), layer.rho)
    error = chain.pose_error(chain.forward(layer.q), np.ascontiguousarray(turned))
    assert np.abs(error).max() < 1e-6
    assert np.hypot(layer.rho[:, 0], layer.rho[:, 1]).max() <= relaxation.inner
    assert chain.within_limits(layer.q).all()
    # a millimetre farther there is none
    nominal[1, 3] = border + 1e-3
    (layer,) = sample_block(chain, nominal[None], rng=np.random.default_rng(0), sampling=FEW, relaxation=relaxation)
    assert not len(layer.q)


def relaxed_border(chain: qparm.SerialChain, nominal: np.ndarray, relaxation: Relaxation) -> float:
    """Return how far along y a pose is just within the bound of reach."""
    near, far = 0.5, 5.0
    for _ in range(60):
        middle = 0.5 * (near + far)
        nominal = nominal.copy()
        nominal[1, 3] = middle
        near, far = (near, middle) if relaxed_excess(chain, nominal[None], relaxation)[0][0] > 0 else (middle, far)
    return near
