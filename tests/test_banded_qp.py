"""The banded solver against cvxpy, and against the conditions of optimality."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from qparm.banded.qp import REACH, banded_qp_kernel

TOLERANCE = 1e-8


class Problem:
    """A random problem that is feasible: its bounds lie about the rows of a random point."""

    def __init__(self, rng: np.random.Generator, N: int, r: int, m: int, width: float) -> None:
        self.shape = N, r, m
        size = N * r
        # squares of stencils over four waypoints, as smoothing has them
        L = np.zeros((3 * size, size))
        for row in range(3 * size):
            first = int(rng.integers(0, max(1, N - REACH)))
            span = slice(first * r, min(first + REACH + 1, N) * r)
            L[row, span] = rng.standard_normal(span.stop - span.start)
        self.dense = L.T @ L + 0.1 * np.eye(size)
        self.H = np.zeros((N, REACH + 1, r, r))
        for k in range(N):
            for o in range(min(REACH + 1, N - k)):
                self.H[k, o] = self.dense[k * r : (k + 1) * r, (k + o) * r : (k + o + 1) * r]
        self.g = 20.0 * rng.standard_normal((N, r))
        self.C = rng.standard_normal((N, m, r))
        inside = np.einsum("kia,ka->ki", self.C, rng.standard_normal((N, r)))
        self.lo, self.hi = self._around(rng, inside, width)
        self.slo, self.shi = self._around(rng, np.diff(inside, axis=0), width)

    @staticmethod
    def _around(
        rng: np.random.Generator, rows: NDArray[np.float64], width: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        lo = rows - width * rng.random(rows.shape)
        hi = rows + width * rng.random(rows.shape)
        lo[rng.random(rows.shape) < 0.3] = -np.inf
        hi[rng.random(rows.shape) < 0.3] = np.inf
        return lo, hi

    def solve(self) -> tuple[int, NDArray[np.float64], NDArray[np.float64]]:
        """Return the iterations, the optimum as the kernel finds it, and its quality."""
        z, quality = np.zeros(self.g.size), np.zeros(3)
        count = banded_qp_kernel(
            self.H, self.g, self.C, self.lo, self.hi, self.slo, self.shi, TOLERANCE, 100, z, quality
        )
        return count, z, quality

    def value(self, z: NDArray[np.float64]) -> float:
        """Return the objective."""
        return float(0.5 * z @ self.dense @ z + self.g.ravel() @ z)

    def rows(self, z: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the values of the bounded rows: of waypoints, and of steps between them."""
        box = np.einsum("kia,ka->ki", self.C, z.reshape(self.g.shape))
        return box, np.diff(box, axis=0)

    def reference(self) -> NDArray[np.float64]:
        """Return the optimum as cvxpy and Clarabel find it."""
        import cvxpy as cp

        z = cp.Variable(self.g.size)
        N, r, m = self.shape
        big = np.zeros((N * m, N * r))
        for k in range(N):
            big[k * m : (k + 1) * m, k * r : (k + 1) * r] = self.C[k]
        constraints = []
        for matrix, lo, hi in ((big, self.lo.ravel(), self.hi.ravel()),
                               (big[m:] - big[:-m], self.slo.ravel(), self.shi.ravel())):  # fmt: skip
            below, above = np.isfinite(lo), np.isfinite(hi)
            constraints += [matrix[below] @ z >= lo[below]] if below.any() else []
            constraints += [matrix[above] @ z <= hi[above]] if above.any() else []
        root = np.linalg.cholesky(self.dense)
        problem = cp.Problem(cp.Minimize(0.5 * cp.sum_squares(root.T @ z) + self.g.ravel() @ z), constraints)
        problem.solve(solver=cp.CLARABEL, tol_gap_abs=1e-12, tol_gap_rel=1e-12, tol_feas=1e-12)
        assert problem.status == "optimal"
        assert z.value is not None
        return np.asarray(z.value)


@pytest.mark.parametrize("N", [1, 2, 3, 4, 9, 30])
@pytest.mark.parametrize("r", [1, 2, 3])
def test_optimum_is_that_of_cvxpy(rng: np.random.Generator, N: int, r: int) -> None:
    problem = Problem(rng, N, r, m=r + 2, width=1.0)
    count, z, quality = problem.solve()
    assert count > 0
    assert quality[1] <= TOLERANCE
    reference = problem.reference()
    assert np.abs(z - reference).max() < 1e-5
    assert problem.value(z) == pytest.approx(problem.value(reference), rel=1e-8)


@pytest.mark.parametrize("width", [0.01, 0.3, 5.0, np.inf])
def test_kkt_conditions_hold(rng: np.random.Generator, width: float) -> None:
    """Independent of any solver: the gradient is a combination of the active rows, with the right signs."""
    from scipy.optimize import lsq_linear

    problem = Problem(rng, 12, 2, m=5, width=1.0)
    if np.isinf(width):
        problem.lo[:], problem.hi[:], problem.slo[:], problem.shi[:] = -np.inf, np.inf, -np.inf, np.inf
    else:
        problem = Problem(rng, 12, 2, m=5, width=width)
    count, z, _ = problem.solve()
    assert count > 0
    box, step = problem.rows(z)
    N, r, _ = problem.shape
    gradient = problem.dense @ z + problem.g.ravel()
    columns = []
    for rows, lo, hi, is_step in ((box, problem.lo, problem.hi, False), (step, problem.slo, problem.shi, True)):
        assert (rows >= lo - 1e-9).all()
        assert (rows <= hi + 1e-9).all()
        for side, active in ((1.0, rows <= lo + 1e-6), (-1.0, rows >= hi - 1e-6)):
            for k, i in np.argwhere(active):
                column = np.zeros((N, r))
                if is_step:
                    column[k], column[k + 1] = -problem.C[k, i], problem.C[k + 1, i]
                else:
                    column[k] = problem.C[k, i]
                columns.append(side * column.ravel())
    if np.isinf(width):
        assert not columns
        assert np.abs(gradient).max() < 1e-6
        return
    assert len(columns) > 3
    fit = lsq_linear(np.array(columns).T, gradient, bounds=(0.0, np.inf), tol=1e-14)
    assert np.abs(fit.fun).max() < 1e-5


def test_start_may_break_the_bounds(rng: np.random.Generator) -> None:
    problem = Problem(rng, 8, 2, m=4, width=0.5)
    _, z, quality = problem.solve()
    start = 3.0 * rng.standard_normal(z.shape)
    bounds = problem.lo, problem.hi, problem.slo, problem.shi
    count = banded_qp_kernel(problem.H, problem.g, problem.C, *bounds, TOLERANCE, 100, start, quality)
    assert count > 0
    assert np.abs(start - z).max() < 1e-5


def test_a_problem_without_a_solution_is_told(rng: np.random.Generator) -> None:
    problem = Problem(rng, 5, 1, m=2, width=0.5)
    problem.C[:] = 1.0
    problem.lo[:], problem.hi[:] = np.tile([1.0, -np.inf], (5, 1)), np.tile([np.inf, 0.0], (5, 1))
    problem.slo[:], problem.shi[:] = -np.inf, np.inf
    assert problem.solve()[0] < 0


def test_not_positive_definite_is_told(rng: np.random.Generator) -> None:
    problem = Problem(rng, 4, 2, m=2, width=1.0)
    problem.H[:, 0] = -np.eye(2)
    problem.H[:, 1:] = 0.0
    problem.lo[:], problem.hi[:], problem.slo[:], problem.shi[:] = -np.inf, np.inf, -np.inf, np.inf
    assert problem.solve()[0] < 0
