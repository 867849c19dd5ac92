"""Small vectors, rotations and linear systems inside compiled laws: no library call, no temporary array."""

import math

import numpy as np

from control.kernels.compiled import kernel

Triple = tuple[float, float, float]


@kernel("f8(f8, f8, f8)")
def clip(value: float, low: float, high: float) -> float:
    """`value`, or the end of [low, high] beyond which it lies."""
    return min(max(value, low), high)


@kernel("UniTuple(f8, 3)(matrix, vector)")
def rotate(rotation: np.ndarray, vector: np.ndarray) -> Triple:
    """R v of a matrix (3, 3) and a vector (3,)."""
    r, v = rotation, vector
    return (
        r[0, 0] * v[0] + r[0, 1] * v[1] + r[0, 2] * v[2],
        r[1, 0] * v[0] + r[1, 1] * v[1] + r[1, 2] * v[2],
        r[2, 0] * v[0] + r[2, 1] * v[1] + r[2, 2] * v[2],
    )


@kernel("UniTuple(f8, 3)(matrix, vector)")
def rotate_back(rotation: np.ndarray, vector: np.ndarray) -> Triple:
    """R^T v of a matrix (3, 3) and a vector (3,)."""
    r, v = rotation, vector
    return (
        r[0, 0] * v[0] + r[1, 0] * v[1] + r[2, 0] * v[2],
        r[0, 1] * v[0] + r[1, 1] * v[1] + r[2, 1] * v[2],
        r[0, 2] * v[0] + r[1, 2] * v[1] + r[2, 2] * v[2],
    )


@kernel("b1(f8[:,::1])")
def factorize(matrix: np.ndarray) -> bool:
    """Cholesky's factor L of A = L L^T in place; False where A is not positive definite.

    Args:
        matrix: (n, n) A, symmetric; its lower triangle is read and becomes L.
    """
    for j in range(len(matrix)):
        pivot = matrix[j, j]
        for k in range(j):
            pivot -= matrix[j, k] * matrix[j, k]
        if not pivot > 0.0:
            return False
        root = math.sqrt(pivot)
        matrix[j, j] = root
        for i in range(j + 1, len(matrix)):
            rest = matrix[i, j]
            for k in range(j):
                rest -= matrix[i, k] * matrix[j, k]
            matrix[i, j] = rest / root
    return True


@kernel("void(f8[:,::1], f8[::1])")
def substitute(factor: np.ndarray, vector: np.ndarray) -> None:
    """Solve L L^T x = b in place.

    Args:
        factor: (n, n) of `factorize`.
        vector: (n,) b, becomes x.
    """
    size = len(vector)
    for j in range(size):
        for k in range(j):
            vector[j] -= factor[j, k] * vector[k]
        vector[j] /= factor[j, j]
    for j in range(size - 1, -1, -1):
        for k in range(j + 1, size):
            vector[j] -= factor[k, j] * vector[k]
        vector[j] /= factor[j, j]


@kernel("void(f8[:,::1], f8[:,::1])")
def substitute_all(factor: np.ndarray, vectors: np.ndarray) -> None:
    """Solve L L^T X = B in place, for all columns at once.

    Args:
        factor: (n, n) of `factorize`.
        vectors: (n, m) B, becomes X.
    """
    size, count = vectors.shape
    for j in range(size):
        for k in range(j):
            for column in range(count):
                vectors[j, column] -= factor[j, k] * vectors[k, column]
        scale = 1.0 / factor[j, j]
        for column in range(count):
            vectors[j, column] *= scale
    for j in range(size - 1, -1, -1):
        for k in range(j + 1, size):
            for column in range(count):
                vectors[j, column] -= factor[k, j] * vectors[k, column]
        scale = 1.0 / factor[j, j]
        for column in range(count):
            vectors[j, column] *= scale


@kernel("b1(f8[:,::1], f8[::1])")
def solve_positive(matrix: np.ndarray, vector: np.ndarray) -> bool:
    """Solve A x = b in place; False where A is not positive definite.

    Args:
        matrix: (n, n) A, symmetric; its lower triangle is read and becomes Cholesky's factor.
        vector: (n,) b, becomes x.
    """
    if not factorize(matrix):
        return False
    substitute(matrix, vector)
    return True
