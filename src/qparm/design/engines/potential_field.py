"""An artificial potential field that drives away from obstacles (Khatib 1986)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["repulsion"]


def repulsion(
    u: NDArray[np.float64],
    obstacles: NDArray[np.float64],
    *,
    strength: float,
    radius: float,
    nearest: int = 4,
    largest: float = 0.2,
) -> NDArray[np.float64]:
    """Return the push on a particle: the sum of η (1/ρ - 1/ρ₀) / ρ² ∇ρ over obstacles nearer than ρ₀.

    Parameters
    ----------
    u : ndarray, shape (d,)
    obstacles : ndarray, shape (n, d)
        One at the particle's own place has no direction and pushes nowhere.
    strength, radius : float
        η and ρ₀.
    nearest : int
        How many obstacles count.
    largest : float
        Length to which the push is cut.
    """
    away = u - obstacles
    distance = np.sqrt((away**2).sum(axis=1))
    near = np.flatnonzero((distance < radius) & (distance > 1e-9))
    near = near[np.argsort(distance[near], kind="stable")[:nearest]]
    if not len(near):
        return np.zeros_like(u)
    rho = distance[near, None]
    push = (strength * (1 / rho - 1 / radius) / rho**2 * away[near] / rho).sum(axis=0)
    size = float(np.sqrt(push @ push))
    return push * (largest / size) if size > largest else push
