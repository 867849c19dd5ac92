"""Rotations of many robots at once: the laws of control.frames in a loop, and products of small matrices.

Arrays of a batch lie in Fortran order, n innermost, so that arithmetic on components runs over contiguous numbers.
"""

import numpy as np

from control.frames import quaternion_from_rotation, rotation_error, rotation_from_quaternion
from control.kernels.compiled import kernel


@kernel("void(matrix, f8[:,:,:])")
def _rotations_from_quaternions(wxyz: np.ndarray, out: np.ndarray) -> None:
    """control.frames.rotation_from_quaternion of each row (n, 4)."""
    for robot in range(len(wxyz)):
        out[robot] = rotation_from_quaternion(wxyz[robot])


@kernel("void(Array(f8, 3, 'A', True), f8[:,:])")
def _quaternions_from_rotations(rotations: np.ndarray, out: np.ndarray) -> None:
    """control.frames.quaternion_from_rotation of each matrix (n, 3, 3)."""
    for robot in range(len(rotations)):
        out[robot] = quaternion_from_rotation(rotations[robot])


@kernel("void(Array(f8, 3, 'A', True), Array(f8, 3, 'A', True), f8[:,:])")
def _rotation_errors(targets: np.ndarray, actual: np.ndarray, out: np.ndarray) -> None:
    """control.frames.rotation_error of each pair of matrices (n, 3, 3)."""
    for robot in range(len(targets)):
        out[robot] = rotation_error(targets[robot], actual[robot])


def rotations_from_quaternions(wxyz: np.ndarray) -> np.ndarray:
    """Rotation matrices (n, 3, 3) of unit quaternions (n, 4)."""
    out = np.empty((len(wxyz), 3, 3), order="F")
    _rotations_from_quaternions(wxyz, out)
    return out


def quaternions_from_rotations(rotations: np.ndarray) -> np.ndarray:
    """Unit quaternions (n, 4), w >= 0, of rotation matrices (n, 3, 3)."""
    out = np.empty((len(rotations), 4), order="F")
    _quaternions_from_rotations(rotations, out)
    return out


def rotation_errors(targets: np.ndarray, actual: np.ndarray) -> np.ndarray:
    """Rotation vectors (n, 3), rad, that turn `actual` into `targets`, both (n, 3, 3)."""
    out = np.empty((len(targets), 3), order="F")
    _rotation_errors(targets, actual, out)
    return out


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Cross products (n, 3), without the overhead of np.cross."""
    out = np.empty(a.shape, order="F")
    out[:, 0] = a[:, 1] * b[:, 2] - a[:, 2] * b[:, 1]
    out[:, 1] = a[:, 2] * b[:, 0] - a[:, 0] * b[:, 2]
    out[:, 2] = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return out


def products(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Matrix products (n, i, k) of `a` (n, i, j) and `b` (n, j, k), faster than matmul for small ones in Fortran order."""
    return np.einsum("nij,njk->nik", a, b)


def rotate(rotations: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """`rotations` (n, 3, 3) times `vectors` (n, 3)."""
    return np.einsum("nij,nj->ni", rotations, vectors)


def rotate_back(rotations: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Transposed `rotations` (n, 3, 3) times `vectors` (n, 3)."""
    return np.einsum("nji,nj->ni", rotations, vectors)
