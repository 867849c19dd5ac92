"""What runs: controller, scene, backend, the simulated robot's mass error, and the speed of time."""

import html
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import viser

from web import theme
from web.sink import ConsoleSink
from web.widget_binding import Binding, Worker

_TABLE_PERIOD_S = 0.5


def text(field: str) -> Callable[[np.void], str]:
    """Reader of a text field of a SNAPSHOT record."""
    return lambda snapshot: snapshot[field].decode()


def backends_html(backends: Sequence[dict[str, Any]], selected: str) -> str:
    """The backends, and for those that cannot be used here, why."""
    rows = []
    for backend in backends:
        name = html.escape(backend["name"])
        if backend["name"] == selected:
            rows.append(f"<div><b>{name}</b>: in use</div>")
        elif backend["available"]:
            rows.append(f"<div>{name}: available</div>")
        else:
            rows.append(f'<div style="opacity:0.75">{name}: not available. {html.escape(backend["reason"] or "")}</div>')
    return f'<div style="{theme.SMALL_TEXT}" data-forcelens="backends">Backend{"".join(rows)}</div>'


class SetupPanel:
    """Widgets of everything that is chosen rather than commanded."""

    def __init__(self, server: viser.ViserServer, sink: ConsoleSink) -> None:
        gui, choices = server.gui, sink.available()
        self._choices = choices
        controller = gui.add_dropdown("Controller", tuple(choices["controllers"]))
        scene = gui.add_dropdown("Scene", tuple(choices["scenes"]), hint="Loads the scene with the robot at its start.")
        self.mass = gui.add_slider(
            "Robot mass [x]", 0.5, 1.5, 0.01, 1.0, hint="Scales the simulated robot's mass. The estimators are not told."
        )
        self.speed = gui.add_slider("Speed [x]", 0.1, 4.0, 0.1, 1.0, hint="Simulated seconds per second.")
        self._backends = gui.add_html("")
        worker = Worker()
        self._bindings = [
            Binding(controller, text("controller"), sink.select_controller, worker),
            Binding(scene, text("scene"), sink.set_scene, worker),
            Binding(self.mass, lambda s: float(s["mass_scale_true"]), sink.set_mismatch, worker),
            Binding(self.speed, lambda s: float(s["speed"]), lambda value: sink.set_run(None, value), worker),
        ]
        self._next_table_s = 0.0

    def update(self, snapshot: np.void) -> None:
        """Show what a SNAPSHOT record says is running."""
        for binding in self._bindings:
            binding.sync(snapshot)
        now = time.monotonic()
        if now >= self._next_table_s:
            self._next_table_s = now + _TABLE_PERIOD_S
            self._backends.content = backends_html(self._choices["backends"], snapshot["backend"].decode())
