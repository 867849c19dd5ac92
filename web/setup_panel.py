"""What runs: controller, and of a simulation the scene, the robot's mass error and payload, and the speed of time."""

import numpy as np
import viser

from sim.backends.simulation.mismatch import PAYLOAD_RANGE_KG
from sim.runtime.snapshot import on_hardware
from web.sink import ConsoleSink
from web.widget_binding import Binding, Worker, text

NOTICE_S = 6.0

_LOADED = "The robot is at its start, and the command at its default."
_LOADING = "Loads a scene with the robot at its start and the command at its default."


class SetupPanel:
    """Widgets of everything that is chosen rather than commanded."""

    def __init__(self, server: viser.ViserServer, sink: ConsoleSink) -> None:
        self._server = server
        self._scene = ""
        gui, choices = server.gui, sink.available()
        controller = gui.add_dropdown("Controller", tuple(choices["controllers"]))
        scene = gui.add_dropdown("Scene", tuple(choices["scenes"]), hint=_LOADING)
        self.mass = gui.add_slider(
            "Robot mass [x]", 0.5, 1.5, 0.01, 1.0, hint="Scales the simulated robot's mass. The estimators are not told."
        )
        self.payload = gui.add_slider(
            "Payload [kg]", *PAYLOAD_RANGE_KG, 0.05, 0.0, hint="A mass in the simulated hand. The estimators are not told."
        )
        self.speed = gui.add_slider("Speed [x]", 0.1, 4.0, 0.1, 1.0, hint="Simulated seconds per second.")
        worker = Worker()
        self._controller = Binding(controller, text("controller"), sink.select_controller, worker)
        self._simulation = [
            Binding(scene, text("scene"), sink.set_scene, worker),
            Binding(
                self.mass,
                lambda _: sink.mismatch().mass_scale,
                lambda value: sink.set_mismatch(mass_scale=value),
                worker,
            ),
            Binding(
                self.payload,
                lambda _: sink.mismatch().payload_kg,
                lambda value: sink.set_mismatch(payload_kg=value),
                worker,
            ),
            Binding(self.speed, lambda s: float(s["speed"]), lambda value: sink.set_run(None, value), worker),
        ]

    def update(self, snapshot: np.void) -> None:
        """Show what a SNAPSHOT record says is running."""
        self._controller.sync(snapshot)
        simulated = not on_hardware(snapshot)
        self._tell_scene(snapshot["scene"].decode() if simulated else "")
        for binding in self._simulation:
            if binding.widget.visible != simulated:
                binding.widget.visible = simulated
            if simulated:
                binding.sync(snapshot)

    def _tell_scene(self, scene: str) -> None:
        """Whoever looks on is told of another scene, by whomever it was loaded, because it undoes what was commanded."""
        if scene and self._scene and scene != self._scene:
            for client in self._server.get_clients().values():
                client.add_notification(f"Scene {scene}", _LOADED, auto_close_seconds=NOTICE_S)
        self._scene = scene
