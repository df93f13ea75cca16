"""Reasons why poses are missed: the verdicts of ``check_reach``, for many poses at once."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from qparm.path.relaxation import EXACT, Relaxation
from qparm.reach.many_arms import DesignReach, reach_of_designs
from qparm.reach.verdict import Reach, ReachReason, with_free_orientation, without_limits
from qparm.robot import check_poses

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from qparm.robot import SerialChain

__all__ = ["coverage"]


def coverage(
    chain: SerialChain,
    poses: ArrayLike,
    *,
    relaxation: Relaxation = EXACT,
    position_tolerance: float = 1e-6,
    rotation_tolerance: float = 1e-5,
    restarts: int = 20,
    seed: int = 0,
    threads: int | None = None,
) -> list[Reach]:
    """Return for each of many poses whether the arm reaches it, and if not, why.

    What is missed without proof is asked for again without position limits, and then with the tool free to turn.

    Parameters
    ----------
    chain : SerialChain
    poses : (P, 4, 4) array_like
        Poses of the tool in the base frame.
    relaxation, position_tolerance, rotation_tolerance, restarts, seed, threads
        See :func:`qparm.reach_of_designs`.

    Returns
    -------
    list of Reach
    """
    poses = check_poses(poses)

    def reach(arm: SerialChain, which: NDArray[np.intp], allowed: Relaxation) -> DesignReach:
        return reach_of_designs(
            [arm],
            poses[which],
            relaxation=allowed,
            position_tolerance=position_tolerance,
            rotation_tolerance=rotation_tolerance,
            restarts=restarts,
            seed=seed,
            threads=threads,
        )

    words = relaxation.words
    first = reach(chain, np.arange(len(poses)), relaxation)
    within = first.reached[0]
    verdicts = [Reach(ReachReason.WITHIN_REACH, relaxed=words)] * len(poses)
    if relaxation.tilt:
        planned = reach(chain, np.arange(len(poses)), relaxation.planned).reached[0]
        within |= planned
        for k in np.flatnonzero(~planned):
            verdicts[k] = Reach(ReachReason.WITHIN_REACH, relaxed=relaxation.words_beyond_plans)
    for k in np.flatnonzero(first.proved[0]):
        far, near = float(first.too_far[0, k]), float(first.too_near[0, k])
        verdicts[k] = Reach(ReachReason.TOO_FAR if far > 0 else ReachReason.TOO_NEAR, max(far, near), words)
    missed = np.flatnonzero(~within & ~first.proved[0])
    for reason, arm, allowed in (
        (ReachReason.LIMITS, without_limits, relaxation),
        (ReachReason.ORIENTATION, with_free_orientation, EXACT),
    ):
        found = reach(arm(chain), missed, allowed).reached[0] if len(missed) else np.zeros(0, dtype=bool)
        for k in missed[found]:
            verdicts[k] = Reach(reason, relaxed=words)
        missed = missed[~found]
    for k in missed:
        verdicts[k] = Reach(ReachReason.POSITION, relaxed=words)
    return verdicts
