"""Differential steps to be timed: where the arm is and where the tool shall be, for two mixes.

*jumps*     random configurations, targets a random displacement away: about half of the steps meet a bound
*tracking*  what following the rows of the reference raster at the cell's feed really asks for, one target a tick,
            each from where the step before it ended
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

import qparm
from qparm.ik import DifferentialIK, closed_form, solve_poses, step_problem

__all__ = ["StepMix", "jumps", "tracking"]


@dataclass(frozen=True, eq=False)
class StepMix:
    """Steps of one time step each.

    Attributes
    ----------
    name : str
    time_step : float
        s.
    q : (N, n) ndarray
        Where the arm is (m, rad).
    targets : (N, 4, 4) ndarray
        Where the tool shall be, base frame.
    bounded : (N,) ndarray of bool
        Whether the closed form leaves the step's bounds.
    """

    name: str
    time_step: float
    q: NDArray[np.float64]
    targets: NDArray[np.float64]
    bounded: NDArray[np.bool_]

    def only(self, name: str, mask: NDArray[np.bool_]) -> StepMix:
        """Return the steps of a mask under another name."""
        return StepMix(name, self.time_step, self.q[mask], self.targets[mask], self.bounded[mask])


def _mix(
    chain: qparm.SerialChain, name: str, time_step: float, Q: NDArray[np.float64], T: NDArray[np.float64]
) -> StepMix:
    steps = [step_problem(chain, q, target, method="dls", time_step=time_step) for q, target in zip(Q, T, strict=True)]
    return StepMix(name, time_step, Q, T, np.array([not step.within_bounds(closed_form(step)) for step in steps]))


def jumps(chain: qparm.SerialChain, *, count: int = 200, time_step: float = 0.05) -> StepMix:
    """Return steps towards targets that lie far away for one time step."""
    rng = np.random.default_rng(5)
    Q = chain.lower + rng.uniform(0.05, 0.95, (count, chain.n)) * (chain.upper - chain.lower)
    near = Q + rng.normal(size=Q.shape) * rng.choice([0.01, 0.2], (count, 1)) * chain.scale
    return _mix(chain, "jumps", time_step, Q, chain.forward(np.clip(near, chain.lower, chain.upper)))


def tracking(cell: qparm.Cell, *, count: int = 200, time_step: float = 0.01) -> StepMix:
    """Return steps, evenly thinned to ``count``, of following every row at the cell's feed from where its start is."""
    chain, path = cell.chain(), cell.tool_path()
    ik = DifferentialIK(chain, time_step=time_step)
    Q, T = [], []
    for row in range(len(path.rows)):
        poses = path.poses[path.row_of_point == row]
        first = solve_poses(chain, poses[:1], restarts=21, rng=np.random.default_rng(row))
        if not first.reached[0]:
            continue
        q = first.q[0]
        for target in _ticks(poses, cell.process.feed * time_step):
            Q.append(q)
            T.append(target)
            q = ik.step(q, target).q
    pick = np.round(np.linspace(0, len(Q) - 1, min(count, len(Q)))).astype(int)
    return _mix(chain, "tracking", time_step, np.array(Q)[pick], np.array(T)[pick])


def _ticks(poses: NDArray[np.float64], advance: float) -> NDArray[np.float64]:
    """Return the poses every ``advance`` metres along straight lines between poses."""
    lengths = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    s = np.concatenate([[0.0], np.cumsum(lengths)])
    at = np.arange(advance, s[-1], advance)
    T = np.tile(np.eye(4), (len(at), 1, 1))
    T[:, :3, :3] = Slerp(s, Rotation.from_matrix(poses[:, :3, :3]))(at).as_matrix()
    for k in range(3):
        T[:, k, 3] = np.interp(at, s, poses[:, k, 3])
    return T
