"""A convex QP over a whole path, by an interior point method whose cost is linear in the path's length.

    min  1/2 z^T H z + g^T z      s.t.  lo_k <= C_k z_k <= hi_k,   slo_k <= C_{k+1} z_{k+1} - C_k z_k <= shi_k

z_k are the r unknowns of waypoint k, C_k (m, r). H couples a waypoint with the three that follow it, so that
the condensed matrix H + C^T (Lambda / S) C of every iteration is banded with 4 r - 1 subdiagonals: one band
Cholesky factorisation an iteration. Mehrotra's predictor and corrector.
"""

from __future__ import annotations

import math

import numpy as np

from qparm.banded.matrix import band_cholesky, band_solve
from qparm.compiled.kernels import c2, c3, c4, f8, i8, kernel, kernel_helper, o1

__all__ = ["REACH", "banded_qp_kernel"]

# How many following waypoints the objective couples with one: third differences span four.
REACH = 3
# A step goes this far to the border of the positive orthant.
_TO_BORDER = 0.995


@kernel_helper
def rows_of(C, z, box, step):
    """Write box = C_k z_k and step = C_{k+1} z_{k+1} - C_k z_k."""
    N, m, r = C.shape
    for k in range(N):
        for i in range(m):
            s = 0.0
            for a in range(r):
                s += C[k, i, a] * z[k * r + a]
            box[k, i] = s
    for k in range(N - 1):
        for i in range(m):
            step[k, i] = box[k + 1, i] - box[k, i]


@kernel_helper
def add_transposed(C, box, step, out):
    """Add C^T box and the steps' C^T step to out."""
    N, m, r = C.shape
    for k in range(N):
        for i in range(m):
            t = box[k, i]
            if k < N - 1:
                t -= step[k, i]
            if k > 0:
                t += step[k - 1, i]
            if t != 0.0:
                for a in range(r):
                    out[k * r + a] += C[k, i, a] * t


@kernel_helper
def gradient(H, g, z, out):
    """Write H z + g."""
    N, reach, r, _ = H.shape
    for k in range(N):
        for a in range(r):
            out[k * r + a] = g[k, a]
    for k in range(N):
        for o in range(min(reach, N - k)):
            for a in range(r):
                for b in range(r):
                    h = H[k, o, a, b]
                    out[k * r + a] += h * z[(k + o) * r + b]
                    if o > 0:
                        out[(k + o) * r + b] += h * z[k * r + a]


@kernel_helper
def condense(H, C, box, step, A, kb):
    """Write the band of H + C^T diag(box, step) C."""
    N, reach, r, _ = H.shape
    m = C.shape[1]
    A[:] = 0.0
    for k in range(N):
        for o in range(min(reach, N - k)):
            for a in range(r):
                for b in range(r):
                    row, column = (k + o) * r + b, k * r + a
                    if row >= column:
                        A[row, row - column] += H[k, o, a, b]
        for i in range(m):
            w = box[k, i]
            if k < N - 1:
                w += step[k, i]
            if k > 0:
                w += step[k - 1, i]
            if w != 0.0:
                for a in range(r):
                    for b in range(a + 1):
                        A[k * r + a, a - b] += w * C[k, i, a] * C[k, i, b]
            if k < N - 1 and step[k, i] != 0.0:
                w = -step[k, i]
                for a in range(r):
                    for b in range(r):
                        row, column = (k + 1) * r + b, k * r + a
                        A[row, row - column] += w * C[k + 1, i, b] * C[k, i, a]


@kernel_helper
def start_side(a, lo, hi, s_lo, s_hi, l_lo, l_hi, scale):
    """Write first slacks and multipliers; those of infinite bounds stay zero."""
    count = 0
    for k in range(a.shape[0]):
        for i in range(a.shape[1]):
            l_lo[k, i] = l_hi[k, i] = 0.0
            s_lo[k, i] = s_hi[k, i] = 1.0
            if lo[k, i] > -math.inf:
                s_lo[k, i] = max(a[k, i] - lo[k, i], scale)
                l_lo[k, i] = scale
                count += 1
            if hi[k, i] < math.inf:
                s_hi[k, i] = max(hi[k, i] - a[k, i], scale)
                l_hi[k, i] = scale
                count += 1
    return count


@kernel_helper
def complement(s_lo, s_hi, l_lo, l_hi):
    """Return the sum of slack times multiplier."""
    t = 0.0
    for k in range(s_lo.shape[0]):
        for i in range(s_lo.shape[1]):
            t += s_lo[k, i] * l_lo[k, i] + s_hi[k, i] * l_hi[k, i]
    return t


@kernel_helper
def weights_of(s_lo, s_hi, l_lo, l_hi, out):
    """Write Lambda / S of both sides."""
    for k in range(out.shape[0]):
        for i in range(out.shape[1]):
            out[k, i] = l_lo[k, i] / s_lo[k, i] + l_hi[k, i] / s_hi[k, i]


