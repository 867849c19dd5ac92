"""Rotations and the heading frame. Quaternions are wxyz; `rotation_a_to_b` maps vectors from frame a to frame b.

Frames:
    world: inertial, z up.
    base: trunk of the robot, x forward, y left, z up.
    heading: the paper's body-aligned world frame. Origin on the ground straight below the base origin, x along the base's
        x axis projected on the ground, z up along gravity.
    end_effector: centre of the tool ball, x out of the wrist.
"""

import numpy as np

AXES = ("x", "y", "z")
"""Names of a frame's axes, in the order of every vector."""


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


def quaternion_from_rotation(rotation: np.ndarray) -> np.ndarray:
    """Unit quaternion (4,) wxyz with w >= 0 of a rotation matrix (3, 3) (Shepperd's method)."""
    r = rotation
    trace = r[0, 0] + r[1, 1] + r[2, 2]
    if trace > max(r[0, 0], r[1, 1], r[2, 2]):
        wxyz = np.array([1 + trace, r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
    elif r[0, 0] >= max(r[1, 1], r[2, 2]):
        wxyz = np.array([r[2, 1] - r[1, 2], 1 + 2 * r[0, 0] - trace, r[0, 1] + r[1, 0], r[0, 2] + r[2, 0]])
    elif r[1, 1] >= r[2, 2]:
        wxyz = np.array([r[0, 2] - r[2, 0], r[0, 1] + r[1, 0], 1 + 2 * r[1, 1] - trace, r[1, 2] + r[2, 1]])
    else:
        wxyz = np.array([r[1, 0] - r[0, 1], r[0, 2] + r[2, 0], r[1, 2] + r[2, 1], 1 + 2 * r[2, 2] - trace])
    wxyz /= np.linalg.norm(wxyz)
    return -wxyz if wxyz[0] < 0 else wxyz


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


def rotation_heading_to_world(rotation_base_to_world: np.ndarray) -> np.ndarray:
    """Yaw-only rotation (3, 3) of the heading frame. The base's x axis must not be vertical."""
    x, y = rotation_base_to_world[0, 0], rotation_base_to_world[1, 0]
    norm = np.hypot(x, y)
    return _rotation_about_z(x / norm, y / norm)


def rotation_z(angle: float) -> np.ndarray:
    """Rotation matrix (3, 3) by `angle`, rad, about z."""
    return _rotation_about_z(np.cos(angle), np.sin(angle))


def _rotation_about_z(c: float, s: float) -> np.ndarray:
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def skew(v: np.ndarray) -> np.ndarray:
    """Cross-product matrix (3, 3): `skew(a) @ b == cross(a, b)`."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def rotation_error(target: np.ndarray, actual: np.ndarray) -> np.ndarray:
    """Rotation vector (3,), rad, in the common parent frame that turns `actual` into `target` (both (3, 3) into that frame)."""
    relative = target @ actual.T
    wxyz = quaternion_from_rotation(relative)
    norm = np.linalg.norm(wxyz[1:])
    if norm < 1e-9:
        return 2.0 * wxyz[1:]
    return 2.0 * np.arctan2(norm, wxyz[0]) / norm * wxyz[1:]
