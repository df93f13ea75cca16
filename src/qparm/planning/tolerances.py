"""Tolerances and margins of all stages of planning: how exactly poses are solved, how far inside the limits.

The chain of margins is that of the stages. What is searched and smoothed keeps farther inside the limits than what
comes after it needs: the curve between waypoints swings a little beyond them, and a form of the trajectory a little
beyond the curve.
"""

__all__ = [
    "CURVE_MARGIN",
    "EXACT_POSE",
    "FOLLOWED_POSE",
    "LIMIT_MARGIN",
    "REST_MARGIN",
    "SEARCH_POSE",
    "STEP_TRUST",
    "TRANSITION_MARGIN",
    "TURN_MARGIN",
]

# --- poses (m, rad) -------------------------------------------------------------------------------------

# Samples of the search, which are only compared with each other.
SEARCH_POSE = 1e-7
# What an edge is followed through, and a bundle of ways goes on from: a step may be small.
FOLLOWED_POSE = 1e-8
# Waypoints: nothing of the cell's tolerances (micrometres) is used up by them.
EXACT_POSE = 1e-11

# --- steps of projections -------------------------------------------------------------------------------

# A step onto a pose is trusted this far, in velocity-scaled joints (rad of the fastest joint).
STEP_TRUST = 0.5

# --- distances from the joint limits (velocity-scaled, rad) ---------------------------------------------

# Ruckig misses positions by 1e-8, which must not lead beyond a limit that a joint rests at.
REST_MARGIN = 2e-7
# Waypoints that are added keep half of what smoothing keeps.
CURVE_MARGIN = 1e-4
# The smoothed path: its curve swings a little beyond its waypoints.
LIMIT_MARGIN = 2e-4
# Transitions are begun this far inside.
TRANSITION_MARGIN = 2e-3
# Rows and turns that flow into each other: a turn bends the curve, and where a joint rested on its limit, that would
# lead beyond it.
TURN_MARGIN = 5e-3
