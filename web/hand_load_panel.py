"""What the hand reads without contact and what it carries: tare, and the tool, set or found by a short motion."""

import html
from collections.abc import Callable

import numpy as np
import viser

from control.hand_load.tool import MAX_TOOL_CENTER_M, MAX_TOOL_KG
from web import theme
from web.sink import ConsoleSink
from web.widget_binding import Worker, attempt

_MOTION = "Turns the free hand through six postures, in some 11 s: keep clear. Any other command ends it."


def hand_load_html(snapshot: np.void) -> str:
    """Tare and tool of a SNAPSHOT record, and what there is to say of the tool."""
    offset = ", ".join(f"{each:.2f}" for each in snapshot["tare_n"])
    center = ", ".join(f"{100 * each:.1f}" for each in snapshot["tool_center_of_mass"])
    rows = [f"Tare: {offset} N" if snapshot["tare_n"].any() else "Tare: none"]
    mass = snapshot["tool_mass"]
    rows.append(f"Tool: {mass:.2f} kg at {center} cm" if mass > 0 else "Tool: none")
    message = snapshot["tool_message"].decode(errors="replace")
    note = f'<div data-forcelens="tool-message">{html.escape(message)}</div>' if message else ""
    body = "".join(f"<div>{row}</div>" for row in rows)
    return f'<div style="{theme.SMALL_TEXT}" data-forcelens="hand-load">{body}{note}</div>'


class HandLoadPanel:
    """A folder with tare and tool; build it inside the container that shall hold it."""

    def __init__(self, gui: viser.GuiApi, sink: ConsoleSink) -> None:
        self._worker = Worker()
        self._shown: tuple[float, ...] | None = None
        with gui.add_folder("Hand load"):
            self._note = gui.add_html("")
            self.tare = gui.add_button("Tare", hint="What the free hand reads now becomes its zero.")
            self.clear = gui.add_button("Clear the tare")
            self.mass = gui.add_number("Tool mass [kg]", 0.0, min=0.0, max=MAX_TOOL_KG, step=0.01)
            self.center = gui.add_vector3(
                "Tool centre [m]",
                (0.0, 0.0, 0.0),
                min=np.full(3, -MAX_TOOL_CENTER_M),
                max=np.full(3, MAX_TOOL_CENTER_M),
                step=0.005,
                hint="Of mass, in the hand's frame.",
            )
            self.put = gui.add_button("Set the tool", hint="Robot and estimate reckon with it from now on.")
            self.identify = gui.add_button("Find the tool", hint=_MOTION)
            self.progress = gui.add_progress_bar(0.0, visible=False)
        self._on_click(self.tare, sink.tare)
        self._on_click(self.clear, sink.clear_tare)
        self._on_click(self.put, lambda: sink.set_tool(self.mass.value, self.center.value))
        self._on_click(self.identify, sink.identify_tool)

    def _on_click(self, button: viser.GuiButtonHandle, action: Callable[[], object]) -> None:
        @button.on_click
        async def _(event: viser.GuiEvent) -> None:
            self._worker.submit(button.label, lambda: attempt(action, event.client))

    def update(self, snapshot: np.void) -> None:
        """Show tare and tool of a SNAPSHOT record; what is being entered stays until the tool itself changes."""
        content = hand_load_html(snapshot)
        if content != self._note.content:
            self._note.content = content
        tool = (float(snapshot["tool_mass"]), *snapshot["tool_center_of_mass"].tolist())
        if tool != self._shown:
            self._shown = tool
            self.mass.value, (x, y, z) = round(tool[0], 3), (round(each, 4) for each in tool[1:])
            self.center.value = (x, y, z)
        progress = float(snapshot["tool_progress"])
        moving = bool(np.isfinite(progress))
        if self.progress.visible != moving:
            self.progress.visible = moving
            self.identify.disabled = moving
        if moving:
            self.progress.value = round(100.0 * progress)
