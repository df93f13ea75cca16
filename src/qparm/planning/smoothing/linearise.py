"""The path QP about one iterate, compiled: null spaces, least-norm corrections, and the objective in what is left."""

from __future__ import annotations

import math

import numpy as np

from qparm.banded.qp import REACH
from qparm.compiled.kernels import c2, c3, f8, kernel, kernel_helper, o2, o3, o4, void

__all__ = ["linearise_kernel"]

# A row of R smaller than the largest by more than this is no row: the task has lost rank there.
_RANK = 1e-9
# What the differences do not see (a straight line through one run) is held by next to nothing.
_HELD = 1e-9


@kernel_helper
def householder(A, V, beta, R):
    """Factor A (n, m), m <= n, in place: R (m, m) upper triangular, reflectors in V (n, m) and beta (m,)."""
    n, m = A.shape
    for j in range(m):
        norm = 0.0
        for i in range(j, n):
            norm += A[i, j] * A[i, j]
        norm = math.sqrt(norm)
        alpha = -norm if A[j, j] > 0.0 else norm
        for i in range(n):
            V[i, j] = A[i, j] if i >= j else 0.0
        V[j, j] -= alpha
        square = 0.0
        for i in range(j, n):
            square += V[i, j] * V[i, j]
        beta[j] = 2.0 / square if square > 0.0 else 0.0
        for k in range(j, m):
            t = 0.0
            for i in range(j, n):
                t += V[i, j] * A[i, k]
            t *= beta[j]
            for i in range(j, n):
                A[i, k] -= t * V[i, j]
        for i in range(j + 1):
            R[i, j] = A[i, j]


@kernel_helper
def reflect(V, beta, x):
    """Multiply x by Q in place."""
    n, m = V.shape
    for j in range(m - 1, -1, -1):
        t = 0.0
        for i in range(j, n):
            t += V[i, j] * x[i]
        t *= beta[j]
        for i in range(j, n):
            x[i] -= t * V[i, j]


@kernel(void(c3, c2, c2, c2, c3, c2, f8, o2, o3, o4, o2))
def linearise_kernel(task, error, K, u, relaxed, rho, nominal, p, B, H, g):
    """Write p, B, H and g of ``min 1/2 z^T H z + g^T z`` with d = p + B z and J d = e.

    task (N, m, n), error (N, m): the pose rows J and e. K (4, N): couplings of the differences; u (N, n): the
    scaled joints. relaxed (N, f, n), rho (N, f): rows and values of the free parameters, whose squares weigh
    ``nominal``. p (N, n), B (N, n, r), H (N, 4, r, r), g (N, r). With J^T = Q R the last columns of Q span
    the null space and p = Q R^-T e is the least-norm correction.
    """
    N, m, n = task.shape
    r, f = B.shape[2], relaxed.shape[1]
    A, V, beta, R, x, y = np.empty((n, m)), np.empty((n, m)), np.empty(m), np.zeros((m, m)), np.empty(n), np.empty(m)
    Ku, moved = np.zeros((N, n)), np.empty((N, n))
    for k in range(N):
        for i in range(n):
            for j in range(m):
                A[i, j] = task[k, j, i]
        householder(A, V, beta, R)
        largest = 0.0
        for j in range(m):
            largest = max(largest, abs(R[j, j]))
        for j in range(m):
            t = error[k, j]
            for i in range(j):
                t -= R[i, j] * y[i]
            y[j] = t / R[j, j] if abs(R[j, j]) > _RANK * largest else 0.0
        for i in range(n):
            x[i] = y[i] if i < m else 0.0
        reflect(V, beta, x)
        for i in range(n):
            p[k, i] = x[i]
            moved[k, i] = u[k, i] + x[i]
        for a in range(r):
            x[:] = 0.0
            x[m + a] = 1.0
            reflect(V, beta, x)
            for i in range(n):
                B[k, i, a] = x[i]
    H[:] = 0.0
    for k in range(N):
        for o in range(min(REACH + 1, N - k)):
            c = K[o, k]
            if c == 0.0:
                continue
            for i in range(n):
                Ku[k, i] += c * moved[k + o, i]
                if o > 0:
                    Ku[k + o, i] += c * moved[k, i]
                for a in range(r):
                    t = c * B[k, i, a]
                    for b in range(r):
                        H[k, o, a, b] += t * B[k + o, i, b]
    for k in range(N):
        for a in range(r):
            t = 0.0
            for i in range(n):
                t += B[k, i, a] * Ku[k, i]
            g[k, a] = t
            H[k, 0, a, a] += _HELD
        for j in range(f):
            value = rho[k, j]
            for i in range(n):
                value += relaxed[k, j, i] * p[k, i]
            for a in range(r):
                t = 0.0
                for i in range(n):
                    t += relaxed[k, j, i] * B[k, i, a]
                g[k, a] += 2.0 * nominal * t * value
                for b in range(r):
                    t2 = 0.0
                    for i in range(n):
                        t2 += relaxed[k, j, i] * B[k, i, b]
                    H[k, 0, a, b] += 2.0 * nominal * t * t2