@kernel_helper
def push(a, lo, hi, s_lo, s_hi, l_lo, l_hi, mu, c_lo, c_hi, out):
    """Write what the rows add to the right-hand side: C^T out, with second-order terms c."""
    for k in range(a.shape[0]):
        for i in range(a.shape[1]):
            t = 0.0
            if l_hi[k, i] > 0.0:
                residual = a[k, i] + s_hi[k, i] - hi[k, i]
                t += (l_hi[k, i] * residual - (s_hi[k, i] * l_hi[k, i] - mu + c_hi[k, i])) / s_hi[k, i]
            if l_lo[k, i] > 0.0:
                residual = -a[k, i] + s_lo[k, i] + lo[k, i]
                t -= (l_lo[k, i] * residual - (s_lo[k, i] * l_lo[k, i] - mu + c_lo[k, i])) / s_lo[k, i]
            out[k, i] = t


@kernel_helper
def sides(a, da, lo, hi, s_lo, s_hi, l_lo, l_hi, mu, c_lo, c_hi, d_s_lo, d_s_hi, d_l_lo, d_l_hi, alpha):
    """Write the steps of slacks and multipliers; shorten alpha (primal, dual) to stay positive."""
    for k in range(a.shape[0]):
        for i in range(a.shape[1]):
            d_s_lo[k, i] = d_s_hi[k, i] = d_l_lo[k, i] = d_l_hi[k, i] = 0.0
            if l_hi[k, i] > 0.0:
                residual = a[k, i] + s_hi[k, i] - hi[k, i]
                ds = -residual - da[k, i]
                dl = (-(s_hi[k, i] * l_hi[k, i] - mu + c_hi[k, i]) - l_hi[k, i] * ds) / s_hi[k, i]
                d_s_hi[k, i], d_l_hi[k, i] = ds, dl
                if ds < 0.0:
                    alpha[0] = min(alpha[0], -s_hi[k, i] / ds)
                if dl < 0.0:
                    alpha[1] = min(alpha[1], -l_hi[k, i] / dl)
            if l_lo[k, i] > 0.0:
                residual = -a[k, i] + s_lo[k, i] + lo[k, i]
                ds = -residual + da[k, i]
                dl = (-(s_lo[k, i] * l_lo[k, i] - mu + c_lo[k, i]) - l_lo[k, i] * ds) / s_lo[k, i]
                d_s_lo[k, i], d_l_lo[k, i] = ds, dl
                if ds < 0.0:
                    alpha[0] = min(alpha[0], -s_lo[k, i] / ds)
                if dl < 0.0:
                    alpha[1] = min(alpha[1], -l_lo[k, i] / dl)


@kernel_helper
def largest_violation(a, lo, hi):
    """Return by how much the rows leave their bounds."""
    worst = 0.0
    for k in range(a.shape[0]):
        for i in range(a.shape[1]):
            worst = max(worst, lo[k, i] - a[k, i], a[k, i] - hi[k, i])
    return worst


