"""Measures that an arm can attain on a path, whatever planner moves it: taken over the self-motion sets of the points.

Solutions of every third point and of the rows' ends are sampled (:mod:`qparm.planning.search.sampling`), with the same
draws for every design. The best of them, moved on, give what the point attains
(:mod:`qparm.design.best_of_points`); dynamic programming over all of them gives the path with the fewest
reconfigurations and the smallest largest step. No planner's own luck is in it, so neighbouring designs compare.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from qparm.design.best_of_points import OfConfigurations, best_of_points
from qparm.planning.paper.jump import jump_criteria, jumps_between
from qparm.planning.problem import row_end
from qparm.planning.search.layered import FORCED, INSIDE, ROW_END, LayeredSearch
from qparm.planning.search.projection import velocity_scale
from qparm.planning.search.refine import refine
from qparm.planning.search.sampling import Layer, Sampling, sample_block
from qparm.planning.solution import PathSolution, driven_edges, knots
from qparm.reach.margin import attainable_margin
from qparm.robot.compliance import tool_compliance

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.cell import Cell
    from qparm.path import ToolPath
    from qparm.path.relaxation import Relaxation
    from qparm.robot import SerialChain
    from qparm.robot.compliance import Elasticity

__all__ = ["OF_PATH", "OF_POINTS", "attainable_measures", "soft_minimum"]

OF_POINTS = ("singularity_margin", "limit_margin", "lever", "compliance")
OF_PATH = ("reconfigurations", "row_end_reconfigurations", "largest_step", "motion_time")

# Coarser than the planner's: designs are told apart, not planned.
_STRIDE = 3
_SAMPLING = Sampling(spacing=np.radians(45.0), starts=60, fresh=4, fresh_where_empty=60, copies=0.3, most=200)
_FRESH_OF_ROW = 240
# The best path is searched again in a bundle of so many copies, so many times.
_COPIES, _ROUNDS = 12, 24
# The singularity margin is climbed from so many of a point's solutions.
_CLIMBS = 2
# Of a soft minimum over the points, in the measure's own units (all are around 0.1 to 1).
_TEMPERATURE = 0.02


def attainable_measures(
    cell: Cell, tool_path: ToolPath, *, seed: int, names: Sequence[str] = (*OF_POINTS, *OF_PATH)
) -> dict[str, float]:
    """Return the measures of a cell that covers its path.

    Parameters
    ----------
    cell : Cell
    tool_path : ToolPath
        The cell's.
    seed : int
        Of the draws; the same for all designs that are compared.
    names : sequence of str
        Those that are wanted; one of a path brings all of :data:`OF_PATH`.

    Returns
    -------
    dict of str to float
        ``singularity_margin``: softmin over the points of the largest smallest singular value of the scaled Jacobian
        (:func:`qparm.reach.attainable_margin`). ``limit_margin``: softmin over the
        points of the largest ``min_i 4 (q - lower)(upper - q) / range²``. ``lever``: the largest over the points of the
        smallest root of the sum of squared moment arms of a force along the tool's axis (m). ``compliance``: the same
        of how far the tool deflects along the surface's normal (m/N), if the cell has stiffnesses.
        ``reconfigurations``, ``row_end_reconfigurations``, ``largest_step`` (rad, between neighbouring points),
        ``motion_time`` (s): of the best path through the samples.
    """
    chain = cell.chain()
    relaxation = cell.relaxation()
    at = _thinned(tool_path, knots(chain, tool_path))
    layers = _layers(chain, tool_path, at, relaxation, seed)
    there = [k for k, layer in enumerate(layers) if len(layer.q)]
    poses, found = tool_path.poses[at[there]], [layers[k] for k in there]
    measures: dict[str, float] = {}
    if "singularity_margin" in names:
        measures["singularity_margin"] = soft_minimum(_singularity_margin(chain, poses, found, relaxation))
    for number, (name, of) in enumerate(_of_configurations(cell.elasticity()).items()):
        if name in names:
            values = best_of_points(chain, poses, found, of, relaxation, np.random.default_rng([seed, 7, number]))
            measures[name] = soft_minimum(values) if name == "limit_margin" else -float(values.min())
    if set(OF_PATH) & set(names):
        measures |= _best_path(cell, chain, tool_path, at, layers, relaxation, seed)
    return measures


def _thinned(tool_path: ToolPath, at: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return every third of some points, evenly over each row, with its ends."""
    chosen = []
    for index in range(len(tool_path.rows)):
        part = at[tool_path.row_of_point[at] == index]
        count = -(-(len(part) - 1) // _STRIDE) + 1
        chosen.append(part[np.unique(np.round(np.linspace(0, len(part) - 1, count)).astype(np.int64))])
    return np.concatenate(chosen)


def _layers(
    chain: SerialChain, tool_path: ToolPath, at: NDArray[np.int64], relaxation: Relaxation, seed: int
) -> list[Layer]:
    row = tool_path.row_of_point[at]
    layers: list[Layer] = []
    seeds = None
    for index in range(len(tool_path.rows)):
        part = at[row == index]
        rng = np.random.default_rng([seed, 3, index])
        # a short row has fewer neighbours to bring solutions
        sampling = replace(_SAMPLING, fresh=max(_SAMPLING.fresh, -(-_FRESH_OF_ROW // max(len(part), 1))))
        # a row starts from what the one before ended with, so that there are ways across the row end
        layers += sample_block(
            chain, tool_path.poses[part], rng=rng, sampling=sampling, relaxation=relaxation, seeds=seeds
        )
        seeds = layers[-1]
    return layers


def _singularity_margin(
    chain: SerialChain, poses: NDArray[np.float64], layers: list[Layer], relaxation: Relaxation
) -> NDArray[np.float64]:
    """Return the attainable margin of each pose, climbed from its best solutions, the tool turned as in the best."""
    starts, rho = np.empty((len(layers), _CLIMBS, chain.n)), np.empty((len(layers), 3))
    for k, layer in enumerate(layers):
        J = chain.scaled_jacobian(layer.q)
        # the smallest eigenvalue of J J^T is the square of the smallest singular value, and much cheaper
        best = np.argsort(-np.linalg.eigvalsh(J @ J.transpose(0, 2, 1))[:, 0], kind="stable")
        starts[k], rho[k] = layer.q[np.resize(best[:_CLIMBS], _CLIMBS)], layer.rho[best[0]]
    turned = poses.copy()
    turned[:, :3, :3] = poses[:, :3, :3] @ relaxation.rotations(rho)
    margin = attainable_margin(chain, turned, starts=starts, climbs=_CLIMBS, threads=1).margin
    return margin[np.isfinite(margin)]


def _limit_margin(chain: SerialChain, q: NDArray[np.float64], _: NDArray[np.float64]) -> NDArray[np.float64]:
    limited = ~chain.continuous
    middle, half = 0.5 * (chain.lower + chain.upper), 0.5 * (chain.upper - chain.lower)
    return (1.0 - ((q - middle) / half) ** 2)[:, limited].min(axis=1, initial=1.0)


def _lever(chain: SerialChain, q: NDArray[np.float64], _: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the negative root of the sum of squared moment arms of a force along the tool's axis."""
    axis = chain.forward(q)[:, :3, 2]
    arms = np.einsum("ka,kan->kn", axis, chain.jacobian(q)[:, :3][:, :, ~chain.prismatic])
    return -np.sqrt((arms**2).sum(axis=1))


def _of_configurations(elasticity: Elasticity | None) -> dict[str, OfConfigurations]:
    """Return the measures of single configurations, of each the larger the better."""
    found: dict[str, OfConfigurations] = {"limit_margin": _limit_margin, "lever": _lever}
    if elasticity is not None:
        found["compliance"] = lambda chain, q, normals: -tool_compliance(chain, q, normals, elasticity)
    return found


def _best_path(
    cell: Cell,
    chain: SerialChain,
    tool_path: ToolPath,
    at: NDArray[np.int64],
    layers: list[Layer],
    relaxation: Relaxation,
    seed: int,
) -> dict[str, float]:
    edges = jump_criteria(chain, tool_path, cell.jump())
    limits = jumps_between(edges, at)
    inside = np.concatenate([[0], np.cumsum(~row_end(tool_path))])
    ends = inside[at[1:]] == inside[at[:-1]]
    search = LayeredSearch(chain, velocity_scale(chain))
    there: list[int] = []
    for k, layer in enumerate(layers):
        if not len(layer.q):
            continue
        gap = bool(there) and there[-1] != k - 1
        kind = FORCED if gap else ROW_END if k > 0 and ends[k - 1] else INSIDE
        search.add(layer, kind, limits[max(k - 1, 0)])
        there.append(k)
    q, rho, reached = np.zeros((len(at), chain.n)), np.zeros((len(at), 3)), np.zeros(len(at), dtype=bool)
    q[there], rho[there], _ = search.path()
    reached[there] = True
    found, _ = refine(
        chain, tool_path.poses[at], PathSolution(q, relaxation.unwound(rho), reached, driven_edges(q, reached, limits)),
        limits, ends, relaxation, np.random.default_rng([seed, 6]), copies=_COPIES, rounds=_ROUNDS, threads=1,
    )  # fmt: skip
    step = np.abs(np.diff(found.q, axis=0))
    broken = reached[:-1] & reached[1:] & ~found.driven
    scaled = (step / velocity_scale(chain)).max(axis=1) / np.diff(at)
    feeding = np.where(ends, 0.0, np.abs(np.diff(tool_path.s[at])) / cell.process.feed)
    seconds = np.maximum(feeding, (step / chain.velocity).max(axis=1))
    return {
        "reconfigurations": float((broken & ~ends).sum()),
        "row_end_reconfigurations": float((broken & ends).sum()),
        "largest_step": float(scaled[found.driven].max(initial=0.0)),
        "motion_time": float(seconds[reached[:-1] & reached[1:]].sum()),
    }


def soft_minimum(values: NDArray[np.float64]) -> float:
    """Return ``-t ln(mean(exp(-v / t)))``, t = 0.02: near the least, but every low value counts."""
    least = float(values.min())
    return least - _TEMPERATURE * float(np.log(np.mean(np.exp(-(values - least) / _TEMPERATURE))))
