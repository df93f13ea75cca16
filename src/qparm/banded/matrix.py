"""Compiled: Cholesky factor and solution of symmetric band matrices."""

from __future__ import annotations

import math

from qparm.compiled.kernels import kernel_helper

__all__ = ["band_cholesky", "band_solve"]


@kernel_helper
def band_cholesky(A, kb):
    """Factor a symmetric band matrix in place; ``A[I, o]`` holds entry (I, I - o). Return False if not positive."""
    for i in range(A.shape[0]):
        first = max(0, i - kb)
        for j in range(first, i + 1):
            s = A[i, i - j]
            for k in range(max(first, j - kb), j):
                s -= A[i, i - k] * A[j, j - k]
            if j < i:
                A[i, i - j] = s / A[j, 0]
            else:
                if not s > 0.0:
                    return False
                A[i, 0] = math.sqrt(s)
    return True


@kernel_helper
def band_solve(A, kb, x):
    """Solve in place with the factor of :func:`band_cholesky`."""
    N = A.shape[0]
    for i in range(N):
        s = x[i]
        for k in range(max(0, i - kb), i):
            s -= A[i, i - k] * x[k]
        x[i] = s / A[i, 0]
    for i in range(N - 1, -1, -1):
        s = x[i] / A[i, 0]
        x[i] = s
        for k in range(max(0, i - kb), i):
            x[k] -= A[i, i - k] * s
