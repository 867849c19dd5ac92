"""Ground forces on the wheels, estimated and true, each with the friction cone it must stay in.

A cone turns to the warning colour while the estimated force lies outside it: the wheel is about to slip.
"""

import numpy as np
import viser

from control.frames import rotation_z
from control.joints import LEGS, WHEEL_FRICTION
from web import theme
from web.cone_mesh import cone_mesh
from web.force_arrows import Arrows

METERS_PER_NEWTON = 0.0025

_COUNT = len(LEGS)
_CONE_HEIGHT_M = 0.11
_HIDDEN_SCALE = 1e-4
_APART = np.array([0.012, 0.0, 0.0])
_OUTWARD = np.array([[0.0, 0.045 if leg[1] == "L" else -0.045, 0.0] for leg in LEGS])
"""(4, 3) m, heading frame: arrows stand beside the wheel, which would hide them."""


def outside_cone(forces: np.ndarray) -> np.ndarray:
    """(n,) bool: which ground forces (n, 3) N, z up, violate Coulomb friction."""
    return np.hypot(forces[:, 0], forces[:, 1]) > WHEEL_FRICTION * forces[:, 2]


class WheelContacts:
    """Contact forces and cones of the four wheels."""

    def __init__(self, server: viser.ViserServer) -> None:
        self.estimated = Arrows(server, "/contacts/estimated", [theme.ESTIMATED] * _COUNT, 0.005)
        self.true = Arrows(server, "/contacts/true", [theme.TRUE] * _COUNT, 0.005)
        vertices, faces = cone_mesh(WHEEL_FRICTION * _CONE_HEIGHT_M, _CONE_HEIGHT_M)
        wxyz = np.zeros((_COUNT, 4))
        wxyz[:, 0] = 1.0
        self.cones = server.scene.add_batched_meshes_simple(
            "/contacts/cones",
            vertices,
            faces,
            wxyz,
            np.zeros((_COUNT, 3)),
            batched_scales=np.full(_COUNT, _HIDDEN_SCALE),
            batched_colors=np.tile(np.array(theme.CONE, np.uint8), (_COUNT, 1)),
            opacity=0.3,
            side="double",
            lod="off",
        )
        self._touching = np.zeros(_COUNT, bool)
        self._slipping = np.zeros(_COUNT, bool)
        self.cones_enabled = True

    def update(self, snapshot: np.void) -> None:
        """Draw the contacts of a SNAPSHOT record."""
        to_world = rotation_z(snapshot["heading_yaw"])
        touching = snapshot["wheel_in_contact"]
        points = snapshot["wheel_contact_position_in_world"]
        for arrows, forces, side in (
            (self.estimated, snapshot["wheel_force_estimated_n"], -1.0),
            (self.true, snapshot["wheel_force_true_n"], 1.0),
        ):
            known = np.isfinite(forces).all(axis=1) & np.isfinite(points).all(axis=1)
            arrows.draw(
                points + (_OUTWARD + side * _APART) @ to_world.T, METERS_PER_NEWTON * forces @ to_world.T, touching & known
            )
        self._update_cones(points, touching, outside_cone(snapshot["wheel_force_estimated_n"]))

    def _update_cones(self, points: np.ndarray, touching: np.ndarray, slipping: np.ndarray) -> None:
        if self.cones.visible != self.cones_enabled:
            self.cones.visible = self.cones_enabled
        if not self.cones_enabled:
            return
        if np.isfinite(points).all():
            self.cones.batched_positions = points.astype(np.float32)
        if not np.array_equal(touching, self._touching):
            self._touching = touching.copy()
            self.cones.batched_scales = np.where(touching, 1.0, _HIDDEN_SCALE).astype(np.float32)
        if not np.array_equal(slipping, self._slipping):
            self._slipping = slipping.copy()
            self.cones.batched_colors = np.where(slipping[:, None], theme.CONE_EXCEEDED, theme.CONE).astype(np.uint8)

    def hide(self) -> None:
        """Draw nothing: there is no live snapshot."""
        self.estimated.hide()
        self.true.hide()
        none = np.zeros(_COUNT, bool)
        self._update_cones(np.zeros((_COUNT, 3)), none, none)
