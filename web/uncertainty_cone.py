"""A cone around the estimated force: from the hand to the head of the arrow, as wide there as the estimate is uncertain."""

import numpy as np
import viser

from web import theme
from web.cone_mesh import cone_mesh


def spread(force: np.ndarray, sigma: np.ndarray) -> tuple[float, float]:
    """Standard deviation along a force (3,) N and across it (the mean of both directions), N, from `sigma` (3,) per axis."""
    direction = force / np.linalg.norm(force)
    variance = sigma**2
    along = float(variance @ direction**2)
    return np.sqrt(along), np.sqrt((variance.sum() - along) / 2.0)


class UncertaintyCone:
    """Ends `theme.SHOWN_SIGMAS` standard deviations beyond the arrow and is that wide around it."""

    def __init__(self, server: viser.ViserServer) -> None:
        vertices, faces = cone_mesh(1.0, 1.0)
        self.mesh = server.scene.add_mesh_simple(
            "/forces/uncertainty",
            vertices,
            faces,
            color=theme.UNCERTAIN,
            opacity=0.5,
            side="double",
            visible=False,
        )

    def draw(self, origin: np.ndarray, direction: np.ndarray, length: float, radius: float) -> None:
        """Show the cone with its apex at `origin` (3,) m along a unit vector (3,), both in world; other lengths in m."""
        self.mesh.position = origin
        self.mesh.wxyz = _turn_z_to(direction)
        self.mesh.scale = (radius, radius, length)
        if not self.mesh.visible:
            self.mesh.visible = True

    def hide(self) -> None:
        """Show nothing."""
        if self.mesh.visible:
            self.mesh.visible = False


def _turn_z_to(direction: np.ndarray) -> tuple[float, float, float, float]:
    x, y, z = direction
    if z < -1.0 + 1e-9:
        return 0.0, 1.0, 0.0, 0.0
    quaternion = np.array([1.0 + z, -y, x, 0.0])
    w, i, j, k = quaternion / np.linalg.norm(quaternion)
    return w, i, j, k
