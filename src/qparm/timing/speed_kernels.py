"""Compiled: the path-speed problem by a barrier method, its cost linear in the number of knots.

Unknown is b(u) = (du/dt)^2, a cubic spline. At every collocation point, with q1, q2, q3 the derivatives of the
joints by u, velocity, acceleration and jerk are

    q1 sqrt(b),    q2 b + q1 b'/2,    sqrt(b) (q3 b + 3/2 q2 b' + 1/2 q1 b'')

and the time is the integral of b^(-1/2). All shares of limits stay strictly inside (-1, 1): a step that leaves
them is shortened. Newton's matrix leaves out the curvature of the jerk row, the only part that is not convex, so it
is positive definite, and banded, since four splines overlap.
"""

from __future__ import annotations

import math

import numpy as np

from qparm.banded.matrix import band_cholesky, band_solve
from qparm.compiled.kernels import c1, c2, c3, f8, i8, kernel, kernel_helper, o1, o2, o3, void

__all__ = ["PER_INTERVAL", "cubic_basis", "largest_shares", "solve_speed"]

# Collocation points of each interval, its first knot among them: b'' is linear in between, so its extremes are there.
PER_INTERVAL = 4
# Newton steps for one weight of the barrier, and halvings of one step.
_MOST_STEPS = 30
_MOST_HALVINGS = 40
# By what the weight of time against the barrier grows from round to round.
_GROWTH = 8.0


