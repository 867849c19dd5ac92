"""A push test on the live simulation: pulls at the hand from all around, and the plot of what came of them."""

import time

import numpy as np
import viser

from sim.runtime.snapshot import on_hardware
from sim.trials.pull import MODES
from web.push_test import PushTests, PushTestStatus, push_test_html
from web.widget_binding import Worker, attempt

PERIOD_S = 0.5
DIRECTIONS = {"8, level": 8, "26, all around": 26}
_HINT = "Resets the simulation before each pull, some 7 simulated seconds each; any other command ends it."


class PushTestPanel:
    """A folder with the test; build it inside the container that shall hold it."""

    def __init__(self, gui: viser.GuiApi, tests: PushTests) -> None:
        self._tests = tests
        self._worker = Worker()
        self._next_s = 0.0
        self._shown: PushTestStatus | None = None
        self.folder = gui.add_folder("Push test")
        with self.folder:
            self.mode = gui.add_dropdown("Robot yields in", tuple(MODES))
            self.force = gui.add_number("Pull with [N]", 20.0, min=1.0, max=60.0, step=1.0)
            self.directions = gui.add_dropdown("Directions", tuple(DIRECTIONS))
            self.run = gui.add_button("Run the push test", hint=_HINT)
            self.cancel = gui.add_button("Cancel the push test", visible=False)
            self.plot = gui.add_html("")

        @self.run.on_click
        async def _(event: viser.GuiEvent) -> None:
            mode, force, count = self.mode.value, self.force.value, DIRECTIONS[self.directions.value]
            self._worker.submit("run", lambda: attempt(lambda: tests.start(mode, force, count), event.client))

        @self.cancel.on_click
        async def _(_: viser.GuiEvent) -> None:
            tests.cancel()

    def update(self, snapshot: np.void) -> None:
        """Show how far the test is; it is hidden on hardware."""
        simulated = not on_hardware(snapshot)
        if self.folder.visible != simulated:
            self.folder.visible = simulated
        now = time.monotonic()
        status = self._tests.status()
        if status == self._shown or now < self._next_s:
            return
        self._next_s, self._shown = now + PERIOD_S, status
        self.run.visible, self.cancel.visible = not status.running, status.running
        self.plot.content = push_test_html(status)
