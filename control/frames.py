"""Rotations and the heading frame. Quaternions are wxyz; `rotation_a_to_b` maps vectors from frame a to frame b.

Frames:
    world: inertial, z up.
    base: trunk of the robot, x forward, y left, z up.
    heading: the paper's body-aligned world frame. Origin on the ground straight below the base origin, x along the base's
        x axis projected on the ground, z up along gravity.
    end_effector: centre of the tool ball, x out of the wrist.
"""

import math

import numpy as np

from control.kernels.compiled import kernel

AXES = ("x", "y", "z")
"""Names of a frame's axes, in the order of every vector."""


@kernel("f8[:,::1](vector)")
def rotation_from_quaternion(wxyz: np.ndarray) -> np.ndarray:
    """Rotation matrix (3, 3) of a unit quaternion (4,) wxyz."""
    w, x, y, z = wxyz
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


@kernel("f8[::1](matrix)")
def quaternion_from_rotation(rotation: np.ndarray) -> np.ndarray:
    """Unit quaternion (4,) wxyz with w >= 0 of a rotation matrix (3, 3) (Shepperd's method)."""
    r = rotation
    trace = r[0, 0] + r[1, 1] + r[2, 2]
    if trace > max(r[0, 0], r[1, 1], r[2, 2]):
        w, x, y, z = 1 + trace, r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]
    elif r[0, 0] >= max(r[1, 1], r[2, 2]):
        w, x, y, z = r[2, 1] - r[1, 2], 1 + 2 * r[0, 0] - trace, r[0, 1] + r[1, 0], r[0, 2] + r[2, 0]
    elif r[1, 1] >= r[2, 2]:
        w, x, y, z = r[0, 2] - r[2, 0], r[0, 1] + r[1, 0], 1 + 2 * r[1, 1] - trace, r[1, 2] + r[2, 1]
    else:
        w, x, y, z = r[1, 0] - r[0, 1], r[0, 2] + r[2, 0], r[1, 2] + r[2, 1], 1 + 2 * r[2, 2] - trace
    norm = math.sqrt(w * w + x * x + y * y + z * z)
    norm = -norm if w < 0.0 else norm
    return np.array([w / norm, x / norm, y / norm, z / norm])


@kernel("f8[::1](vector, vector)")
def quaternion_multiply(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Hamilton product (4,) of two wxyz quaternions: first `b`, then `a`."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return np.array(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ]
    )


@kernel("f8[:,::1](matrix)")
def rotation_heading_to_world(rotation_base_to_world: np.ndarray) -> np.ndarray:
    """Yaw-only rotation (3, 3) of the heading frame. The base's x axis must not be vertical."""
    x, y = rotation_base_to_world[0, 0], rotation_base_to_world[1, 0]
    norm = math.hypot(x, y)
    c, s = x / norm, y / norm
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def rotation_z(angle: float) -> np.ndarray:
    """Rotation matrix (3, 3) by `angle`, rad, about z."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def skew(v: np.ndarray) -> np.ndarray:
    """Cross-product matrix (3, 3): `skew(a) @ b == cross(a, b)`."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


@kernel("f8[::1](matrix, matrix)")
def rotation_error(target: np.ndarray, actual: np.ndarray) -> np.ndarray:
    """Rotation vector (3,), rad, in the common parent frame that turns `actual` into `target` (both (3, 3) into that frame)."""
    relative = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            relative[i, j] = target[i, 0] * actual[j, 0] + target[i, 1] * actual[j, 1] + target[i, 2] * actual[j, 2]
    wxyz = quaternion_from_rotation(relative)
    sine = math.sqrt(wxyz[1] ** 2 + wxyz[2] ** 2 + wxyz[3] ** 2)
    return (2.0 if sine < 1e-9 else 2.0 * math.atan2(sine, wxyz[0]) / sine) * wxyz[1:]
