"""The last minute of a simulation: look back at it, and go on from any moment with something changed."""

from typing import Any

import numpy as np
import viser

from sim.runtime.history import WINDOW_S
from sim.runtime.snapshot import Mode
from web import theme
from web.sink import ConsoleSink
from web.widget_binding import Binding, Worker, attempt

STEP_S = 0.1
UNCHANGED = "as it was"
_MASSES = ("0.8", "0.9", "1.0", "1.1", "1.2")
_HINT = "Seconds before the newest moment. Pauses. To run goes on from the newest moment again."
_BRANCH_HINT = (
    "Sets the simulation back to what is shown, with what is chosen here, and runs. "
    "The future that it had stays as a pale robot and a dashed line."
)


class HistoryPanel:
    """Widgets of the past; hidden where there is none."""

    def __init__(self, server: viser.ViserServer, sink: ConsoleSink) -> None:
        gui, choices = server.gui, sink.available()
        self._sink = sink
        self._worker = Worker()
        self._range_s = (np.nan, np.nan)
        self._shown_s = np.nan
        self._paused = False
        self.note = gui.add_html("")
        self.back = gui.add_slider("Back [s]", -WINDOW_S, 0.0, 0.02, 0.0, hint=_HINT)
        self._binding = Binding(self.back, lambda s: float(s["time_s"] - s["history_end_s"]), self._look, self._worker)
        step = gui.add_button("Step back", icon=viser.Icon.PLAYER_TRACK_PREV, hint=f"{STEP_S:g} s earlier; pauses.")
        with gui.add_folder("Go on from here") as self._folder:
            self.controller = gui.add_dropdown("Controller", (UNCHANGED, *choices["controllers"]))
            self.estimator = gui.add_dropdown("Estimator", (UNCHANGED, *choices["estimators"]))
            self.mass = gui.add_dropdown("Robot mass", (UNCHANGED, *_MASSES))
            branch = gui.add_button("Go on", icon=viser.Icon.GIT_BRANCH, hint=_BRANCH_HINT)
        self._widgets = (self.back, step, self._folder)
        self._on_click(step, self.step_back)
        self._on_click(branch, self.go_on)

    def _on_click(self, button: viser.GuiButtonHandle, action: Any) -> None:
        @button.on_click
        async def _(event: viser.GuiEvent) -> None:
            self._worker.submit(button.label, lambda: attempt(action, event.client))

    def update(self, snapshot: np.void) -> None:
        """Show what a SNAPSHOT record says of the past."""
        self._range_s = start_s, end_s = float(snapshot["history_start_s"]), float(snapshot["history_end_s"])
        self._shown_s = float(snapshot["time_s"])
        self._paused = snapshot["mode"] != Mode.RUNNING
        kept = bool(np.isfinite(end_s))
        for widget in self._widgets:
            if widget.visible != kept:
                widget.visible = kept
        if kept:
            self._binding.sync(snapshot)
        self._tell(_words(start_s, end_s, self._shown_s, bool(snapshot["past"])))

    def step_back(self) -> None:
        """Show what was STEP_S before what is shown."""
        self._show(self._shown_s - STEP_S)

    def go_on(self) -> None:
        """Set the simulation back to what is shown, with what is chosen, and run."""
        changes: dict[str, Any] = {}
        for field, widget in (("controller", self.controller), ("estimator", self.estimator)):
            if widget.value != UNCHANGED:
                changes[field] = widget.value
        if self.mass.value != UNCHANGED:
            changes["mass_scale"] = float(self.mass.value)
        self._pause()
        self._sink.past.branch(**changes)
        self._sink.set_run("running", None)

    def _look(self, back_s: float) -> None:
        self._show(self._range_s[1] + back_s)

    def _show(self, time_s: float) -> None:
        self._pause()
        start_s, end_s = self._range_s
        self._sink.past.seek(min(max(time_s, start_s), end_s))

    def _pause(self) -> None:
        if not self._paused:
            self._sink.set_run("paused", None)

    def _tell(self, words: str) -> None:
        content = f'<div data-forcelens="history" style="{theme.SMALL_TEXT}">{words}</div>'
        if self.note.content != content:
            self.note.content = content


def _words(start_s: float, end_s: float, shown_s: float, past: bool) -> str:
    if not np.isfinite(end_s):
        return "Nothing is kept of what was: a robot cannot be set back, nor a controller that does not say what it carries."
    if past:
        return f"<b>The past:</b> {shown_s:.2f} s of {start_s:.2f} to {end_s:.2f} s."
    return f"The last {end_s - start_s:.0f} s can be shown again, and gone on from."
