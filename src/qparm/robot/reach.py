"""How far an arm reaches, as a proof: a pose beyond the greatest reach of the links is out of reach.

On every revolute axis pick one point. It belongs to both links that the joint connects, so the distance
between the points of neighbouring axes is constant, and no configuration takes the last point farther
from the first than the sum of these distances. *Every* choice of points gives such a bound; the least one
is a convex problem (a sum of Euclidean norms in the positions along the axes), solved once per chain.
For a spherical-wrist arm it is upper arm plus forearm, between shoulder and wrist centre.

Leading prismatic joints (a rail, a gantry) move the first point; a prismatic joint farther out adds its travel.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.robot.chain import SerialChain

__all__ = ["ReachBound", "excess_of_reach", "reach_bound"]


@dataclass(frozen=True, eq=False)
class ReachBound:
    """The greatest reach of a chain, from its first revolute axis to its last.

    Attributes
    ----------
    reach : float
        Upper bound on the distance of ``wrist`` from ``shoulder`` (m).
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
    shoulder: NDArray[np.float64]
    travel_axes: NDArray[np.float64]
    travel: NDArray[np.float64]
    wrist: NDArray[np.float64]

    def nearest_shoulder(self, wrist: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the shoulder position within the travel that is nearest to a point in the base frame."""
        offset = wrist - self.shoulder
        k = self.travel_axes.shape[1]
        if k == 0:
            return self.shoulder
        if k == 1:
            t = np.clip(self.travel_axes[:, 0] @ offset, *self.travel[0])
            return self.shoulder + self.travel_axes[:, 0] * t
        from scipy.optimize import lsq_linear

        # bvls is an active set, exact up to rounding; the interior method stops micrometres short
        t = lsq_linear(
            self.travel_axes, offset, bounds=(self.travel[:, 0], self.travel[:, 1]), method="bvls", tol=1e-15
        ).x
        return self.shoulder + self.travel_axes @ t


def reach_bound(chain: SerialChain) -> ReachBound | None:
    """Return the greatest reach of a chain, or None for one with fewer than two revolute joints."""
    from scipy.optimize import minimize

    revolute = np.flatnonzero(~chain.prismatic)
    if len(revolute) < 2:
        return None
    first, last = revolute[0], revolute[-1]
    frames = chain.frames(np.zeros(chain.n))[1:-1]
    tool = chain.forward(np.zeros(chain.n))
    origins, axes = frames[revolute, :3, 3], frames[revolute, :3, 2]
    length = np.abs(origins - origins[0]).max() + chain.characteristic_length

    # Distances between the points at zero angles are those at any angles, as long as no prismatic joint
    # lies between; one that does is taken at zero and its largest travel added.
    def distances(t: NDArray[np.float64]) -> NDArray[np.float64]:
        points = origins + axes * (length * t)[:, None]
        return np.linalg.norm(np.diff(points, axis=0), axis=1)

    # Smoothed norms make it differentiable where axes meet; the bound is then evaluated exactly, and any
    # t gives a valid bound.
    def smoothed(t: NDArray[np.float64], s: float) -> tuple[float, NDArray[np.float64]]:
        d = np.diff(origins + axes * (length * t)[:, None], axis=0)
        norms = np.sqrt((d**2).sum(axis=1) + (s * length) ** 2)
        pull = np.concatenate([np.zeros((1, 3)), d / norms[:, None], np.zeros((1, 3))])
        return float(norms.sum()), length * (axes * (pull[:-1] - pull[1:])).sum(axis=1)

    start = np.zeros(len(revolute))
    for smoothing in (1e-2, 1e-4, 1e-6, 1e-8):
        start = minimize(smoothed, start, args=(smoothing,), jac=True, method="BFGS", options={"gtol": 1e-10}).x
    between = [i for i in range(first, last) if chain.prismatic[i]]
    extra = sum(max(abs(chain.lower[i]), abs(chain.upper[i])) for i in between)
    points = origins + axes * (length * start)[:, None]
    wrist = np.asarray(np.linalg.solve(tool, np.append(points[-1], 1.0))[:3], dtype=np.float64)
    beyond = [i for i in range(last + 1, chain.n) if chain.prismatic[i]]
    extra += sum(max(abs(chain.lower[i]), abs(chain.upper[i])) for i in beyond)
    return ReachBound(
        reach=float(distances(start).sum() + extra),
        shoulder=points[0],
        travel_axes=frames[:first, :3, 2].T.copy(),
        travel=np.column_stack([chain.lower[:first], chain.upper[:first]]),
        wrist=wrist,
    )


def excess_of_reach(chain: SerialChain, target: NDArray[np.float64]) -> float:
    """Return by how much a pose lies beyond the greatest reach (m); positive proves it out of reach.

    A micrometre is left for rounding.
    """
    bound = chain.reach_bound
    if bound is None:
        return -np.inf
    wrist = target[:3, :3] @ bound.wrist + target[:3, 3]
    distance = float(np.linalg.norm(wrist - bound.nearest_shoulder(wrist)))
    return distance - bound.reach - 1e-6
