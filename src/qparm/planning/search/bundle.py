"""A bundle of ways along a row: the arm follows the tool path from one configuration, in many ways at once.

At every place each way is moved on to the nearest configuration and to displaced ones beside it, a tool that may spin
or tilt turning with it. What is within a small step of where it came from is kept, as many as the bundle holds: those
with the most reserve to limits, and others at random. A way that would have to step too far is moved on in as many
smaller steps as it takes. The bundle ends where none of them gets any farther. That is a search, no proof.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from qparm.ik.iterate import REACHED
from qparm.ik.relaxed import relaxed_iterate_kernel
from qparm.path.relaxation import Relaxation
from qparm.planning.search.continuity import LARGE_STEP
from qparm.planning.search.projection import project, search_scale, velocity_scale
from qparm.planning.search.sampling import Layer
from qparm.planning.tolerances import STEP_TRUST

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.robot import SerialChain

__all__ = ["Bundle", "follow_bundle", "nearest_way", "selected"]

_TOLERANCE = 1e-9
_ITERATIONS = 25
# The tool turns for nothing beside the joints: what is asked is how little they must move.
_EASE = 10.0
# Each way is moved on to so many configurations displaced by so much (scaled rad, and rad of the tool); two that are
# nearer than this to each other are one.
_BESIDE, _WIDTH, _APART = 4, 0.15, 0.05
# The way to the next place is one step; where that is too large it is halved, as often as this.
_DEPTH = 8


@dataclass(frozen=True, eq=False)
class Bundle:
    """How far the ways of a bundle got.

    Attributes
    ----------
    layers : tuple of Layer
        The ways at each place that some reached, in the order of travel; the first are the starts.
    parents : tuple of (m,) ndarray of int
        Which way of the layer before each comes from; -1 for the starts.
    arrived : bool
        Whether some reached the last place.
    """

    layers: tuple[Layer, ...]
    parents: tuple[NDArray[np.int64], ...]
    arrived: bool

    def way(self, end: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the way (k, n) to one of the last layer's ends, and how the tool stands on it (k, 3)."""
        q, rho, j = [], [], end
        for layer, parent in zip(reversed(self.layers), reversed(self.parents), strict=True):
            q.append(layer.q[j])
            rho.append(layer.rho[j])
            j = int(parent[j])
        return np.array(q[::-1]), np.array(rho[::-1])


def follow_bundle(
    chain: SerialChain,
    poses: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    s: NDArray[np.float64],
    starts: Layer,
    *,
    relaxation: Relaxation,
    rng: np.random.Generator,
    width: int = 32,
) -> Bundle:
    """Follow a row from some configurations as far as that goes.

    Parameters
    ----------
    chain : SerialChain
    poses : callable
        ``poses(s)`` gives (k, 4, 4) poses at places s, base frame.
    s : (k,) ndarray
        Places in the order of travel, ascending or descending; the starts are at the first (m).
    starts : Layer
    relaxation : Relaxation
    rng : numpy.random.Generator
    width : int
        Ways kept at a place.
    """
    kept = selected(chain, starts, width, rng)
    layers, parents = [Layer(starts.q[kept], starts.rho[kept])], [np.full(len(kept), -1, dtype=np.int64)]
    for k in range(1, len(s)):
        found, parent = _moved_on(chain, poses, (float(s[k - 1]), float(s[k])), layers[-1], relaxation, rng)
        kept = selected(chain, found, width, rng)
        if not len(kept):
            break
        layers.append(Layer(found.q[kept], found.rho[kept]))
        parents.append(parent[kept])
    return Bundle(tuple(layers), tuple(parents), len(layers) == len(s))


