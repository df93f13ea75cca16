"""Proved bounds on how far and how near an arm reaches: a pose beyond either bound is out of reach.

On every revolute axis pick one point. It belongs to both links that the joint connects, so the distance
between the points of neighbouring axes is constant, and no configuration takes the last point farther
from the first than the sum of these distances. *Every* choice of points gives such a bound; the least one
is a convex problem (a sum of Euclidean norms in the positions along the axes), solved once per chain.
For a spherical-wrist arm it is upper arm plus forearm, between shoulder and wrist centre.

Where one joint lies between two points, its position limits bound their distance from both sides (an elbow that
folds by 120 degrees keeps the wrist away from the shoulder). The triangle inequality carries such intervals from pair
to pair, up to first and last.

Leading prismatic joints (a rail, a gantry) move the first point; a prismatic joint farther out adds its travel.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.robot.chain import SerialChain

__all__ = ["ReachBound", "excess_of_reach", "is_out_of_reach", "reach_bound", "reach_excess"]

# Left for rounding (m).
_ROUNDING = 1e-6
# A point this near to an axis (m) counts as on it.
_ON_AXIS = 3e-8
# Newton steps for each smoothing of the norms, at most.
_NEWTON_STEPS = 40


@dataclass(frozen=True, eq=False)
class ReachBound:
    """The greatest and the least reach of a chain, from its first revolute axis to its last.

    Attributes
    ----------
    reach : float
        Upper bound on the distance of ``wrist`` from ``shoulder`` (m).
    least_reach : float
        Lower bound on it (m); 0 where the arm can fold up.
    shoulder : (3,) ndarray
        The first point, in the base frame, at zero of the leading prismatic joints.
    travel_axes : (3, k) ndarray
        Directions of the leading prismatic joints in the base frame.
    travel : (k, 2) ndarray
        Their limits (m).
    wrist : (3,) ndarray
        The last point, in the tool's frame.
    """

    reach: float
    least_reach: float
    shoulder: NDArray[np.float64]
    travel_axes: NDArray[np.float64]
    travel: NDArray[np.float64]
    wrist: NDArray[np.float64]

    def nearest_shoulder(self, wrist: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the shoulder position within the travel nearest to a point in the base frame, or to each of (N, 3)."""
        offset = wrist - self.shoulder
        k = self.travel_axes.shape[1]
        if k == 0:
            return self.shoulder + 0.0 * offset
        if k == 1:
            t = np.clip(offset @ self.travel_axes[:, 0], *self.travel[0])
            return self.shoulder + np.multiply.outer(t, self.travel_axes[:, 0])
        if offset.ndim == 2:
            return np.array([self.nearest_shoulder(point) for point in wrist]).reshape(-1, 3)
        from scipy.optimize import lsq_linear

        # bvls is an active set, exact up to rounding; the interior method stops micrometres short
        t = lsq_linear(
            self.travel_axes, offset, bounds=(self.travel[:, 0], self.travel[:, 1]), method="bvls", tol=1e-15
        ).x
        return self.shoulder + self.travel_axes @ t

    def farthest_distance(self, wrist: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how far (N, 3) points in the base frame are from the end of the travel farthest from each, (N,)."""
        ends = [self.shoulder + self.travel_axes @ t for t in itertools.product(*self.travel)]
        return np.linalg.norm(wrist[:, None] - np.array(ends)[None], axis=2).max(axis=1)


def reach_bound(chain: SerialChain) -> ReachBound | None:
    """Return the greatest and least reach of a chain, or None for one with fewer than two revolute joints."""
    revolute = np.flatnonzero(~chain.prismatic)
    if len(revolute) < 2:
        return None
    first, last = revolute[0], revolute[-1]
    frames = chain.frames(np.zeros(chain.n))[1:-1]
    tool = chain.forward(np.zeros(chain.n))
    origins, axes = frames[revolute, :3, 3], frames[revolute, :3, 2]
    length = np.abs(origins - origins[0]).max() + chain.characteristic_length
    points = origins + axes * _least_sum_of_legs(origins, axes, length)[:, None]
    least, greatest = _distances(chain, revolute, points, frames)
    wrist = np.asarray(np.linalg.solve(tool, np.append(points[-1], 1.0))[:3], dtype=np.float64)
    beyond = sum(_largest_travel(chain, i) for i in range(last + 1, chain.n))
    return ReachBound(
        reach=greatest + beyond,
        least_reach=max(least - beyond, 0.0),
        shoulder=points[0],
        travel_axes=frames[:first, :3, 2].T.copy(),
        travel=np.column_stack([chain.lower[:first], chain.upper[:first]]),
        wrist=wrist,
    )


def _least_sum_of_legs(origins: NDArray[np.float64], axes: NDArray[np.float64], length: float) -> NDArray[np.float64]:
    """Return positions along the axes (m) that make the legs between neighbouring points least in sum.

    Newton's method on smoothed norms, sqrt(|v|^2 + s^2), with s falling: they are differentiable where axes meet.
    Any positions give a valid bound.
    """
    m = len(origins)
    # leg i is v_i = offsets_i + G_i t
    offsets = np.diff(origins, axis=0)
    G = np.zeros((m - 1, 3, m))
    legs = np.arange(m - 1)
    G[legs, :, legs], G[legs, :, legs + 1] = -axes[:-1], axes[1:]
    t = np.zeros(m)
    for smoothing in (1e-1, 1e-2, 1e-4, 1e-6, 1e-8):
        s2 = (smoothing * length) ** 2
        v = offsets + G @ t
        norms = np.sqrt((v**2).sum(axis=1) + s2)
        for _ in range(_NEWTON_STEPS):
            unit = v / norms[:, None]
            along = np.einsum("ijk,ij->ik", G, unit)
            gradient = along.sum(axis=0)
            hessian = np.einsum("ijk,ijl,i->kl", G, G, 1 / norms) - np.einsum("ik,il,i->kl", along, along, 1 / norms)
            # parallel axes leave the points free to slide together
            hessian[np.diag_indices(m)] += 1e-9 * np.trace(hessian)
            step = np.linalg.solve(hessian, -gradient)
            decrease = float(-gradient @ step)
            if decrease < 1e-13 * length:
                break
            share = 1.0
            while share > 1e-6:
                trial = offsets + G @ (t + share * step)
                trial_norms = np.sqrt((trial**2).sum(axis=1) + s2)
                if norms.sum() - trial_norms.sum() >= 1e-4 * share * decrease:
                    break
                share *= 0.5
            else:
                break
            t, v, norms = t + share * step, trial, trial_norms
    return t


def _distances(
    chain: SerialChain, revolute: NDArray[np.intp], points: NDArray[np.float64], frames: NDArray[np.float64]
) -> tuple[float, float]:
    """Return the least and the greatest distance between the first and the last point (m), as far as is proved.

    ``points`` and ``frames`` are those at zero of all joints.
    """
    m = len(points)
    least, greatest = np.zeros((m, m)), np.full((m, m), np.inf)
    np.fill_diagonal(greatest, 0.0)
    forwards = [_joints_through(chain, frames, points[a], range(revolute[a] + 1, chain.n)) for a in range(m)]
    backwards = [_joints_through(chain, frames, points[b], range(revolute[b] - 1, -1, -1)) for b in range(m)]
    for a, b in itertools.combinations(range(m), 2):
        moving = range(revolute[a] + forwards[a] + 1, revolute[b] - backwards[b])
        distance = float(np.linalg.norm(points[b] - points[a]))
        if len(moving) == 1:
            (i,) = moving
            pair = _over_joint(chain, i, points[a], points[b], frames[i])
        elif chain.prismatic[moving].all():
            slide = sum(_largest_travel(chain, i) for i in moving)
            pair = max(distance - slide, 0.0), distance + slide
        else:
            continue
        least[a, b], greatest[a, b] = least[b, a], greatest[b, a] = pair
    for _ in range(m):  # each sweep at least doubles how many points a bound may go through
        greatest = np.minimum(greatest, (greatest[:, :, None] + greatest[None]).min(axis=1))
        farther = (least[:, :, None] - greatest[None]).max(axis=1)
        tightened = np.maximum(least, np.maximum(farther, farther.T))
        if np.array_equal(tightened, least):
            break
        least = tightened
    return float(least[0, -1]), float(greatest[0, -1])


def _joints_through(
    chain: SerialChain, frames: NDArray[np.float64], point: NDArray[np.float64], joints: Iterable[int]
) -> int:
    """Return how many of the joints, in turn, do not move a point because it lies on their axes."""
    count = 0
    for i in joints:
        offset = point - frames[i, :3, 3]
        if chain.prismatic[i] or np.linalg.norm(np.cross(frames[i, :3, 2], offset)) > _ON_AXIS:
            break
        count += 1
    return count


def _over_joint(
    chain: SerialChain, i: int, start: NDArray[np.float64], end: NDArray[np.float64], frame: NDArray[np.float64]
) -> tuple[float, float]:
    """Return least and greatest distance of two points that joint i alone moves against each other (m)."""
    axis, lower, upper = frame[:3, 2], float(chain.lower[i]), float(chain.upper[i])
    if chain.prismatic[i]:
        return _when_slid(end - start, axis, lower, upper)
    if chain.continuous[i]:
        lower, upper = -np.pi, np.pi
    return _when_turned(start - frame[:3, 3], end - frame[:3, 3], axis, lower, upper)


def _when_turned(
    u: NDArray[np.float64], v: NDArray[np.float64], axis: NDArray[np.float64], lower: float, upper: float
) -> tuple[float, float]:
    """Return least and greatest |R v - u| for rotations R about an axis through the origin, lower to upper (rad)."""
    along = float((u @ axis) * (v @ axis))
    cosine, sine = float(u @ v) - along, float(u @ np.cross(axis, v))
    # u . R v = along + radius cos(q - peak)
    radius, peak = np.hypot(cosine, sine), np.arctan2(sine, cosine)
    low, high = lower - peak, upper - peak
    ends = np.cos([low, high])
    most = 1.0 if np.ceil(low / (2 * np.pi)) <= np.floor(high / (2 * np.pi)) else ends.max()
    fewest = -1.0 if np.ceil((low - np.pi) / (2 * np.pi)) <= np.floor((high - np.pi) / (2 * np.pi)) else ends.min()
    squares = float(u @ u + v @ v) - 2 * (along + radius * np.array([most, fewest]))
    least, greatest = np.sqrt(np.maximum(squares, 0.0))
    return float(least), float(greatest)


def _when_slid(v: NDArray[np.float64], axis: NDArray[np.float64], lower: float, upper: float) -> tuple[float, float]:
    """Return least and greatest |v + t axis| for t from lower to upper (m)."""
    nearest = np.clip(-(v @ axis), lower, upper)
    ends = [float(np.linalg.norm(v + t * axis)) for t in (lower, upper)]
    return float(np.linalg.norm(v + nearest * axis)), max(ends)


def _largest_travel(chain: SerialChain, i: int) -> float:
    return float(max(abs(chain.lower[i]), abs(chain.upper[i])))


def reach_excess(chain: SerialChain, targets: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return by how much poses lie beyond the greatest reach, and short of the least; positive proves it.

    A micrometre is left for rounding.

    Parameters
    ----------
    chain : SerialChain
    targets : (N, 4, 4) ndarray

    Returns
    -------
    too_far, too_near : (N,) ndarray
        In m; -inf where nothing is known.
    """
    bound = chain.reach_bound
    if bound is None:
        return np.full(len(targets), -np.inf), np.full(len(targets), -np.inf)
    wrist = targets[:, :3, :3] @ bound.wrist + targets[:, :3, 3]
    nearest = np.linalg.norm(wrist - bound.nearest_shoulder(wrist), axis=1)
    farthest = bound.farthest_distance(wrist)
    return nearest - bound.reach - _ROUNDING, bound.least_reach - farthest - _ROUNDING


def excess_of_reach(chain: SerialChain, target: NDArray[np.float64]) -> float:
    """Return by how much one pose lies beyond the greatest reach (m); positive proves it out of reach."""
    return float(reach_excess(chain, target[None])[0][0])


def is_out_of_reach(chain: SerialChain, target: NDArray[np.float64]) -> bool:
    """Return whether one pose is proved to lie beyond the greatest reach, or nearer than the least."""
    too_far, too_near = reach_excess(chain, target[None])
    return bool(too_far[0] > 0 or too_near[0] > 0)
