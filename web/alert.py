"""The line above the widgets that says why the robot does not obey."""

import html

import numpy as np
import viser

from sim.runtime.fault_words import CONTROL_PROCESS_DEAD_WORDS, message
from sim.runtime.snapshot import Mode

_BOX = "margin:0.5em 0.75em;padding:0.5em 0.75em;border-radius:4px;font-size:0.875em;color:#fff;background:{}"
_RED, _AMBER = "#b3261e", "#8a5a00"


def alert_text(snapshot: np.void | None) -> tuple[str, str] | None:
    """Message and background of the alert for a SNAPSHOT record (None: the control process is dead), None when all is well."""
    if snapshot is None:
        return CONTROL_PROCESS_DEAD_WORDS, _RED
    words = message(snapshot)
    return None if words is None else (words, _RED if snapshot["mode"] == Mode.ESTOP else _AMBER)


class Alert:
    """Shows alert_text, or nothing."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._box = server.gui.add_html("", visible=False)

    def update(self, snapshot: np.void | None) -> None:
        """Say what a SNAPSHOT record gives reason to say; None means that the control process is dead."""
        alert = alert_text(snapshot)
        if alert is not None:
            message, background = alert
            self._box.content = f'<div data-forcelens="alert" style="{_BOX.format(background)}">{html.escape(message)}</div>'
        if self._box.visible != (alert is not None):
            self._box.visible = alert is not None
