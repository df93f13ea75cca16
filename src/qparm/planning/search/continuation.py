"""The following of rows that a search leaves broken, from both sides, before a break is accepted.

From the point before a break a bundle of ways (:mod:`qparm.planning.search.bundle`) goes on along the row; from the
point after it, backwards; and from many solutions of the first and the last point of what is broken. If any of them
gets from one end to the other, the row is driven that way. If none does, the pieces that get farthest are taken.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from qparm.planning.search.bundle import Bundle, follow_bundle
from qparm.planning.search.continuity import edge_is_continuous
from qparm.planning.search.sampling import Layer

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.planning.problem import PathProblem
    from qparm.planning.solution import PathSolution

__all__ = ["followed_on", "joined_rows"]

# Ways followed at once from one configuration, and from the samples of an end; ends of them that are looked at.
_NARROW, _WIDE, _ENDS = 32, 96, 12


def followed_on(
    problem: PathProblem, solution: PathSolution, points: range, *, at: NDArray[np.int64] | None = None
) -> Bundle:
    """Return how far the arm gets from its configuration at one point along the row.

    Parameters
    ----------
    problem : PathProblem
    solution : PathSolution
    points : range
        Entries of the solution in the order of travel, of one row, up or down; it starts at the first.
    at : (K,) ndarray of int, optional
        The points that the solution is about; all by default.
    """
    return _Where(problem, at).follow(points, _start(solution, points[0]), _NARROW)


def joined_rows(
    problem: PathProblem,
    solution: PathSolution,
    *,
    at: NDArray[np.int64] | None = None,
    ends: NDArray[np.bool_] | None = None,
    layers: Sequence[Layer] | None = None,
) -> PathSolution:
    """Return a solution without the breaks inside rows that some way along the row does without.

    Parameters
    ----------
    problem : PathProblem
    solution : PathSolution
    at : (K,) ndarray of int, optional
        The points that the solution is about; all by default.
    ends : (K - 1,) ndarray of bool, optional
        Which edges between these are row ends: there the arm may reconfigure.
    layers : sequence of Layer, optional
        Solutions of all of them, to start from.
    """
    where = _Where(problem, at)
    for first, last in _pieces(where, solution, problem.row_ends if ends is None else ends):
        breaks = first + np.flatnonzero(~solution.driven[first:last])
        best, fewest = solution, len(breaks)
        for count, found in _ways(where, solution, first, last, breaks, layers):
            if count < fewest:
                best, fewest = found, count
                if not count:
                    break
        solution = best
    return solution


@dataclass(frozen=True, eq=False)
class _Where:
    """What a solution is about."""

    problem: PathProblem
    at: NDArray[np.int64] | None

    @property
    def row(self) -> NDArray[np.int64]:
        row = self.problem.tool_path.row_of_point
        return row if self.at is None else row[self.at]

    def follow(self, points: range, starts: Layer, width: int) -> Bundle:
        """Follow the path over some entries, in the order of travel."""
        entries = np.array(points)
        own = entries if self.at is None else self.at[entries]
        tool_path = self.problem.tool_path
        row = int(tool_path.row_of_point[own[0]])
        # the same draws whatever was drawn before
        return follow_bundle(
            self.problem.chain, lambda s: tool_path.pose(row, s), tool_path.s[own], starts,
            relaxation=self.problem.relaxation, rng=np.random.default_rng(0), width=width,
        )  # fmt: skip

    def put(self, solution: PathSolution, points: range, bundle: Bundle) -> PathSolution:
        """Return a solution that goes a bundle's way, of several the one with the most row ends driven."""
        entries = np.array(points)[: len(bundle.layers)]
        order = np.argsort(entries)
        entries = entries[order]
        best, most = solution, -1
        for end in range(min(_ENDS, len(bundle.layers[-1].q))):
            q, rho, driven = solution.q.copy(), solution.rho.copy(), solution.driven.copy()
            way, lean = bundle.way(end)
            q[entries], rho[entries] = way[order], lean[order]
            driven[entries[:-1]] = True
            found = replace(solution, q=q, rho=rho, driven=driven)
            outer = [int(k) for k in (entries[0] - 1, entries[-1]) if 0 <= k < len(driven)]
            for k in outer:
                driven[k] = bool(solution.reached[k] and solution.reached[k + 1]) and edge_is_continuous(
                    self.problem, found, k, at=self.at
                )
            count = int(driven[outer].sum())
            if count > most:
                best, most = found, count
            if most == len(outer):
                break
        return best


def _pieces(where: _Where, solution: PathSolution, ends: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return the pieces of rows that are reached throughout and broken somewhere inside: first and last entry."""
    row = where.row
    # what lies in a self-motion area need not be driven
    together = solution.reached[:-1] & solution.reached[1:] & (row[:-1] == row[1:]) & ~ends
    borders = np.flatnonzero(~together)
    firsts, lasts = np.concatenate([[0], borders + 1]), np.concatenate([borders, [len(row) - 1]])
    return [(int(a), int(b)) for a, b in zip(firsts, lasts, strict=True) if b > a and not solution.driven[a:b].all()]


def _ways(
    where: _Where,
    solution: PathSolution,
    first: int,
    last: int,
    breaks: NDArray[np.int64],
    layers: Sequence[Layer] | None,
) -> Iterator[tuple[int, PathSolution]]:
    """Yield ways along a piece of a row, with how often each is broken."""
    for number, k in enumerate(breaks.tolist()):
        for before, points in (
            (number, range(k, last + 1)),
            (len(breaks) - 1 - number, range(k + 1, first - 1, -1)),
        ):
            found = where.follow(points, _start(solution, points[0]), _NARROW)
            if found.arrived:
                yield before, where.put(solution, points, found)
    for step in (1, -1):
        way, count, points = solution, -1, range(first, last + 1)[::step]
        while len(points):
            start = _start(solution, points[0])
            if layers is not None:
                own = layers[points[0]]
                start = Layer(np.concatenate([start.q, own.q]), np.concatenate([start.rho, own.rho]))
            found = where.follow(points, start, _WIDE)
            way, count, points = where.put(way, points, found), count + 1, points[len(found.layers) :]
            if count >= len(breaks):
                break
        yield count, way


def _start(solution: PathSolution, k: int) -> Layer:
    return Layer(solution.q[k : k + 1], solution.rho[k : k + 1])
