"""How fast the tool goes along rows: at the feed, but for their ends and where a joint can no faster."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["FEED_KEPT", "FeedFigures", "measure_feed"]

# The feed is kept within this share, and at the ends of rows not exceeded by more than that.
FEED_KEPT, _AT_ENDS = 1e-3, 5e-3
# The ends of a row: this long (m), and no longer than this share of it.
_END, _END_SHARE = 0.01, 0.1
# The run-up grows with the feed: the ends are so long at the feed (s) if that is more, by no more than this share.
_END_TIME, _MORE_SHARE = 0.5, 0.15
# Speeds are means over a time in which what a file leaves open is this share of the feed.
_NOISE = 2e-4
# A joint that takes this share of a limit can be why the tool is slower.
_NEAR_LIMIT = 0.75
# So long before and after it is slower for a joint's sake (s), the speed is kept as at the ends of rows: it is smooth.
_SETTLING = 0.1


@dataclass(frozen=True, eq=False)
class FeedFigures:
    """The speed of the tool along one stretch of a row.

    Attributes
    ----------
    deviation, time : float
        Largest share by which the speed is off the feed away from the ends, where no joint limits it (s); NaN if
        that is nowhere.
    at_feed : float
        Share of the way at the feed.
    too_fast, too_slow : tuple of (float, float, int)
        First time (s), worst speed over the feed, and count; empty if there is none.
    """

    deviation: float
    time: float
    at_feed: float
    too_fast: tuple[float, float, int] | tuple[()]
    too_slow: tuple[float, float, int] | tuple[()]


def measure_feed(
    t: NDArray[np.float64],
    s: NDArray[np.float64],
    feed: float,
    blur: float,
    shares: tuple[NDArray[np.float64], NDArray[np.float64]],
) -> FeedFigures | None:
    """Return the speed along a stretch of a row; None if it is too short to tell.

    Parameters
    ----------
    t : (k,) ndarray
        s.
    s : (k,) ndarray
        Where on the row the tool is (m).
    feed : float
        m/s.
    blur : float
        How far each place may be off (m).
    shares : (times (m,), shares (m,))
        The largest share of any limit of any joint over time.
    """
    if len(t) < 3:
        return None
    # over so many places the blur at either end is small
    step = max(1, int(np.ceil(2 * blur / (_NOISE * feed) / float(np.median(np.diff(t))))))
    if len(t) <= 2 * step:
        return None
    span = t[step:] - t[:-step]
    ratio = (s[step:] - s[:-step]) / span / feed
    noise = 2 * blur / (span * feed)
    middle = 0.5 * (t[step:] + t[:-step])
    length = float(s[-1] - s[0])
    end = min(_END, _END_SHARE * length) + min(max(_END_TIME * feed - _END, 0.0), _MORE_SHARE * length)
    inside = (s[:-step] >= s[0] + end) & (s[step:] <= s[-1] - end)
    off = ratio - 1
    fast = off > noise + np.where(inside, FEED_KEPT, _AT_ENDS)
    slow = inside & (off < -noise - FEED_KEPT)
    excused = np.zeros(len(slow), dtype=bool)
    near = np.zeros(len(slow), dtype=bool)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], slow, [False]])))
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        # with the share at either side: a short stretch may have none of its own
        start, stop = np.searchsorted(shares[0], [t[first], t[last - 1 + step]])
        if shares[1][max(start - 1, 0) : stop + 1].max(initial=0.0) >= _NEAR_LIMIT:
            excused[first:last] = True
            near[slice(*np.searchsorted(middle, [middle[first] - _SETTLING, middle[last - 1] + _SETTLING]))] = True
    excused |= near & slow & (off >= -noise - _AT_ENDS)
    slow &= ~excused
    judged = np.where(inside & ~excused, np.abs(off) - noise, -np.inf)
    at = int(judged.argmax())
    way = np.diff(s)
    kept = np.abs(off) <= FEED_KEPT + noise

    def told(which: NDArray[np.bool_]) -> tuple[float, float, int] | tuple[()]:
        if not which.any():
            return ()
        worst = np.where(which, np.abs(off), 0.0).argmax()
        return float(middle[which.argmax()]), float(ratio[worst]), int(which.sum())

    found = bool(np.isfinite(judged[at]))
    return FeedFigures(
        deviation=float(max(judged[at], 0.0)) if found else float("nan"),
        time=float(middle[at]) if found else float("nan"),
        at_feed=float(way[: len(kept)][kept].sum() / max(way.sum(), 1e-12)),
        too_fast=told(fast),
        too_slow=told(slow),
    )
