"""Many poses at once, compiled, on all cores: restarts of one pose, or samples for many."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from qparm.arrays import real_array
from qparm.compiled.kernels import b1, c1, c3, f8, i8, kernel, o3, void
from qparm.compiled.threads import in_threads
from qparm.errors import InvalidInput
from qparm.ik.iterate import NOT_CONVERGED, REACHED, iterate_kernel
from qparm.ik.solve import PoseStatus, active_limits
from qparm.ik.step import METHODS, Method, finite_gain, is_positive, reference_configuration, trust_region
from qparm.robot import check_poses
from qparm.robot.chain import LARGEST
from qparm.robot.reach import is_out_of_reach

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from qparm.robot import SerialChain

__all__ = ["PoseBatch", "solve_poses"]

# Targets a thread takes at a time: enough to forget the cost of handing them over.
_CHUNK = 16


@dataclass(frozen=True, eq=False)
class PoseBatch:
    """Configurations for many poses.

    With ``every_start`` the arrays have one more axis, the starts: (N, K, ...).

    Attributes
    ----------
    chain : SerialChain
    targets : (N, 4, 4) ndarray
    q : (N, n) ndarray
        The configuration that reached the pose, else the one that came nearest.
    end : (N,) ndarray of int
        How the iteration ended: 0 reached, 1 stalled, 2 not converged.
    position_error, rotation_error : (N,) ndarray
        m, rad.
    iterations : (N,) ndarray of int
        Over all starts used.
    starts : (N,) ndarray of int
        Starts used.
    """

    chain: SerialChain
    targets: NDArray[np.float64]
    q: NDArray[np.float64]
    end: NDArray[np.int64]
    position_error: NDArray[np.float64]
    rotation_error: NDArray[np.float64]
    iterations: NDArray[np.int64]
    starts: NDArray[np.int64]

    @property
    def reached(self) -> NDArray[np.bool_]:
        """Which poses are reached: within both tolerances and within the limits."""
        return self.end == REACHED

    @cached_property
    def status(self) -> NDArray[np.object_]:
        """The verdicts as :class:`PoseStatus`, of the shape of ``end``."""
        status = np.empty(self.end.shape, dtype=object)
        status.fill(PoseStatus.REACHED)  # np.full would turn the members into plain strings
        for index in np.argwhere(~self.reached):
            at = tuple(index)
            if is_out_of_reach(self.chain, self.targets[at[0]]):
                status[at] = PoseStatus.UNREACHABLE
            elif self.end[at] == NOT_CONVERGED:
                status[at] = PoseStatus.NOT_CONVERGED
            else:
                status[at] = PoseStatus.AT_LIMITS if active_limits(self.chain, self.q[at]) else PoseStatus.STUCK
        return status


@kernel(
    void(
        c3, b1, c1, c1, c1, f8, c1, c3, c3, i8, c1, f8, f8, f8, i8, i8, i8, i8, o3, o3, o3,
    )
)  # fmt: skip
def solve_batch_kernel(
    fixed, prismatic, lower, upper, scale, length, largest, targets, starts, method, reference, gain,
    position_tolerance, rotation_tolerance, max_iterations, every_start, first, last, q_out, errors_out, counts_out,
):  # fmt: skip
    """Solve targets ``first`` to ``last``, each from its own starts in turn.

    ``counts_out[..., :] = (end, iterations, starts used)``. Without ``every_start`` a target stops at the first
    start that reaches it, and only slot 0 is written: with the best of them.
    """
    n = starts.shape[2]
    q, errors = np.empty(n), np.empty(2)
    counts, trace = np.empty(4, dtype=np.int64), np.empty((0, n))
    for k in range(first, last):
        best = math.inf
        iterations = 0
        for s in range(starts.shape[1]):
            for i in range(n):
                q[i] = starts[k, s, i]
            counts[:] = 0
            end = iterate_kernel(
                fixed, prismatic, lower, upper, scale, length, largest, targets[k], method, reference, gain,
                position_tolerance, rotation_tolerance, max_iterations, q, errors, counts, trace,
            )  # fmt: skip
            iterations += counts[0]
            slot = s if every_start else 0
            distance = math.sqrt((errors[0] / length) ** 2 + errors[1] ** 2)
            if end == REACHED:
                distance = -1.0
            if every_start or s == 0 or distance < best:
                best = distance
                for i in range(n):
                    q_out[k, slot, i] = q[i]
                errors_out[k, slot, 0], errors_out[k, slot, 1] = errors[0], errors[1]
                counts_out[k, slot, 0] = end
            counts_out[k, slot, 1] = counts[0] if every_start else iterations
            counts_out[k, slot, 2] = 1 if every_start else s + 1
            if end == REACHED and not every_start:
                break


def solve_poses(
    chain: SerialChain,
    targets: ArrayLike,
    starts: ArrayLike | None = None,
    *,
    method: Method = "dls",
    restarts: int = 20,
    rng: np.random.Generator | None = None,
    every_start: bool = False,
    position_tolerance: float = 1e-9,
    rotation_tolerance: float = 1e-9,
    max_iterations: int = 200,
    reference: ArrayLike | None = None,
    gain: float = 0.1,
    threads: int | None = None,
) -> PoseBatch:
    """Search configurations for many poses, compiled, on all cores.

    The starts are drawn before anything is solved, so the answer does not depend on the number of threads.

    Parameters
    ----------
    chain : SerialChain
    targets : (N, 4, 4) array_like
        Poses of the tool in the base frame.
    starts : (N, n) or (N, K, n) array_like, optional
        First starts of each pose; random ones follow.
    method : {"dls", "wln", "cwln", "gpm"}
    restarts : int
        Random starts of each pose, besides ``starts``.
    rng : numpy.random.Generator, optional
        Where they are drawn from; required if ``restarts > 0``.
    every_start : bool
        Solve from every start and keep every answer (samples of the self-motion set), instead of stopping at the
        first that reaches the pose.
    position_tolerance, rotation_tolerance : float
        m and rad.
    max_iterations : int
        Per start.
    reference, gain
        For ``method="gpm"``, see :func:`qparm.ik.step_problem`.
    threads : int, optional
        All cores by default.

    Returns
    -------
    PoseBatch

    Raises
    ------
    InvalidInput
        If a shape does not fit, a value is not finite, or there is no start.

    Examples
    --------
    >>> poses = plan.tool_path.poses  # doctest: +SKIP
    >>> batch = qparm.solve_poses(chain, poses, rng=np.random.default_rng(0))  # doctest: +SKIP
    >>> batch.reached.all()  # doctest: +SKIP
    True
    """
    targets = check_poses(targets, what="target")
    if targets.ndim != 3:
        raise InvalidInput(f"targets must be (N, 4, 4), not {targets.shape}")
    if not (isinstance(method, str) and method in METHODS):
        raise InvalidInput(f"method must be one of {', '.join(METHODS)}, not {method!r}")
    for name, value in (("position_tolerance", position_tolerance), ("rotation_tolerance", rotation_tolerance)):
        if not is_positive(value):
            raise InvalidInput(f"{name} must be finite and positive, not {value}")
    if not all(isinstance(x, (int, np.integer)) for x in (max_iterations, restarts, threads or 1)):
        raise InvalidInput("max_iterations, restarts and threads must be whole numbers")
    if max_iterations < 1 or restarts < 0 or (threads is not None and threads < 1):
        raise InvalidInput("max_iterations and threads must be at least 1, restarts not negative")
    all_starts = _starts(chain, len(targets), starts, restarts, rng)
    N, K, n = all_starts.shape
    slots = K if every_start else 1
    q = np.empty((N, slots, n))
    errors, counts = np.empty((N, slots, 2)), np.zeros((N, slots, 3))
    reference_q, largest = reference_configuration(chain, reference), trust_region(chain)

    def solve(first: int, last: int) -> None:
        solve_batch_kernel(
            chain.fixed, chain.prismatic, chain.lower, chain.upper, chain.scale, chain.characteristic_length,
            largest, targets, all_starts, METHODS[method], reference_q, finite_gain(gain), position_tolerance,
            rotation_tolerance, max_iterations, int(every_start), first, last, q, errors, counts,
        )  # fmt: skip

    in_threads(solve, N, _CHUNK, threads)
    whole = counts.astype(np.int64)
    pick = slice(None) if every_start else 0
    return PoseBatch(
        chain=chain,
        targets=targets,
        q=q[:, pick],
        end=whole[:, pick, 0],
        position_error=errors[:, pick, 0],
        rotation_error=errors[:, pick, 1],
        iterations=whole[:, pick, 1],
        starts=whole[:, pick, 2],
    )


def _starts(
    chain: SerialChain, N: int, starts: ArrayLike | None, restarts: int, rng: np.random.Generator | None
) -> NDArray[np.float64]:
    """Return all starts, (N, K, n): the caller's, then random ones."""
    n = chain.n
    if starts is None:
        given = np.empty((N, 0, n))
    else:
        given = real_array(starts, what="starts")
        if given.ndim == 2:
            given = given[:, None, :]
        if given.ndim != 3 or given.shape[0] != N or given.shape[2] != n:
            raise InvalidInput(f"starts must be ({N}, {n}) or ({N}, K, {n}), not {np.shape(starts)}")
        usable = np.abs(given) <= LARGEST
        if not usable.all():
            k, start, i = (int(index) for index in np.argwhere(~usable)[0])
            value = given[k, start, i]
            what = f"beyond {LARGEST:.0e}" if np.isfinite(value) else "not finite"
            raise InvalidInput(f"start {start} of pose {k}, joint {chain.names[i]!r}: {value} is {what}")
    if restarts and not isinstance(rng, np.random.Generator):
        raise InvalidInput("restarts need rng, a seeded numpy.random.Generator: the same seed gives the same answer")
    if given.shape[1] + restarts == 0:
        raise InvalidInput("there is no start: give starts or restarts")
    if rng is None:
        return np.ascontiguousarray(given)
    drawn = chain.random(rng, N * restarts).reshape(N, restarts, n)
    return np.ascontiguousarray(np.concatenate([given, drawn], axis=1))
