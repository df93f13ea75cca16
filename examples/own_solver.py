"""A QP solver of your own: projected gradient, as bad as it is short. What it gets wrong is caught and counted."""

import numpy as np

import qparm
from qparm.ik import SolvedStep, check_optimality


class ProjectedGradient:  # noqa: D101
    name = "projected gradient"

    def solve(self, step):  # noqa: D102
        J, d = step.J, step.c
        for _ in range(300):
            d = np.clip(d - 0.1 * (J.T @ (J @ d - step.e) + step.lam2 * (d - step.c)), step.lb, step.ub)
        optimality = check_optimality(step, d, (step.e - J @ d) / step.lam2)
        return SolvedStep(d, step.e, True, optimality, accepted=optimality.holds())


print(qparm.report(qparm.plan("examples/dome.toml", strategy="general", solver=ProjectedGradient())).text())
