"""The account of a graph search."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["GraphRecord", "SearchCount"]


@dataclass(frozen=True)
class SearchCount:
    """What one density of sampling led to.

    Attributes
    ----------
    density : int
        Times the first sampling's.
    samples : int
        Solutions kept, over all knots.
    inside, row_ends : int
        Reconfigurations of the best path among them, as it would be driven.
    seconds : float
        Spent in reconfigurations and over points not reached, from rest to rest.
    """

    density: int
    samples: int
    inside: int
    row_ends: int
    seconds: float


@dataclass(frozen=True, eq=False)
class GraphRecord:
    """How the graph search went.

    Attributes
    ----------
    knots : int
        Poses searched.
    counts : tuple of SearchCount
        One for each density that was tried.
    inside, row_ends : int
        Reconfigurations that remain.
    proven : bool
        Whether no path has fewer reconfigurations, inside rows and at row ends: every point is reached and there are
        none.
    largest_steps : tuple of float
        Largest velocity-scaled step after the search and after each round of refinement (rad).
    """

    knots: int
    counts: tuple[SearchCount, ...]
    inside: int
    row_ends: int
    proven: bool
    largest_steps: tuple[float, ...]
