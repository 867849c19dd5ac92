"""Vertex normals with creases: edges sharper than the crease angle stay hard, everything else is shaded smooth."""

import numpy as np

from web.robot_visuals.surface import Surface

CREASE_ANGLE_RAD = np.radians(50.0)
_SAME_POINT_M = 1e-6


def shade(surface: Surface) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Split the vertices of `surface` at creases.

    Normals are weighted by face area and corner angle: a narrow edge face between two large ones then carries the whole turn,
    so one face is enough for an edge that looks round.

    Returns:
        vertices (K, 3) in m, unit normals (K, 3), faces (M, 3); M as in `surface`.
    """
    corners = surface.vertices[surface.faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(cross, axis=1)
    face_normal = cross / area[:, None]

    positions = corners.reshape(-1, 3)
    _, point = np.unique(np.round(positions / _SAME_POINT_M).astype(np.int64), axis=0, return_inverse=True)
    flat = np.repeat(face_normal, 3, axis=0)
    weighted = flat * (np.repeat(area, 3) * _corner_angles(corners).ravel())[:, None]

    order = np.argsort(point, kind="stable")
    normals = np.empty_like(weighted)
    for group in np.split(order, np.flatnonzero(np.diff(point[order])) + 1):
        smooth = flat[group] @ flat[group].T > np.cos(CREASE_ANGLE_RAD)
        normals[group] = smooth @ weighted[group]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)

    key = np.column_stack([point, np.round(normals * 1e3).astype(np.int64)])
    _, first, index = np.unique(key, axis=0, return_index=True, return_inverse=True)
    return positions[first], normals[first], index.reshape(-1, 3)


def _corner_angles(corners: np.ndarray) -> np.ndarray:
    """Interior angle in rad at each corner, (M, 3) for triangles (M, 3, 3)."""
    ahead = np.roll(corners, -1, axis=1) - corners
    behind = np.roll(corners, 1, axis=1) - corners
    cosine = np.einsum("mij,mij->mi", ahead, behind) / (np.linalg.norm(ahead, axis=2) * np.linalg.norm(behind, axis=2))
    return np.arccos(np.clip(cosine, -1.0, 1.0))
