"""Exact between points: how far the curve q(s) leads the tool off its path, and waypoints where that is too far."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from qparm.path import joint_curve
from qparm.path.relaxation import Relaxation
from qparm.planning.search.bundle import nearest_way
from qparm.planning.search.projection import project, velocity_scale
from qparm.planning.tolerances import CURVE_MARGIN, EXACT_POSE

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.robot import SerialChain

__all__ = [
    "PoseOf",
    "Stretch",
    "beyond_limits",
    "exact_gaps",
    "exact_stretch",
    "gap_deviations",
    "inset",
    "is_exact",
]

# Places between two waypoints at which the tool is looked at.
_PLACES = (np.arange(8) + 0.5) / 8
# On the curve they keep this share of the tolerance: the rest is for the form in which it is timed. Joint-linearly, as
# the peak lies between them and others look elsewhere, that share.
_SHARE, _SHARE_LINEAR = 0.4, 0.95
_ROUNDS = 12
# A gap is halved no further than this share of the stretch: what is off there is no matter of spacing.
_SHORTEST = 1e-6
# Between these places of a gap a joint turns back once at most, and its speed is nearly even.
_ENDS = np.arange(16) / 16
# How far outside a limit is still the limit (m, rad); the report allows twice that.
_LIMIT = 5e-10
# Where the given waypoints keep farther off them, half of what they keep, at most this (rad, velocity-scaled).
_ROOM = 2e-3


@dataclass(frozen=True, eq=False)
class Stretch:
    """Waypoints of one run or transition, and how exact the curve through them is.

    Attributes
    ----------
    s : (N,) ndarray
        m.
    q : (N, n) ndarray
    rho : (N, 3) ndarray
    given : (N,) ndarray of bool
        False for waypoints that were added.
    curve_position, curve_rotation : (N - 1,) ndarray
        Largest deviation of the tool on the curve in each gap (m, rad).
    linear_position, linear_rotation : (N - 1,) ndarray
        The same where the joints are interpolated linearly.
    """

    s: NDArray[np.float64]
    q: NDArray[np.float64]
    rho: NDArray[np.float64]
    given: NDArray[np.bool_]
    curve_position: NDArray[np.float64]
    curve_rotation: NDArray[np.float64]
    linear_position: NDArray[np.float64]
    linear_rotation: NDArray[np.float64]


PoseOf = Callable[["NDArray[np.float64]"], "NDArray[np.float64]"]


def gap_deviations(
    chain: SerialChain,
    s: NDArray[np.float64],
    q: NDArray[np.float64],
    rho: NDArray[np.float64],
    pose_of: PoseOf,
    relaxation: Relaxation,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the largest tool deviation in each gap: on the curve, and with linear joint interpolation (m, rad).

    Parameters
    ----------
    chain : SerialChain
    s : (N,) ndarray
    q : (N, n) ndarray
    rho : (N, 3) ndarray
    pose_of : callable
        ``pose_of(s)`` gives the (k, 4, 4) nominal poses, base frame.
    relaxation : Relaxation
    """
    at = (s[:-1, None] + np.diff(s)[:, None] * _PLACES).ravel()
    target = pose_of(at)
    if relaxation.free:
        # where waypoints lie on the cone's edge their spline swings out of it
        target = relaxation.targets(target, relaxation.clipped(joint_curve(s, rho)(at)))
    on_curve = joint_curve(s, q)(at)
    linear = (q[:-1, None] + np.diff(q, axis=0)[:, None] * _PLACES[:, None]).reshape(len(at), -1)
    deviations = []
    for joints in (on_curve, linear):
        E = chain.pose_error(chain.forward(joints), target).reshape(len(s) - 1, len(_PLACES), 6)
        deviations += [np.linalg.norm(E[..., :3], axis=2).max(axis=1), np.linalg.norm(E[..., 3:], axis=2).max(axis=1)]
    return deviations[0], deviations[1], deviations[2], deviations[3]


def exact_stretch(
    chain: SerialChain,
    s: NDArray[np.float64],
    q: NDArray[np.float64],
    rho: NDArray[np.float64],
    pose_of: PoseOf,
    *,
    relaxation: Relaxation,
    position: float,
    rotation: float,
    for_linear: bool = False,
) -> Stretch:
    """Return the stretch with as many waypoints added as its curve needs to stay on the path.

    Parameters
    ----------
    chain, s, q, rho, pose_of, relaxation
        See :func:`gap_deviations`.
    position, rotation : float
        How far the tool may be off between waypoints (m, rad).
    for_linear : bool
        Add waypoints until linear joint interpolation keeps the tolerances too.
    """
    chosen: Stretch | None = None
    # a joint that is held at its limit on a part of the way has a kink there, beside which the curve swings beyond it
    for arm in (_room(chain, q), chain, inset(chain, CURVE_MARGIN)):
        stretch = _with_waypoints(
            chain, arm, s, q, rho, pose_of, relaxation=relaxation, position=position, rotation=rotation,
            for_linear=for_linear,
        )  # fmt: skip
        inside = ~_outside_limits(chain, stretch.s, stretch.q)
        if chosen is None or inside.all():
            chosen = stretch
        if inside.all():
            break
    assert chosen is not None
    return chosen


