"""A step of your own in a plan: the motion of the rail is weighted four times."""

from dataclasses import replace

import numpy as np

import qparm


def lazy_rail(chain, q, step):
    """Return the damped least-norm step with less mobility for prismatic joints."""
    return replace(step, S=np.where(chain.prismatic, 0.5, 1.0))


print(qparm.report(qparm.plan("examples/dome.toml", strategy="general", method=lazy_rail)).text())
