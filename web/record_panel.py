"""Starts and ends a recording, and says how it goes."""

import numpy as np
import viser

from web import theme
from web.sink import ConsoleSink
from web.widget_binding import Worker, attempt


class RecordPanel:
    """Widgets of recordings; build it inside the container that shall hold them."""

    def __init__(self, gui: viser.GuiApi, sink: ConsoleSink) -> None:
        worker = Worker()
        with gui.add_folder("Record"):
            self.name = gui.add_text("Name", "", hint="Of the next recording.")
            self.start = gui.add_button("Record", icon=viser.Icon.PLAYER_RECORD, color="red")
            self.stop = gui.add_button("End the recording", icon=viser.Icon.PLAYER_STOP, visible=False)
            self.note = gui.add_html("")

        @self.start.on_click
        async def _(event: viser.GuiEvent) -> None:
            worker.submit("start", lambda: attempt(lambda: sink.recordings.start(self.name.value), event.client))

        @self.stop.on_click
        async def _(event: viser.GuiEvent) -> None:
            worker.submit("stop", lambda: attempt(sink.recordings.stop, event.client))

    def update(self, snapshot: np.void) -> None:
        """Show what a SNAPSHOT record says."""
        recording = bool(snapshot["recording"])
        if self.stop.visible != recording:
            self.stop.visible, self.start.visible = recording, not recording
        words = ""
        if recording:
            words = f"{snapshot['recording_s']:.0f} s, {snapshot['recording_bytes'] / 1e6:.1f} MB"
        content = f'<div data-forcelens="recording" style="{theme.SMALL_TEXT}">{words}</div>'
        if self.note.content != content:
            self.note.content = content
