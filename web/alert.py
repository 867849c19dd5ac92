"""The line above the widgets that says why the robot does not obey."""

import html

import numpy as np
import viser

from sim.runtime.fault_words import CONTROL_PROCESS_SILENT, SILENCE_WORDS, message
from sim.runtime.snapshot import Mode
from web import theme

_BOX = "margin:0.5em 0.75em;padding:0.5em 0.75em;border-radius:4px;font-size:0.875em;color:#fff;background:{}"


def alert_text(snapshot: np.void | None) -> tuple[str, str] | None:
    """Message and background of the alert for a SNAPSHOT record (None: the control process is dead or hangs), or None."""
    if snapshot is None:
        return SILENCE_WORDS[CONTROL_PROCESS_SILENT], theme.ALERT
    words = message(snapshot)
    alarming = snapshot["mode"] == Mode.ESTOP or bool(snapshot["failure"])
    return None if words is None else (words, theme.ALERT if alarming else theme.CAUTION)


class Alert:
    """Shows alert_text, or nothing."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._box = server.gui.add_html("", visible=False)

    def update(self, snapshot: np.void | None) -> None:
        """Say what a SNAPSHOT record gives reason to say; None means that the control process is dead or hangs."""
        alert = alert_text(snapshot)
        if alert is not None:
            message, background = alert
            self._box.content = f'<div data-forcelens="alert" style="{_BOX.format(background)}">{html.escape(message)}</div>'
        if self._box.visible != (alert is not None):
            self._box.visible = alert is not None
