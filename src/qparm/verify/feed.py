"""The tool's speed along rows: at the feed, but for their ends and where a joint can no faster.

Judged is the tool's own speed. It is never beyond the feed. It may be less where a joint is at a limit of velocity,
acceleration or jerk then or nearly then: the fastest motion within limits is at one of them, or at the feed, at any
time. "Nearly" is the distance between two points of the row, in which a smooth law of time can change its mind.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["FEED_KEPT", "FeedFault", "FeedFigures", "LimitShares", "SlowPlace", "SpeedTrace", "judge_feed"]

# The feed is kept within this share.
FEED_KEPT = 1e-3
# The ends of a row: this long (m), and no longer than this share of it.
_END, _END_SHARE = 0.01, 0.1
# The run-up grows with the feed: the ends are so long at the feed (s) if that is more, by no more than this share.
_END_TIME, _MORE_SHARE = 0.5, 0.15
# Shares of the limits of velocity, acceleration and jerk from which on a joint can be why the tool is slower.
_NEAR_LIMIT = np.array([0.9, 0.9, 0.75])
# A limit counts for so long before and after it is reached (s), and on the way from point to point of the row, of which
# no more than this share of the row is taken.
_NEAR_TIME, _NEAR_SHARE = 0.15, 1 / 60
# A speed that falls by this share of the feed has passed its first peak: the run-up is over.
_FALLS = 5e-3


@dataclass(frozen=True, eq=False)
class SpeedTrace:
    """The tool's speed along a stretch of a row.

    Attributes
    ----------
    t : (k,) ndarray
        Ascending (s).
    speed : (k,) ndarray
        m/s; of a row on which the tool turns on the spot, that at which its s grows.
    noise : (k,) ndarray
        By how much each may be off (m/s).
    span : (k,) ndarray
        Over what time around it each is a mean (s); 0 where it is the speed then.
    """

    t: NDArray[np.float64]
    speed: NDArray[np.float64]
    noise: NDArray[np.float64]
    span: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LimitShares:
    """What share of its limits each joint takes over time; what is not known is 0.

    Attributes
    ----------
    start, end : (m,) ndarray
        From and to when (s), ascending.
    share : (3, m, n) ndarray
        The largest then, of velocity, acceleration and jerk.
    """

    start: NDArray[np.float64]
    end: NDArray[np.float64]
    share: NDArray[np.float64]

    @cached_property
    def near(self) -> NDArray[np.float64]:
        """The largest share of each interval over what counts as near a limit, (m,)."""
        return (self.share.max(axis=2) / _NEAR_LIMIT[:, None]).max(axis=0)

    def largest(self, first: float, last: float) -> tuple[float, int, int]:
        """Return the largest share between two times, its order (0 velocity) and joint, by what counts as near."""
        begin = int(np.searchsorted(self.end, first))
        part = self.share[:, begin : max(begin + 1, int(np.searchsorted(self.start, last, side="right")))]
        if not part.size:
            return float("nan"), 0, -1
        weighed = part.max(axis=1) / _NEAR_LIMIT[:, None]
        order, joint = divmod(int(weighed.argmax()), part.shape[2])
        return float(part[order, :, joint].max()), order, joint


@dataclass(frozen=True)
class FeedFault:
    """Where the speed is wrong: the first time (s), the worst speed there (m/s), and at how many places."""

    time: float
    speed: float
    count: int


@dataclass(frozen=True)
class SlowPlace:
    """Where the tool is slowest between the run-ups, and what binds there.

    Attributes
    ----------
    time, speed : float
        s, m/s.
    joint : int
        -1 where none is near a limit.
    limit : str
        ``"velocity"``, ``"acceleration"`` or ``"jerk"``.
    share : float
        Of it.
    """

    time: float
    speed: float
    joint: int
    limit: str
    share: float


@dataclass(frozen=True, eq=False)
class FeedFigures:
    """The speed of the tool along one stretch of a row.

    Attributes
    ----------
    way, kept : float
        How far the tool goes (m), and at the feed for how much of it.
    deviation, time : float
        Largest share by which the speed is off the feed away from the ends, where no joint limits it (s); NaN if
        that is nowhere.
    largest : float
        The largest speed (m/s).
    slowest : SlowPlace or None
        Between the run-ups at either end; None on a stretch that is too short for its feed.
    too_fast, too_slow : FeedFault or None
    """

    way: float
    kept: float
    deviation: float
    time: float
    largest: float
    slowest: SlowPlace | None
    too_fast: FeedFault | None
    too_slow: FeedFault | None


def judge_feed(trace: SpeedTrace, feed: float, limits: LimitShares, spacing: float) -> FeedFigures | None:
    """Return how a stretch of a row is passed; None if nothing is told of it.

    Parameters
    ----------
    trace : SpeedTrace
    feed : float
        m/s.
    limits : LimitShares
    spacing : float
        Between two points of the row (m).
    """
    t, speed, noise = trace.t, trace.speed, trace.noise
    if len(t) < 3:
        return None
    steps = 0.5 * (speed[1:] + speed[:-1]) * np.diff(t)
    # a mean over a time belongs to all of the way passed in it
    half = 0.5 * trace.span * speed
    way = half[0] + np.concatenate([[0.0], np.cumsum(steps)])
    length = float(way[-1] + half[-1])
    off = speed / feed - 1
    slack = noise / feed
    end = min(_END, _END_SHARE * length) + min(max(_END_TIME * feed - _END, 0.0), _MORE_SHARE * length)
    inside = (way - half >= end) & (way + half <= length - end)
    fast, slow = off > FEED_KEPT + slack, inside & (off < -FEED_KEPT - slack)
    reach = min(spacing, _NEAR_SHARE * length)
    excused = slow & _near_a_limit(trace, way, limits, reach) if slow.any() else slow
    slow = slow & ~excused
    judged = np.where(inside & ~excused, np.abs(off) - slack, -np.inf)
    at = int(judged.argmax())
    found = bool(np.isfinite(judged[at]))
    kept = np.abs(off) <= FEED_KEPT + slack
    return FeedFigures(
        way=length,
        kept=float(steps[kept[1:] & kept[:-1]].sum()),
        deviation=float(max(judged[at], 0.0)) if found else float("nan"),
        time=float(t[at]) if found else float("nan"),
        largest=float(speed.max()),
        slowest=_slowest(trace, way, feed, limits, reach),
        too_fast=_fault(fast, trace, off),
        too_slow=_fault(slow, trace, off),
    )


def _fault(which: NDArray[np.bool_], trace: SpeedTrace, off: NDArray[np.float64]) -> FeedFault | None:
    if not which.any():
        return None
    worst = int(np.where(which, np.abs(off), 0.0).argmax())
    return FeedFault(float(trace.t[int(which.argmax())]), float(trace.speed[worst]), int(which.sum()))


def _near_a_limit(trace: SpeedTrace, way: NDArray[np.float64], limits: LimitShares, reach: float) -> NDArray[np.bool_]:
    """Return at which places a joint is near a limit, within the time or the way in which that counts."""
    near = np.flatnonzero(limits.near >= 1.0)
    excused = np.zeros(len(trace.t), dtype=bool)
    near_time = _NEAR_TIME + 0.5 * float(trace.span.max())
    near = near[(limits.end[near] >= trace.t[0] - near_time) & (limits.start[near] <= trace.t[-1] + near_time)]
    if not len(near):
        return excused
    start, end = limits.start[near], limits.end[near]
    first = np.minimum(
        np.searchsorted(trace.t, start - near_time), np.searchsorted(way, np.interp(start, trace.t, way) - reach)
    )
    last = np.maximum(
        np.searchsorted(trace.t, end + near_time, side="right"),
        np.searchsorted(way, np.interp(end, trace.t, way) + reach, side="right"),
    )
    change = np.bincount(first, minlength=len(excused) + 1) - np.bincount(last, minlength=len(excused) + 1)
    return np.cumsum(change[: len(excused)]) > 0


def _slowest(
    trace: SpeedTrace, way: NDArray[np.float64], feed: float, limits: LimitShares, reach: float
) -> SlowPlace | None:
    """Return where the tool is slowest from where it first reaches the feed, or falls, to where it last does."""
    first, last = _run_up(trace.speed, feed), len(trace.t) - 1 - _run_up(trace.speed[::-1], feed)
    if first > last:
        return None
    at = first + int(trace.speed[first : last + 1].argmin())
    time = float(trace.t[at])
    share, order, joint = limits.largest(time, time)
    if not share >= _NEAR_LIMIT[order]:
        places = np.searchsorted(way, [way[at] - reach, way[at] + reach])
        around = trace.t[np.clip(places, 0, len(way) - 1)]
        share, order, joint = limits.largest(
            min(time - _NEAR_TIME, float(around[0])), max(time + _NEAR_TIME, float(around[1]))
        )
    bound = share >= _NEAR_LIMIT[order]
    return SlowPlace(
        time, float(trace.speed[at]), joint if bound else -1, ("velocity", "acceleration", "jerk")[order], share
    )


def _run_up(speed: NDArray[np.float64], feed: float) -> int:
    """Return the first place at which the tool is at the feed, or after which it becomes slower."""
    highest = np.maximum.accumulate(speed)
    over = (speed >= feed * (1 - FEED_KEPT)) | (speed < highest - _FALLS * feed)
    if not over.any():
        return len(speed)
    at = int(over.argmax())
    return int(speed[: at + 1].argmax())