def _with_waypoints(
    chain: SerialChain,
    arm: SerialChain,
    s: NDArray[np.float64],
    q: NDArray[np.float64],
    rho: NDArray[np.float64],
    pose_of: PoseOf,
    *,
    relaxation: Relaxation,
    position: float,
    rotation: float,
    for_linear: bool,
) -> Stretch:
    """Return the stretch with waypoints added within the limits of ``arm``, or of ``chain`` where that cannot be."""
    given = np.ones(len(s), dtype=bool)
    span = float(s[-1] - s[0])
    last: Stretch | None = None
    for _ in range(_ROUNDS + 1):
        deviations = gap_deviations(chain, s, q, rho, pose_of, relaxation)
        last = Stretch(s, q, rho, given, *deviations)
        off = (deviations[0] > _SHARE * position) | (deviations[1] > _SHARE * rotation)
        if for_linear:
            off |= (deviations[2] > _SHARE_LINEAR * position) | (deviations[3] > _SHARE_LINEAR * rotation)
        outside = _outside_limits(chain, s, q)
        off |= outside
        off &= np.diff(s) > _SHORTEST * span
        if not off.any():
            break
        at = 0.5 * (s[:-1] + s[1:])[off]
        start = joint_curve(s, q)(at)
        lean = relaxation.clipped(joint_curve(s, rho)(at)) if relaxation.free else np.zeros((len(at), 3))
        targets = relaxation.targets(pose_of(at), lean)
        added, there = _onto(arm, targets, start)
        if relaxation.free:
            # what the tool, turned as the curve has it, takes beyond a limit, it may not if it turns a little
            for k in np.flatnonzero(~there):
                turned = nearest_way(arm, pose_of(at[k : k + 1])[0], start[k], lean[k], relaxation)
                if turned is not None:
                    target = relaxation.targets(pose_of(at[k : k + 1]), turned[1][None])
                    lean[k] = turned[1]
                    added[k : k + 1], there[k : k + 1] = _onto(arm, target, turned[0][None])
        if arm is not chain and not there.all():
            targets = relaxation.targets(pose_of(at), lean)
            added[~there], there[~there] = _onto(chain, targets[~there], start[~there])
        if not there.any():
            break
        at, added, lean = at[there], added[there], lean[there]
        place = np.searchsorted(s, at)
        s, q, rho = np.insert(s, place, at), np.insert(q, place, added, axis=0), np.insert(rho, place, lean, axis=0)
        given = np.insert(given, place, False)
    assert last is not None
    return last


def _onto(
    arm: SerialChain, targets: NDArray[np.float64], start: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    start = np.clip(start, arm.lower, arm.upper)
    return project(arm, targets, start, position_tolerance=EXACT_POSE, rotation_tolerance=EXACT_POSE, iterations=25)


def is_exact(chain: SerialChain, stretch: Stretch, *, position: float, rotation: float) -> bool:
    """Return whether the curve keeps the tolerances (m, rad) and the joint limits in every gap."""
    return bool(exact_gaps(chain, stretch, position=position, rotation=rotation).all())


def exact_gaps(chain: SerialChain, stretch: Stretch, *, position: float, rotation: float) -> NDArray[np.bool_]:
    """Return in which gaps the curve keeps the tolerances (m, rad) and the joint limits, (N - 1,)."""
    exact = (stretch.curve_position <= position) & (stretch.curve_rotation <= rotation)
    return exact & ~_outside_limits(chain, stretch.s, stretch.q)


def inset(chain: SerialChain, margin: float) -> SerialChain:
    """Return the arm with its limits drawn in by a velocity-scaled margin (rad), or a tenth of a narrow range."""
    margins = np.minimum(margin * velocity_scale(chain), 0.1 * (chain.upper - chain.lower))
    return chain.with_position_limits(chain.lower + margins, chain.upper - margins)


def _room(chain: SerialChain, q: NDArray[np.float64]) -> SerialChain:
    """Return the arm with limits half as far off as all of some configurations (N, n) keep, or by a margin."""
    margins = _ROOM * velocity_scale(chain)
    below = np.clip(0.5 * (q.min(axis=0) - chain.lower), 0.0, margins)
    above = np.clip(0.5 * (chain.upper - q.max(axis=0)), 0.0, margins)
    return chain.with_position_limits(chain.lower + below, chain.upper - above)


def beyond_limits(chain: SerialChain, s: NDArray[np.float64], q: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how far the curve is beyond the joint limits in each gap, (N - 1, n), negative inside (m, rad).

    Looked at where joints turn back, too.

    Parameters
    ----------
    chain : SerialChain
    s : (N,) ndarray
    q : (N, n) ndarray
    """

    def beyond(joints: NDArray[np.float64], i: slice | int = slice(None)) -> NDArray[np.float64]:
        return np.maximum(chain.lower[i] - joints, joints - chain.upper[i])

    curve = joint_curve(s, q)
    rate = curve.derivative()
    ends = np.append((s[:-1, None] + np.diff(s)[:, None] * _ENDS).ravel(), s[-1])
    at_ends, speed = beyond(curve(ends)), rate(ends)
    worst = np.maximum(at_ends[:-1], at_ends[1:])
    for i in range(chain.n):
        turns = np.flatnonzero(speed[:-1, i] * speed[1:, i] < 0)
        a, b, va, vb = ends[turns], ends[turns + 1], speed[turns, i], speed[turns + 1, i]
        peak = curve(a + (b - a) * va / (va - vb))[:, i]
        worst[turns, i] = np.maximum(worst[turns, i], beyond(peak, i))
    return worst.reshape(len(s) - 1, len(_ENDS), chain.n).max(axis=1)


def _outside_limits(chain: SerialChain, s: NDArray[np.float64], q: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return in which gaps the curve leaves the joint limits, (N - 1,)."""
    return np.any(beyond_limits(chain, s, q) > _LIMIT, axis=1)
