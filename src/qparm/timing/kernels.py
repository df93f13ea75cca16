"""Compiled: the exact peaks of quintics.

The extremes of a polynomial lie at the ends and at the roots of its derivative, and between two
neighbouring extremes it is monotone: so from the jerk (a quadratic) downwards, every order's roots are
bracketed by the extremes of the order above.
"""

from __future__ import annotations

import math

import numpy as np

from qparm.compiled.kernels import c1, c2, kernel, kernel_helper, o3, void

__all__ = ["quintic_peaks"]


@kernel_helper
def horner(p, degree, x):
    """Return the polynomial p[0] x^degree + ... + p[degree] at x."""
    value = p[0]
    for k in range(1, degree + 1):
        value = value * x + p[k]
    return value


@kernel_helper
def monotone_roots(p, degree, brackets, count, roots):
    """Write the roots of p that lie between neighbouring brackets, p being monotone there; return how many."""
    found = 0
    low = brackets[0]
    value_low = horner(p, degree, low)
    for k in range(1, count):
        high = brackets[k]
        value_high = horner(p, degree, high)
        if (value_low < 0.0 < value_high) or (value_high < 0.0 < value_low):
            a, b, fa = low, high, value_low
            for _ in range(60):
                middle = 0.5 * (a + b)
                f = horner(p, degree, middle)
                if (f < 0.0) == (fa < 0.0):
                    a = middle
                else:
                    b = middle
                if b - a < 1e-14:
                    break
            roots[found] = 0.5 * (a + b)
            found += 1
        low, value_low = high, value_high
    return found


@kernel_helper
def with_ends(roots, count, brackets):
    """Write 0, the roots, 1 into brackets; return how many."""
    brackets[0] = 0.0
    for k in range(count):
        brackets[k + 1] = roots[k]
    brackets[count + 1] = 1.0
    return count + 2


@kernel_helper
def control_extremes(p, degree, control):
    """Write the Bezier control values of p on [0, 1] and return their least and largest: bounds of p."""
    # b_i = sum_k C(i, k) / C(degree, k) * coefficient of x^k
    low, high = math.inf, -math.inf
    for i in range(degree + 1):
        value, ratio = 0.0, 1.0
        for k in range(i + 1):
            value += ratio * p[degree - k]
            ratio *= (i - k) / (degree - k) if k < degree else 0.0
        control[i] = value
        low, high = min(low, value), max(high, value)
    return low, high


@kernel_helper
def largest_at(p, degree, x, count):
    """Return the largest absolute value of p at the given points."""
    largest = 0.0
    for k in range(count):
        largest = max(largest, abs(horner(p, degree, x[k])))
    return largest


@kernel(void(c2, c2, c2, c1, c2, c1, c1, o3))
def quintic_peaks(q, v, a, dt, limits, lower, upper, peaks):
    """Write the peaks of the quintics between neighbouring states (q, v, a).

    ``peaks[k, i] = (max |velocity|, max |acceleration|, max |jerk|, least, largest position)`` of joint i
    on interval k. Velocities and positions that are proved to lie within their limits by their control
    values are given by these, which bound them; all others are exact.
    """
    p5, p4, p3, p2 = np.empty(6), np.empty(5), np.empty(4), np.empty(3)
    roots, brackets, control = np.empty(8), np.empty(10), np.empty(6)
    for k in range(dt.shape[0]):
        h = dt[k]
        for i in range(q.shape[1]):
            # in x = time / h, relative to the first position, which keeps the digits of small steps
            D = q[k + 1, i] - q[k, i]
            v0, v1 = v[k, i] * h, v[k + 1, i] * h
            a0, a1 = a[k, i] * h * h, a[k + 1, i] * h * h
            D = D - v0 - 0.5 * a0
            E = v1 - v0 - a0
            F = a1 - a0
            p5[0] = 6.0 * D - 3.0 * E + 0.5 * F
            p5[1] = -15.0 * D + 7.0 * E - F
            p5[2] = 10.0 * D - 4.0 * E + 0.5 * F
            p5[3] = 0.5 * a0
            p5[4] = v0
            p5[5] = 0.0
            for m in range(5):
                p4[m] = (5 - m) * p5[m]
            for m in range(4):
                p3[m] = (4 - m) * p4[m]
            for m in range(3):
                p2[m] = (3 - m) * p3[m]
            # jerk: its ends and its vertex; its roots by the stable quadratic formula
            jerk = max(abs(p2[2]), abs(p2[0] + p2[1] + p2[2]))
            if p2[0] != 0.0:
                vertex = -0.5 * p2[1] / p2[0]
                if 0.0 < vertex < 1.0:
                    jerk = max(jerk, abs(horner(p2, 2, vertex)))
            count = 0
            discriminant = p2[1] * p2[1] - 4.0 * p2[0] * p2[2]
            if discriminant > 0.0:
                w = -0.5 * (p2[1] + math.copysign(math.sqrt(discriminant), p2[1]))
                first = w / p2[0] if p2[0] != 0.0 else math.nan
                second = p2[2] / w if w != 0.0 else math.nan
                if first > second:
                    first, second = second, first
                if 0.0 < first < 1.0:
                    roots[count] = first
                    count += 1
                if 0.0 < second < 1.0:
                    roots[count] = second
                    count += 1
            count = with_ends(roots, count, brackets)
            peaks[k, i, 1] = largest_at(p3, 3, brackets, count) / (h * h)
            peaks[k, i, 2] = jerk / (h * h * h)
            low, high = control_extremes(p4, 4, control)
            fast = max(-low, high) / h
            low, high = control_extremes(p5, 5, control)
            low += q[k, i]
            high += q[k, i]
            if fast > limits[0, i] or low < lower[i] or high > upper[i]:
                count = monotone_roots(p3, 3, brackets, count, roots)
                count = with_ends(roots, count, brackets)
                fast = largest_at(p4, 4, brackets, count) / h
                count = monotone_roots(p4, 4, brackets, count, roots)
                low = high = q[k, i]
                roots[count] = 1.0
                for m in range(count + 1):
                    value = q[k, i] + horner(p5, 5, roots[m])
                    low, high = min(low, value), max(high, value)
            peaks[k, i, 0] = fast
            peaks[k, i, 3] = low
            peaks[k, i, 4] = high
