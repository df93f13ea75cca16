"""A timing of your own: the quintic form with half the acceleration and jerk, for a gentle first run."""

from dataclasses import replace

import qparm
from qparm.timing import quintic_trajectory


def gentle(chain, joint_path, **options):
    """Return the trajectory of an arm that must do everything at half its accelerations and jerks."""
    joints = tuple(replace(j, acceleration=j.acceleration / 2, jerk=j.jerk / 2) for j in chain.joints)
    return quintic_trajectory(replace(chain, joints=joints), joint_path, **options)


plan = qparm.plan("examples/dome.toml", timing=gentle)
print(qparm.report(plan).text())
