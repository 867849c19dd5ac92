"""Which robot is driven, simulated or real, and on hardware its drives: what may be asked of them, their health, the link."""

import html
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
import viser

from sim.backends.hardware.backend import HONESTY
from sim.backends.hardware.limits import HardwareLimits
from sim.backends.hardware.states import DriveState, allowed_requests
from sim.backends.hardware.status import HardwareStatus
from sim.runtime.snapshot import on_hardware
from web import theme
from web.sink import ConsoleSink, notify
from web.widget_binding import Binding, Worker, text

PERIOD_S = 0.25
HOT_C = HardwareLimits().temperature_warn_c
"""From here on a motor stands out in the table."""

REQUESTS: dict[str, tuple[str, str]] = {
    "engage": ("Engage", "The robot's own program lays it down and lets go of its motors. Then they are damped."),
    "stand": ("Stand up", "The robot stands up and reaches out with its arm."),
    "start": ("Start the controller", "The controller moves the robot. Whoever pulls at its hand leads it."),
    "hold": ("Hold still", ""),
    "sit": ("Sit down", "The robot folds arm and legs and lies down."),
    "damp": ("Damp", "The motors only damp: a standing robot sinks to the ground."),
    "release": ("Release the motors", ""),
    "clear": ("Clear the fault", ""),
}
"""Label of each request, and what is asked before one that moves the robot."""

_BADGE = "padding:0.4em 0.6em;margin:0.3em 0;border-radius:4px;color:#fff;background:{}"


def backends_html(backends: Sequence[dict[str, Any]]) -> str:
    """The backends that cannot be used here, and why."""
    rows = [
        f"<div>{html.escape(backend['name'])}: not available. {html.escape(backend['reason'] or '')}</div>"
        for backend in backends
        if not backend["available"]
    ]
    return f'<div style="{theme.SMALL_TEXT}" data-forcelens="backends">{"".join(rows)}</div>'


def status_html(status: HardwareStatus | None) -> str:
    """Drives, faults, link and battery of a robot; None when its I/O process has died."""
    rows = [f"<div>Hardware backend: <b>{HONESTY}</b>. It has driven an emulated robot only.</div>"]
    if status is None:
        rows.append(_badge(theme.ALERT, "The I/O process has died. The robot gets no commands: use its own stop."))
        return _box(rows, "")
    if status.dry_run:
        rows.append(_badge(theme.CAUTION, "DRY RUN: everything is computed and nothing is sent. The robot does not move."))
    moving = status.engaging or status.state in (DriveState.STANDING_UP, DriveState.SITTING)
    progress = f" {100 * status.progress:.0f} %" if moving else ""
    doing = "engaging" if status.engaging else status.state.name.lower().replace("_", " ")
    rows.append(f"<div>Drives: <b>{doing}</b>{progress}</div>")
    notes = dict.fromkeys((*status.faults, *status.warnings, *filter(None, [status.message])))
    if notes:
        rows.append(_badge(theme.ALERT if status.state == DriveState.FAULT else theme.CAUTION, "; ".join(notes)))
    rows += [
        f"<div>State of the base {_age(status.base_age_s)} old, of the arm {_age(status.arm_age_s)}</div>",
        f"<div>Latency, state to command {status.tick_work_ms:.1f} ms; longest period {status.worst_period_ms:.1f} ms</div>",
        f"<div>{status.states_received} states, {status.states_missed} missed, {status.bad_messages} unsound; "
        f"{status.frames_sent} commands sent</div>",
        f"<div>Battery {_battery(status)}</div>",
    ]
    return _box(rows, motors_html(status))


def motors_html(status: HardwareStatus) -> str:
    """The health table: temperature, torque and lost packets of every motor."""
    rows = []
    for motor in status.motors:
        hot = "" if motor.temperature_c < HOT_C else f' style="color:{theme.css(theme.CONE_EXCEEDED)}"'
        lost = "–" if motor.lost is None else str(motor.lost)
        temperature = f"{motor.temperature_c:.0f}" if np.isfinite(motor.temperature_c) else "–"
        torque = f"{motor.torque_nm:.1f}" if np.isfinite(motor.torque_nm) else "–"
        rows.append(
            f"<tr{hot}><td>{motor.name}</td><td align=right>{temperature}</td>"
            f"<td align=right>{torque}</td><td align=right>{lost}</td></tr>"
        )
    head = "<tr><th align=left>Motor</th><th align=right>°C</th><th align=right>N m</th><th align=right>lost</th></tr>"
    return f'<table style="width:100%" data-forcelens="motors">{head}{"".join(rows)}</table>'


