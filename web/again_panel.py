"""Runs an estimator over the recording that is shown, and gives the charts what it says beside what was estimated then."""

import html
import time
from typing import Any

import numpy as np
import viser

from web import theme
from web.sink import ConsoleSink
from web.widget_binding import Worker, attempt

POLL_S = 0.2
_HINT = "Of its momentum observer, K1 and K2; with zeros it has those that it had."
_RUN_HINT = "Over the whole recording, as fast as it goes. What it says is drawn as a dashed line in the charts."
_IDLE = "What another estimator, or other gains, would have said."


class AgainPanel:
    """Widgets of an estimator that is run again; hidden unless a recording is shown.

    Attributes:
        ready: it has said something of the recording that is shown.
    """

    def __init__(self, gui: viser.GuiApi, sink: ConsoleSink) -> None:
        self.ready = False
        self._sink = sink
        self._worker = Worker()
        self._recording: str | None = None
        self._time_s = np.zeros(0)
        self._force_n = np.zeros((0, 3))
        with gui.add_folder("Estimate again", visible=False) as self.folder:
            self.estimator = gui.add_dropdown("By", tuple(sink.available()["estimators"]))
            self.gains = gui.add_vector2("Gains", (0.0, 0.0), min=(0.0, 0.0), step=0.1, hint=_HINT)
            run = gui.add_button("Estimate", icon=viser.Icon.REFRESH, hint=_RUN_HINT)
            self.note = gui.add_html("")
        self._tell(_IDLE)

        @run.on_click
        async def _(event: viser.GuiEvent) -> None:
            self._worker.submit(run.label, lambda: attempt(self.run, event.client))

    def update(self) -> None:
        """Show the widgets while a recording is shown; what is known of another one is forgotten."""
        shown = self._sink.estimates.shown
        if self._recording == shown:
            return
        self._recording, self.ready = shown, False
        self.folder.visible = shown is not None
        self._tell(_IDLE)

    def force_estimated_n(self, time_s: np.ndarray) -> np.ndarray:
        """Force (n, 3) N that it gives at times (n,) since the start; NaN where it says nothing."""
        forces = np.full((len(time_s), 3), np.nan)
        if self.ready:
            inside = (time_s >= self._time_s[0]) & (time_s <= self._time_s[-1])
            forces[inside] = self._force_n[np.searchsorted(self._time_s, time_s[inside], side="right") - 1]
        return forces

    def run(self) -> None:
        """Run what is chosen, and wait for it."""
        recording = self._sink.estimates.shown
        k1, k2 = self.gains.value
        key = self._sink.estimates.again(self.estimator.value, (k1, k2) if k1 > 0.0 and k2 > 0.0 else None)
        self._tell(f"{html.escape(self.estimator.value)} runs over the recording ...")
        while (answer := self._sink.estimates.result(str(recording), key))["state"] == "running":
            time.sleep(POLL_S)
        if recording != self._sink.estimates.shown:
            return
        if answer["state"] == "done":
            self.ready = False  # the charts are drawn meanwhile
            self._time_s, self._force_n = np.array(answer["time_s"]), np.array(answer["force_n"], float)
            self.ready = len(self._time_s) > 0
        self._tell(_words(answer))

    def _tell(self, words: str) -> None:
        self.note.content = f'<div data-forcelens="again" style="{theme.SMALL_TEXT}">{words}</div>'


def _words(answer: dict[str, Any]) -> str:
    name = html.escape(answer["estimator"])
    if answer["state"] == "failed":
        return f"{name} failed: {html.escape(answer['message'])}"
    gains = answer["gains"]
    told = "" if gains is None else f" with {gains['k1']:g}, {gains['k2']:g}"
    words = f"<b>{name}</b>{told}: {answer['difference_rms_n']:.2f} N rms from what was estimated then"
    if answer["error_rms_n"] is None:
        return f"{words}."
    return f"{words}; {answer['error_rms_n']:.2f} N from the truth, then {answer['error_then_rms_n']:.2f} N."
