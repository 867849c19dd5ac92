"""Opens a recording and moves about in it."""

from typing import Any

import numpy as np
import viser

from sim.runtime.replay_session import BACKEND
from web import theme
from web.sink import ConsoleSink
from web.widget_binding import Binding, Worker, attempt

NONE = "none yet"


class ReplayPanel:
    """Widgets of a recording that is shown; build it inside the container that shall hold them."""

    def __init__(self, gui: viser.GuiApi, sink: ConsoleSink) -> None:
        self._sink = sink
        self._worker = Worker()
        self._duration_s = 0.0
        self._recording = True  # so that the first snapshot lists what there is
        with gui.add_folder("Replay"):
            self.recordings = gui.add_dropdown("Recording", (NONE,))
            show = gui.add_button("Show it", icon=viser.Icon.PLAYER_PLAY, hint="Instead of what runs now.")
            self.time = gui.add_slider("Time [s]", 0.0, 1.0, 0.02, 0.0, visible=False)
            self.speed = gui.add_slider("Replay speed [x]", 0.1, 8.0, 0.1, 1.0, visible=False)
            self.leave = gui.add_button("Back to the simulation", visible=False)
            self.note = gui.add_html("", visible=False)
        self._bindings = [
            Binding(self.time, lambda s: float(s["time_s"]), lambda t: sink.past.change_replay(time_s=t), self._worker),
            Binding(self.speed, lambda s: float(s["speed"]), lambda v: sink.past.change_replay(speed=v), self._worker),
        ]
        self._on_click(show, self.show)
        self._on_click(self.leave, lambda: sink.set_backend("simulation"))

    def _on_click(self, button: viser.GuiButtonHandle, action: Any) -> None:
        @button.on_click
        async def _(event: viser.GuiEvent) -> None:
            self._worker.submit(button.label, lambda: attempt(action, event.client))

    def show(self) -> None:
        """Show the recording that is chosen."""
        if self.recordings.value == NONE:
            raise ValueError("there is no recording yet; the button Record makes one")
        self._sink.set_backend(BACKEND, recording=self.recordings.value)

    def update(self, snapshot: np.void) -> None:
        """Show where it stands; the list is made anew whenever a recording has ended."""
        replayed = snapshot["backend"] == BACKEND.encode()
        recording = bool(snapshot["recording"])
        if self._recording and not recording:
            self._worker.submit("list", self.refresh)
        self._recording = recording
        for widget in (self.time, self.speed, self.leave, self.note):
            if widget.visible != replayed:
                widget.visible = replayed
                if replayed and widget is self.time:
                    self._worker.submit("fit", lambda: attempt(self._fit, None))
        if replayed:
            for binding in self._bindings:
                binding.sync(snapshot)
            words = f"<b>A recording</b> is shown, {self._duration_s:.1f} s long. Nothing is sent to any robot."
            content = f'<div data-forcelens="replay" style="{theme.SMALL_TEXT}">{words}</div>'
            if self.note.content != content:
                self.note.content = content

    def refresh(self) -> None:
        """List the recordings that are finished."""
        names = tuple(self._sink.recordings.ids()) or (NONE,)
        if names != tuple(self.recordings.options):
            self.recordings.options = names

    def _fit(self) -> None:
        self._duration_s = self._sink.past.replay()["duration_s"]
        self.time.max = max(self._duration_s, self.time.step)
