"""Camera presets and a camera that follows the robot. Every client has a camera of its own."""

import math
import time

import numpy as np
import viser

from control.frames import rotation_z

FOV_RAD = 0.8
"""Vertical field of view on a canvas that is wide enough."""

HALF_WIDTH = 0.4
"""Tangent of half the horizontal field of view that START needs for the robot and its outstretched hand."""

START = "Corner"
PRESETS: dict[str, tuple[tuple[float, float, float], tuple[float, float, float]]] = {
    START: ((1.6, -1.45, 0.95), (0.16, 0.0, 0.38)),
    "Front": ((2.3, 0.0, 0.65), (0.1, 0.0, 0.4)),
    "Side": ((0.2, -2.2, 0.6), (0.2, 0.0, 0.38)),
    "Top": ((0.17, 0.0, 2.7), (0.18, 0.0, 0.3)),
    "Hand": ((0.95, -0.75, 0.85), (0.5, 0.0, 0.55)),
}
"""Camera position and the point looked at, (3,) m each, in the heading frame."""

CENTER = np.array([0.1, 0.0, 0.38])
"""Where a following camera looks, (3,) m from the point on the ground below the base, world axes."""

_USER_PAUSE_S = 0.4
_STEP_M = 0.004
_TURNED_M = 0.005


def fov_rad(aspect: float) -> float:
    """Vertical field of view on a canvas that is `aspect` times as wide as high: so much that the robot fits a narrow one."""
    return 2.0 * math.atan(max(math.tan(FOV_RAD / 2.0), HALF_WIDTH / aspect))


class Follower:
    """Keeps one client's camera on the robot from wherever its operator turns it.

    What a client reports lags behind what it was told, so only the vector from the point looked at to the camera is taken
    from it: following leaves that vector alone, and it changes exactly when the operator turns or zooms. While it changes,
    following pauses, so that the two do not fight.
    """

    def __init__(self, client: viser.ClientHandle) -> None:
        self.center = CENTER
        self._client = client
        self._arm = self._reported_arm()
        self._turned_s = -np.inf
        self._told = np.full(3, np.inf)

    def _reported_arm(self) -> np.ndarray:
        return self._client.camera.position - self._client.camera.look_at

    def update(self, base_position: np.ndarray) -> None:
        """Look at the robot whose base is at (3,) m in world."""
        now = time.monotonic()
        arm = self._reported_arm()
        if np.abs(arm - self._arm).max() > _TURNED_M:
            self._arm = arm
            self._turned_s = now
        look_at = base_position * [1.0, 1.0, 0.0] + self.center
        if now - self._turned_s < _USER_PAUSE_S or np.abs(look_at - self._told).max() < _STEP_M:
            return
        self._told = look_at
        self._client.camera.position = look_at + self._arm
        self._client.camera.look_at = look_at


def fit_to_canvas(camera: viser.CameraHandle) -> None:
    """Give a client's camera the field of view for its canvas, whatever its shape is now."""
    if camera.image_width > 0 and camera.image_height > 0:  # not so while the canvas has no room at all
        camera.fov = fov_rad(camera.aspect)


class Camera:
    """Places clients' cameras relative to the robot."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._followers: dict[int, Follower] = {}
        self._base_position = np.zeros(3)
        self._heading_yaw = 0.0
        server.initial_camera.position, server.initial_camera.look_at = PRESETS[START]
        server.initial_camera.fov = FOV_RAD

        @server.on_client_connect
        async def _(client: viser.ClientHandle) -> None:
            @client.camera.on_update
            async def _(camera: viser.CameraHandle) -> None:
                fit_to_canvas(camera)

        @server.on_client_disconnect
        async def _(client: viser.ClientHandle) -> None:
            self._followers.pop(client.client_id, None)

    def place(self, client: viser.ClientHandle, preset: str) -> None:
        """Put a client's camera at a preset relative to where the robot stands now."""
        rotation = rotation_z(self._heading_yaw)
        origin = self._base_position * [1.0, 1.0, 0.0]
        position, look_at = (origin + rotation @ np.array(point) for point in PRESETS[preset])
        client.camera.position = position
        client.camera.look_at = look_at
        if client.client_id in self._followers:
            self._followers[client.client_id].center = look_at - origin

    def follow(self, client: viser.ClientHandle, on: bool) -> None:
        """Start or stop following the robot with a client's camera."""
        if on:
            self._followers[client.client_id] = Follower(client)
        else:
            self._followers.pop(client.client_id, None)

    def update(self, snapshot: np.void) -> None:
        """Take the robot's place from a SNAPSHOT record and move the cameras that follow it."""
        self._base_position = snapshot["base_position"].copy()
        self._heading_yaw = float(snapshot["heading_yaw"])
        for follower in list(self._followers.values()):
            follower.update(self._base_position)
