"""The feed of a row: the speed of the tool's own point, slower only where a joint is near one of its limits."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from comparisons.soak.kinematics import Cell

__all__ = ["Judge", "judge_feed"]

# Faster than the feed by this share is wrong anywhere, slower only between run-ups and away from limits.
_FASTER, _SLOWER = 0.005, 1.5e-3
# A joint is near a limit from this share of it on, and so are the moments around (s): accelerations lag behind jerk.
_NEAR, _AROUND = 0.75, 0.1
_LIMITS = ("velocity", "acceleration", "jerk")


class Judge:
    """Collects what is wrong, and figures.

    Attributes
    ----------
    wrong : list of str
    figures : dict of str to float
    """

    def __init__(self) -> None:
        self.wrong: list[str] = []
        self.figures: dict[str, Any] = {}

    def that(self, name: str, value: float, limit: float) -> None:
        """Note a figure, and as wrong where it is beyond its limit."""
        self.figures[name] = float(value)
        if not value <= limit:
            self.wrong.append(f"{name}: {value:.6g} > {limit:.6g}")

    def most(self, name: str, value: float) -> None:
        """Note the largest of a figure."""
        self.figures[name] = max(self.figures.get(name, -np.inf), float(value))


def judge_feed(
    judge: Judge,
    cell: Cell,
    report: dict[str, Any],
    row: int,
    t: NDArray[np.float64],
    states: Sequence[NDArray[np.float64]],
    azimuth: NDArray[np.float64],
) -> None:
    """Judge one passage of a row.

    Parameters
    ----------
    judge : Judge
    cell : Cell
    report : dict
        ``report.json``: where it says that the feed gives way because of a joint, that joint must be near its limit.
    row : int
    t : (N,) ndarray
        Seconds.
    states : sequence of four (N, n) ndarray
        Positions, velocities, accelerations, jerks.
    azimuth : (N,) ndarray
        Of the tool on the zone (rad).
    """
    _, _, jacobian = cell.jacobian(states[0])
    speed = np.linalg.norm(np.einsum("tij,tj->ti", jacobian[:, :3], states[1]), axis=1) / cell.feed
    shares = np.stack([np.abs(state) / limit for state, limit in zip(states[1:], _limits(cell), strict=True)])
    way = np.abs(azimuth - azimuth[0]) * cell.r * np.cos(cell.els[row])
    total = way[-1]
    margin = min(0.01, 0.1 * total) if cell.feed <= 0.02 + 1e-12 else min(max(0.5 * cell.feed, 0.01), total / 4)
    judge.most("feed exceeded by", speed.max() - 1)
    if speed.max() > 1 + _FASTER:
        judge.wrong.append(
            f"feed: the tool is {speed.max():.4f} times as fast on row {row} at {t[speed.argmax()]:.3f} s"
        )
    judged = (way > margin) & (way < total - margin) & ~_around(t, shares.max(axis=(0, 2)) >= _NEAR)
    if judged.any():
        slow = np.where(judged, 1 - speed, -np.inf)
        judge.most("feed missed by, with no joint near a limit", slow.max())
        if slow.max() > _SLOWER:
            at = int(slow.argmax())
            judge.wrong.append(
                f"feed: {speed[at]:.4f} of it on row {row} at {t[at]:.3f} s, {way[at] * 1e3:.2f} of {total * 1e3:.1f}"
                f" mm, the largest share of a joint's limit {shares[:, at].max():.3f}"
            )
    for name, limit, moment in _named(report, row, t):
        share = shares[_LIMITS.index(limit), np.abs(t - moment) <= _AROUND, cell.names.index(name)].max(initial=0.0)
        if share < _NEAR:
            judge.wrong.append(
                f"feed: said to give way on row {row} at {moment:.3f} s because of the {limit} of {name}, which has a"
                f" share of {share:.3f} there"
            )


def _limits(cell: Cell) -> tuple[NDArray[np.float64], ...]:
    return cell.vmax, cell.amax, cell.jmax


def _around(t: NDArray[np.float64], busy: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which moments are near a busy one."""
    at = t[busy]
    if not len(at):
        return np.zeros(len(t), dtype=bool)
    after = np.searchsorted(at, t)
    before, next_ = at[np.maximum(after - 1, 0)], at[np.minimum(after, len(at) - 1)]
    return np.minimum(np.abs(t - before), np.abs(t - next_)) <= _AROUND


def _named(report: dict[str, Any], row: int, t: NDArray[np.float64]) -> list[tuple[str, str, float]]:
    """Return joint, limit and time (s) where the report says that the feed gives way within this passage."""
    feed = report.get("measured", {}).get("feed")
    rows = feed.get("rows", []) if isinstance(feed, dict) else []
    return [
        (one["joint"], one["limit"], one["time"])
        for one in rows
        if one["row"] == row and one.get("joint") and one.get("limit") in _LIMITS and t[0] <= one["time"] <= t[-1]
    ]