@kernel(void(c1, c1, o3))
def cubic_basis(knots, x, basis):
    """Write the four cubic B-splines and their first two derivatives, (P, 3, 4).

    ``knots`` (M + 7,) with the ends repeated four times; ``x`` ascending, each interval with as many points.
    """
    M = knots.shape[0] - 7
    per = (x.shape[0] - 1) // M
    for p in range(x.shape[0]):
        i = min(p // per, M - 1) + 3
        h = knots[i + 1] - knots[i]
        r = x[p]
        l1, l2, l3 = r - knots[i], r - knots[i - 1], r - knots[i - 2]
        r1, r2, r3 = knots[i + 1] - r, knots[i + 2] - r, knots[i + 3] - r
        w20, w21 = l2 + r1, l1 + r2
        w30, w31, w32 = l3 + r1, l2 + r2, l1 + r3
        a0, a1 = r1 / h, l1 / h
        s0, s1, s2 = r1 * a0 / w20, l2 * a0 / w20 + r2 * a1 / w21, l1 * a1 / w21
        basis[p, 0, 0] = r1 * s0 / w30
        basis[p, 0, 1] = l3 * s0 / w30 + r2 * s1 / w31
        basis[p, 0, 2] = l2 * s1 / w31 + r3 * s2 / w32
        basis[p, 0, 3] = l1 * s2 / w32
        basis[p, 1, 0] = -3.0 * s0 / w30
        basis[p, 1, 1] = 3.0 * (s0 / w30 - s1 / w31)
        basis[p, 1, 2] = 3.0 * (s1 / w31 - s2 / w32)
        basis[p, 1, 3] = 3.0 * s2 / w32
        d0, d1, d2 = -2.0 * a0 / w20, 2.0 * (a0 / w20 - a1 / w21), 2.0 * a1 / w21
        basis[p, 2, 0] = -3.0 * d0 / w30
        basis[p, 2, 1] = 3.0 * (d0 / w30 - d1 / w31)
        basis[p, 2, 2] = 3.0 * (d1 / w31 - d2 / w32)
        basis[p, 2, 3] = 3.0 * d2 / w32


@kernel_helper
def expand(basis, coefficients, values):
    """Write b, b', b'' at all points."""
    M = coefficients.shape[0] - 3
    for p in range(basis.shape[0]):
        i = min(p // PER_INTERVAL, M - 1)
        for d in range(3):
            s = 0.0
            for a in range(4):
                s += basis[p, d, a] * coefficients[i + a]
            values[p, d] = s


@kernel_helper
def merit(rows, cap, width, worth, density, weight, values, step, length):
    """Return time's weight times time plus barrier at values + length * step; inf outside."""
    total = 0.0
    for p in range(values.shape[0]):
        b0 = values[p, 0] + length * step[p, 0]
        b1 = values[p, 1] + length * step[p, 1]
        b2 = values[p, 2] + length * step[p, 2]
        product = 1.0 - cap[p] * b0
        if not (b0 > 0.0 and product > 0.0):
            return math.inf
        root = math.sqrt(b0)
        for j in range(rows.shape[1]):
            a = rows[p, j, 0] * b0 + rows[p, j, 1] * b1
            r = root * (rows[p, j, 2] * b0 + rows[p, j, 3] * b1 + rows[p, j, 4] * b2)
            if not (abs(a) < 1.0 and abs(r) < 1.0):
                return math.inf
            product *= (1.0 - a * a) * (1.0 - r * r)
        if not product > 0.0:
            return math.inf
        total += width[p] * (weight * worth[p] / root - density[p] * math.log(product))
    return total


@kernel_helper
def assemble(rows, cap, width, worth, density, weight, basis, values, gradient, band):
    """Write gradient and banded matrix of the merit."""
    gradient[:] = 0.0
    band[:] = 0.0
    M = gradient.shape[0] - 3
    local = np.empty(4)
    for p in range(values.shape[0]):
        b0, b1, b2 = values[p, 0], values[p, 1], values[p, 2]
        root = math.sqrt(b0)
        g0, g1, g2 = -0.5 * weight * worth[p] / (b0 * root), 0.0, 0.0
        h00 = 0.75 * weight * worth[p] / (b0 * b0 * root)
        h01 = h02 = h11 = h12 = h22 = 0.0
        density_p = density[p]
        slack = 1.0 - cap[p] * b0
        g0 += density_p * cap[p] / slack
        h00 += density_p * (cap[p] / slack) ** 2
        for j in range(rows.shape[1]):
            a0, a1 = rows[p, j, 0], rows[p, j, 1]
            a = a0 * b0 + a1 * b1
            s = 1.0 / (1.0 - a * a)
            first, second = density_p * 2.0 * a * s, density_p * 2.0 * (1.0 + a * a) * s * s
            g0 += first * a0
            g1 += first * a1
            h00 += second * a0 * a0
            h01 += second * a0 * a1
            h11 += second * a1 * a1
            inner = rows[p, j, 3] * b1 + rows[p, j, 4] * b2
            r = root * (rows[p, j, 2] * b0 + inner)
            s = 1.0 / (1.0 - r * r)
            first, second = density_p * 2.0 * r * s, density_p * 2.0 * (1.0 + r * r) * s * s
            r0 = 1.5 * rows[p, j, 2] * root + 0.5 * inner / root
            r1 = rows[p, j, 3] * root
            r2 = rows[p, j, 4] * root
            g0 += first * r0
            g1 += first * r1
            g2 += first * r2
            h00 += second * r0 * r0
            h01 += second * r0 * r1
            h02 += second * r0 * r2
            h11 += second * r1 * r1
            h12 += second * r1 * r2
            h22 += second * r2 * r2
        w = width[p]
        i = min(p // PER_INTERVAL, M - 1)
        for a in range(4):
            e0, e1, e2 = basis[p, 0, a], basis[p, 1, a], basis[p, 2, a]
            gradient[i + a] += w * (g0 * e0 + g1 * e1 + g2 * e2)
            local[0] = w * (h00 * e0 + h01 * e1 + h02 * e2)
            local[1] = w * (h01 * e0 + h11 * e1 + h12 * e2)
            local[2] = w * (h02 * e0 + h12 * e1 + h22 * e2)
            for c in range(a + 1):
                band[i + a, a - c] += local[0] * basis[p, 0, c] + local[1] * basis[p, 1, c] + local[2] * basis[p, 2, c]


@kernel(i8(c3, c1, c1, c1, c3, f8, f8, o1))
def solve_speed(rows, cap, width, worth, basis, first_weight, last_weight, coefficients):
    """Solve from strictly feasible coefficients (M + 3,) and return the Newton steps; -1 if the start is not.

    rows (P, n, 5): what b, b' give of the share of acceleration, and b, b', b'' of that of jerk over sqrt(b); cap
    (P,): 1 / largest b; width (P,): weights of the integral over u; worth (P,): of a second there; basis (P, 3, 4).
    """
    P, K = rows.shape[0], coefficients.shape[0]
    values, step = np.empty((P, 3)), np.zeros((P, 3))
    density, gradient, band = np.empty(P), np.empty(K), np.empty((K, 4))
    direction = np.empty(K)
    expand(basis, coefficients, values)
    steps = 0
    weight = first_weight
    while True:
        seconds = 0.0
        for p in range(P):
            if not values[p, 0] > 0.0:
                return -1
            # the barrier is an integral over time, as the objective is: the optimum is approached evenly everywhere
            density[p] = 1.0 / math.sqrt(values[p, 0])
            seconds += width[p] * density[p]
        value = merit(rows, cap, width, worth, density, weight, values, step, 0.0)
        if not value < math.inf:
            return -1
        last = weight >= last_weight
        for _ in range(_MOST_STEPS):
            assemble(rows, cap, width, worth, density, weight, basis, values, gradient, band)
            for i in range(K):
                direction[i] = -gradient[i]
            if not band_cholesky(band, 3):
                break
            band_solve(band, 3, direction)
            decrement = 0.0
            for i in range(K):
                decrement -= gradient[i] * direction[i]
            if not decrement > (1e-3 if last else 1e-2) * seconds:
                break
            expand(basis, direction, step)
            length, found, after = 1.0, False, math.inf
            for _ in range(_MOST_HALVINGS):
                after = merit(rows, cap, width, worth, density, weight, values, step, length)
                if after < value - 1e-4 * length * decrement:
                    found = True
                    break
                length *= 0.5
            steps += 1
            if not found:
                break
            for i in range(K):
                coefficients[i] += length * direction[i]
            expand(basis, coefficients, values)
            value = after
            step[:] = 0.0
        step[:] = 0.0
        if last:
            return steps
        weight = min(weight * _GROWTH, last_weight)


@kernel(void(c2, c2, c2, c2, c2, i8, o2))
def largest_shares(q1, q2, q3, b, limits, per, shares):
    """Write the largest shares of velocity, acceleration and jerk of each interval, (M, 3).

    Each is looked at ``per`` times and at the interval's end; in between, at the vertices of the parabolas through
    three neighbouring looks.

    q1, q2, q3 (M * per + 1, n); b (M * per + 1, 3); limits (3, n).
    """
    n = q1.shape[1]
    values = np.empty((3, per + 1, n))
    for m in range(shares.shape[0]):
        for k in range(per + 1):
            p = m * per + k
            root = math.sqrt(b[p, 0])
            for j in range(n):
                values[0, k, j] = q1[p, j] * root / limits[0, j]
                values[1, k, j] = (q2[p, j] * b[p, 0] + 0.5 * q1[p, j] * b[p, 1]) / limits[1, j]
                jerk = q3[p, j] * b[p, 0] + 1.5 * q2[p, j] * b[p, 1] + 0.5 * q1[p, j] * b[p, 2]
                values[2, k, j] = root * jerk / limits[2, j]
        for order in range(3):
            largest = 0.0
            for k in range(per + 1):
                for j in range(n):
                    largest = max(largest, abs(values[order, k, j]))
            for k in range(1, per):
                for j in range(n):
                    middle = values[order, k, j]
                    slope = 0.5 * (values[order, k + 1, j] - values[order, k - 1, j])
                    bend = values[order, k + 1, j] - 2.0 * middle + values[order, k - 1, j]
                    # the vertex lies between the three looks
                    if abs(slope) < abs(bend):
                        largest = max(largest, abs(middle - 0.5 * slope * slope / bend))
            shares[m, order] = largest
