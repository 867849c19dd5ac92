"""Rotations of many robots at once: leading axis n, otherwise as control.frames.

Arrays of a batch lie in Fortran order, n innermost, so that arithmetic on components runs over contiguous numbers.
"""

import numpy as np


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Cross product over the last axis, without the overhead of np.cross."""
    out = np.empty(np.broadcast_shapes(a.shape, b.shape), order="F")
    out[..., 0] = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    out[..., 1] = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    out[..., 2] = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return out


def rotations_from_quaternions(wxyz: np.ndarray) -> np.ndarray:
    """Rotation matrices (n, 3, 3) of unit quaternions (n, 4)."""
    w, x, y, z = wxyz.T
    out = np.empty((len(wxyz), 3, 3), order="F")
    out[:, 0, 0], out[:, 0, 1], out[:, 0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    out[:, 1, 0], out[:, 1, 1], out[:, 1, 2] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    out[:, 2, 0], out[:, 2, 1], out[:, 2, 2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)
    return out


def quaternions_from_rotations(rotations: np.ndarray) -> np.ndarray:
    """Unit quaternions (n, 4), w >= 0, of rotation matrices (n, 3, 3): the column of 4 q q^T with the largest diagonal."""
    r = rotations
    products = np.empty((len(r), 4, 4), order="F")
    trace = r[:, 0, 0] + r[:, 1, 1] + r[:, 2, 2]
    products[:, 0, 0] = 1.0 + trace
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        products[:, i + 1, i + 1] = 1.0 + 2.0 * r[:, i, i] - trace
        products[:, 0, i + 1] = products[:, i + 1, 0] = r[:, k, j] - r[:, j, k]
        products[:, i + 1, j + 1] = products[:, j + 1, i + 1] = r[:, i, j] + r[:, j, i]
    largest = np.argmax(np.einsum("nii->ni", products), axis=1)
    wxyz = products[np.arange(len(r)), largest]
    wxyz /= np.linalg.norm(wxyz, axis=1, keepdims=True)
    return np.where(wxyz[:, :1] < 0.0, -wxyz, wxyz)


def quaternion_products(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Hamilton products (n, 4): first `b`, then `a`."""
    out = np.empty_like(a)
    out[:, 0] = a[:, 0] * b[:, 0] - np.einsum("ni,ni->n", a[:, 1:], b[:, 1:])
    out[:, 1:] = a[:, :1] * b[:, 1:] + b[:, :1] * a[:, 1:] + cross(a[:, 1:], b[:, 1:])
    return out


def rotation_errors(targets: np.ndarray, actual: np.ndarray) -> np.ndarray:
    """Rotation vectors (n, 3), rad, that turn `actual` into `targets`, both (n, 3, 3)."""
    wxyz = quaternions_from_rotations(products(targets, actual.transpose(0, 2, 1)))
    sine = np.linalg.norm(wxyz[:, 1:], axis=1, keepdims=True)
    return np.where(sine < 1e-9, 2.0, 2.0 * np.arctan2(sine, wxyz[:, :1]) / np.maximum(sine, 1e-9)) * wxyz[:, 1:]


def products(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Matrix products (n, i, k) of `a` (n, i, j) and `b` (n, j, k), faster than matmul for small ones in Fortran order."""
    return np.einsum("nij,njk->nik", a, b)


def rotate(rotations: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """`rotations` (n, 3, 3), or matrices (n, i, j), times `vectors` (n, j)."""
    return np.einsum("nij,nj->ni", rotations, vectors)


def rotate_back(rotations: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Transposed `rotations` (n, 3, 3), or matrices (n, j, i), times `vectors` (n, j)."""
    return np.einsum("nji,nj->ni", rotations, vectors)


def solve_positive(matrices: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Solutions x (n, k) of `matrices` (n, k, k), symmetric and positive definite, times x = `vectors` (n, k)."""
    size = vectors.shape[1]
    rows = np.concatenate([matrices, vectors[:, :, None]], axis=2)
    for i in range(size - 1):
        factors = rows[:, i + 1 :, i] / rows[:, i, i, None]
        rows[:, i + 1 :, i + 1 :] -= factors[:, :, None] * rows[:, i, None, i + 1 :]
    solution = np.empty_like(vectors)
    for i in reversed(range(size)):
        known = np.einsum("nj,nj->n", rows[:, i, i + 1 : size], solution[:, i + 1 :])
        solution[:, i] = (rows[:, i, size] - known) / rows[:, i, i]
    return solution


def headings(rotations_base_to_world: np.ndarray) -> np.ndarray:
    """Rotations (n, 3, 3) heading to world, see control.frames."""
    x, y = rotations_base_to_world[:, 0, 0], rotations_base_to_world[:, 1, 0]
    norm = np.hypot(x, y)
    out = np.zeros_like(rotations_base_to_world)
    out[:, 0, 0] = out[:, 1, 1] = x / norm
    out[:, 1, 0] = y / norm
    out[:, 0, 1] = -out[:, 1, 0]
    out[:, 2, 2] = 1.0
    return out
