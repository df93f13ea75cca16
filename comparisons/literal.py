"""Eq. 5 of the paper to the letter: CWLN without bounds and without a trust region, beside the bounded step.

    python -m comparisons.literal [--cell FILE] [--seeds N] [--out FOLDER]

Same weights, clamp, damping and warm start; a configuration counts as reached only within the position limits.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import qparm
from comparisons.stop_rule import within_tolerance
from comparisons.tables import save_table
from qparm.ik import StepProblem, clamping_weights, closed_form

_ITERATIONS = 100


def iterate(chain: qparm.SerialChain, q: np.ndarray, target: np.ndarray) -> tuple[np.ndarray, bool]:
    """Return where eq. 5 ends, and whether the pose is reached there within the limits."""
    unbounded = np.full(chain.n, np.inf)
    for _ in range(_ITERATIONS):
        e = chain.pose_error(chain.forward(q), target)
        e[:3] /= chain.characteristic_length
        if within_tolerance(chain, e):
            return q, bool(chain.within_limits(q).all())
        size = float(np.linalg.norm(e))
        W, phi = clamping_weights(chain, np.clip(q, chain.lower - 1.0, chain.upper + 1.0))
        c = -(1 - W) * phi * min(1.0, size / 1e-2)
        lam2 = 1e-3 * size**2 + 1e-12
        step = StepProblem(chain.scaled_jacobian(q), e, np.sqrt(W), c, lam2, -unbounded, unbounded)
        q = q + chain.scale * closed_form(step)
    return q, False


def main() -> None:
    """Print and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cell", type=Path, default=Path("examples/dome.toml"))
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--out", type=Path, default=Path("comparisons/out"))
    arguments = parser.parse_args()
    cell = qparm.Cell.load(arguments.cell)
    chain, poses, jump = cell.chain(), cell.tool_path().poses, cell.jump()
    rows = []
    for seed in range(arguments.seeds):
        rng = np.random.default_rng(seed)
        q, there = iterate(chain, chain.random(rng, 1)[0], poses[0])
        while not there:
            q, there = iterate(chain, chain.random(rng, 1)[0], poses[0])
        Q, reached = np.empty((len(poses), chain.n)), np.zeros(len(poses), dtype=bool)
        for k, pose in enumerate(poses):
            q, reached[k] = iterate(chain, q, pose)
            Q[k] = q
        jumps = int((np.abs(np.diff(Q[reached], axis=0)) > jump).any(axis=1).sum())
        step = np.abs(np.diff(Q[reached], axis=0))[:, ~chain.prismatic].max()
        rows.append([seed, int((~reached).sum()), jumps, f"{np.degrees(step):.0f}"])
    header = ["seed", "not reached", "jumps (also across missing points)", "largest step (deg)"]
    title = f"Eq. 5 to the letter on {cell.name}, {len(poses)} points"
    print(save_table(arguments.out, "literal", title, header, rows))


if __name__ == "__main__":
    main()
