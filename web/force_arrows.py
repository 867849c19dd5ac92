"""Force arrows at the hand: commanded, estimated, true.

The three stand side by side, so that equal forces stay visible as three arrows instead of hiding each other. Every arrow
is the force of the environment on the robot.
"""

import numpy as np
import viser

from web import theme

METERS_PER_NEWTON = 0.01
SHOWN_FROM_N = 0.5
"""Weaker forces are not drawn: an arrow that is shorter than its head says nothing."""

_APART_M = 0.024
_VIEW = np.array([-0.63, 0.63, -0.45])
"""About where the first camera looks, heading frame: arrows spread across it, whatever their direction."""

_SIDES = {"commanded": -1.0, "estimated": 0.0, "true": 1.0}
_COLORS = {"commanded": theme.COMMANDED, "estimated": theme.ESTIMATED, "true": theme.TRUE}


def rotation_from_yaw(yaw: float) -> np.ndarray:
    """Rotation (3, 3) of the heading frame from its yaw in rad."""
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def sideways(force: np.ndarray) -> np.ndarray:
    """Offset (3,) m, heading frame, across a force (3,) and across the view."""
    x, y, z = force
    across = np.array([y * _VIEW[2] - z * _VIEW[1], z * _VIEW[0] - x * _VIEW[2], x * _VIEW[1] - y * _VIEW[0]])
    return _APART_M * across / max(float(np.linalg.norm(across)), 1e-9)


class Arrows:
    """A fixed number of arrows of one colour. Arrows without length are hidden."""

    def __init__(self, server: viser.ViserServer, name: str, count: int, color: theme.RGB, radius: float) -> None:
        self._points = np.zeros((count, 2, 3), np.float32)
        self._handle = server.scene.add_arrows(
            name,
            self._points,
            theme.in_scene(color),
            shaft_radius=radius,
            head_radius=2.4 * radius,
            head_length=5.0 * radius,
            visible=False,
        )
        self.enabled = True

    @property
    def visible(self) -> bool:
        """Whether anything is drawn."""
        return self._handle.visible

    @property
    def points(self) -> np.ndarray:
        """(n, 2, 3) m, tail and tip of every arrow as last drawn, in world."""
        return self._points

    def draw(self, origins: np.ndarray, vectors: np.ndarray, shown: np.ndarray) -> None:
        """Draw arrows `shown` (n,) from `origins` (n, 3) along `vectors` (n, 3), both in world and in metres."""
        visible = self.enabled and bool(shown.any())
        if visible:
            points = np.empty_like(self._points)
            points[:, 0] = origins
            points[:, 1] = origins + vectors
            # A hidden arrow of a group is parked far below the floor: its head would show even at length zero.
            points[~shown] = (0.0, 0.0, -100.0)
            if not np.allclose(points, self._points, atol=2e-4):
                self._points = points
                self._handle.points = points
        if self._handle.visible != visible:
            self._handle.visible = visible


class ForceArrows:
    """The three forces at the hand."""

    def __init__(self, server: viser.ViserServer) -> None:
        self.arrows = {name: Arrows(server, f"/forces/{name}", 1, color, 0.0075) for name, color in _COLORS.items()}

    def update(self, snapshot: np.void) -> None:
        """Draw the forces of a SNAPSHOT record."""
        command = snapshot["applied_command"]
        forces = {
            "commanded": command["force_n"] * command["mask"],
            "estimated": snapshot["force_estimated"],
            "true": snapshot["force_true"],
        }
        to_world = rotation_from_yaw(snapshot["heading_yaw"])
        hand = snapshot["end_effector_position_in_world"]
        for name, force in forces.items():
            # NaN, "not available", compares false and is not drawn.
            shown = np.array([np.linalg.norm(force) >= SHOWN_FROM_N])
            origin = hand + to_world @ (_SIDES[name] * sideways(force))
            self.arrows[name].draw(origin[None], METERS_PER_NEWTON * (to_world @ force)[None], shown)

    def hide(self) -> None:
        """Draw nothing: there is no live snapshot."""
        for arrows in self.arrows.values():
            arrows.draw(np.zeros((1, 3)), np.zeros((1, 3)), np.array([False]))
