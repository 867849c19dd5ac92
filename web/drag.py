"""What the operator grabs in the scene: a ball at the hand that pulls with a spring, and the position target's gizmo."""

import time

import numpy as np
import viser

from control.frames import rotation_z
from sim.runtime.snapshot import on_hardware
from web import theme
from web.command_panel import reachable
from web.sink import ConsoleSink, reports_refusal
from web.widget_binding import EDIT_GRACE_S


class GrabHandle:
    """A ball at the hand. Dragging it pulls the hand; the client that grabbed it owns it until it lets go or vanishes."""

    def __init__(self, server: viser.ViserServer, sink: ConsoleSink) -> None:
        self._sink = sink
        self._owner: int | None = None
        self._ball = server.scene.add_icosphere("/hand_grab", 0.036, color=theme.HANDLE, opacity=0.45)
        self.spring = server.scene.add_line_segments(
            "/hand_spring",
            np.zeros((1, 2, 3), np.float32),
            theme.HANDLE,
            thickness=0.006,
            thickness_units="world",
            visible=False,
        )

        def dragged(event: viser.SceneNodeDragEvent[viser.IcosphereHandle]) -> None:
            self.pull(event.client_id, None if event.phase == "end" else event.end_position)

        self._ball.on_drag("left")(reports_refusal(dragged))

        @server.on_client_disconnect
        async def _(client: viser.ClientHandle) -> None:
            self.pull(client.client_id, None)

    def pull(self, client_id: int, target_in_world: tuple[float, float, float] | None) -> None:
        """Pull towards a point (3,) m in world on behalf of a client, or let go with None; ignores all but the owner."""
        if self._owner != client_id and (self._owner is not None or target_in_world is None):
            return
        self._owner = None  # and so it stays if the pull is refused
        self._sink.set_drag(target_in_world)
        if target_in_world is not None:
            self._owner = client_id

    def update(self, snapshot: np.void) -> None:
        """Follow the hand of a SNAPSHOT record and draw the spring while it pulls."""
        hand = snapshot["end_effector_position_in_world"]
        self._ball.position = hand
        simulated = not on_hardware(snapshot)
        if self._ball.visible != simulated:  # a real hand is pulled by hand
            self._ball.visible = simulated
        active = bool(snapshot["drag_active"])
        if active:
            self.spring.points = np.stack([hand, snapshot["drag_target_in_world"]])[None].astype(np.float32)
        if self.spring.visible != active:
            self.spring.visible = active


class TargetGizmo:
    """Moves the hand's position target along the heading axes. Axes under force control cannot be moved.

    The gizmo stands at the target as asked; a small ball shows the target as applied, after limits and rate limits.
    """

    def __init__(self, server: viser.ViserServer, sink: ConsoleSink) -> None:
        self._sink = sink
        self._held = False
        self._hold_until_s = 0.0
        self._world_from_heading = np.zeros(3), np.eye(3)
        self._mask = np.zeros(3)
        self.handle = server.scene.add_transform_controls(
            "/target", scale=0.17, disable_rotations=True, depth_test=False, line_width=2.5, opacity=0.9
        )
        self._applied = server.scene.add_icosphere("/target_applied", 0.012, color=theme.TARGET, opacity=0.9)

        def moved(event: viser.TransformControlsEvent) -> None:
            self._held = event.phase != "end"
            self.move(np.asarray(event.target.position))

        self.handle.on_update(reports_refusal(moved))

    def move(self, position_in_world: np.ndarray) -> None:
        """Command the target (3,) m in world, or the nearest that can be reached."""
        self._hold_until_s = time.monotonic() + EDIT_GRACE_S
        origin, rotation = self._world_from_heading
        position = rotation.T @ (position_in_world - origin)
        self._sink.patch_command(position_m=reachable(position, self._sink.limits).tolist())

    def update(self, snapshot: np.void) -> None:
        """Follow the target of a SNAPSHOT record, unless somebody holds the gizmo."""
        yaw = snapshot["heading_yaw"]
        origin = snapshot["base_position"] * [1.0, 1.0, 0.0]
        rotation = rotation_z(yaw)
        self._world_from_heading = origin, rotation
        self._applied.position = snapshot["target_position_in_world"]
        mask = snapshot["command"]["mask"]
        if not np.array_equal(mask, self._mask):
            self._mask = mask.copy()
            self.handle.active_axes = (mask[0] == 0, mask[1] == 0, mask[2] == 0)
        if self._held or time.monotonic() < self._hold_until_s:
            return
        # On a force axis the applied target follows the hand, and the gizmo goes with it.
        target = np.where(mask == 1, snapshot["applied_command"]["position_m"], snapshot["command"]["position_m"])
        self.handle.position = origin + rotation @ target
        self.handle.wxyz = (np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2))
