"""Reach of many arms: for the design of an arm, thousands of designs times hundreds of poses.

One design at a time, in three stages, each more expensive than the one before:

1. *Proof*: a pose beyond the greatest reach of the links, or nearer than they fold, is out
   (:mod:`qparm.robot.reach`); no search.
2. *Region growing*: from a configuration found for one pose, its nearest poses are tried, from theirs the next.
   A neighbour is a few damped least-norm steps away.
3. *Restarts* for the poses left over, in rounds: each gets the next of its starts, the nearest of a bank of random
   configurations by the distance of their tool poses; what is found grows again.

A tool that may spin or tilt is searched for together with the arm (:mod:`qparm.ik.relaxed`), and what is left over
then with the tool as it is drawn, so that no freedom ever costs a pose.

A pose counts as not reached when its neighbours' configurations and all its starts have failed: that is a search,
no proof. The bank is drawn from the seed alone and every design is treated by itself, so a verdict depends neither on
the other designs of a call nor on the number of threads.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from qparm.compiled.kernels import b1, c1, c2, c3, ci2, f8, i8, kernel, kernel_helper, o2, oi, void
from qparm.compiled.threads import in_threads
from qparm.errors import InvalidInput
from qparm.ik.iterate import REACHED, iterate_kernel
from qparm.ik.relaxed import nearest_parameters, relaxed_iterate_kernel
from qparm.ik.step import METHODS, is_positive, trust_region
from qparm.path.relaxation import EXACT, Relaxation
from qparm.reach.relaxed_bound import relaxed_excess
from qparm.reach.starts import BANK, nearest_of_bank, nearest_of_relaxed_bank, nearest_poses
from qparm.robot import SerialChain, check_poses
from qparm.robot.kernels import forward_and_axes

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

__all__ = ["DesignReach", "reach_of_designs"]

_DLS = METHODS["dls"]
# Iterations from a neighbour's configuration, and from a start of the bank.
_STEPS_FROM_NEIGHBOUR = 40
_STEPS_FROM_START = 100

_UNKNOWN, _REACHED, _PROVED = 0, 1, 2


@dataclass(frozen=True, eq=False)
class DesignReach:
    """What D designs reach of P poses.

    Attributes
    ----------
    reached : (D, P) ndarray of bool
        A configuration within the limits was found, to the tolerances.
    too_far : (D, P) ndarray
        How far (m) the wrist lies beyond the greatest reach of the links, 0 where it does not: a proof. Of a tool that
        may spin or tilt: however it is turned.
    too_near : (D, P) ndarray
        How far (m) it lies within the least reach, 0 where it does not: a proof.
    restarts : int
        How many starts a pose that is neither reached nor proved had, besides its neighbours' configurations.
    q : (D, P, n) ndarray or None
        The configurations found, NaN where there is none; if they were asked for. Those of a tool that may spin or
        tilt tell by their own pose how it is turned.
    """

    reached: NDArray[np.bool_]
    too_far: NDArray[np.float64]
    too_near: NDArray[np.float64]
    restarts: int
    q: NDArray[np.float64] | None = field(default=None, repr=False)

    @property
    def proved(self) -> NDArray[np.bool_]:
        """Which poses are out of reach beyond doubt, (D, P)."""
        return (self.too_far > 0) | (self.too_near > 0)

    @property
    def missed(self) -> NDArray[np.intp]:
        """How many poses each design does not reach, (D,)."""
        return (~self.reached).sum(axis=1)


@kernel_helper
def _seek(
    fixed, prismatic, lower, upper, scale, length, largest, target, cone, position_tolerance, rotation_tolerance,
    steps, q, rho, errors, counts, trace,
):  # fmt: skip
    """Iterate q, and rho where the tool is free, towards a target; return whether it is reached."""
    if cone[0] > 0.0 or cone[1] > 0.0:
        end = relaxed_iterate_kernel(
            fixed, prismatic, lower, upper, scale, length, largest, target, cone, 1.0, position_tolerance,
            rotation_tolerance, steps, q, rho, errors,
        )  # fmt: skip
    else:
        end = iterate_kernel(
            fixed, prismatic, lower, upper, scale, length, largest, target, _DLS, q, 0.0, position_tolerance,
            rotation_tolerance, steps, q, errors, counts, trace,
        )  # fmt: skip
    return end == REACHED


@kernel(void(c3, b1, c1, c1, c1, f8, c1, c3, c1, ci2, c2, i8, f8, f8, i8, i8, oi, o2))
def reach_kernel(
    fixed, prismatic, lower, upper, scale, length, largest, targets, cone, neighbours, bank, restarts,
    position_tolerance, rotation_tolerance, steps_from_neighbour, steps_from_start, state, Q,
):  # fmt: skip
    """Grow ``state`` from unknown to reached, and write the configurations into ``Q`` (P, n).

    cone : half angle of the tool's tilt (rad), and 1 where its spin is free.
    """
    P, n, B = targets.shape[0], fixed.shape[0] - 1, bank.shape[0]
    q, errors, counts, trace = np.empty(n), np.empty(2), np.zeros(4, dtype=np.int64), np.empty((0, n))
    rho, lean, free = np.zeros(3), np.zeros((P, 3)), cone[0] > 0.0 or cone[1] > 0.0
    queue = np.empty(P, dtype=np.int64)
    starts = np.full((P, restarts), -1, dtype=np.int64)
    bank_poses, JT, distance = np.empty((B, 4, 4)), np.empty((n, 6)), np.empty(B)
    for b in range(B):
        forward_and_axes(fixed, prismatic, bank[b], bank_poses[b], JT)
    for attempt in range(restarts):
        left = 0
        for k in range(P):
            if state[k] != _UNKNOWN:
                continue
            if starts[k, 0] < 0:
                if free:
                    nearest_of_relaxed_bank(targets[k], bank_poses, cone, length, distance, starts[k])
                else:
                    nearest_of_bank(targets[k], bank_poses, length, distance, starts[k])
            for i in range(n):
                q[i] = bank[starts[k, attempt], i]
            if free:
                nearest_parameters(targets[k], bank_poses[starts[k, attempt]], cone, rho)
            if not _seek(
                fixed, prismatic, lower, upper, scale, length, largest, targets[k], cone, position_tolerance,
                rotation_tolerance, steps_from_start, q, rho, errors, counts, trace,
            ):  # fmt: skip
                left += 1
                continue
            state[k] = _REACHED
            for i in range(n):
                Q[k, i] = q[i]
            for i in range(3):
                lean[k, i] = rho[i]
            queue[0], head, tail = k, 0, 1
            while head < tail:
                at = queue[head]
                head += 1
                for j in range(neighbours.shape[1]):
                    to = neighbours[at, j]
                    if state[to] != _UNKNOWN:
                        continue
                    for i in range(n):
                        q[i] = Q[at, i]
                    for i in range(3):
                        rho[i] = lean[at, i]
                    if not _seek(
                        fixed, prismatic, lower, upper, scale, length, largest, targets[to], cone, position_tolerance,
                        rotation_tolerance, steps_from_neighbour, q, rho, errors, counts, trace,
                    ):  # fmt: skip
                        continue
                    state[to] = _REACHED
                    for i in range(n):
                        Q[to, i] = q[i]
                    for i in range(3):
                        lean[to, i] = rho[i]
                    queue[tail] = to
                    tail += 1
        if left == 0:
            break


def reach_of_designs(
    chains: Sequence[SerialChain],
    poses: ArrayLike,
    *,
    relaxation: Relaxation = EXACT,
    position_tolerance: float = 1e-6,
    rotation_tolerance: float = 1e-5,
    restarts: int = 20,
    seed: int = 0,
    keep_q: bool = False,
    threads: int | None = None,
) -> DesignReach:
    """Return which poses each of many arms reaches.

    Parameters
    ----------
    chains : sequence of D SerialChain
    poses : (P, 4, 4) or (D, P, 4, 4) array_like
        Poses of the tool in the base frame, the same for all designs or each its own.
    relaxation : Relaxation
        Which rotations of the tool are free: a pose is reached if it is with the tool turned in some way.
    position_tolerance, rotation_tolerance : float
        m and rad.
    restarts : int
        Starts that a pose gets before it counts as not reached, besides its neighbours' configurations.
    seed : int
        Of the random configurations that the starts are taken from.
    keep_q : bool
        Keep the configurations (all chains must then have the same number of joints).
    threads : int, optional
        All cores by default; the answer does not depend on it.

    Returns
    -------
    DesignReach

    Raises
    ------
    InvalidInput
        If a shape does not fit or a value is not finite.

    Examples
    --------
    >>> found = reach_of_designs([chain], plan.tool_path.poses)  # doctest: +SKIP
    >>> found.missed  # doctest: +SKIP
    array([0])
    """
    chains = list(chains)
    poses = check_poses(poses)
    D = len(chains)
    if poses.ndim not in (3, 4) or (poses.ndim == 4 and len(poses) != D):
        raise InvalidInput(f"poses must be (P, 4, 4) or ({D}, P, 4, 4), not {poses.shape}")
    for name, value in (("position_tolerance", position_tolerance), ("rotation_tolerance", rotation_tolerance)):
        if not is_positive(value):
            raise InvalidInput(f"{name} must be finite and positive, not {value}")
    for name, value, least in (
        ("restarts", restarts, 1),
        ("seed", seed, 0),
        ("threads", 1 if threads is None else threads, 1),
    ):
        if not isinstance(value, (int, np.integer)) or not least <= value:
            raise InvalidInput(f"{name} must be a whole number from {least}, not {value!r}")
    if restarts > BANK:
        raise InvalidInput(f"restarts must be at most {BANK}, not {restarts}")
    P = poses.shape[-3]
    n = chains[0].n if chains else 0
    for d, chain in enumerate(chains):
        if keep_q and chain.n != n:
            raise InvalidInput(f"keep_q needs chains of as many joints: chain 0 has {n}, chain {d} has {chain.n}")
    reached = np.zeros((D, P), dtype=bool)
    too_far, too_near = np.zeros((D, P)), np.zeros((D, P))
    kept = np.full((D, P, n), np.nan) if keep_q else None
    shared = nearest_poses(poses, chains[0].characteristic_length) if chains and poses.ndim == 3 else None

    def search(
        d: int, targets: NDArray[np.float64], neighbours: NDArray[np.int64], allowed: Relaxation
    ) -> tuple[NDArray[np.bool_], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        chain = chains[d]
        far, near = relaxed_excess(chain, targets, allowed)
        state = np.where((far > 0) | (near > 0), _PROVED, _UNKNOWN)
        Q = np.full((P, chain.n), np.nan)
        bank = chain.random(np.random.default_rng([seed, chain.n]), BANK)
        reach_kernel(
            chain.fixed, chain.prismatic, chain.lower, chain.upper, chain.scale, chain.characteristic_length,
            trust_region(chain), targets, np.array([allowed.tilt, float(allowed.spin)]), neighbours, bank, restarts,
            position_tolerance, rotation_tolerance, _STEPS_FROM_NEIGHBOUR, _STEPS_FROM_START, state, Q,
        )  # fmt: skip
        return state == _REACHED, far, near, Q

    def solve(first: int, last: int) -> None:
        for d in range(first, last):
            targets = poses if poses.ndim == 3 else poses[d]
            neighbours = nearest_poses(targets, chains[d].characteristic_length) if shared is None else shared
            found, far, near, Q = search(d, targets, neighbours, relaxation)
            if relaxation.free and not found.all():
                fixed, _, _, Q_fixed = search(d, targets, neighbours, EXACT)
                Q[fixed & ~found] = Q_fixed[fixed & ~found]
                found |= fixed
            reached[d], too_far[d], too_near[d] = found, np.maximum(far, 0.0), np.maximum(near, 0.0)
            if kept is not None:
                kept[d] = Q

    in_threads(solve, D, 1, threads)
    return DesignReach(reached=reached, too_far=too_far, too_near=too_near, restarts=restarts, q=kept)
