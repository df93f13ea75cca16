"""Expected gain of hypervolume, exact for independent normal objectives (Emmerich et al. 2011, box by box)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.special import ndtr

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["expected_gain", "expected_shortfall"]


def expected_shortfall(
    level: NDArray[np.float64], mean: NDArray[np.float64], deviation: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return E[max(level - f, 0)] for normal f; a deviation of 0 is a known value. All broadcast."""
    gap = level - mean
    sure = deviation <= 0
    z = gap / np.where(sure, 1.0, deviation)
    density = np.exp(-0.5 * z**2) / np.sqrt(2 * np.pi)
    return np.where(sure, np.maximum(gap, 0.0), gap * ndtr(z) + deviation * density)


def expected_gain(
    lower: NDArray[np.float64],
    upper: NDArray[np.float64],
    mean: NDArray[np.float64],
    deviation: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the hypervolume that designs are expected to add.

    Parameters
    ----------
    lower, upper : ndarray, shape (b, m)
        Disjoint boxes that fill what is not dominated yet (:func:`qparm.design.archive.free_boxes`).
    mean, deviation : ndarray, shape (k, m)

    Returns
    -------
    ndarray, shape (k,)
    """
    product = np.ones((len(mean), len(lower)))
    for j in range(mean.shape[1]):
        mu, sigma = mean[:, j : j + 1], deviation[:, j : j + 1]
        # Boxes share their ends: each end once.
        ends, place = np.unique(np.concatenate([lower[:, j], upper[:, j]]), return_inverse=True)
        finite = np.isfinite(ends)
        value = np.zeros((len(mean), len(ends)))
        value[:, finite] = expected_shortfall(ends[finite], mu, sigma)
        product *= value[:, place[len(lower) :]] - value[:, place[: len(lower)]]
    return product.sum(axis=1)
