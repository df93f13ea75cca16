"""The jump criterion of each edge of a tool path: an angle; for the paper's strategies also a time.

A reconfiguration is a matter of geometry: the joints cannot follow the tool path from one pose to the next, at
whatever speed. So what is searched, smoothed and driven is held to the angle alone, and where a joint is too slow the
feed gives way. The paper takes 50 degrees and says that it follows from the distance of the points and the largest
joint speed; ``reverse`` and ``general`` choose by both, ``min(jump, velocity ds / feed)`` for every joint, the rail by
its own travel and speed.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from qparm.errors import InvalidInput

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.path import ToolPath
    from qparm.robot import SerialChain

__all__ = ["check_criteria", "jump_criteria", "jump_ratios", "jumps_between"]


def jump_criteria(
    chain: SerialChain, tool_path: ToolPath, jump: NDArray[np.float64], *, feed: float | None = None
) -> NDArray[np.float64]:
    """Return the largest joint step that is no jump, for every edge.

    Parameters
    ----------
    chain : SerialChain
    tool_path : ToolPath
    jump : (n,) or (P - 1, n) ndarray
        The criterion that holds everywhere (m, rad), such as ``cell.jump()``; or what holds for each edge as it is.
    feed : float, optional
        Speed of the tool inside the rows (m/s). With it no joint may turn farther than it can in an edge's time, as
        the paper has it.

    Returns
    -------
    (P - 1, n) ndarray
        Entry k is for the edge from point k to the next. Across a row end, which has a time of its own, it is ``jump``
        for each step from one via pose to the next.

    Raises
    ------
    InvalidInput
        If ``jump`` or ``feed`` is not positive, or a shape does not fit.
    """
    if feed is not None and not (math.isfinite(feed) and feed > 0):
        raise InvalidInput(f"feed must be finite and positive, not {feed}")
    criteria = np.array(check_criteria(chain, tool_path, jump))
    crossed = np.diff(tool_path.row_of_point) != 0
    if np.ndim(jump) == 1:
        criteria[crossed] *= np.array([1.0 + len(transition.s) for transition in tool_path.transitions])[:, None]
    if feed is None:
        return criteria
    inside = np.flatnonzero(~crossed)
    seconds = np.abs(tool_path.s[inside + 1] - tool_path.s[inside]) / feed
    criteria[inside] = np.minimum(criteria[inside], chain.velocity * seconds[:, None])
    return criteria


def check_criteria(chain: SerialChain, tool_path: ToolPath, jump: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return criteria as (P - 1, n) after checking them; (n,) holds for every edge.

    Raises
    ------
    InvalidInput
        If the shape does not fit or an entry is not positive; infinity stands for no criterion.
    """
    edges, n = tool_path.point_count - 1, chain.n
    criteria = np.asarray(jump, dtype=float)
    if criteria.shape not in ((n,), (edges, n)):
        raise InvalidInput(f"jump must be ({n},) or ({edges}, {n}), not {criteria.shape}")
    if not (criteria > 0).all():
        where = tuple(int(i) for i in np.argwhere(~(criteria > 0))[0])
        edge = f"edge {where[0]}, " if len(where) == 2 else ""
        raise InvalidInput(f"jump, {edge}joint {chain.names[where[-1]]!r}: {criteria[where]} is not positive")
    return np.ascontiguousarray(np.broadcast_to(criteria, (edges, n)))


def jumps_between(jump: NDArray[np.float64], at: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the criteria between some of the points: those of the edges between them add up.

    Parameters
    ----------
    jump : (P - 1, n) ndarray
        Of the edges between neighbouring points (m, rad).
    at : (K,) ndarray of int
        Points, ascending.

    Returns
    -------
    (K - 1, n) ndarray
    """
    summed = np.concatenate([np.zeros((1, jump.shape[1])), np.cumsum(jump, axis=0)])
    return np.ascontiguousarray(summed[at[1:]] - summed[at[:-1]])


def jump_ratios(a: NDArray[np.float64], b: NDArray[np.float64], criterion: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the step from ``a`` to ``b`` over its criterion, the worst joint's: (...), a jump if over 1."""
    return (np.abs(b - a) / criterion).max(axis=-1)
