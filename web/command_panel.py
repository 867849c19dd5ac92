"""What the operator commands: per heading axis of the hand a force or a position, the base velocity, and guidance."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import viser

from control.command.limits import DEFAULT_COMMAND, CommandLimits, clip_command
from control.frames import AXES
from web.sink import ConsoleSink, reports_refusal
from web.widget_binding import Binding

_VELOCITY_LABELS = ("ahead [m/s]", "left [m/s]", "turn [rad/s]")


def reachable(position_m: Sequence[float] | np.ndarray, limits: CommandLimits) -> np.ndarray:
    """The nearest hand target (3,) m in the heading frame that the limits allow."""
    return clip_command(replace(DEFAULT_COMMAND, position_m=np.asarray(position_m, float)), limits).position_m


def element(field: str, index: int, kind: Callable[[Any], Any]) -> Callable[[np.void], Any]:
    """Reader of one element of a vector of the command, as asked, in a SNAPSHOT record."""
    return lambda snapshot: kind(snapshot["command"][field][index])


class CommandPanel:
    """Widgets of the full command. A vector goes out whole, with the other axes as their widgets show them."""

    def __init__(self, server: viser.ViserServer, sink: ConsoleSink) -> None:
        self._gui = server.gui
        self._sink = sink
        self._bindings: list[Binding] = []
        guidance = self._gui.add_checkbox(
            "Guidance",
            False,
            hint="Zero-force guidance: lead the robot by the hand. Overrides forces and base velocity.",
        )
        self._bind(guidance, lambda s: bool(s["command"]["guidance"]), lambda on: sink.patch_command(guidance=on))
        with self._gui.add_folder("Hand"):
            self._add_hand()
        with self._gui.add_folder("Base"):
            self._add_base()

    def _bind(self, widget: Any, read: Callable[[np.void], Any], send: Callable[[Any], object]) -> None:
        self._bindings.append(Binding(widget, read, send))

    def _add_hand(self) -> None:
        limits = self._sink.limits
        boxes = (limits.position_x_m, limits.position_y_m, limits.position_z_m)
        self.modes, self.positions, self.forces = [], [], []
        for index, axis in enumerate(AXES):
            self.modes.append(
                self._gui.add_checkbox(
                    f"{axis}: force", False, hint=f"On: control the contact force along {axis}. Off: hold the position."
                )
            )
            self.positions.append(
                self._gui.add_slider(
                    f"{axis} [m]", *boxes[index], 0.005, float(DEFAULT_COMMAND.position_m[index]), hint="In the heading frame."
                )
            )
            self.forces.append(
                self._gui.add_slider(
                    f"f{axis} [N]", *limits.force_n, 0.5, 0.0, visible=False, hint="Force of the environment on the hand."
                )
            )

        def send_mask(_: bool) -> None:
            self._sink.patch_command(mask=[int(mode.value) for mode in self.modes])

        def send_position(_: float) -> None:
            self._sink.patch_command(position_m=reachable([w.value for w in self.positions], limits).tolist())

        def send_force(_: float) -> None:
            self._sink.patch_command(force_n=[w.value for w in self.forces])

        for index in range(3):
            self._bind(self.modes[index], element("mask", index, bool), send_mask)
            self._bind(self.positions[index], element("position_m", index, float), send_position)
            self._bind(self.forces[index], element("force_n", index, float), send_force)

    def _add_base(self) -> None:
        limits = self._sink.limits
        ranges = (limits.velocity_x_mps, limits.velocity_y_mps, limits.yaw_rate_rps)
        self._velocities = [
            self._gui.add_slider(label, *span, 0.05, 0.0) for label, span in zip(_VELOCITY_LABELS, ranges, strict=True)
        ]

        def send_velocity(_: float) -> None:
            self._sink.patch_command(base_velocity=[w.value for w in self._velocities])

        for index, widget in enumerate(self._velocities):
            self._bind(widget, element("base_velocity", index, float), send_velocity)
        stop = self._gui.add_button("Stop the base", icon=viser.Icon.PLAYER_STOP)
        stop.on_click(reports_refusal(lambda _: self._sink.patch_command(base_velocity=[0.0, 0.0, 0.0])))

    def update(self, snapshot: np.void) -> None:
        """Show the command of a SNAPSHOT record, and per axis only the target that its mode uses."""
        for binding in self._bindings:
            binding.sync(snapshot)
        for mode, position, force in zip(self.modes, self.positions, self.forces, strict=True):
            if force.visible != mode.value:
                force.visible = mode.value
                position.visible = not mode.value
