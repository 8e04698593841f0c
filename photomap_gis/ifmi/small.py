"""Small symmetric matrices, compiled: what LAPACK does for eight unknowns takes less time than to ask it.

The kernels of other files call these: their kept machine code holds these functions as they were when it was made.
Where this file is changed, `touch` those.
"""

from __future__ import annotations

import math

import numpy as np

from photomap_gis.compiled import compiled
from photomap_gis.core.similarity import FloatArray

SWEEPS = 12
"""Jacobi's rotations converge quadratically: matrices of 8 rows need five or six sweeps."""


@compiled("void(f8[:, ::1], f8[:, ::1])")
def solve(matrix: FloatArray, right: FloatArray) -> None:
    """Solve ``matrix X = right`` by Cholesky's factors, in place of both; ``right`` is ``(n, k)``.

    Only the lower triangle of the matrix is read, which must be positive definite: where it is not, X is NaN.
    """
    n, k = right.shape
    for i in range(n):
        for j in range(i + 1):
            total = matrix[i, j]
            for m in range(j):
                total -= matrix[i, m] * matrix[j, m]
            matrix[i, j] = math.sqrt(total) if i == j else total / matrix[j, j]
    for c in range(k):
        for i in range(n):
            total = right[i, c]
            for m in range(i):
                total -= matrix[i, m] * right[m, c]
            right[i, c] = total / matrix[i, i]
        for i in range(n - 1, -1, -1):
            total = right[i, c]
            for m in range(i + 1, n):
                total -= matrix[m, i] * right[m, c]
            right[i, c] = total / matrix[i, i]


@compiled("void(f8[:, ::1], f8[:, ::1])")
def eigen(matrix: FloatArray, axes: FloatArray) -> None:
    """Turn a symmetric matrix into its eigenvalues, on its diagonal, and write its axes, in columns (Jacobi)."""
    n = len(matrix)
    axes[:] = 0.0
    for i in range(n):
        axes[i, i] = 1.0
    for _ in range(SWEEPS):
        beside, along = 0.0, 0.0
        for i in range(n):
            along += matrix[i, i] * matrix[i, i]
            for j in range(i):
                beside += matrix[i, j] * matrix[i, j]
        if beside <= 1e-26 * along:
            break
        for p in range(n - 1):
            for q in range(p + 1, n):
                if matrix[p, q] == 0.0:
                    continue
                ratio = (matrix[q, q] - matrix[p, p]) / (2.0 * matrix[p, q])
                t = math.copysign(1.0, ratio) / (abs(ratio) + math.sqrt(ratio * ratio + 1.0))
                c = 1.0 / math.sqrt(t * t + 1.0)
                s = t * c
                for m in range(n):
                    at_p, at_q = matrix[m, p], matrix[m, q]
                    matrix[m, p], matrix[m, q] = c * at_p - s * at_q, s * at_p + c * at_q
                for m in range(n):
                    at_p, at_q = matrix[p, m], matrix[q, m]
                    matrix[p, m], matrix[q, m] = c * at_p - s * at_q, s * at_p + c * at_q
                    at_p, at_q = axes[m, p], axes[m, q]
                    axes[m, p], axes[m, q] = c * at_p - s * at_q, s * at_p + c * at_q


@compiled("f4(f4[::1], i8)")
def ranked(values: np.ndarray, rank: int) -> float:
    """Return the value that would stand at ``rank`` if ``(n,)`` values were sorted; their order is changed (Hoare)."""
    low, high = 0, len(values) - 1
    while low < high:
        pivot, i, j = values[(low + high) // 2], low, high
        while i <= j:
            while values[i] < pivot:
                i += 1
            while pivot < values[j]:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i += 1
                j -= 1
        if rank <= j:
            high = j
        elif rank >= i:
            low = i
        else:
            break
    return float(values[rank])