def _battery(status: HardwareStatus) -> str:
    return "unknown" if status.battery_percent is None else f"{status.battery_percent} %, {status.battery_v:.1f} V"


def _age(age_s: float) -> str:
    return f"{1e3 * age_s:.0f} ms" if age_s < 10.0 else "never or long"


def _badge(color: str, words: str) -> str:
    return f'<div style="{_BADGE.format(color)}">{html.escape(words)}</div>'


def _box(rows: list[str], table: str) -> str:
    return f'<div style="{theme.SMALL_TEXT}" data-forcelens="hardware">{"".join(rows)}{table}</div>'


class HardwarePanel:
    """Backend picker, and on hardware the buttons that the drives' state allows, asking before the robot moves."""

    def __init__(self, server: viser.ViserServer, sink: ConsoleSink) -> None:
        gui, self._sink, self._worker = server.gui, sink, Worker()
        backends = sink.available()["backends"]
        names = tuple(backend["name"] for backend in backends)
        self.backend = gui.add_dropdown("Backend", names, hint="What the controller drives.")
        self.dry_run = gui.add_checkbox("Dry run", True, hint="On hardware: compute everything and send nothing.")
        gui.add_html(backends_html(backends), visible=not all(backend["available"] for backend in backends))
        self.buttons = {request: self._add_button(gui, request) for request in REQUESTS}
        self._status = gui.add_html("", visible=False)
        self._hardware = False
        self._bindings = [
            Binding(self.backend, text("backend"), self._choose, self._worker),
            Binding(self.dry_run, self._dry_run, self._set_dry_run, self._worker),
        ]
        self._next_s = 0.0

    def update(self, snapshot: np.void | None) -> None:
        """Show a SNAPSHOT record (None: the control process is dead) and what the robot's I/O process reports."""
        if snapshot is not None:
            self._hardware = on_hardware(snapshot)
            for binding in self._bindings:
                binding.sync(snapshot)
        now = time.monotonic()
        if now >= self._next_s:
            self._next_s = now + PERIOD_S
            self._show(self._sink.hardware_status() if self._hardware else None)

    def _show(self, status: HardwareStatus | None) -> None:
        allowed = [] if status is None or status.engaging else allowed_requests(status.state)
        for request, button in self.buttons.items():
            if button.visible != (request in allowed):
                button.visible = request in allowed
        if self._status.visible != self._hardware:
            self._status.visible = self._hardware
        if self._hardware:
            self._status.content = status_html(status)

    def _choose(self, name: str) -> None:
        if name == "hardware":
            self._sink.set_backend(name, dry_run=self.dry_run.value)
        else:
            self._sink.set_backend(name)

    def _dry_run(self, snapshot: np.void) -> bool:
        return bool(snapshot["dry_run"]) if on_hardware(snapshot) else self.dry_run.value

    def _set_dry_run(self, on: bool) -> None:
        if self._hardware:
            self._sink.set_backend("hardware", dry_run=on)

    def _add_button(self, gui: viser.GuiApi, request: str) -> viser.GuiButtonHandle:
        label, question = REQUESTS[request]
        button = gui.add_button(label, visible=False)

        @button.on_click
        async def _(event: viser.GuiEvent) -> None:
            if event.client is None:
                return
            if question:
                self._ask(event.client, request)
            else:
                self._request(event.client, request)

        return button

    def _ask(self, client: viser.ClientHandle, request: str) -> None:
        label, question = REQUESTS[request]
        modal = client.gui.add_modal(label)
        with modal:
            client.gui.add_html(f'<div style="padding:0.75em">{question} Keep clear, and the e-stop at hand.</div>')
            confirm = client.gui.add_button(f"Yes: {label.lower()}", color="red")
            cancel = client.gui.add_button("Cancel")

        @confirm.on_click
        async def _(_: viser.GuiEvent) -> None:
            modal.close()
            self._request(client, request)

        @cancel.on_click
        async def _(_: viser.GuiEvent) -> None:
            modal.close()

    def _request(self, client: viser.ClientHandle, request: str) -> None:
        def act() -> None:
            try:
                self._sink.drive(request)
            except (ValueError, RuntimeError) as refusal:
                notify(client, str(refusal))

        self._worker.submit(request, act)
