"""The layered search against all paths, one by one."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from numpy.typing import NDArray

from qparm import SerialChain
from qparm.planning.search.layered import DRIVEN, FORCED, INSIDE, ROW_END, LayeredSearch
from qparm.planning.search.projection import velocity_scale
from qparm.planning.search.sampling import Layer
from qparm.robot import rest_to_rest_time

Cost = tuple[int, float, float, float]


def layers_of(chain: SerialChain, rng: np.random.Generator, sizes: list[int], spread: float) -> list[Layer]:
    """Return layers about a slow walk, so that some steps are driven and some are not."""
    scale, n = velocity_scale(chain), chain.n
    middle = 0.5 * (chain.lower + chain.upper) + np.cumsum(0.1 * rng.standard_normal((len(sizes), n)), axis=0) * scale
    return [
        Layer(middle[k] + spread * scale * rng.standard_normal((m, n)), rng.standard_normal((m, 3)))
        for k, m in enumerate(sizes)
    ]


def cost_of(
    chain: SerialChain, path: NDArray[np.float64], kinds: list[int], jumps: NDArray[np.float64], cap: float = np.inf
) -> Cost:
    """Return the cost of one path, from its definition."""
    inside, seconds, largest, squares = 0, 0.0, 0.0, 0.0
    for k in range(1, len(path)):
        step = np.abs(path[k] - path[k - 1])
        scaled = step / velocity_scale(chain)
        if kinds[k] != FORCED and (step <= jumps[k]).all() and scaled.max() <= cap:
            largest, squares = max(largest, float(scaled.max())), squares + float((scaled**2).sum())
        else:
            inside += kinds[k] == INSIDE
            seconds += float(rest_to_rest_time(chain, path[k - 1], path[k]))
    return inside, seconds, largest, squares


def best_of_all(
    chain: SerialChain, layers: list[Layer], kinds: list[int], jumps: NDArray[np.float64], cap: float = np.inf
) -> tuple[Cost, NDArray[np.float64]]:
    best: tuple[Cost, NDArray[np.float64]] | None = None
    for choice in product(*(range(len(layer.q)) for layer in layers)):
        path = np.array([layer.q[j] for layer, j in zip(layers, choice, strict=True)])
        cost = cost_of(chain, path, kinds, jumps, cap)
        if not np.isinf(cap):
            # a finite cap takes the place of the third part
            cost = (cost[0], cost[1], 0.0, cost[3])
        rounded = (cost[0], round(cost[1], 10), round(cost[2], 10), cost[3])
        if best is None or rounded < (best[0][0], round(best[0][1], 10), round(best[0][2], 10), best[0][3]):
            best = cost, path
    assert best is not None
    return best


def search_of(
    chain: SerialChain, layers: list[Layer], kinds: list[int], jumps: NDArray[np.float64], *, cap: float = np.inf,
    prune: bool = False,
) -> tuple[NDArray[np.float64], NDArray[np.float64], Cost]:  # fmt: skip
    search = LayeredSearch(chain, velocity_scale(chain), cap=cap)
    for layer, kind, jump in zip(layers, kinds, jumps, strict=True):
        search.add(layer, kind, jump)
        if prune:
            search.prune()
    return search.path()


def jumps_of(chain: SerialChain, count: int, degrees: float) -> NDArray[np.float64]:
    return np.tile(np.radians(degrees) * velocity_scale(chain), (count, 1))


def assert_same(found: Cost, expected: Cost) -> None:
    assert found[0] == expected[0]
    assert found[1:] == pytest.approx(expected[1:], rel=1e-9, abs=1e-12)


KINDS = {
    "inside": [FORCED, INSIDE, INSIDE, INSIDE, INSIDE],
    "row end": [FORCED, INSIDE, ROW_END, INSIDE, INSIDE],
    "forced": [FORCED, INSIDE, FORCED, INSIDE, ROW_END],
}


@pytest.mark.parametrize("kinds", KINDS.values(), ids=KINDS.keys())
@pytest.mark.parametrize("degrees", [10.0, 25.0, 60.0, 400.0])
@pytest.mark.parametrize("cap", [np.inf, np.radians(30.0)], ids=["free", "capped"])
def test_best_path_is_the_best_of_all(
    chain: SerialChain, rng: np.random.Generator, kinds: list[int], degrees: float, cap: float
) -> None:
    """Over jump criteria that allow no step, some, most and all."""
    for spread in (0.1, 0.4):
        layers = layers_of(chain, rng, [3, 4, 2, 4, 3], spread)
        jumps = jumps_of(chain, 5, degrees)
        expected, best = best_of_all(chain, layers, kinds, jumps, cap)
        q, rho, cost = search_of(chain, layers, kinds, jumps, cap=cap)
        if np.isinf(cap):
            # the sum of squares is the least one only once the largest step is known: by a second pass
            assert_same((*cost[:3], 0.0), (*expected[:3], 0.0))
            assert_same(cost_of(chain, q, kinds, jumps), cost)
            q, rho, second = search_of(chain, layers, kinds, jumps, cap=cost[2] * (1 + 1e-9))
            assert_same((*second[:2], 0.0, second[3]), (*expected[:2], 0.0, expected[3]))
        else:
            assert_same(cost, expected)
        assert np.abs(q - best).max() == 0
        for k, layer in enumerate(layers):
            j = int(np.flatnonzero((layer.q == q[k]).all(axis=1))[0])
            assert (layer.rho[j] == rho[k]).all()


@pytest.mark.slow
def test_a_reconfiguration_inside_a_row_is_where_it_is_shortest(chain: SerialChain, rng: np.random.Generator) -> None:
    """A break early may be longer than one later, though what leads there needs none before."""
    kinds, jumps, once = [FORCED, INSIDE, INSIDE, INSIDE], jumps_of(chain, 4, 30.0), 0
    for _ in range(60):
        layers = layers_of(chain, rng, [5, 6, 6, 5], 0.4)
        expected, _ = best_of_all(chain, layers, kinds, jumps, np.inf)
        once += expected[0] == 1
        assert search_of(chain, layers, kinds, jumps)[2][:2] == pytest.approx(expected[:2], rel=1e-12)
    assert once > 10


def test_where_all_is_driven_or_left_out_no_path_reconfigures(chain: SerialChain, rng: np.random.Generator) -> None:
    kinds, jumps = [FORCED, INSIDE, INSIDE, INSIDE], jumps_of(chain, 4, 60.0)
    for _ in range(20):
        layers = layers_of(chain, rng, [5, 6, 6, 5], 0.4)
        searches = [LayeredSearch(chain, velocity_scale(chain)) for _ in range(2)]
        for layer, kind, jump in zip(layers, kinds, jumps, strict=True):
            searches[0].add(layer, kind, jump)
            searches[1].add(layer, DRIVEN if kind == INSIDE else kind, jump)
        free, driven = searches[0].cost, searches[1].cost
        reached = free[:, 0] == 0
        np.testing.assert_array_equal(driven[reached], free[reached])
        assert np.isinf(driven[~reached, 0]).all()


def test_some_of_these_reconfigure(chain: SerialChain, rng: np.random.Generator) -> None:
    """The comparison above would say little if all its paths were driven, or none."""
    layers = layers_of(chain, rng, [3, 4, 2, 4, 3], 0.4)
    counts = {d: search_of(chain, layers, KINDS["inside"], jumps_of(chain, 5, d))[2][0] for d in (10.0, 60.0, 400.0)}
    assert counts[10.0] > counts[400.0] == 0


def test_row_end_is_cheaper_than_inside(chain: SerialChain) -> None:
    """Two pieces that do not meet: the arm changes over at the row end, though it takes longer there."""
    q = 0.5 * (chain.lower + chain.upper)
    away = q + np.radians(40.0) * velocity_scale(chain)
    far = q + np.radians(80.0) * velocity_scale(chain)
    layers = [Layer(np.array(x), np.zeros((len(x), 3))) for x in ([q], [q, away], [far, q], [far])]
    jumps = jumps_of(chain, 4, 30.0)
    _, _, cost = search_of(chain, layers, [FORCED, INSIDE, ROW_END, INSIDE], jumps)
    assert cost[0] == 0
    assert cost[1] == pytest.approx(float(rest_to_rest_time(chain, q, far)))
    _, _, cost = search_of(chain, layers, [FORCED, INSIDE, INSIDE, INSIDE], jumps)
    assert cost[0] == 1


def test_forced_edge_costs_its_time_and_counts_nowhere(chain: SerialChain, rng: np.random.Generator) -> None:
    a, b = layers_of(chain, rng, [1, 1], 0.01)
    _, _, cost = search_of(chain, [a, b], [FORCED, FORCED], jumps_of(chain, 2, 400.0))
    assert cost[0] == 0
    assert cost[1] == pytest.approx(float(rest_to_rest_time(chain, a.q[0], b.q[0])))
    assert cost[2:] == (0.0, 0.0)


def test_cap_makes_large_steps_reconfigurations(chain: SerialChain) -> None:
    q = 0.5 * (chain.lower + chain.upper)
    layers = [Layer(x[None], np.zeros((1, 3))) for x in (q, q + 0.2 * velocity_scale(chain))]
    jumps = jumps_of(chain, 2, 50.0)
    assert search_of(chain, layers, [FORCED, INSIDE], jumps, cap=0.21)[2][0] == 0
    assert search_of(chain, layers, [FORCED, INSIDE], jumps, cap=0.19)[2][0] == 1


def test_pruning_keeps_the_best_path(chain: SerialChain, rng: np.random.Generator) -> None:
    sizes = rng.integers(1, 12, size=60).tolist()
    layers = layers_of(chain, rng, sizes, 0.3)
    kinds = [FORCED, *(INSIDE if k % 10 else ROW_END for k in range(1, 60))]
    jumps = jumps_of(chain, 60, 50.0)
    plain = search_of(chain, layers, kinds, jumps)
    pruned = search_of(chain, layers, kinds, jumps, prune=True)
    assert (plain[0] == pruned[0]).all()
    assert (plain[1] == pruned[1]).all()
    assert plain[2] == pruned[2]


def test_pruning_lets_go_of_what_no_path_uses(chain: SerialChain, rng: np.random.Generator) -> None:
    search = LayeredSearch(chain, velocity_scale(chain))
    jump = jumps_of(chain, 1, 50.0)[0]
    for layer in layers_of(chain, rng, [50] * 40, 0.2):
        search.add(layer, INSIDE, jump)
        search.prune()
    kept = [len(layer.q) for layer in search._layers]
    assert kept[-1] == 50
    assert max(kept[:30]) < 25
