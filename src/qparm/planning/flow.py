"""Rows that are passed without a stop at their ends: one curve through rows and turns, exact between points too."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from qparm.planning.exact import PoseOf, Stretch, exact_gaps, exact_stretch

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.path.relaxation import Relaxation
    from qparm.robot import SerialChain

__all__ = ["Piece", "flowing"]


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
        See :func:`qparm.planning.exact.exact_stretch`.
    """
    if len(pieces) < 2:
        return list(pieces)
    spans = [float(piece.stretch.s[-1] - piece.stretch.s[0]) for piece in pieces]
    borders = np.concatenate([[0.0], np.cumsum(spans)])
    parts = [piece.stretch for piece in pieces]
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
        local = whole.s[a : b + 1] - borders[k] + piece.stretch.s[0]
        # those that were there keep their places to the last bit
        local[whole.given[a : b + 1]] = piece.stretch.s
        gaps = {name: getattr(whole, name)[a:b] for name in _OF_GAPS}
        stretch = Stretch(local, whole.q[a : b + 1], whole.rho[a : b + 1], own[a : b + 1], **gaps)
        joined.append(replace(piece, stretch=stretch, flows=k < len(pieces) - 1))
    return joined


_OF_GAPS = ("curve_position", "curve_rotation", "linear_position", "linear_rotation")


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
