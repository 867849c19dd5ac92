"""A triangle mesh and the rigid moves and reflections that place it.

Shapes are drawn on (u, v) and raised along w. `Surface.along` puts them on (x, y) raised along z for axis "z", on (x, z) raised
along y for axis "y", and on (y, z) raised along x for axis "x".
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

Axis = Literal["x", "y", "z"]

_ORDER = {"z": (0, 1, 2), "y": (0, 2, 1), "x": (2, 0, 1)}


@dataclass(frozen=True)
class Surface:
    """Triangle mesh: vertices (N, 3) in m, faces (M, 3) counter-clockwise seen from outside."""

    vertices: np.ndarray
    faces: np.ndarray

    def moved(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> "Surface":
        return Surface(self.vertices + np.array([x, y, z]), self.faces)

    def along(self, axis: Axis) -> "Surface":
        """Turn the build axis w onto `axis` (see above for where u and v go)."""
        faces = self.faces[:, ::-1] if axis == "y" else self.faces  # (u, w, v) is a reflection: flip it back
        return Surface(self.vertices[:, _ORDER[axis]], faces)

    def turned(self, axis: Axis, angle: float) -> "Surface":
        """Rotate by `angle` rad about a coordinate axis through the origin."""
        i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
        rotation = np.eye(3)
        rotation[i, i] = rotation[j, j] = np.cos(angle)
        rotation[j, i] = np.sin(angle)
        rotation[i, j] = -rotation[j, i]
        return Surface(self.vertices @ rotation.T, self.faces)

    def mirrored(self, axis: Axis) -> "Surface":
        """Reflect through the plane normal to `axis`, keeping the faces wound outwards."""
        sign = np.where(np.arange(3) == "xyz".index(axis), -1.0, 1.0)
        return Surface(self.vertices * sign, self.faces[:, ::-1])
