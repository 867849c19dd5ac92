"""Force arrows at the hand: commanded (as applied), estimated, true, and on demand the estimates that are not selected.

They stand side by side, so that equal forces stay visible as several arrows instead of hiding each other. Every arrow
is the force of the environment on the robot.
"""

from collections.abc import Sequence

import numpy as np
import viser

from control.frames import rotation_z
from web import theme
from web.uncertainty_cone import UncertaintyCone, spread

METERS_PER_NEWTON = 0.01
SHOWN_FROM_N = 0.5
"""Weaker forces are not drawn: an arrow that is shorter than its head says nothing."""

_APART_M = 0.024
_VIEW = np.array([-0.63, 0.63, -0.45])
"""About where the first camera looks, heading frame: arrows spread across it, whatever their direction."""

_SIDES = {"commanded": -1.0, "estimated": 0.0, "true": 1.0}
_OF_CONTROLLER_SIDE = -0.5
_COLORS = {"commanded": theme.COMMANDED, "estimated": theme.ESTIMATED, "true": theme.TRUE}
_FIRST_OTHER_SIDE, _OTHERS_APART = 1.7, 0.5
"""Where the estimates that are not selected stand, and how far apart, in the unit of _SIDES."""


def sideways(force: np.ndarray) -> np.ndarray:
    """Offset (3,) m, heading frame, across a force (3,) and across the view."""
    x, y, z = force
    across = np.array([y * _VIEW[2] - z * _VIEW[1], z * _VIEW[0] - x * _VIEW[2], x * _VIEW[1] - y * _VIEW[0]])
    return _APART_M * across / max(float(np.linalg.norm(across)), 1e-9)


class Arrows:
    """One arrow per colour. Arrows without length are hidden."""

    def __init__(self, server: viser.ViserServer, name: str, colors: Sequence[theme.RGB], radius: float) -> None:
        self._points = np.zeros((len(colors), 2, 3), np.float32)
        self._handle = server.scene.add_arrows(
            name,
            self._points,
            np.array([theme.in_scene(color) for color in colors], np.uint8),
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

    def hide(self) -> None:
        """Draw nothing until the next `draw`."""
        if self._handle.visible:
            self._handle.visible = False


class ForceArrows:
    """The forces at the hand.

    Attributes:
        arrows: commanded, estimated and true.
        others: the estimates that are not selected, thin, in the order of the snapshot; switched off at first.
        of_controller: the estimate that the controller makes itself, where it does.
    """

    def __init__(self, server: viser.ViserServer) -> None:
        self.arrows = {name: Arrows(server, f"/forces/{name}", [color], 0.0075) for name, color in _COLORS.items()}
        self.others = Arrows(server, "/forces/estimates", theme.ESTIMATORS, 0.003)
        self.others.enabled = False
        self.of_controller = Arrows(server, "/forces/controller", [theme.OF_CONTROLLER], 0.005)
        self.uncertainty = UncertaintyCone(server)

    def update(self, snapshot: np.void) -> None:
        """Draw the forces of a SNAPSHOT record."""
        command = snapshot["applied_command"]
        forces = {
            "commanded": command["force_n"] * command["mask"],
            "estimated": snapshot["force_estimated_n"],
            "true": snapshot["force_true_n"],
        }
        to_world = rotation_z(snapshot["heading_yaw"])
        hand = snapshot["end_effector_position_in_world"]
        for name, force in forces.items():
            origin = hand + to_world @ (_SIDES[name] * sideways(force))
            self.arrows[name].draw(origin[None], METERS_PER_NEWTON * (to_world @ force)[None], _shown(force[None]))
        own = snapshot["force_of_controller_n"]
        beside = hand + to_world @ (_OF_CONTROLLER_SIDE * sideways(own))
        self.of_controller.draw(beside[None], METERS_PER_NEWTON * (to_world @ own)[None], _shown(own[None]))
        if self.others.enabled or self.others.visible:
            self._draw_others(snapshot, hand, to_world)
        self._draw_uncertainty(snapshot, hand, to_world)

    def _draw_others(self, snapshot: np.void, hand: np.ndarray, to_world: np.ndarray) -> None:
        forces = snapshot["force_estimates_n"]
        other = (snapshot["estimator_names"] != b"") & (snapshot["estimator_names"] != snapshot["estimator"])
        sides = _FIRST_OTHER_SIDE + _OTHERS_APART * (np.cumsum(other) - 1)
        origins = hand + (sides[:, None] * np.array([sideways(force) for force in forces])) @ to_world.T
        self.others.draw(origins, METERS_PER_NEWTON * forces @ to_world.T, other & _shown(forces))

    def _draw_uncertainty(self, snapshot: np.void, hand: np.ndarray, to_world: np.ndarray) -> None:
        force, sigma = snapshot["force_estimated_n"], snapshot["force_sigma_n"]
        size = float(np.linalg.norm(force))
        if not (self.arrows["estimated"].visible and np.isfinite(sigma).all()):
            self.uncertainty.hide()
            return
        along, across = (METERS_PER_NEWTON * theme.SHOWN_SIGMAS * each for each in spread(force, sigma))
        self.uncertainty.draw(hand, to_world @ force / size, METERS_PER_NEWTON * size + along, across)

    def hide(self) -> None:
        """Draw nothing: there is no live snapshot."""
        for arrows in (*self.arrows.values(), self.others, self.of_controller):
            arrows.hide()
        self.uncertainty.hide()


def _shown(forces: np.ndarray) -> np.ndarray:
    # NaN, "not available", compares false and is not drawn.
    return np.linalg.norm(forces, axis=1) >= SHOWN_FROM_N
