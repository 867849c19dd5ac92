"""The line above the widgets that says why the robot does not obey."""

import html

import numpy as np
import viser

from control.safety import Fault
from sim.backends.hardware.states import Trip, describe
from sim.runtime.snapshot import Mode, on_hardware
from web import theme

_FAULT_WORDS = {
    Fault.TILT: "the base tilts too far",
    Fault.NOT_FINITE: "a value is not finite",
    Fault.STALE_SETPOINT: "no fresh command arrives",
    Fault.STALE_TARGETS: "the controller delivers no targets",
    Fault.JOINT_LIMIT: "a joint is at its limit",
    Fault.TORQUE_LIMIT: "a joint is at its torque limit",
    Fault.ESTIMATOR_STALE: "the force estimate is stale",
    Fault.CONTROLLER_ERROR: "the controller failed",
    Fault.TIP_OVER_LIMIT: "the commanded force is reduced, or the robot would tip over",
}
_BOX = "margin:0.5em 0.75em;padding:0.5em 0.75em;border-radius:4px;font-size:0.875em;color:#fff;background:{}"


def alert_text(snapshot: np.void | None) -> tuple[str, str] | None:
    """Message and background of the alert for a SNAPSHOT record (None: the control process is dead or hangs), or None."""
    if snapshot is None:
        return "The control process has stopped, or hangs. Restart it in the bar at the top.", theme.ALERT
    mode = Mode(snapshot["mode"])
    if mode is Mode.ESTOP:
        return "E-stop is latched: the drives only damp. Clear it in the bar at the top.", theme.ALERT
    if snapshot["failure"]:
        return f"Stopped: {snapshot['failure'].decode(errors='replace')}.", theme.ALERT
    faults = ", ".join(words for fault, words in _FAULT_WORDS.items() if snapshot["faults"] & fault)
    if on_hardware(snapshot):
        faults = ", ".join(describe(Trip(int(snapshot["drive_faults"]))))
    if mode is Mode.FAULT:
        return f"Fault, the drives only damp: {faults or 'unknown'}.", theme.CAUTION
    return None


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
