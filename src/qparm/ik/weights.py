"""The weights of the IK steps: Chan-Dubey for WLN (eq. 3), clamping weight and clamp for CWLN (eq. 4).

The paper uses two opposite conventions without saying so. In eq. 3 the weight W stands inverted: a
joint that nears its limit is slowed by a *large* W_ii (the text's "smaller weight factors" is a
slip). In eq. 4 the weight W~ stands as it is: a mobility, 1 for a free joint and 0 for one at its
limit. Both reach the step as ``S = R^(-1/2)``: ``S = W^(-1/2)`` and ``S = W~^(1/2)``.

All functions work in scaled joints (q / D, see :class:`qparm.robot.SerialChain`), where a range of
a prismatic joint and a range of a revolute one can be compared.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from qparm.compiled.kernels import kernel_helper

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.robot import SerialChain

__all__ = ["CLAMP_GAIN", "CLAMP_ZONE", "chan_dubey_weights", "clamping_weights", "damping", "fade"]

# The zone before a limit in which CWLN clamps, as a share of the joint's range, and the pull at the
# limit itself, in scaled units. The cited papers could not be read; public implementations of them use
# 0.05 to 0.10 and 0.1.
CLAMP_ZONE = 0.10
CLAMP_GAIN = 0.10


@kernel_helper
def chan_dubey_gradient(q, lower, upper):
    """Return dH/dq of H = 1/4 range^2 / ((upper - q)(q - lower)) for one joint, in its own units.

    It grows without bound towards the limits and is clamped there: a joint at or past its limit keeps
    the weight of one a billionth of its range away.
    """
    width = upper - lower
    above = max(q - lower, 1e-9 * width)
    below = max(upper - q, 1e-9 * width)
    return width * width * (2.0 * q - upper - lower) / (4.0 * below * below * above * above)


@kernel_helper
def smoothstep(x):
    """Return 3 x^2 - 2 x^3 between 0 and 1."""
    if x <= 0.0:
        return 0.0
    if x >= 1.0:
        return 1.0
    return x * x * (3.0 - 2.0 * x)


@kernel_helper
def clamping_mobility(q, lower, upper):
    """Return the entry of W~ for one joint: 1 away from the limits, 0 at them."""
    return smoothstep(min(q - lower, upper - q) / (CLAMP_ZONE * (upper - lower)))


@kernel_helper
def clamp(q, lower, upper):
    """Return the entry of phi for one joint in scaled units: it points *towards* the nearer limit."""
    return CLAMP_GAIN * (2.0 * q - upper - lower) / (upper - lower)


def chan_dubey_weights(
    chain: SerialChain, q: NDArray[np.float64], direction: NDArray[np.float64] | None = None
) -> NDArray[np.float64]:
    """Return the diagonal of W for WLN (Chan and Dubey 1995).

        W_ii = 1 + |dH/dq_i|   if the joint moves towards its nearer limit, else 1

    Parameters
    ----------
    chain : SerialChain
    q : (n,) ndarray
    direction : (n,) ndarray, optional
        A step whose signs tell which way each joint moves; without it every joint counts as moving
        towards its limit.

    Returns
    -------
    (n,) ndarray
        Weights >= 1. ``dH/dq`` is taken in scaled joints.
    """
    q = chain.check_configuration(q)
    D = chain.scale
    W = np.ones(chain.n)
    for i in range(chain.n):
        g = chan_dubey_gradient(q[i] / D[i], chain.lower[i] / D[i], chain.upper[i] / D[i])
        if direction is None or g * direction[i] > 0:
            W[i] += abs(g)
    return W


def clamping_weights(chain: SerialChain, q: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the diagonal of W~ and the clamp phi of CWLN (eq. 4).

        W~_ii = 3 x^2 - 2 x^3,   x = distance to the nearer limit / (0.10 range), clipped to [0, 1]
        phi_i = 0.10 (2 q_i - upper_i - lower_i) / range_i          (scaled: 1 rad, 1 characteristic length)

    Parameters
    ----------
    chain : SerialChain
    q : (n,) ndarray

    Returns
    -------
    W, phi : (n,) ndarray
        The step's centre is ``c = -(I - W) phi``: it pulls back into the range.
    """
    q = chain.check_configuration(q)
    D = chain.scale
    W, phi = np.empty(chain.n), np.empty(chain.n)
    for i in range(chain.n):
        W[i] = clamping_mobility(q[i] / D[i], chain.lower[i] / D[i], chain.upper[i] / D[i])
        phi[i] = clamp(q[i] / D[i], chain.lower[i] / D[i], chain.upper[i] / D[i])
    return W, phi


@kernel_helper
def damping(e_norm):
    """Return Sugihara's lambda^2 = 1e-3 |e|^2 + 1e-12 for a scaled error norm."""
    return 1e-3 * e_norm * e_norm + 1e-12


@kernel_helper
def fade(e_norm):
    """Return the factor by which the centre c shrinks as the error vanishes.

    Where c is not zero the step leaves a bias of lambda^2 |A^-1 J c|, and every iteration also moves
    in the null space; with c proportional to the error both vanish, and convergence stays quadratic.
    """
    return min(1.0, e_norm / 1e-2)
