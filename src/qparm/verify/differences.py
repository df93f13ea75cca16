"""Limits of velocity, acceleration and jerk from positions alone, by divided differences.

The k-th divided difference of a motion over k + 1 samples, times k!, is a weighted mean of its k-th derivative over
the time from the first to the last (the weights are a B-spline). A mean beyond the limit proves that the limit is
exceeded, and a motion that keeps its limits never gives one: whatever the file leaves open is taken off first.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from qparm.verify.feed import LimitShares

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.verify.clock import Clock

__all__ = ["MeanShares", "divided_differences", "mean_shares", "shares_along"]

# Samples at a time, and the longest time of a mean (s).
_CHUNK, _LONGEST = 65_536, 0.5
# Rounding that is no more than this share of a limit needs no longer means.
_NOISE = 1e-4
_ORDERS = 3


@dataclass(frozen=True, eq=False)
class MeanShares:
    """The largest means over their limits that are proved.

    Attributes
    ----------
    share, time : (3, n) ndarray
        Of velocity, acceleration and jerk: the share, and the middle of the mean's time (s).
    first, count : (3, n) ndarray
        Where the limit is first exceeded (s, NaN if nowhere), and how often, at the most telling distance of samples.
    """

    share: NDArray[np.float64]
    time: NDArray[np.float64]
    first: NDArray[np.float64]
    count: NDArray[np.int64]


def divided_differences(
    t: NDArray[np.float64], q: NDArray[np.float64], step: int
) -> list[tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]]:
    """Return for the orders 1 to 3 the mean derivatives over every order + 1 samples that are ``step`` apart.

    Parameters
    ----------
    t : (T,) ndarray
    q : (T, n) ndarray
    step : int

    Returns
    -------
    list of (means (k, n), times of their middles (k,), weights (k,))
        The weight is by how much a rounding of 1 in every position may change the mean.
    """
    values, weights, orders = q, np.ones(len(t)), []
    for order in range(1, _ORDERS + 1):
        if len(t) <= order * step:
            break
        span = (t[order * step :] - t[: -order * step]) / order
        values = (values[step:] - values[:-step]) / span[:, None]
        weights = (weights[step:] + weights[:-step]) / span
        orders.append((values, 0.5 * (t[order * step :] + t[: -order * step]), weights))
    return orders


def mean_shares(
    clock: Clock, q: NDArray[np.float64], rounding: NDArray[np.float64], limits: NDArray[np.float64], *, slack: float
) -> MeanShares:
    """Return the largest proved means of all three derivatives, over samples 1, 2, 4, ... apart.

    Parameters
    ----------
    clock : Clock
    q : (T, n) ndarray
    rounding : (n,) ndarray
        Of the positions.
    limits : (3, n) ndarray
    slack : float
        Share over 1 that counts as kept.
    """
    n = q.shape[1]
    share, time = np.zeros((3, n)), np.zeros((3, n))
    first, count = np.full((3, n), np.nan), np.zeros((3, n), dtype=np.int64)
    for step in _steps(clock, rounding, limits):
        found = np.zeros((3, n), dtype=np.int64)
        for start in range(0, len(q), _CHUNK):
            part = slice(start, start + _CHUNK + 3 * step)
            t = clock.t[part]
            blur = rounding + limits[0] * clock.rounding[part].max()
            for order, (means, middle, weights) in enumerate(divided_differences(t, q[part], step)):
                proved = (np.abs(means) - weights[:, None] * blur) / limits[order]
                at = proved.argmax(axis=0)
                largest = proved[at, np.arange(n)]
                better = largest > share[order]
                share[order, better], time[order, better] = largest[better], middle[at[better]]
                if (largest > 1 + slack).any():
                    beyond = proved > 1 + slack
                    found[order] += beyond.sum(axis=0)
                    earliest = np.where(beyond.any(axis=0), middle[beyond.argmax(axis=0)], np.nan)
                    first[order] = np.fmin(first[order], earliest)
        count = np.maximum(count, found)
    return MeanShares(share, time, first, count)


def shares_along(
    clock: Clock, q: NDArray[np.float64], rounding: NDArray[np.float64], limits: NDArray[np.float64]
) -> LimitShares:
    """Return the shares of limits that positions (T, n) prove, over the time of each mean.

    Over samples that are far enough apart for the rounding, no farther.
    """
    step = _steps(clock, rounding, limits)[-1]
    spread = max(1, step // 4)
    t, thin = clock.t[::spread], q[::spread]
    blur = rounding + limits[0] * clock.rounding.max(initial=0.0)
    times: list[NDArray[np.float64]] = [np.empty(0)]
    shares: list[NDArray[np.float64]] = [np.empty((3, 0, q.shape[1]))]
    for order, (means, middle, weights) in enumerate(divided_differences(t, thin, max(1, step // spread))):
        part = np.zeros((3, *means.shape))
        part[order] = np.maximum(np.abs(means) - weights[:, None] * blur, 0.0) / limits[order]
        times.append(middle)
        shares.append(part)
    time, share = np.concatenate(times), np.concatenate(shares, axis=1)
    at = np.argsort(time, kind="stable")
    return LimitShares(time[at], time[at], share[:, at])


def _steps(clock: Clock, rounding: NDArray[np.float64], limits: NDArray[np.float64]) -> list[int]:
    """Return the distances of samples to look over: doubled until rounding is nothing or the time too long."""
    h = clock.period if clock.sampled else float(np.median(np.diff(clock.t))) if len(clock.t) > 1 else 1.0
    blur = rounding + limits[0] * float(np.median(clock.rounding))
    steps = [1]
    while 6 * h * steps[-1] <= _LONGEST and (8 * blur / (h * steps[-1]) ** 3 > _NOISE * limits[2]).any():
        steps.append(2 * steps[-1])
    return steps
