"""What the robot does by itself: pick a task, shape it, start and abort it, watch its phase, and compare with the paper."""

import html
import time
from collections.abc import Mapping
from typing import Any

import numpy as np
import viser

from sim.tasks.task import SITE_OPTIONS
from web import theme
from web.sink import ConsoleSink
from web.widget_binding import Worker, attempt

PERIOD_S = 0.3

PAPER: dict[str, dict[str, tuple[str, str]]] = {
    "wipe": {"position_rmse_cm": ("planar position", "2.90 cm"), "force_rmse_n": ("normal force control", "2.13 N")},
    "box": {
        "force_y_rmse_n": ("lateral force control", "0.98 N"),
        "force_z_rmse_n": ("vertical force control", "3.98 N"),
        "y_min_m": ("farthest right", "-0.205 m"),
        "y_max_m": ("farthest left", "0.220 m"),
    },
    "valve": {"turned_place_rad": ("turned in place", "shown"), "turned_drive_rad": ("turned while driving", "shown")},
    "door": {"opened_rad": ("opened", "shown once")},
    "sequence": {"steps_done": ("steps done", "future work")},
    "guidance": {"lead_force_n": ("largest lead", "shown"), "drift_cm": ("drift at rest", "not told")},
}
"""By task and metric: what it is, and what the paper reports."""

_COLORS = {"succeeded": "#1b6e3c", "failed": theme.ALERT, "aborted": theme.CAUTION}


def label(key: str) -> str:
    """An option's or metric's name for people: "force [N]" of "force_n"."""
    units = {"n": "N", "m": "m", "s": "s", "rad": "rad", "cm": "cm", "mps": "m/s", "rps": "rad/s"}
    words = key.split("_")
    unit = units.get(words[-1]) if len(words) > 1 else None
    return f"{' '.join(words[:-1])} [{unit}]" if unit else " ".join(words)


def status_html(task: Mapping[str, Any] | None) -> str:
    """Phase, metrics beside the paper's figures, and outcome of a task as REST tells it; None before the first."""
    if task is None:
        return f'<div style="{theme.SMALL_TEXT}" data-forcelens="task">No task has been begun.</div>'
    outcome = task["outcome"]
    said = f"{outcome}{': ' + task['reason'] if task['reason'] else ''}" if outcome else f"at work: {task['phase']}"
    color = _COLORS.get(outcome or "", "#2b5c8a")
    rows = [
        f'<div style="padding:0.4em 0.6em;margin:0.3em 0;border-radius:4px;color:#fff;background:{color}">'
        f"<b>{html.escape(task['name'])}</b> {html.escape(said)}</div>"
    ]
    paper = PAPER.get(task["name"], {})
    cells = ["<tr><th align=left>as estimated</th><th align=right>now</th><th align=right>paper</th></tr>"]
    for key, value in task["metrics"].items():
        words, _, unit = label(key).partition(" [")
        name, theirs = paper.get(key, (words, ""))
        shown = "–" if value is None else f"{value:.2f} {unit.rstrip(']')}"
        cells.append(f"<tr><td>{html.escape(name)}</td><td align=right>{shown}</td><td align=right>{theirs}</td></tr>")
    rows.append(f'<table style="width:100%">{"".join(cells)}</table>')
    return f'<div style="{theme.SMALL_TEXT}" data-forcelens="task">{"".join(rows)}</div>'


class TasksPanel:
    """Widgets of the tasks. One worker asks the control process, so that no browser waits for it."""

    def __init__(self, server: viser.ViserServer, sink: ConsoleSink) -> None:
        gui, self._sink, self._worker = server.gui, sink, Worker()
        self._kinds = {kind["name"]: kind for kind in sink.tasks.kinds()}
        first = next(iter(self._kinds))
        self.task = gui.add_dropdown("Task", tuple(self._kinds), initial_value=first)
        self.description = gui.add_html("")
        self.options: dict[str, dict[str, viser.GuiNumberHandle[float]]] = {}
        for name, kind in self._kinds.items():
            own = {key: option for key, option in kind["options"].items() if key not in SITE_OPTIONS}
            self.options[name] = {key: self._add_number(gui, key, option) for key, option in own.items()}
        with gui.add_folder("Where the site is believed", expand_by_default=False):
            site = self._kinds[first]["options"]
            self.site = {key: self._add_number(gui, key, site[key]) for key in SITE_OPTIONS}
            for number in self.site.values():
                number.visible = True
        self.start = gui.add_button("Start", icon=viser.Icon.PLAYER_PLAY, color="green")
        self.abort = gui.add_button("Abort", icon=viser.Icon.PLAYER_STOP, color="red", visible=False)
        self.bar = gui.add_progress_bar(0.0, visible=False)
        self.status = gui.add_html(status_html(None))
        self._next_s = 0.0
        self._shown_id = 0
        self._show_options()

        @self.task.on_update
        async def _(_: viser.GuiEvent) -> None:
            self._show_options()

        @self.start.on_click
        async def _(event: viser.GuiEvent) -> None:
            name = self.task.value
            numbers = {**self.options[name], **self.site}
            options = {key: float(number.value) for key, number in numbers.items()}
            self._act(event.client, lambda: sink.tasks.start(name, options))

        @self.abort.on_click
        async def _(event: viser.GuiEvent) -> None:
            self._act(event.client, lambda: sink.tasks.abort())

    def update(self, snapshot: np.void) -> None:
        """Show the task of a SNAPSHOT record."""
        running = bool(snapshot["task_in_charge"]) and snapshot["task_outcome"] == 0
        if self.abort.visible != running:
            self.abort.visible, self.start.visible, self.bar.visible = running, not running, running
        now = time.monotonic()
        key = int(snapshot["task_id"])
        if key == 0 or now < self._next_s or not (running or key != self._shown_id):
            return
        self._next_s = now + PERIOD_S
        self.bar.value = 100.0 * float(snapshot["task_progress"])
        self._shown_id = 0 if running else key
        self._worker.submit("status", self._refresh)

    def _refresh(self) -> None:
        try:
            self.status.content = status_html(self._sink.tasks.get())
        except (ValueError, RuntimeError):
            self._shown_id = 0  # the next snapshot asks again

    def _act(self, client: viser.ClientHandle | None, action: Any) -> None:
        self._worker.submit("act", lambda: attempt(action, client))

    def _show_options(self) -> None:
        kind = self._kinds[self.task.value]
        scene = f" Scene: <b>{kind['scene']}</b>." if kind["scene"] else ""
        self.description.content = f'<div style="{theme.SMALL_TEXT}">{html.escape(kind["description"])}.{scene}</div>'
        for name, numbers in self.options.items():
            for number in numbers.values():
                if number.visible != (name == kind["name"]):
                    number.visible = name == kind["name"]

    @staticmethod
    def _add_number(gui: viser.GuiApi, key: str, option: Mapping[str, Any]) -> viser.GuiNumberHandle[float]:
        return gui.add_number(
            label(key),
            float(option["default"]),
            min=option["minimum"],
            max=option["maximum"],
            step=0.01,
            visible=False,
            hint=f"{option['minimum']:g} to {option['maximum']:g} {option['unit']}",
        )
