"""Smoothing a whole joint path by convex subproblems: every pose stays exact, every limit holds.

    min  sum w_2 |D2 u|^2 + w_3 |D3 u|^2 (within runs) + w_1 |D1 u|^2 (between runs),     u = q / velocity scale
    s.t. J_k d_k = e_k,   lower <= q_k + d_k <= upper,   |d_k| <= trust,   |D1 (u + d)| <= step

The pose rows are eliminated, d_k = p_k + N_k z_k with N_k a basis of null(J_k), so that r = n - 6 unknowns a
waypoint remain (more where the task is relaxed) in a banded QP. After each subproblem every waypoint is
moved back onto its pose; the trust region shrinks where that undoes the gain.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from qparm.banded.qp import REACH, banded_qp_kernel
from qparm.path.relaxation import EXACT, Relaxation
from qparm.planning.search.projection import project, velocity_scale
from qparm.planning.smoothing.linearise import linearise_kernel
from qparm.planning.tolerances import EXACT_POSE, LIMIT_MARGIN

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.robot import SerialChain

__all__ = ["Smoothed", "mean_spacing", "roughness", "smooth", "smoothness"]

_WEIGHT_SECOND, _WEIGHT_THIRD = 1.0, 1.0
# Between runs the arm rests, so only the length of its way counts, and little; on turns between rows its bends, too.
_WEIGHT_BETWEEN = 3e-2
_WEIGHT_TURN = 1e-2
# Weight of a radian away from the nominal tool orientation, relative to a radian of second difference.
_WEIGHT_NOMINAL = 1e-5
_TRUST, _LARGEST_TRUST, _SMALLEST_TRUST = 0.2, 0.8, 1e-5
_QP_TOLERANCE, _QP_ITERATIONS = 1e-5, 80


@dataclass(frozen=True, eq=False)
class Smoothed:
    """A smoothed path and what it took.

    Attributes
    ----------
    q : (N, n) ndarray
    parameters : (N, 3) ndarray
        Where the relaxed tool stands: tilt about the path frame's x and y, spin about its z (rad).
    before, after : float
        The objective.
    iterations : int
        Subproblems solved.
    """

    q: NDArray[np.float64]
    parameters: NDArray[np.float64]
    before: float
    after: float
    iterations: int


def stencils(
    s: NDArray[np.float64],
    run: NDArray[np.int64],
    linked: NDArray[np.bool_],
    *,
    spacing: NDArray[np.float64] | None = None,
    turn: NDArray[np.bool_] | None = None,
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the differences that the objective squares: first waypoints (T,), coefficients (T, 4).

    Divided differences times the spacing to their order, so that even spacing gives plain differences; on turns, where
    waypoints are close in corners and far apart between, times their own mean distance.

    Parameters
    ----------
    s : (N,) ndarray
        Arc length within the run (m), ascending in it.
    run : (N,) ndarray of int
        Which run a waypoint belongs to.
    linked : (N - 1,) ndarray of bool
        Whether an edge between two runs is driven, rather than a reconfiguration.
    spacing : (N,) ndarray, optional
        Usual distance from each waypoint to the next (m); by default the run's mean.
    turn : (N,) ndarray of bool, optional
        Which waypoints lie on turns between rows; none by default.
    """
    turn = np.zeros(len(s), dtype=bool) if turn is None else turn
    firsts, rows = [], []
    edge = np.flatnonzero(((run[:-1] != run[1:]) & linked) | turn[:-1] | turn[1:])
    firsts.append(edge)
    rows.append(np.sqrt(_WEIGHT_BETWEEN) * np.tile([-1.0, 1.0, 0.0, 0.0], (len(edge), 1)))
    if spacing is None:
        spacing = mean_spacing(s, run)
    for order, weight in ((2, _WEIGHT_SECOND), (3, _WEIGHT_THIRD)):
        first = np.flatnonzero(run[:-order] == run[order:])
        if not len(first):
            continue
        at = s[first[:, None] + np.arange(order + 1)]
        coefficients = np.zeros((len(first), 4))
        for i in range(order + 1):
            others = [j for j in range(order + 1) if j != i]
            coefficients[:, i] = 1.0 / np.prod(at[:, i, None] - at[:, others], axis=1)
        factorial = 2.0 if order == 2 else 6.0
        on_turn = turn[first[:, None] + np.arange(order + 1)].any(axis=1)
        coefficients *= np.sqrt(np.where(on_turn, _WEIGHT_TURN, weight))[:, None]
        # corners have their waypoints close: times any other distance their bends, which the path asks for, are all
        gap = np.where(on_turn, (at[:, -1] - at[:, 0]) / order, spacing[first])
        coefficients *= factorial * gap[:, None] ** order
        firsts.append(first)
        rows.append(coefficients)
    return np.concatenate(firsts), np.concatenate(rows)


