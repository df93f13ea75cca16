"""Reachability of single poses, and the reason where one is out of reach."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np

from qparm.errors import InvalidInput
from qparm.ik.iterate import REACHED
from qparm.ik.relaxed import nearest_parameters_kernel, relaxed_iterate_kernel
from qparm.ik.solve import PoseSolver
from qparm.ik.step import trust_region
from qparm.path.relaxation import EXACT, Relaxation
from qparm.reach.relaxed_bound import relaxed_excess
from qparm.robot import Joint, SerialChain, check_poses

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

__all__ = ["Reach", "ReachReason", "check_reach"]

# "Without limits" still needs a box to draw starts from: two turns either way, ten times the travel.
_FREE_ANGLE = 4 * np.pi
_FREE_TRAVEL = 10.0
# Iterations of arm and tool together, from each start.
_ITERATIONS = 200


class ReachReason(StrEnum):
    """Why a pose is out of reach, or that it is not."""

    WITHIN_REACH = "within reach"
    """Reached from some start."""
    TOO_FAR = "too far"
    """Proved: the wrist lies beyond the greatest reach of the links."""
    TOO_NEAR = "too near"
    """Proved: the wrist lies nearer than the links fold."""
    LIMITS = "limits"
    """Reached without joint position limits, not with them."""
    ORIENTATION = "orientation"
    """Not reached even without limits, but with the tool turned another way."""
    POSITION = "position"
    """No start brings the tool to the position in any orientation, though it lies within the reach bound."""


@dataclass(frozen=True)
class Reach:
    """The verdict on one pose.

    Attributes
    ----------
    reason : ReachReason
    excess : float
        How far (m) the wrist lies beyond the greatest reach, or short of the least; 0 where it does neither. Only
        this is a proof; the other reasons rest on the number of starts that were tried.
    relaxed : str
        What the tool was free to do, in words; empty where it stands as it is drawn.
    """

    reason: ReachReason
    excess: float = 0.0
    relaxed: str = ""

    def __str__(self) -> str:
        return self.sentence(f"{self.excess * 1e3:.1f}")

    def sentence(self, excess: str) -> str:
        """Return the verdict in words, with an excess (mm) as text: that of one pose, or a range of several."""
        words = {
            ReachReason.TOO_FAR: f"too far: the wrist lies {excess} mm beyond the greatest reach",
            ReachReason.TOO_NEAR: f"too near: the wrist lies {excess} mm nearer than the arm folds",
            ReachReason.WITHIN_REACH: "within reach from another start",
            ReachReason.LIMITS: "joint limits: reached without them, not with them",
            ReachReason.ORIENTATION: "orientation: the position is reached, not with this tool orientation",
            ReachReason.POSITION: "position: not reached in any orientation",
        }[self.reason]
        return f"{words}, {self.relaxed}" if self.relaxed else words


def check_reach(
    chain: SerialChain,
    poses: ArrayLike,
    *,
    rng: np.random.Generator,
    starts: int = 100,
    relaxation: Relaxation = EXACT,
    position_tolerance: float = 1e-6,
    rotation_tolerance: float = 1e-5,
    q_start: NDArray[np.float64] | None = None,
) -> list[Reach]:
    """Return for each pose whether the arm reaches it, and if not, why.

    Parameters
    ----------
    chain : SerialChain
    poses : (N, 4, 4) array_like
    rng : numpy.random.Generator
        Where starts are drawn from.
    starts : int
        How many random starts a pose gets before it counts as not reached.
    relaxation : Relaxation
        Which rotations of the tool are free: a pose is reached if it is with the tool turned in some way.
    position_tolerance, rotation_tolerance : float
        m and rad.
    q_start : (n,) ndarray, optional
        A first start; poses near each other are then found from the neighbour's configuration.

    Returns
    -------
    list of Reach
    """
    poses = check_poses(poses)
    if poses.ndim != 3:
        raise InvalidInput(f"poses must be (N, 4, 4), not {poses.shape}")
    tolerances = (position_tolerance, rotation_tolerance)
    words = relaxation.words
    searches = [(_Search(chain, relaxation, *tolerances), relaxation.words_beyond_plans if relaxation.tilt else words)]
    if relaxation.tilt:
        searches.insert(0, (_Search(chain, relaxation.planned, *tolerances), words))
    no_limits: _Search | None = None
    any_orientation: _Search | None = None
    verdicts = []
    q = 0.5 * (chain.lower + chain.upper) if q_start is None else chain.check_one_configuration(q_start, what="q_start")
    for pose, far, near in zip(poses, *relaxed_excess(chain, poses, relaxation), strict=True):
        if far > 0 or near > 0:
            reason = ReachReason.TOO_FAR if far > 0 else ReachReason.TOO_NEAR
            verdicts.append(Reach(reason, float(max(far, near)), words))
            continue
        within = next(
            ((found, said) for one, said in searches if (found := one.found(pose, q, rng, starts)) is not None), None
        )
        if within is not None:
            q, said = within
            verdicts.append(Reach(ReachReason.WITHIN_REACH, relaxed=said))
            continue
        if no_limits is None or any_orientation is None:
            no_limits = _Search(without_limits(chain), relaxation, *tolerances)
            any_orientation = _Search(with_free_orientation(chain), EXACT, *tolerances)
        if no_limits.found(pose, q, rng, starts) is not None:
            verdicts.append(Reach(ReachReason.LIMITS, relaxed=words))
        elif any_orientation.found(pose, np.append(q, np.zeros(3)), rng, starts) is not None:
            verdicts.append(Reach(ReachReason.ORIENTATION, relaxed=words))
        else:
            verdicts.append(Reach(ReachReason.POSITION, relaxed=words))
    return verdicts


class _Search:
    """The search for one pose from many starts: with the tool as free as it is, then as it is drawn."""

    def __init__(self, chain: SerialChain, relaxation: Relaxation, position: float, rotation: float) -> None:
        self._chain, self._relaxation, self._position, self._rotation = chain, relaxation, position, rotation
        self._solver = PoseSolver(chain, method="dls", position_tolerance=position, rotation_tolerance=rotation)

    def found(
        self, pose: NDArray[np.float64], q: NDArray[np.float64], rng: np.random.Generator, starts: int
    ) -> NDArray[np.float64] | None:
        """Return a configuration that reaches the pose, None if none of the starts leads to one."""
        for find in (self._turning, self._as_drawn) if self._relaxation.free else (self._as_drawn,):
            solution = find(pose, q)
            for _ in range(starts):
                if solution is not None:
                    break
                solution = find(pose, self._chain.random(rng, 1)[0])
            if solution is not None:
                return solution
        return None

    def _as_drawn(self, pose: NDArray[np.float64], q: NDArray[np.float64]) -> NDArray[np.float64] | None:
        solution = self._solver.solve(pose, q)
        return solution.q if solution.reached else None

    def _turning(self, pose: NDArray[np.float64], q: NDArray[np.float64]) -> NDArray[np.float64] | None:
        chain, q, rho = self._chain, q.copy(), np.empty(3)
        cone = np.array([self._relaxation.tilt, float(self._relaxation.spin)])
        nearest_parameters_kernel(pose, chain.forward(q), cone, rho)
        end = relaxed_iterate_kernel(
            chain.fixed, chain.prismatic, chain.lower, chain.upper, chain.scale, chain.characteristic_length,
            trust_region(chain), pose, cone, 1.0, self._position, self._rotation, _ITERATIONS, q, rho, np.empty(2),
        )  # fmt: skip
        return q if end == REACHED else None


def without_limits(chain: SerialChain) -> SerialChain:
    """Return the arm with joints that turn, and slide, far beyond their position limits."""
    middle, half = 0.5 * (chain.lower + chain.upper), 0.5 * (chain.upper - chain.lower)
    lower = np.where(chain.prismatic, middle - _FREE_TRAVEL * half, -_FREE_ANGLE)
    return chain.with_position_limits(lower, np.where(chain.prismatic, middle + _FREE_TRAVEL * half, _FREE_ANGLE))


def with_free_orientation(chain: SerialChain) -> SerialChain:
    """Return the chain with three more axes that meet in the tool's origin: any orientation for the asking."""
    quarter = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]], dtype=float)  # about x
    joints = list(chain.joints)
    for k, transform in enumerate((np.asarray(chain.transform_tool), quarter, quarter.T)):
        joints.append(
            Joint(f"free orientation {k + 1}", "revolute", transform, (-_FREE_ANGLE, _FREE_ANGLE), 1.0, 1.0, 1.0)
        )
    return replace(chain, joints=tuple(joints), transform_tool=np.eye(4))
