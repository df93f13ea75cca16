"""Ways off the surface: back along a prismatic joint, up along the normal, or one after the other."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from qparm.ik import PoseSolver
from qparm.path import joint_curve
from qparm.planning.moves.clearance import Distance, ToolDistance, rises, stays_clear
from qparm.robot.limits import rest_to_rest_time

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.robot import SerialChain

__all__ = ["MARGIN", "Escape", "chord_parameter", "escapes", "piece_time"]

# A way off ends this much farther out than it must (m): room for the bound by which the rest is checked.
MARGIN = 1e-3
# Between two places of a way off that are looked at (m).
_LOOK = 5e-4
# Between two poses of a lift (m), the greatest height it is tried to, and how many poses it has at least.
_RISE, _HIGHEST, _FEWEST = 5e-3, 0.15, 6
# So many times closer are they where nothing else is found: straight lines between them bend less.
_FINER = 4
# A lift whose joints step farther (share of a second at full speed) passes a singularity: it ends there.
_LARGEST_STEP = 0.35
# A tilted lift keeps so close to the normal at its waypoints (m).
_ON_NORMAL = 1e-6
# A straight line in joint space stands for a lift if the tool keeps so close to the normal (share of the height).
_STRAIGHT = 0.1


@dataclass(frozen=True, eq=False)
class Escape:
    """A way off the surface.

    Attributes
    ----------
    kind : str
        ``"rail retreat"``, ``"normal lift"`` (``"tool axis lift"`` where no surface is known), ``"tilted lift"``
        (the tool's rotation is given up where the arm cannot keep it), ``"both"`` or ``"free"``: already away from the
        workpiece.
    pieces : tuple of (k, n) ndarray
        From the surface outwards, each from rest to rest; the distance grows all the way, but on the last of
        ``"both"``, which keeps the clearance. None if free.
    q : (n,) ndarray
        Where it ends (m, rad).
    time : float
        s.
    travels : int
        How many of the last pieces travel, at a distance that need not grow.
    """

    kind: str
    pieces: tuple[NDArray[np.float64], ...]
    q: NDArray[np.float64]
    time: float
    travels: int = 0

    def roles(self, off: str) -> list[str]:
        """Return what each piece does: ``off``, or it travels."""
        return [off] * (len(self.pieces) - self.travels) + ["travel"] * self.travels


def chord_parameter(chain: SerialChain, Q: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the parameter of a piece's curve at its waypoints (k, n): chords in joint speeds, from 0, (k,)."""
    steps = np.linalg.norm(np.diff(Q, axis=0) / chain.velocity, axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def piece_time(chain: SerialChain, Q: NDArray[np.float64]) -> float:
    """Return the time of a piece from rest to rest (s): of a curve, as if each joint kept its steepest slope."""
    if len(Q) == 2:
        return float(rest_to_rest_time(chain, Q[0], Q[1]))
    s = chord_parameter(chain, Q)
    steepest = (np.abs(np.diff(Q, axis=0)) / np.diff(s)[:, None]).max(axis=0)
    return float(rest_to_rest_time(chain, np.zeros(chain.n), steepest * s[-1]))


def escapes(
    chain: SerialChain,
    q: NDArray[np.float64],
    *,
    distance: Distance | None,
    clearance: float,
) -> tuple[list[Escape], list[str]]:
    """Return the ways off the surface that end beyond the clearance.

    Parameters
    ----------
    chain : SerialChain
    q : (n,) ndarray
        A configuration whose tool is at the surface (m, rad).
    distance : Distance or None
        See :class:`qparm.planning.moves.clearance.Distance`; where it is None the tool's own -z is the only way off.
    clearance : float
        m.

    Returns
    -------
    ways : list of Escape
    refused : list of str
        For each kind of way that there is not, why.
    """
    pose = chain.forward(q)
    if distance is None:
        origin, normal = pose[:3, 3], -pose[:3, 2]
        height = ToolDistance(chain, lambda points: (points - origin) @ normal)
        return _lifts(chain, q, pose, height, clearance, along="tool axis")
    start = float(distance(q[None])[0])
    if start >= clearance + MARGIN:
        return [Escape("free", (), q, 0.0)], []
    retreats, refused = _retreats(chain, q, distance, clearance)
    lifts, why = _lifts(chain, q, pose, distance, clearance)
    both = [further for lift in lifts[:1] for further in _retreats_after(chain, lift, distance, clearance)]
    return [*retreats, *lifts, *both], refused + why


def _retreats(
    chain: SerialChain, q: NDArray[np.float64], distance: Distance, clearance: float
) -> tuple[list[Escape], list[str]]:
    """Return straight retreats by each prismatic joint: as far as needed, half as far again as it goes, all the way."""
    ways, refused = [], []
    for i in np.flatnonzero(chain.prismatic):
        most = 0.0
        for end in (chain.lower[i], chain.upper[i]):
            travel = abs(end - q[i])
            if travel < _LOOK:
                continue
            Q = np.repeat(q[None], int(np.ceil(travel / _LOOK)) + 1, axis=0)
            Q[:, i] = np.linspace(q[i], end, len(Q))
            d = distance(Q)
            falls = np.flatnonzero(np.diff(d) < 0)
            # the top may lie between the last two places that still rise
            last = max(0, int(falls[0]) - 1) if len(falls) else len(Q) - 1
            far = np.flatnonzero(d[: last + 1] >= clearance + MARGIN)
            most = max(most, float(d[last]))
            if len(far):
                depths = sorted({int(far[0]), (int(far[0]) + last) // 2, last})
                ways += [_escape(chain, "rail retreat", (np.stack([q, Q[k]]),)) for k in depths]
        if not any(way.pieces[0][1, i] != q[i] for way in ways):
            refused.append(
                f"joint {chain.names[i]!r} at {q[i] * 1e3:.0f} mm takes the tool no farther than {most * 1e3:.1f} mm"
                " away"
            )
    return ways, refused


def _retreats_after(chain: SerialChain, lift: Escape, distance: Distance, clearance: float) -> list[Escape]:
    """Return what a lift and a retreat after it give: half the travel, and all of it."""
    ways = []
    for i in np.flatnonzero(chain.prismatic):
        for end in (chain.lower[i], chain.upper[i]):
            for share in (0.5, 1.0):
                q = lift.q.copy()
                q[i] += share * (end - q[i])
                farther = distance(np.stack([lift.q, q]))
                if farther[1] > farther[0] and stays_clear(lift.q, q, distance=distance, least=clearance):
                    ways.append(_escape(chain, "both", (*lift.pieces, np.stack([lift.q, q])), travels=1))
    return ways


def _lifts(
    chain: SerialChain, q: NDArray[np.float64], pose: NDArray[np.float64], distance: Distance, clearance: float,
    *, along: str = "normal",
) -> tuple[list[Escape], list[str]]:  # fmt: skip
    """Return lifts along the tool's -z, as high as needed and as high as the arm goes; tilted ones if no other is.

    ``along`` is what the tool's axis is called: where no surface is known it is no more than that.
    """
    normal = -pose[:3, 2]
    need = clearance + MARGIN
    ways: list[Escape] = []
    highest = 0.0
    climbs = ((f"{along} lift", _climb_in_pose), ("tilted lift", _climb_in_position))
    # in one motion if there is one; else in several, and in finer steps
    for (lift, finer), (kind, climb) in product(((_in_one, 1), (_in_several, 1), (_in_several, _FINER)), climbs):
        rise = min(_RISE, need / _FEWEST) / finer
        Q = climb(chain, q, pose, rise * normal, int(np.ceil(max(_HIGHEST, 2.0 * need) / rise)))
        heights = distance(Q)
        highest = max(highest, float(heights.max()))
        far = np.flatnonzero(heights >= need)
        for k in sorted({int(far[0]), len(Q) - 1}) if len(far) else ():
            pieces = lift(chain, Q[: k + 1], normal, distance)
            if pieces:
                ways.append(_escape(chain, kind, pieces))
        if ways:
            return ways, []
    if highest >= need:
        return [], [f"a lift along the {along} leaves the joint limits or does not rise all the way"]
    return [], [f"along the {along} the arm lifts the tool no higher than {highest * 1e3:.1f} mm"]


def _climb_in_pose(
    chain: SerialChain, q: NDArray[np.float64], pose: NDArray[np.float64], rise: NDArray[np.float64], count: int
) -> NDArray[np.float64]:
    """Return configurations (k, n), k <= count + 1, that lift the pose by ``rise`` (3,) each, its rotation kept."""
    solver = PoseSolver(chain, method="dls", max_iterations=30)
    Q, target = [q], pose.copy()
    for k in range(1, count + 1):
        target[:3, 3] = pose[:3, 3] + k * rise
        solution = solver.solve(target, Q[-1])
        if not solution.reached or (np.abs(solution.q - Q[-1]) > _LARGEST_STEP * chain.velocity).any():
            break
        Q.append(solution.q)
    return np.stack(Q)


def _climb_in_position(
    chain: SerialChain, q: NDArray[np.float64], pose: NDArray[np.float64], rise: NDArray[np.float64], count: int
) -> NDArray[np.float64]:
    """Return the same with the rotation left free: least-norm steps of the joints that are not at a limit."""
    Q = [q]
    for k in range(1, count + 1):
        moved, free = Q[-1].copy(), np.ones(chain.n, dtype=bool)
        for _ in range(2 * chain.n):
            missing = pose[:3, 3] + k * rise - chain.forward(moved)[:3, 3]
            if np.linalg.norm(missing) < _ON_NORMAL:
                break
            J = chain.jacobian(moved)[:3] * chain.velocity * free
            step = moved + chain.velocity * (J.T @ np.linalg.lstsq(J @ J.T, missing, rcond=1e-9)[0])
            stopped = free & ((step < chain.lower) | (step > chain.upper))
            if stopped.any():  # a joint that would leave its range stays where it is, the others take over
                free &= ~stopped
            else:
                moved = step
        else:
            break
        if (np.abs(moved - Q[-1]) > _LARGEST_STEP * chain.velocity).any():
            break
        Q.append(moved)
    return np.stack(Q)


def _in_one(
    chain: SerialChain, Q: NDArray[np.float64], normal: NDArray[np.float64], distance: Distance
) -> tuple[NDArray[np.float64], ...]:
    """Return the lift through waypoints (k, n) as one line in joint space, or one curve; nothing if neither will do.

    A line is preferred: all joints move in one profile, and limits hold on it because they hold at its ends.
    """
    if _is_lift(chain, Q, normal, distance):
        return (Q[[0, -1]],)
    if len(Q) < _FEWEST:
        return ()
    s = chord_parameter(chain, Q)
    curve = np.asarray(joint_curve(s, Q)(_places(len(Q))[:, 0] * s[-1]))
    return (Q,) if chain.within_limits(curve[:-1], tolerance=1e-12).all() and rises(distance(curve)) else ()


def _in_several(
    chain: SerialChain, Q: NDArray[np.float64], normal: NDArray[np.float64], distance: Distance
) -> tuple[NDArray[np.float64], ...]:
    """Return the lift as straight lines strung together, each as long as it can be, the arm at rest between them.

    A curve swings beyond a limit that a joint rests at; lines do not.
    """
    pieces, first = [], 0
    while first < len(Q) - 1:
        onwards = range(len(Q) - 1, first, -1)
        last = next((k for k in onwards if _is_lift(chain, Q[first : k + 1], normal, distance)), None)
        if last is None:
            return ()
        pieces.append(Q[[first, last]])
        first = last
    return tuple(pieces)


def _places(count: int) -> NDArray[np.float64]:
    """Return shares of the way through so many waypoints, and one beyond its end.

    A top between the last two would not show otherwise.
    """
    return (np.arange(10 * count + 2) / (10 * count))[:, None]


def _is_lift(chain: SerialChain, Q: NDArray[np.float64], normal: NDArray[np.float64], distance: Distance) -> bool:
    """Return whether the straight line from first to last lifts the tool along the normal, rising all the way."""
    line = Q[0] + _places(len(Q)) * (Q[-1] - Q[0])
    p = chain.forward(line)[:, :3, 3]
    way = p - p[0]
    aside = np.linalg.norm(way - np.outer(way @ normal, normal), axis=1).max()
    return bool(aside <= _STRAIGHT * np.linalg.norm(way[-2]) and rises(distance(line)))


def _escape(chain: SerialChain, kind: str, pieces: tuple[NDArray[np.float64], ...], *, travels: int = 0) -> Escape:
    return Escape(kind, pieces, pieces[-1][-1], sum(piece_time(chain, piece) for piece in pieces), travels)
