"""Names that can be chosen: strategies, IK steps, timing forms, design methods, formats, each with a word on it.

The command line and the library read the names here; the things themselves stand in the tables named beside them, which
a test holds to these. Nothing is loaded.
"""

__all__ = ["DESIGN_METHODS", "METHODS", "STRATEGIES", "TIMING_FORMS", "TRAJECTORY_FORMATS", "in_words"]

# qparm.planning.strategies.STRATEGIES
STRATEGIES = {
    "graph": "search the whole path at once",
    "reverse": "the paper's improved strategy",
    "general": "its baseline",
}
# qparm.ik.METHODS
METHODS = {
    "cwln": "clamping weighted least norm",
    "wln": "weighted least norm",
    "gpm": "gradient projection",
    "dls": "damped least norm",
}
# qparm.timing.FORMS
TIMING_FORMS = {
    "quintic": "quintic polynomials",
    "ruckig": "jerk-limited profiles by Ruckig",
}
# qparm.design.engines.METHODS
DESIGN_METHODS = {
    "hybrid": "a particle swarm guided by models",
    "mopso": "Coello's particle swarm",
    "paper": "the paper's swarm",
    "grid": "the whole map",
    "sobol": "evenly spread designs",
}
# qparm.export.FORMATS
TRAJECTORY_FORMATS = {
    "csv": "positions, velocities, accelerations, jerks, segments",
    "npz": "the same for numpy",
    "parquet": "the same as columns",
    "stream": "positions at every tick of a servo interface",
    "json": "a ROS 2 trajectory_msgs/JointTrajectory",
    "yaml": "the same",
    "mcap": "the same as a message",
    "rosbag2": "the same in a bag",
    "krl": "a program for KUKA robots",
    "rapid": "a program for ABB robots",
}


def in_words(choices: dict[str, str]) -> str:
    """Return names and words in a sentence for a help text."""
    return " ".join(f"{name}: {words}." for name, words in choices.items())
