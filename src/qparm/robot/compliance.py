"""Compliance, the tool's deflection under a force: joints as springs and, unless rigid, links as bending beams.

A unit force along n at the tool's origin puts the torque J_p,i . n on joint i, which turns by that over its stiffness
k_i, and moves the tool along n by it once more. A link of length L between two joints' origins carries the moment
m(x) = (p - x) x n; bending takes the part across the link, with EI the same about all axes (Euler and Bernoulli):

    c = sum_i (J_p,i . n)^2 / k_i  +  sum_links  L / (3 EI) (|m_0|^2 + m_0 . m_1 + |m_1|^2)        (m / N)

m_0, m_1 at the link's ends: of a cantilever with the force at its end, L^3 / (3 EI). Torsion, shear and stretch of
links, and what bearings and the floor give, are left out; all are small beside joints and bending in usual arms.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from qparm.compiled.kernels import b1, c1, c2, c3, f8, kernel, o1, void
from qparm.errors import InvalidInput
from qparm.robot.kernels import forward_and_axes

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from qparm.robot.chain import SerialChain

__all__ = ["Elasticity", "tool_compliance"]


@dataclass(frozen=True, eq=False)
class Elasticity:
    """What deflects in an arm.

    Attributes
    ----------
    joints : (n,) ndarray
        Stiffness of each joint (N m/rad, N/m).
    links : float
        Bending stiffness EI of every link (N m^2); infinite where links are rigid.
    """

    joints: NDArray[np.float64]
    links: float = np.inf

    def __post_init__(self) -> None:
        if not ((np.isfinite(self.joints) & (self.joints > 0)).all() and self.links > 0):
            raise InvalidInput(f"stiffnesses must be positive, not {self.joints} and {self.links}")


@kernel(void(c3, b1, c2, c2, c1, f8, o1))
def compliance_kernel(fixed, prismatic, Q, directions, joint_compliance, link_compliance, out):
    """Write how far the tool deflects along each direction (N, 3) under a unit force (m/N)."""
    n = Q.shape[1]
    pose, axes = np.empty((4, 4)), np.empty((n, 6))
    o, m, t = np.empty((n + 1, 3)), np.empty((2, 3)), np.empty(3)
    for k in range(Q.shape[0]):
        forward_and_axes(fixed, prismatic, Q[k], pose, axes)
        nx, ny, nz = directions[k, 0], directions[k, 1], directions[k, 2]
        total = 0.0
        for i in range(n):
            wx, wy, wz = axes[i, 3], axes[i, 4], axes[i, 5]
            x, y, z = pose[0, 3] - axes[i, 0], pose[1, 3] - axes[i, 1], pose[2, 3] - axes[i, 2]
            if prismatic[i]:
                along = wx * nx + wy * ny + wz * nz
            else:
                along = (wy * z - wz * y) * nx + (wz * x - wx * z) * ny + (wx * y - wy * x) * nz
            total += along * along * joint_compliance[i]
        if link_compliance > 0.0:
            for a in range(3):
                for i in range(n):
                    o[i, a] = axes[i, a]
                o[n, a] = pose[a, 3]
            for i in range(n):
                length = 0.0
                for a in range(3):
                    t[a] = o[i + 1, a] - o[i, a]
                    length += t[a] * t[a]
                length = np.sqrt(length)
                if length == 0.0:
                    continue
                for end in range(2):
                    x, y, z = pose[0, 3] - o[i + end, 0], pose[1, 3] - o[i + end, 1], pose[2, 3] - o[i + end, 2]
                    m[end, 0], m[end, 1], m[end, 2] = y * nz - z * ny, z * nx - x * nz, x * ny - y * nx
                    twist = (m[end, 0] * t[0] + m[end, 1] * t[1] + m[end, 2] * t[2]) / (length * length)
                    for a in range(3):
                        m[end, a] -= twist * t[a]
                square = 0.0
                for a in range(3):
                    square += m[0, a] * m[0, a] + m[0, a] * m[1, a] + m[1, a] * m[1, a]
                total += square * length / 3.0 * link_compliance
        out[k] = total


def tool_compliance(
    chain: SerialChain, q: ArrayLike, directions: ArrayLike, elasticity: Elasticity
) -> NDArray[np.float64]:
    """Return how far the tool deflects along directions, under a force of 1 N along them.

    Parameters
    ----------
    chain : SerialChain
    q : (N, n) array_like
        m and rad.
    directions : (N, 3) array_like
        Unit vectors, base frame.
    elasticity : Elasticity

    Returns
    -------
    (N,) ndarray
        m/N.

    Raises
    ------
    InvalidInput
        If a shape does not fit or a value is not finite.
    """
    Q = np.atleast_2d(chain.check_configuration(q))
    directions = np.ascontiguousarray(directions, dtype=float)
    if directions.shape != (len(Q), 3) or not np.isfinite(directions).all():
        raise InvalidInput(f"directions must be ({len(Q)}, 3) finite numbers")
    if elasticity.joints.shape != (chain.n,):
        raise InvalidInput(f"there are stiffnesses of {len(elasticity.joints)} joints, the arm has {chain.n}")
    out = np.empty(len(Q))
    compliance_kernel(
        chain.fixed, chain.prismatic, Q, directions, 1.0 / elasticity.joints, 1.0 / elasticity.links, out
    )  # fmt: skip
    return out
