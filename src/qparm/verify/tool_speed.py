"""The tool's own speed, and the shares of limits that joints take, from states of a motion or from places alone."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from qparm.verify.feed import LimitShares, SpeedTrace
from qparm.verify.interpolate import interval_peaks, positions_at
from qparm.verify.kinematics import rotation_angle, tool_velocities

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.cell import Cell
    from qparm.verify.files import KnotTable

__all__ = ["shares_of_knots", "shares_of_samples", "speeds_of_knots", "speeds_of_places"]

# Places on each interval between knots: one in so many seconds, within these bounds.
_PLACE, _LEAST, _MOST = 0.02, 2, 12
# Speeds are means over a time in which what a file leaves open is this share of the feed.
_NOISE = 2e-4
_CHUNK = 8192


def speeds_of_knots(cell: Cell, knots: KnotTable, start: float, end: float, *, radius: float = 0.0) -> SpeedTrace:
    """Return the tool's speed from a time to another, of the quintics between knots.

    Parameters
    ----------
    cell : Cell
    knots : KnotTable
    start, end : float
        s.
    radius : float
        0 where the tool moves; where it turns on the spot, what a radian counts (m).
    """
    inner = knots.t[(knots.t > start) & (knots.t < end)]
    borders = np.concatenate([[start], inner, [end]])
    h = np.diff(borders)
    count = np.clip(np.ceil(h / _PLACE), _LEAST, _MOST).astype(np.int64)
    share = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    t = np.append(np.repeat(borders[:-1], count) + share * np.repeat(h / count, count), end)
    speed = np.empty(len(t))
    for first in range(0, len(t), _CHUNK):
        part = slice(first, first + _CHUNK)
        moving, turning = tool_velocities(cell, positions_at(knots, t[part]), positions_at(knots, t[part], order=1))
        speed[part] = radius * turning if radius else moving
    return SpeedTrace(t, speed, np.zeros(len(t)), np.zeros(len(t)))


def shares_of_knots(knots: KnotTable, limits: NDArray[np.float64]) -> LimitShares:
    """Return the shares of limits (3, n) at the peaks of the quintics between knots."""
    return LimitShares(knots.t[:-1], knots.t[1:], interval_peaks(knots) / limits[:, None])


def shares_of_samples(
    t: NDArray[np.float64], derivatives: NDArray[np.float64], rounding: NDArray[np.float64], limits: NDArray[np.float64]
) -> LimitShares:
    """Return the shares of limits (3, n) that a file's states prove: at the samples, and of jerk the means between.

    Parameters
    ----------
    t : (T,) ndarray
    derivatives : (3, T, n) ndarray
        Position, velocity, acceleration.
    rounding : (3, n) ndarray
        Of these.
    limits : (3, n) ndarray
    """
    size = np.maximum(np.abs(derivatives[1:]) - rounding[1:, None], 0.0)
    jerk = np.maximum(np.abs(np.diff(derivatives[2], axis=0)) - 2 * rounding[2], 0.0) / np.diff(t)[:, None]
    both = np.maximum(size[:, 1:], size[:, :-1])
    return LimitShares(t[:-1], t[1:], np.concatenate([both, jerk[None]]) / limits[:, None])


def speeds_of_places(
    t: NDArray[np.float64], position: NDArray[np.float64], rotation: NDArray[np.float64], *,
    feed: float, blur: float, radius: float = 0.0,
) -> SpeedTrace:  # fmt: skip
    """Return the tool's mean speeds between places, over times in which blur is little.

    Parameters
    ----------
    t : (k,) ndarray
    position : (k, 3), rotation : (k, 3, 3) ndarray
        Of the tool.
    feed : float
        m/s.
    blur : float
        How far each place may be off (m).
    radius : float
        See :func:`speeds_of_knots`.
    """
    if len(t) < 2:
        return SpeedTrace(*(np.empty(0) for _ in range(4)))
    step = max(1, int(np.ceil(2 * blur / (_NOISE * feed) / float(np.median(np.diff(t))))))
    t, position, rotation = (np.concatenate([values[:-1:step], values[-1:]]) for values in (t, position, rotation))
    if radius:
        way = radius * rotation_angle(rotation[:-1].transpose(0, 2, 1) @ rotation[1:])
    else:
        chord = np.diff(position, axis=0)
        way = np.linalg.norm(chord, axis=1)
        # an arc is longer than its chord: by the square of the angle by which the next chord is turned against it
        across = np.linalg.norm(np.cross(chord[:-1], chord[1:]), axis=1)
        angle = np.arctan2(across, (chord[:-1] * chord[1:]).sum(axis=1))
        turn = np.zeros(len(way))
        turn[1:], turn[:-1] = angle, np.maximum(turn[:-1], angle)
        way = way * (1 + np.minimum(turn, 0.5) ** 2 / 24)
    span = np.diff(t)
    return SpeedTrace(0.5 * (t[1:] + t[:-1]), way / span, 2 * blur / span, span)
