"""A reconfiguration as a motion: the tool leaves the surface, the joints move, the tool returns."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from qparm.errors import InvalidInput
from qparm.planning.moves.clearance import Distance, least_distance
from qparm.planning.moves.detour import connect
from qparm.planning.moves.escape import Escape, chord_parameter, escapes, piece_time

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from qparm.robot import SerialChain

__all__ = ["Motion", "MotionFailure", "plan_motion"]

# A tool point this near to the surface is on it (m): what is shown is a tenth of a millimetre.
_TOUCHES = 5e-5


@dataclass(frozen=True, eq=False)
class Motion:
    """A motion off the surface and back to it.

    Attributes
    ----------
    pieces : tuple of (k, n) ndarray
        Waypoints (m, rad), each piece from rest to rest, the next starting where the one before ends. Two waypoints
        are a straight line in joint space; more are passed on the curve that
        :func:`qparm.path.joint_curve` gives through them.
    parameters : tuple of (k,) ndarray
        The curve's parameter at the waypoints of each piece.
    roles : tuple of str
        ``"leave"`` (the distance grows all the way), ``"travel"`` (the clearance is kept) or ``"return"`` (it falls).
    escape : str
        How the surface is left, and how it is reached again where that differs: ``"rail retreat"``,
        ``"normal lift"``, ``"tool axis lift"``, ``"tilted lift"``, ``"both"``, ``"free"``.
    least_clearance : float
        Least distance of the tool point from the workpiece on the pieces that travel (m); NaN if no surface is known
        or none travels.
    least_at : tuple of (int, float)
        The piece on which it is found, and where on it, from 0 to 1.
    time : float
        Sum of the pieces' times from rest to rest (s).
    """

    pieces: tuple[NDArray[np.float64], ...]
    parameters: tuple[NDArray[np.float64], ...]
    roles: tuple[str, ...]
    escape: str
    least_clearance: float
    least_at: tuple[int, float]
    time: float


@dataclass(frozen=True)
class MotionFailure:
    """No motion was found.

    Attributes
    ----------
    reason : str
        Why, in a sentence, with the distances that were found.
    """

    reason: str


def plan_motion(
    chain: SerialChain,
    q_from: ArrayLike,
    q_to: ArrayLike,
    *,
    distance: Distance | None,
    clearance: float,
    from_surface: bool,
    to_surface: bool,
    rng: np.random.Generator,
) -> Motion | MotionFailure:
    """Plan a motion between two configurations during which the tool point keeps clear of the workpiece.

    The tool leaves the surface back along a prismatic joint or up along its own -z (or the one after the other),
    the joints move in straight lines, and the tool returns. Of all combinations that keep the clearance the one
    of least time is taken; if there is none, ways around over random configurations are searched.

    Parameters
    ----------
    chain : SerialChain
    q_from, q_to : (n,) array_like
        Configurations within the limits (m, rad).
    distance : Distance or None
        How far configurations are from the workpiece (:class:`qparm.planning.moves.clearance.ToolDistance`). None: no
        surface is known, the tool is lifted and nothing else is checked.
    clearance : float
        Distance that the tool point keeps while it travels (m).
    from_surface, to_surface : bool
        Whether the tool is at the surface there; where it is not, as at home, it need not leave it.
    rng : numpy.random.Generator
        Draws the ways around; the same state gives the same motion.

    Returns
    -------
    Motion or MotionFailure

    Raises
    ------
    InvalidInput
        If a configuration does not fit the chain or lies outside its limits, or the clearance is not a length.
    """
    q0 = _checked(chain, q_from, "q_from")
    q1 = _checked(chain, q_to, "q_to")
    if not (np.isfinite(clearance) and clearance >= 0):
        raise InvalidInput(f"clearance must be finite and must not be negative, not {clearance}")
    if not isinstance(rng, np.random.Generator):
        raise InvalidInput("rng must be a seeded numpy.random.Generator: the same seed gives the same answer")
    ways: list[list[Escape]] = []
    for q, at_surface, what in ((q0, from_surface, "leave"), (q1, to_surface, "return to")):
        found, refused = _ends(chain, q, at_surface, distance, clearance)
        if not found:
            no_way = f"no way to {what} the surface: " if at_surface else ""
            return MotionFailure(no_way + "; ".join(refused))
        ways.append(found)
    way = connect(chain, ways[0], ways[1], distance=distance, clearance=clearance, rng=rng)
    if way is None:
        return MotionFailure(
            f"the surface can be left in {len(ways[0])} ways and reached in {len(ways[1])}, but between them no motion"
            f" was found on which the tool keeps {clearance * 1e3:.1f} mm away"
        )
    return _motion(chain, way.leave, way.via, way.arrive, distance)


def _checked(chain: SerialChain, q: ArrayLike, what: str) -> NDArray[np.float64]:
    array = chain.check_one_configuration(q, what=what)
    outside = np.flatnonzero(~chain.within_limits(array, tolerance=1e-12))
    if len(outside):
        i = int(outside[0])
        raise InvalidInput(f"{what}, joint {chain.names[i]!r}: {array[i]} lies outside its limits")
    return array


def _ends(
    chain: SerialChain, q: NDArray[np.float64], at_surface: bool, distance: Distance | None, clearance: float
) -> tuple[list[Escape], list[str]]:
    """Return the ways from an end of the motion to where the joints may move."""
    if at_surface:
        return escapes(chain, q, distance=distance, clearance=clearance)
    if distance is not None:
        d = float(distance(q[None])[0])
        if d < clearance:
            where = f"{abs(d) * 1e3:.1f} mm from the workpiece, within the clearance of {clearance * 1e3:g} mm"
            if d < -_TOUCHES:
                where = f"{-d * 1e3:.1f} mm inside the workpiece"
            return [], [f"at its free end the tool point lies {where}"]
    return [Escape("free", (), q, 0.0)], []


def _motion(
    chain: SerialChain,
    leave: Escape,
    via: tuple[NDArray[np.float64], ...],
    arrive: Escape,
    distance: Distance | None,
) -> Motion:
    """Return the motion of the two ways and the configurations between them."""
    pieces, roles = list(leave.pieces), leave.roles("leave")
    for a, b in pairwise([leave.q, *via, arrive.q]):
        if (a != b).any():
            pieces.append(np.stack([a, b]))
            roles.append("travel")
    pieces += [np.ascontiguousarray(piece[::-1]) for piece in arrive.pieces[::-1]]
    roles += arrive.roles("return")[::-1]
    least, at = float("nan"), (-1, 0.0)
    if distance is not None:
        for k, (piece, role) in enumerate(zip(pieces, roles, strict=True)):
            if role == "travel":
                d, u = least_distance(piece[0], piece[1], distance)
                if not d >= least:
                    least, at = d, (k, u)
    kinds = [way.kind for way in (leave, arrive) if way.pieces]
    return Motion(
        pieces=tuple(pieces),
        parameters=tuple(chord_parameter(chain, piece) for piece in pieces),
        roles=tuple(roles),
        escape=" / ".join(dict.fromkeys(kinds)) or "free",
        least_clearance=least,
        least_at=at,
        time=sum(piece_time(chain, piece) for piece in pieces),
    )