def selected(chain: SerialChain, layer: Layer, most: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """Return which solutions to go on with: half by their reserve to limits, half at random, none near another."""
    kept: list[int] = []
    apart = search_scale(chain) * _APART
    reserve = np.argsort(-chain.distance_to_limits(layer.q), kind="stable") if len(layer.q) else np.empty(0, int)
    for order, room in ((reserve, most // 2), (rng.permutation(len(layer.q)), most)):
        for k in order:
            if len(kept) == room:
                break
            if (np.abs(layer.q[kept] - layer.q[k]) > apart).any(axis=1).all():
                kept.append(int(k))
    return np.array(kept, dtype=np.int64)


def _moved_on(
    chain: SerialChain,
    poses: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    gap: tuple[float, float],
    ways: Layer,
    relaxation: Relaxation,
    rng: np.random.Generator,
) -> tuple[Layer, NDArray[np.int64]]:
    """Return what the ways become at the next place, and which of them each comes from."""
    scale, (m, n) = search_scale(chain), ways.q.shape
    pose = poses(np.array([gap[1]]))[0]
    moved, alive = _in_steps(chain, poses, gap, ways, relaxation, _DEPTH)
    which = np.flatnonzero(alive)
    q, rho, parent = [moved[which]], [ways.rho[which]], [which]
    for k in range(m) if relaxation.free else ():
        turned = nearest_way(chain, pose, ways.q[k], ways.rho[k], relaxation)
        if turned is not None and (np.abs(turned[0] - ways.q[k]) <= LARGE_STEP * scale).all():
            q.append(turned[0][None])
            rho.append(turned[1][None])
            parent.append(np.array([k]))
    arrived, leans, of = np.concatenate(q), np.concatenate(rho), np.concatenate(parent)
    # from where they arrived, some go a little way along the self-motion set
    tries = arrived[:, None] + rng.standard_normal((len(of), _BESIDE, n)) * scale * _WIDTH
    leaning = relaxation.clipped(leans[:, None] + rng.standard_normal((len(of), _BESIDE, 3)) * _WIDTH)
    moved, there = _onto(chain, pose, tries, leaning, relaxation)
    there &= (np.abs(moved - arrived[:, None]) <= LARGE_STEP * scale).all(axis=2)
    beside = np.broadcast_to(of[:, None], there.shape)[there]
    return (
        Layer(np.concatenate([arrived, moved[there]]), np.concatenate([leans, leaning[there]])),
        np.concatenate([of, beside]),
    )


def _in_steps(
    chain: SerialChain,
    poses: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    gap: tuple[float, float],
    ways: Layer,
    relaxation: Relaxation,
    depth: int,
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return where ways come over a gap in small steps, (m, n), and which of them do; others stay where they are."""
    pose = poses(np.array([gap[1]]))[0]
    moved, there = _onto(chain, pose, ways.q[:, None], ways.rho[:, None], relaxation)
    q, alive = moved[:, 0], there[:, 0]
    alive &= (np.abs(q - ways.q) <= LARGE_STEP * search_scale(chain)).all(axis=1)
    left = np.flatnonzero(~alive)
    q[left] = ways.q[left]
    if depth and len(left):
        middle = 0.5 * (gap[0] + gap[1])
        half, on = _in_steps(chain, poses, (gap[0], middle), Layer(q[left], ways.rho[left]), relaxation, depth - 1)
        left, half = left[on], half[on]
        if len(left):
            whole, on = _in_steps(chain, poses, (middle, gap[1]), Layer(half, ways.rho[left]), relaxation, depth - 1)
            q[left[on]], alive[left[on]] = whole[on], True
    return q, alive


def _onto(
    chain: SerialChain,
    pose: NDArray[np.float64],
    starts: NDArray[np.float64],
    leans: NDArray[np.float64],
    relaxation: Relaxation,
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return starts (m, M, n) moved onto a pose, and which of them arrived."""
    return project(
        chain, np.broadcast_to(pose, (len(starts), 4, 4)), np.clip(starts, chain.lower, chain.upper),
        position_tolerance=_TOLERANCE, rotation_tolerance=_TOLERANCE, iterations=_ITERATIONS, threads=1,
        offsets=relaxation.rotations(leans.reshape(-1, 3)) if relaxation.free else None,
    )  # fmt: skip


def nearest_way(
    chain: SerialChain,
    pose: NDArray[np.float64],
    q: NDArray[np.float64],
    rho: NDArray[np.float64],
    relaxation: Relaxation,
) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Return the nearest configuration of a pose, the tool turning as it may, and how it stands, if there is one."""
    if not relaxation.free:
        moved, there = _onto(chain, pose, q[None, None], rho[None, None], relaxation)
        return (moved[0, 0], rho) if there[0, 0] else None
    q, rho, cone = np.clip(q, chain.lower, chain.upper), rho.copy(), np.array([relaxation.tilt, float(relaxation.spin)])
    end = relaxed_iterate_kernel(
        chain.fixed, chain.prismatic, chain.lower, chain.upper, velocity_scale(chain), chain.characteristic_length,
        np.full(chain.n, STEP_TRUST), pose, cone, _EASE, _TOLERANCE, _TOLERANCE, _ITERATIONS, q, rho, np.empty(2),
    )  # fmt: skip
    return (q, rho) if end == REACHED else None
