"""Flowing rows, passed without a stop at their ends: one curve through rows and turns, exact between points too."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from qparm.path import joint_curve
from qparm.planning.interpolation.exact import PoseOf, Stretch, exact_gaps, exact_stretch
from qparm.planning.search.projection import project
from qparm.planning.tolerances import EXACT_POSE

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.path.relaxation import Relaxation
    from qparm.robot import SerialChain

__all__ = ["Piece", "flowing"]

# Next to a short gap of the neighbouring piece each gap is at most so many times the one before it: a curve through
# waypoints a millimetre apart that goes on to the next one after twenty swings there, in all joints.
_GROWTH = 2.0


@dataclass(frozen=True, eq=False)
class Piece:
    """A run of a row or a transition, by itself.

    Attributes
    ----------
    stretch : Stretch
    pose_of : callable
        The nominal poses at its s, base frame.
    flows : bool
        Whether the next piece follows without a stop.
    """

    stretch: Stretch
    pose_of: PoseOf
    flows: bool = False


def flowing(
    chain: SerialChain,
    pieces: Sequence[Piece],
    *,
    relaxation: Relaxation,
    position: float,
    rotation: float,
    for_linear: bool = False,
) -> list[Piece]:
    """Return pieces that follow each other as pieces of one curve, with the waypoints added that it needs.

    Where one curve cannot keep the tolerances or the joint limits, it stops at both ends of the piece in question.

    Parameters
    ----------
    chain : SerialChain
    pieces : sequence of Piece
        Each beginning where the one before ends, along the same direction.
    relaxation, position, rotation, for_linear
        See :func:`qparm.planning.interpolation.exact.exact_stretch`.
    """
    if len(pieces) < 2:
        return list(pieces)
    spans = [float(piece.stretch.s[-1] - piece.stretch.s[0]) for piece in pieces]
    borders = np.concatenate([[0.0], np.cumsum(spans)])
    parts = [_graded(chain, pieces, k, relaxation) for k in range(len(pieces))]
    s = np.concatenate([[0.0], *(at + part.s[1:] - part.s[0] for at, part in zip(borders, parts, strict=False))])
    kept = [slice(int(k > 0), None) for k in range(len(parts))]
    q, rho, given = (
        np.concatenate([getattr(part, name)[k] for part, k in zip(parts, kept, strict=True)])
        for name in ("q", "rho", "given")
    )

    def pose_of(x: NDArray[np.float64]) -> NDArray[np.float64]:
        poses = np.empty((len(x), 4, 4))
        at = np.clip(np.searchsorted(borders, x, side="right") - 1, 0, len(pieces) - 1)
        for k in np.unique(at):
            own = at == k
            first, last = parts[k].s[[0, -1]]
            poses[own] = pieces[k].pose_of(np.clip(x[own] - borders[k] + first, first, last))
        return poses

    whole = exact_stretch(
        chain, s, q, rho, pose_of, relaxation=relaxation, position=position, rotation=rotation, for_linear=for_linear
    )
    ends = np.flatnonzero(whole.given)[np.cumsum([0, *(len(part.s) - 1 for part in parts)])]
    exact = exact_gaps(chain, whole, position=position, rotation=rotation)
    bad = [not exact[a:b].all() for a, b in pairwise(ends.tolist())]
    if any(bad):
        return _with_stops(
            chain, pieces, bad, relaxation=relaxation, position=position, rotation=rotation, for_linear=for_linear
        )
    own = np.zeros(len(whole.s), dtype=bool)
    own[whole.given] = given
    joined = []
    for k, (piece, a, b) in enumerate(zip(pieces, ends[:-1].tolist(), ends[1:].tolist(), strict=True)):
        local = whole.s[a : b + 1] - borders[k] + parts[k].s[0]
        # those that were there keep their places to the last bit
        local[whole.given[a : b + 1]] = parts[k].s
        gaps = {name: getattr(whole, name)[a:b] for name in _OF_GAPS}
        stretch = Stretch(local, whole.q[a : b + 1], whole.rho[a : b + 1], own[a : b + 1], **gaps)
        joined.append(replace(piece, stretch=stretch, flows=k < len(pieces) - 1))
    return joined


_OF_GAPS = ("curve_position", "curve_rotation", "linear_position", "linear_rotation")


def _graded(chain: SerialChain, pieces: Sequence[Piece], k: int, relaxation: Relaxation) -> Stretch:
    """Return a piece's stretch with waypoints of its own curve where its neighbours' waypoints are much closer.

    How far its curve is off in the gaps is left open.
    """
    stretch = pieces[k].stretch
    places: list[float] = []
    for end, other, sign in ((0, k - 1, 1.0), (-1, k + 1, -1.0)):
        if not 0 <= other < len(pieces):
            continue
        gap = float(np.diff(pieces[other].stretch.s)[-1 - end])
        own, away = float(np.diff(stretch.s)[end]), 0.0
        while away + 2.0 * _GROWTH * gap <= own:
            gap *= _GROWTH
            away += gap
            places.append(float(stretch.s[end]) + sign * away)
    if not places:
        return stretch
    at = np.unique(places)
    lean = joint_curve(stretch.s, stretch.rho)(at)
    lean = relaxation.clipped(lean) if relaxation.free else np.zeros_like(lean)
    targets = relaxation.targets(pieces[k].pose_of(at), lean)
    start = np.clip(joint_curve(stretch.s, stretch.q)(at), chain.lower, chain.upper)
    q, there = project(
        chain, targets, start, position_tolerance=EXACT_POSE, rotation_tolerance=EXACT_POSE, iterations=25
    )
    place = np.searchsorted(stretch.s, at[there])
    open_gaps = np.full(len(stretch.s) + len(place) - 1, np.nan)
    return Stretch(
        np.insert(stretch.s, place, at[there]),
        np.insert(stretch.q, place, q[there], axis=0),
        np.insert(stretch.rho, place, lean[there], axis=0),
        np.insert(stretch.given, place, False),
        *(open_gaps,) * 4,
    )


def _with_stops(chain: SerialChain, pieces: Sequence[Piece], bad: Sequence[bool], **options: object) -> list[Piece]:
    """Return the pieces with a stop at both ends of the bad ones, flowing in between."""
    done: list[Piece] = []
    group: list[Piece] = []
    for piece, wrong in zip(pieces, bad, strict=True):
        if wrong:
            done += [*flowing(chain, group, **options), piece]  # type: ignore[arg-type]
            group = []
        else:
            group.append(piece)
    return [*done, *flowing(chain, group, **options)]  # type: ignore[arg-type]
