"""Samples of the self-motion sets along a run of poses: carried from pose to pose, spread, and kept apart.

The solutions of one pose are nearly those of the next. So a set of solutions is drawn at the first pose and
carried along: each is moved onto the next pose, some are copied and displaced, a few are drawn anew, and
what lies within ``spacing`` of a kept one is dropped. Each brings what the arm's flips make of it
(:mod:`qparm.robot.flips`), so that most need not be solved for. Then the same backwards, so that solutions found late
reach the poses before them. The set fills what can be filled of the self-motion sets, in every piece that was met.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from qparm.compiled.kernels import b1, c1, c2, c3, f8, i8, kernel, kernel_helper, o3, oi, void
from qparm.ik.closed_form_step import M
from qparm.ik.iterate import REACHED
from qparm.ik.relaxed import offset_of, relaxed_iterate_kernel, turned
from qparm.path.relaxation import Relaxation
from qparm.planning.search.projection import move_onto, search_scale, turn_of, velocity_scale
from qparm.planning.tolerances import SEARCH_POSE, STEP_TRUST
from qparm.reach.relaxed_bound import relaxed_excess
from qparm.robot.flips import flips

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.robot import SerialChain

__all__ = ["Layer", "Sampling", "sample_block"]

_ITERATIONS = 10
_FIRST_ITERATIONS = 20
# Where no draw of the tool's turn leads to a solution, arm and tool are moved together from so many starts of a kind.
_FEW, _TURNING_ITERATIONS = 20, 100
# Spacing of the solutions on a curve, and by how much it grows with each dimension beyond the second.
_SPACING_OF_CURVE, _WIDER = np.radians(6.0), 1.4
# A solution carried back that is this near to a kept one, in spacings, is not solved again.
_KNOWN = 0.5
# A displaced copy that is this near to a kept solution after so many steps is given up.
_LOOK, _BESIDE = 2, 0.9


@dataclass(frozen=True)
class Sampling:
    """How densely the self-motion sets are sampled.

    Attributes
    ----------
    spacing : float
        Kept solutions differ by more than this in some velocity-scaled joint (rad).
    starts : int
        Random starts at the first and last pose of a block.
    fresh, fresh_where_empty : int
        Random starts at every pose; at one whose neighbour has no solution (where that is fewer, ``fresh`` of them).
    copies : float
        Displaced copies, as a share of the solutions carried over.
    most : int
        Solutions kept at a pose.
    """

    spacing: float = np.radians(20.0)
    starts: int = 200
    fresh: int = 4
    fresh_where_empty: int = 100
    copies: float = 0.3
    most: int = 1500

    @classmethod
    def of_dimension(cls, dimension: int) -> Sampling:
        """Return a sampling of sets of so many dimensions: the more there are, the farther apart.

        A curve is filled as densely as it takes for steps along it to be short; what a set of two dimensions is filled
        with is the measure for larger ones.
        """
        spacing = _SPACING_OF_CURVE if dimension <= 1 else cls.spacing * _WIDER ** (dimension - 2)
        return cls(spacing=spacing)

    def finer(self, factor: float) -> Sampling:
        """Return a sampling with about ``factor`` times as many solutions of a two-dimensional set."""
        return Sampling(
            spacing=self.spacing / np.sqrt(factor),
            starts=round(self.starts * factor),
            fresh=round(self.fresh * factor),
            fresh_where_empty=round(self.fresh_where_empty * factor),
            copies=self.copies,
            most=round(self.most * factor),
        )


@dataclass(frozen=True, eq=False)
class Layer:
    """The solutions of one pose.

    Attributes
    ----------
    q : (m, n) ndarray
    rho : (m, 3) ndarray
        The tool's relaxed parameters, see :class:`Relaxation`.
    """

    q: NDArray[np.float64]
    rho: NDArray[np.float64]


@kernel_helper
def is_apart(Q, k, m, q, scale, turn, spacing):
    """Return whether q differs from each of the first m solutions of layer k by more than the spacing."""
    for a in range(m):
        near = True
        for i in range(q.shape[0]):
            d = q[i] - Q[k, a, i]
            if turn[i] < np.inf:
                d -= turn[i] * round(d / turn[i])
            if abs(d) > spacing * scale[i]:
                near = False
                break
        if near:
            return False
    return True


@kernel_helper
def keep(Q, rho, count, k, q, parameters, scale, turn, spacing):
    """Add a solution to layer k if it is apart from all others."""
    if count[k] < Q.shape[1] and is_apart(Q, k, count[k], q, scale, turn, spacing):
        for i in range(q.shape[0]):
            Q[k, count[k], i] = q[i]
        for i in range(3):
            rho[k, count[k], i] = parameters[i]
        count[k] += 1


@kernel_helper
def flip_into(prismatic, lower, upper, sign, shift, q, flipped):
    """Write a flip of q, by whole turns within the limits, and return whether there is one."""
    for i in range(q.shape[0]):
        x = sign[i] * q[i] + shift[i]
        if not prismatic[i]:
            x += 2 * np.pi * round((0.5 * (lower[i] + upper[i]) - x) / (2 * np.pi))
        if x < lower[i] or x > upper[i]:
            return False
        flipped[i] = x
    return True


@kernel(void(c3, b1, c1, c1, c1, c1, f8, c1, c3, f8, f8, c3, c2, c3, c1, c2, c2, i8, i8, i8, i8, o3, o3, oi))
def carry_kernel(
    fixed, prismatic, lower, upper, scale, turn, length, largest, targets, spacing, copies, noise, pick, fresh, cone,
    sign, shift, few, first, last, direction, Q, rho, count,
):  # fmt: skip
    """Carry the solutions of layer ``first`` to layer ``last``, one layer at a time.

    noise (c, E, n + 3): displacements of copies; pick (c, E): which solution each copies, in [0, 1); fresh
    (c, F, n + 3): new starts; cone: half angle of the tilt, 1 where the spin is free; ``few`` of the new starts
    are used where the layer before has solutions, else all. sign, shift (f, n): flips, under which every solution
    is kept too.
    """
    n = Q.shape[2]
    flipped = np.empty(n)
    target, offset = np.empty((3, 4)), np.empty((3, 3))
    pose, JT, A, G = np.empty((4, 4)), np.empty((n, M)), np.empty((M, M)), np.empty((n, n))
    e, z, residual, g, errors = np.empty(M), np.empty(M), np.empty(M), np.empty(max(n, M)), np.empty(2)
    y, lo, hi, y_new, q, parameters = np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(3)
    state = np.empty(n, dtype=np.int64)
    k = first
    while True:
        previous = k - direction
        has_previous = k != first
        carried = count[previous] if has_previous else 0
        displaced = min(int(np.ceil(copies * carried)), noise.shape[1])
        new = min(few, fresh.shape[1]) if carried > 0 or (not has_previous and count[k] > 0) else fresh.shape[1]
        for c in range(carried + displaced + new):
            if count[k] >= Q.shape[1]:
                break
            if c < carried:
                for i in range(n):
                    q[i] = Q[previous, c, i]
                for i in range(3):
                    parameters[i] = rho[previous, c, i]
                # on its way back it would only find the solution that it came from, or one beside it; so would
                # another solution's flip
                if not is_apart(Q, k, count[k], q, scale, turn, _KNOWN * spacing):
                    continue
            elif c < carried + displaced:
                t = c - carried
                source = int(pick[k, t] * carried)
                for i in range(n):
                    q[i] = min(max(Q[previous, source, i] + scale[i] * noise[k, t, i], lower[i]), upper[i])
                for i in range(3):
                    parameters[i] = rho[previous, source, i] + noise[k, t, n + i]
            else:
                t = c - carried - displaced
                for i in range(n):
                    q[i] = fresh[k, t, i]
                for i in range(3):
                    parameters[i] = fresh[k, t, n + i]
            tilt = np.sqrt(parameters[0] ** 2 + parameters[1] ** 2)
            if tilt > cone[0]:
                parameters[0] *= 0.999999 * cone[0] / tilt
                parameters[1] *= 0.999999 * cone[0] / tilt
            if cone[1] == 0.0:
                parameters[2] = 0.0
            offset_of(parameters, offset)
            turned(targets[k], offset, target)
            # where a few steps lead, more of them hardly lead away from: most copies end beside what is there
            if (
                carried <= c < carried + displaced
                and not move_onto(
                    fixed, prismatic, lower, upper, scale, length, largest, target, SEARCH_POSE, SEARCH_POSE, _LOOK,
                    q, pose, JT, A, G, e, z, y, lo, hi, y_new, residual, g, state, errors,
                )
                and not is_apart(Q, k, count[k], q, scale, turn, _BESIDE * spacing)
            ):  # fmt: skip
                continue
            if not move_onto(
                fixed, prismatic, lower, upper, scale, length, largest, target, SEARCH_POSE, SEARCH_POSE,
                _ITERATIONS if c < carried + displaced else _FIRST_ITERATIONS,
                q, pose, JT, A, G, e, z, y, lo, hi, y_new, residual, g, state, errors,
            ):  # fmt: skip
                continue
            for i in range(n):
                if turn[i] < np.inf:
                    q[i] -= turn[i] * round(q[i] / turn[i])
            keep(Q, rho, count, k, q, parameters, scale, turn, spacing)
            for f in range(sign.shape[0]):
                if flip_into(prismatic, lower, upper, sign[f], shift[f], q, flipped):
                    keep(Q, rho, count, k, flipped, parameters, scale, turn, spacing)
        if k == last:
            return
        k += direction


def sample_block(
    chain: SerialChain,
    targets: NDArray[np.float64],
    *,
    rng: np.random.Generator,
    sampling: Sampling,
    relaxation: Relaxation,
    seeds: Layer | None = None,
) -> list[Layer]:
    """Return the solutions of each pose of a run.

    Parameters
    ----------
    chain : SerialChain
    targets : (c, 4, 4) ndarray
        Base frame.
    rng : numpy.random.Generator
    sampling : Sampling
    relaxation : Relaxation
    seeds : Layer, optional
        Solutions near the first pose, to be carried along with the others.

    Returns
    -------
    list of Layer
        One for each pose, empty where no solution was found.
    """
    c, n = len(targets), chain.n
    most = sampling.most
    Q, rho, count = np.empty((c, most, n)), np.zeros((c, most, 3)), np.zeros(c, dtype=np.int64)
    scale, largest = search_scale(chain), np.full(n, STEP_TRUST)
    cone = np.array([relaxation.inner, float(relaxation.spin)])
    displacement = np.concatenate([np.full(n, 0.75 * sampling.spacing), [0.5 * relaxation.tilt] * 2, [0.5]])
    many = max(1, int(np.ceil(sampling.copies * most)))
    turned = flips(chain)
    sign = np.array([flip.sign for flip in turned]).reshape(-1, n)
    shift = np.array([flip.shift for flip in turned]).reshape(-1, n)
    targets = np.ascontiguousarray(targets)

    def carry(first: int, last: int, starts: NDArray[np.float64], few: int) -> None:
        noise = rng.standard_normal((c, min(many, 400), n + 3)) * displacement
        carry_kernel(
            chain.fixed, chain.prismatic, chain.lower, chain.upper, scale, turn_of(chain), chain.characteristic_length,
            largest, targets, sampling.spacing, sampling.copies, noise, rng.random(noise.shape[:2]), starts, cone, sign,
            shift, few, first, last, 1 if last >= first else -1, Q, rho, count,
        )  # fmt: skip

    def drawn(number: int) -> NDArray[np.float64]:
        q = chain.random(rng, c * number)
        parameters = relaxation.random(rng, c * number)
        return np.concatenate([q, parameters], axis=1).reshape(c, number, n + 3)

    # the ends get many starts, and what their neighbours in the path bring; then there and back
    for end in (0, c - 1):
        starts = np.zeros((c, sampling.starts, n + 3))
        starts[end] = np.concatenate(
            [chain.random(rng, sampling.starts), relaxation.random(rng, sampling.starts)], axis=1
        )
        if end == 0 and seeds is not None and len(seeds.q):
            near = np.concatenate([seeds.q, seeds.rho], axis=1)[: sampling.starts]
            starts[0, : len(near)] = near
        carry(end, end, starts, sampling.starts)
        if c == 1:
            break
    if c > 1:
        starts = drawn(max(sampling.fresh, sampling.fresh_where_empty))
        carry(0, c - 1, starts, sampling.fresh)
        carry(c - 1, 0, starts[:, ::-1].copy(), 0)
    layers = [Layer(Q[k, : count[k]].copy(), rho[k, : count[k]].copy()) for k in range(c)]
    if relaxation.free:
        too_far, too_near = relaxed_excess(chain, targets, relaxation)
        for k in np.flatnonzero((count == 0) & (too_far <= 0) & (too_near <= 0)):
            layers[k] = _found_by_turning(chain, targets[k], layers, int(k), rng, sampling, relaxation)
    return layers


def _found_by_turning(
    chain: SerialChain,
    target: NDArray[np.float64],
    layers: list[Layer],
    k: int,
    rng: np.random.Generator,
    sampling: Sampling,
    relaxation: Relaxation,
) -> Layer:
    """Return solutions of a pose at which no drawn turn of the tool led to one: arm and tool are moved together.

    At the border of reach few turns lead to a solution, and no draw meets them.
    """
    cone = np.array([relaxation.inner, float(relaxation.spin)])
    starts = Layer(chain.random(rng, sampling.fresh_where_empty), relaxation.random(rng, sampling.fresh_where_empty))
    found_q: list[NDArray[np.float64]] = []
    found_rho: list[NDArray[np.float64]] = []
    for layer in (*layers[max(k - 1, 0) : k], *layers[k + 1 : k + 2], starts):
        for q, parameters in zip(layer.q[:_FEW].copy(), layer.rho[:_FEW].copy(), strict=True):
            end = relaxed_iterate_kernel(
                chain.fixed, chain.prismatic, chain.lower, chain.upper, velocity_scale(chain),
                chain.characteristic_length, np.full(chain.n, STEP_TRUST), target, cone, 1.0, SEARCH_POSE, SEARCH_POSE,
                _TURNING_ITERATIONS, q, parameters, np.empty(2),
            )  # fmt: skip
            if end == REACHED:
                q[chain.continuous] -= 2 * np.pi * np.round(q[chain.continuous] / (2 * np.pi))
                found_q.append(q)
                found_rho.append(parameters)
    return Layer(np.array(found_q).reshape(-1, chain.n), np.array(found_rho).reshape(-1, 3))
