"""A planner of your own: every pose by itself, the solution nearest to home. It reaches all, and jumps."""

import numpy as np

import qparm


def nearest_to_home(chain, tool_path, home, rng):
    """Return for every pose, of 20 random solutions, the one nearest to home."""
    found = qparm.solve_poses(chain, tool_path.poses, restarts=20, rng=rng, every_start=True)
    distance = np.linalg.norm((found.q - home) / chain.scale, axis=2)
    nearest = np.where(found.reached, distance, np.inf).argmin(axis=1)
    return found.q[np.arange(len(nearest)), nearest]


print(qparm.report(qparm.plan("examples/reconfiguration.toml", strategy=nearest_to_home)).text())
