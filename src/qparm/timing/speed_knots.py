"""Knots of the spline of squared path speed: where they are close, and the soft ends of the path."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from qparm.timing.soft_ends import SoftEnds

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from scipy.interpolate import PPoly

    from qparm.robot.motion_limits import MotionLimits
    from qparm.timing.path_speed import FeedSections

__all__ = ["halved_knots", "soft_ends", "speed_knots"]

# Intervals of the spline: so many at least, or so many between two waypoints on paths that are not long.
_LEAST_INTERVALS, _PER_GAP, _LONG = 200, 3, 6000
# In a soft end an interval is this share of its width; beyond, at most that share of the distance to the end.
_FINE, _GRADING = 1 / 14, 0.15
# The widest soft end, as a share of the path.
_WIDEST = 0.12
# Next to a border between feed and none, an interval is this share of the way in which acceleration is built up there.
_FINE_BORDER = 0.1
# Intervals beside those that are halved, which are halved too.
_BESIDE = 2


def soft_ends(curve: PPoly, limits: MotionLimits, feed: FeedSections) -> SoftEnds:
    """Return soft ends about as wide as the way in which full speed is reached."""
    length = float(curve.x[-1])
    widths = []
    for place, fastest in ((0.0, feed.speeds[0]), (length, feed.speeds[-1])):
        slope = np.abs(curve(place, 1))
        with np.errstate(divide="ignore"):
            speed, acceleration, jerk = (float((row / slope).min()) for row in limits.table)
        speed = min(speed, float(fastest))
        width = _WIDEST * length
        if np.isfinite(speed) and np.isfinite(acceleration):
            swift = speed < acceleration**2 / jerk
            time = 2.0 * np.sqrt(speed / jerk) if swift else speed / acceleration + acceleration / jerk
            width = min(width, speed * time / 1.2)
        widths.append(max(width, 1e-6 * length))
    return SoftEnds(length, *widths)


def speed_knots(ends: SoftEnds, curve: PPoly, limits: MotionLimits, feed: FeedSections) -> NDArray[np.float64]:
    """Return knots in u: the curve's breaks, and as many between them as the ends and the path ask for."""
    breaks = np.union1d(curve.x, _near_borders(curve, limits, feed))
    total = ends.total
    widest = total / max(_LEAST_INTERVALS, min(_PER_GAP * (len(breaks) - 1), _LONG))
    # how fine from either end to where the grading has grown to the widest interval
    sides = []
    for width in (ends.start, ends.end):
        nodes = [0.0]
        while nodes[-1] < 0.5 * total:
            step = min(widest, max(_FINE * width, _GRADING * nodes[-1]))
            nodes.append(nodes[-1] + step)
            if step >= widest:
                break
        sides.append(np.array(nodes))
    left, right = sides[0][sides[0] < 0.5 * total], total - sides[1][sides[1] < 0.5 * total][::-1]
    middle = np.linspace(left[-1], right[0], max(2, int(np.ceil((right[0] - left[-1]) / widest)) + 1))
    nodes = np.concatenate([left, middle[1:-1], right])
    given = ends.inverse(breaks.copy())
    given[0], given[-1] = 0.0, total
    depth = np.interp(given, nodes, np.arange(float(len(nodes))))
    count = np.maximum(np.ceil(np.diff(depth) - 1e-6).astype(np.int64), 1)
    index = np.repeat(np.arange(len(count)), count)
    within = np.arange(len(index)) - np.repeat(np.cumsum(count) - count, count)
    at = depth[index] + np.diff(depth)[index] * within / count[index]
    knots = np.append(np.interp(at, np.arange(float(len(nodes))), nodes), total)
    knots[np.append(np.cumsum(count) - count, len(knots) - 1)] = given
    return knots


def halved_knots(knots: NDArray[np.float64], which: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return knots with intervals and those next to them halved."""
    which = np.convolve(which, np.ones(2 * _BESIDE + 1), mode="same") > 0
    return np.union1d(knots, 0.5 * (knots[:-1] + knots[1:])[which])


def _near_borders(curve: PPoly, limits: MotionLimits, feed: FeedSections) -> NDArray[np.float64]:
    """Return the inner borders, and places at either side of them, growing apart: there the speed changes fast."""
    inner = feed.borders[1:-1]
    if not len(inner):
        return inner
    time = float((limits.acceleration / limits.jerk).min())
    places = [inner]
    for border, speeds in zip(inner, pairwise(feed.speeds), strict=True):
        speed = min(speeds)
        if not np.isfinite(speed):
            continue
        first = _FINE_BORDER * speed * time
        gaps = np.diff(curve.x)[np.clip(np.searchsorted(curve.x, border) - 1, 0, len(curve.x) - 2)]
        count = max(0, int(np.log1p(_GRADING * gaps / first) / np.log1p(_GRADING)))
        away = first * np.expm1(np.arange(1, count + 1) * np.log1p(_GRADING)) / _GRADING
        near = np.concatenate([border - away, border + away])
        places.append(near[(near > 0) & (near < curve.x[-1])])
    return np.unique(np.concatenate(places))
