"""Warnings about a plan that is executable: joints that come so near to their limits that another setup may stop."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from qparm.reports.words import shown
from qparm.verify.finding import AT_LIMIT

if TYPE_CHECKING:
    from qparm.pipeline import Plan
    from qparm.verify import Figures

__all__ = ["NEAR_LIMIT_PRISMATIC", "NEAR_LIMIT_REVOLUTE", "limit_warnings"]

# A joint that comes this near to a position limit is worth a warning (m, rad): soft limits and calibrations of one
# controller and the next differ by that much.
NEAR_LIMIT_PRISMATIC, NEAR_LIMIT_REVOLUTE = 1e-3, float(np.radians(0.2))


def limit_warnings(figures: Figures, plan: Plan) -> tuple[str, ...]:
    """Return a sentence for each joint that comes near a position limit without leaving it.

    Parameters
    ----------
    figures : Figures
        As measured on the files: they say how near.
    plan : Plan
        It says which limit that is.
    """
    chain, path = plan.chain, plan.joint_path
    positions = np.concatenate([path.q, plan.trajectory(plan.trajectory.boundaries)])
    room = np.stack([(positions - chain.lower).min(axis=0), (chain.upper - positions).min(axis=0)])
    away = path.q[1:-1]
    room_away = np.stack(
        [(away - chain.lower).min(axis=0, initial=np.inf), (chain.upper - away).min(axis=0, initial=np.inf)]
    )
    sentences = []
    for i, joint in enumerate(figures.joints):
        near = NEAR_LIMIT_PRISMATIC if joint.unit == "m" else NEAR_LIMIT_REVOLUTE
        distance = min(joint.limit_distance_waypoints, joint.limit_distance_trajectory)
        if chain.continuous[i] or not -AT_LIMIT <= distance <= near:
            continue
        side = int(room[:, i].argmin())
        name, limit = ("lower", chain.lower[i]) if side == 0 else ("upper", chain.upper[i])
        how = f"comes within {shown(distance, joint.unit)} of" if distance > AT_LIMIT else "touches"
        only = ", at home only" if room_away[side, i] > near else ""
        sentences.append(f"joint {joint.name!r} {how} its {name} limit of {shown(limit, joint.unit)}{only}")
    return tuple(sentences)
