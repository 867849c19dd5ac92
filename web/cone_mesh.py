"""An open cone, for friction and for uncertainty."""

import numpy as np

_FACES = 28


def cone_mesh(radius: float, height: float) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (n, 3) and faces (m, 3) of a cone with its apex at the origin, its axis along z and its rim at `height`."""
    angle = np.linspace(0.0, 2.0 * np.pi, _FACES, endpoint=False)
    rim = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.full(_FACES, height)], axis=1)
    first = np.arange(_FACES)
    faces = np.stack([np.zeros(_FACES, int), 1 + first, 1 + (first + 1) % _FACES], axis=1)
    return np.vstack([np.zeros(3), rim]), faces