def mean_spacing(s: NDArray[np.float64], run: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return for each waypoint the mean distance between neighbours of its run, (N,), m; 1 where it has none."""
    ds, mean = np.diff(s), np.ones(int(run.max()) + 1)
    for index in np.unique(run):
        inside = ds[(run[:-1] == index) & (run[1:] == index)]
        if len(inside):
            mean[index] = inside.mean()
    return mean[run]


def _differences(first: NDArray[np.int64], rows: NDArray[np.float64], u: NDArray[np.float64]) -> NDArray[np.float64]:
    padded = np.concatenate([u, np.zeros((REACH, u.shape[1]))])
    return sum(rows[:, i, None] * padded[first + i] for i in range(REACH + 1))  # type: ignore[return-value]


def smoothness(chain: SerialChain, s: NDArray[np.float64], run: NDArray[np.int64], q: NDArray[np.float64]) -> float:
    """Return the objective of a path whose runs are not linked."""
    first, rows = stencils(s, run, np.zeros(len(q) - 1, dtype=bool))
    return float((_differences(first, rows, q / velocity_scale(chain)) ** 2).sum())


def roughness(x: NDArray[np.float64], usual: NDArray[np.float64]) -> float:
    """Return the sum of x^2 (1 + (x / 3 rms)^6) over second differences: peaks count.

    Parameters
    ----------
    x, usual : (T, n) ndarray
        Those in question, and those whose root mean square is taken for usual (rad).
    """
    mean = max(float((usual**2).mean()), 1e-24) if usual.size else 1.0
    return float((x**2 * (1.0 + (x**2 / (9.0 * mean)) ** 3)).sum())


def smooth(
    chain: SerialChain,
    poses: NDArray[np.float64],
    q: NDArray[np.float64],
    *,
    s: NDArray[np.float64],
    run: NDArray[np.int64],
    linked: NDArray[np.bool_],
    spacing: NDArray[np.float64] | None = None,
    turn: NDArray[np.bool_] | None = None,
    step: NDArray[np.float64],
    relaxation: Relaxation = EXACT,
    parameters: NDArray[np.float64] | None = None,
    iterations: int = 40,
    tolerance: float = 1e-4,
    threads: int | None = None,
) -> Smoothed:
    """Return the smoothest path near a given one, through the same poses.

    Parameters
    ----------
    chain : SerialChain
    poses : (N, 4, 4) ndarray
        Base frame.
    q : (N, n) ndarray
        Within the limits and on the poses (m, rad).
    s, run, linked, spacing, turn
        See :func:`stencils`.
    step : (N - 1, n) ndarray
        Largest joint steps on driven edges (m, rad); inf where there is none.
    relaxation : Relaxation
        Which rotations of the tool are free.
    parameters : (N, 3) ndarray, optional
        Where the relaxed tool stands at first.
    iterations : int
    tolerance : float
        The iteration ends when the objective falls by less than this share.
    threads : int, optional
        All cores by default.

    Returns
    -------
    Smoothed
        The given path where nothing better was found.
    """
    N, n = q.shape
    r = n - 6 + relaxation.freedom
    D = velocity_scale(chain)
    rho = np.zeros((N, 3)) if parameters is None else parameters.copy()
    first, rows = stencils(s, run, linked, spacing=spacing, turn=turn)
    free = list(relaxation.free)

    def objective(q: NDArray[np.float64], rho: NDArray[np.float64]) -> float:
        nominal = _WEIGHT_NOMINAL * (rho[:, free] ** 2).sum()
        return float((_differences(first, rows, q / D) ** 2).sum() + nominal)

    value = before = objective(q, rho)
    if r == 0 or N < 3 or not len(first):
        return Smoothed(q, rho, before, before, 0)
    couplings = _couplings(N, first, rows)
    trust, count, model = _TRUST, 0, None
    z = np.zeros(N * r)
    for count in range(1, iterations + 1):  # noqa: B007
        if model is None:
            model = _Subproblem(chain, poses, q, rho, relaxation, D, couplings, step)
        z[:] = 0.0
        d, d_rho = model.solve(trust, z)
        # the subproblem holds the cone to its own tolerance only
        rho_new = relaxation.clipped(rho + d_rho)
        q_new, there = project(
            chain, relaxation.targets(poses, rho_new), np.clip(q + D * d, chain.lower, chain.upper),
            position_tolerance=EXACT_POSE, rotation_tolerance=EXACT_POSE, threads=threads,
        )  # fmt: skip
        kept = there.all() and bool((np.abs(np.diff(q_new, axis=0)) <= step + 1e-9 + np.maximum(
            np.abs(np.diff(q, axis=0)) - step, 0.0)).all())  # fmt: skip
        value_new = objective(q_new, rho_new) if there.all() else np.inf
        if not kept or value_new >= value:
            trust *= 0.25
            if trust < _SMALLEST_TRUST:
                break
            continue
        gain = (value - value_new) / value
        q, rho, value, model = q_new, rho_new, value_new, None
        trust = min(trust * 1.7, _LARGEST_TRUST)
        if gain < tolerance:
            break
    return Smoothed(q, rho, before, value, count)


def _couplings(N: int, first: NDArray[np.int64], rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return K (4, N): the objective's Hessian holds K[o, k] times the identity between waypoints k and k + o."""
    K = np.zeros((REACH + 1, N + REACH))
    for i in range(REACH + 1):
        for j in range(i, REACH + 1):
            np.add.at(K[j - i], first + i, 2.0 * rows[:, i] * rows[:, j])
    return np.ascontiguousarray(K[:, :N])


class _Subproblem:
    """The path linearised about one iterate: all of it but the trust region."""

    def __init__(
        self,
        chain: SerialChain,
        poses: NDArray[np.float64],
        q: NDArray[np.float64],
        rho: NDArray[np.float64],
        relaxation: Relaxation,
        D: NDArray[np.float64],
        K: NDArray[np.float64],
        step: NDArray[np.float64],
    ) -> None:
        N, n = q.shape
        self._shape, self._free = (N, n), list(relaxation.free)
        task, error, relaxed = relaxation.rows(chain, poses, q, rho, D)
        r = n - task.shape[1]
        self._p, self._N = np.empty((N, n)), np.empty((N, n, r))
        self._H, self._g = np.empty((N, REACH + 1, r, r)), np.empty((N, r))
        self._relaxed = relaxed
        linearise_kernel(
            np.ascontiguousarray(task), np.ascontiguousarray(error), K, q / D, np.ascontiguousarray(relaxed),
            np.ascontiguousarray(rho[:, self._free]), _WEIGHT_NOMINAL, self._p, self._N, self._H, self._g,
        )  # fmt: skip
        self._lower = (chain.lower - q) / D + LIMIT_MARGIN - self._p
        self._upper = (chain.upper - q) / D - LIMIT_MARGIN - self._p
        now_step = np.diff(q / D + self._p, axis=0)
        limit = np.maximum(step / D, np.abs(np.diff(q / D, axis=0)))
        self._slo, self._shi = -limit - now_step, limit - now_step
        self._cone = relaxation.cone(rho, relaxed, self._N, self._p)

    def solve(self, trust: float, z: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the step of the scaled joints (N, n) and of the tool's parameters (N, 3)."""
        N = self._shape[0]
        lo = np.minimum(np.maximum(self._lower, -trust - self._p), 0.0)
        hi = np.maximum(np.minimum(self._upper, trust - self._p), 0.0)
        C, slo, shi = self._N, self._slo, self._shi
        if self._cone is not None:
            rows, cone_lo, cone_hi = self._cone
            C = np.ascontiguousarray(np.concatenate([C, rows], axis=1))
            lo, hi = np.hstack([lo, np.minimum(cone_lo, 0.0)]), np.hstack([hi, np.maximum(cone_hi, 0.0)])
            open_end = np.full((N - 1, rows.shape[1]), np.inf)
            slo, shi = np.hstack([slo, -open_end]), np.hstack([shi, open_end])
        quality = np.zeros(3)
        count = banded_qp_kernel(self._H, self._g, C, lo, hi, slo, shi, _QP_TOLERANCE, _QP_ITERATIONS, z, quality)
        if count < 0 and not np.isfinite(z).all():
            z[:] = 0.0  # no step: the trust region shrinks
        r = self._N.shape[2]
        d = self._p + np.einsum("kia,ka->ki", self._N, z.reshape(N, r))
        d_rho = np.zeros((N, 3))
        if self._free:
            d_rho[:, self._free] = np.einsum("kij,kj->ki", self._relaxed, d)
        return d, d_rho