@kernel(i8(c4, c2, c3, c2, c2, c2, c2, f8, i8, o1, o1))
def banded_qp_kernel(H, g, C, lo, hi, slo, shi, tolerance, limit, z, quality):
    """Solve from z; return the iterations, negative if the tolerance was not met.

    H (N, 4, r, r): blocks (k, k + o); g (N, r); C (N, m, r); lo, hi (N, m); slo, shi (N - 1, m); infinite
    entries allowed. ``quality`` receives the dual residual, the violation of the rows and the mean complement.
    """
    N, m, r = C.shape
    kb = (REACH + 1) * r - 1
    A, dz, rhs, grad = np.empty((N * r, kb + 1)), np.empty(N * r), np.empty(N * r), np.empty(N * r)
    box, dbox, wbox, cbl, cbh = np.empty((N, m)), np.empty((N, m)), np.empty((N, m)), np.zeros((N, m)), np.zeros((N, m))
    step, dstep, wstep = np.empty((N - 1, m)), np.empty((N - 1, m)), np.empty((N - 1, m))
    csl, csh = np.zeros((N - 1, m)), np.zeros((N - 1, m))
    bsl, bsh, bll, blh = np.empty((N, m)), np.empty((N, m)), np.empty((N, m)), np.empty((N, m))
    ssl, ssh = np.empty((N - 1, m)), np.empty((N - 1, m))
    sll, slh = np.empty((N - 1, m)), np.empty((N - 1, m))
    dbsl, dbsh, dbll, dblh = np.empty((N, m)), np.empty((N, m)), np.empty((N, m)), np.empty((N, m))
    dssl, dssh, dsll, dslh = np.empty((N - 1, m)), np.empty((N - 1, m)), np.empty((N - 1, m)), np.empty((N - 1, m))
    alpha = np.empty(2)
    gradient(H, g, z, grad)
    scale = 1e-8
    for i in range(N * r):
        scale = max(scale, abs(grad[i]))
    size = scale
    scale = min(scale, 1.0)
    rows_of(C, z, box, step)
    spread = 0.1
    count = start_side(box, lo, hi, bsl, bsh, bll, blh, spread) + start_side(step, slo, shi, ssl, ssh, sll, slh, spread)
    for k in range(N):
        for i in range(m):
            bll[k, i] *= scale
            blh[k, i] *= scale
    for k in range(N - 1):
        for i in range(m):
            sll[k, i] *= scale
            slh[k, i] *= scale
    for iteration in range(limit):
        rows_of(C, z, box, step)
        gradient(H, g, z, grad)
        for i in range(N * r):
            rhs[i] = grad[i]
        for k in range(N):
            for i in range(m):
                wbox[k, i] = blh[k, i] - bll[k, i]
        for k in range(N - 1):
            for i in range(m):
                wstep[k, i] = slh[k, i] - sll[k, i]
        add_transposed(C, wbox, wstep, rhs)  # the dual residual
        dual = 0.0
        for i in range(N * r):
            dual = max(dual, abs(rhs[i]))
            grad[i] = rhs[i]
        mu = (complement(bsl, bsh, bll, blh) + complement(ssl, ssh, sll, slh)) / max(count, 1)
        violation = max(largest_violation(box, lo, hi), largest_violation(step, slo, shi))
        quality[0], quality[1], quality[2] = dual, violation, mu
        if dual <= tolerance * size and violation <= tolerance and mu <= tolerance * scale * 0.1:
            return iteration
        weights_of(bsl, bsh, bll, blh, wbox)
        weights_of(ssl, ssh, sll, slh, wstep)
        condense(H, C, wbox, wstep, A, kb)
        if not band_cholesky(A, kb):
            return -iteration - 1
        cbl[:] = 0.0
        cbh[:] = 0.0
        csl[:] = 0.0
        csh[:] = 0.0
        target = 0.0
        for corrector in range(2):
            push(box, lo, hi, bsl, bsh, bll, blh, target, cbl, cbh, wbox)
            push(step, slo, shi, ssl, ssh, sll, slh, target, csl, csh, wstep)
            for i in range(N * r):
                dz[i] = grad[i]
            add_transposed(C, wbox, wstep, dz)
            for i in range(N * r):
                dz[i] = -dz[i]
            band_solve(A, kb, dz)
            rows_of(C, dz, dbox, dstep)
            alpha[0] = alpha[1] = 1.0 if corrector == 0 else 1.0 / _TO_BORDER
            sides(box, dbox, lo, hi, bsl, bsh, bll, blh, target, cbl, cbh, dbsl, dbsh, dbll, dblh, alpha)
            sides(step, dstep, slo, shi, ssl, ssh, sll, slh, target, csl, csh, dssl, dssh, dsll, dslh, alpha)
            if corrector == 1 or count == 0:
                break
            ahead = 0.0
            for k in range(N):
                for i in range(m):
                    ahead += (bsl[k, i] + alpha[0] * dbsl[k, i]) * (bll[k, i] + alpha[1] * dbll[k, i])
                    ahead += (bsh[k, i] + alpha[0] * dbsh[k, i]) * (blh[k, i] + alpha[1] * dblh[k, i])
                    cbl[k, i], cbh[k, i] = dbsl[k, i] * dbll[k, i], dbsh[k, i] * dblh[k, i]
            for k in range(N - 1):
                for i in range(m):
                    ahead += (ssl[k, i] + alpha[0] * dssl[k, i]) * (sll[k, i] + alpha[1] * dsll[k, i])
                    ahead += (ssh[k, i] + alpha[0] * dssh[k, i]) * (slh[k, i] + alpha[1] * dslh[k, i])
                    csl[k, i], csh[k, i] = dssl[k, i] * dsll[k, i], dssh[k, i] * dslh[k, i]
            share = ahead / count / max(mu, 1e-300)
            target = mu * share**3
        primal, dual_step = min(1.0, _TO_BORDER * alpha[0]), min(1.0, _TO_BORDER * alpha[1])
        # a quadratic objective ties the two residuals together: one length for both
        length = min(primal, dual_step)
        for i in range(N * r):
            z[i] += length * dz[i]
        for k in range(N):
            for i in range(m):
                bsl[k, i] += length * dbsl[k, i]
                bsh[k, i] += length * dbsh[k, i]
                bll[k, i] += length * dbll[k, i]
                blh[k, i] += length * dblh[k, i]
        for k in range(N - 1):
            for i in range(m):
                ssl[k, i] += length * dssl[k, i]
                ssh[k, i] += length * dssh[k, i]
                sll[k, i] += length * dsll[k, i]
                slh[k, i] += length * dslh[k, i]
    return -limit
