"""The estimators side by side: who feeds the controller, and how far each is from the truth, now and over time."""

import html
import time
from collections.abc import Sequence

import numpy as np
import viser
from viser import uplot

from sim.runtime.fault_words import FLAG_WORDS, estimator_flags
from web import theme
from web.history import History
from web.sink import ConsoleSink
from web.widget_binding import Worker, attempt

WINDOW_S = 30.0
SEND_PERIOD_S = 0.5
_RANGES_N = (2.0, 5.0, 10.0, 20.0, 50.0, 100.0)
UNAVAILABLE = "unavailable"


def swatch(index: int) -> str:
    """A square in the colour of an estimator, HTML."""
    color = theme.css(theme.ESTIMATORS[index])
    return f'<span style="display:inline-block;width:0.7em;height:0.7em;margin-right:0.5em;background:{color}"></span>'


def legend_html(names: Sequence[str]) -> str:
    """Whose colour is which."""
    items = "".join(
        f'<span style="margin-right:1em;white-space:nowrap">{swatch(index)}{html.escape(name)}</span>'
        for index, name in enumerate(names)
    )
    return f'<div style="{theme.SMALL_TEXT}" data-forcelens="legend">{items}</div>'


def estimators_html(snapshot: np.void) -> str:
    """Live error of every estimator against truth, what the selected one says of itself, and the estimated mass."""
    rows = []
    selected = snapshot["estimator"]
    for index, name in enumerate(snapshot["estimator_names"]):
        if not name:
            continue
        error = snapshot["force_errors_rms_n"][index]
        value = f"{error:.2f} N" if np.isfinite(error) else UNAVAILABLE
        style = "font-weight:600" if name == selected else f"color:{theme.FAINT}"
        mark = " (feeds the controller)" if name == selected else ""
        rows.append(
            f'<tr style="{style}"><td>{swatch(index)}{html.escape(name.decode())}{mark}</td><td align="right">{value}</td></tr>'
        )
    sigma, scale = snapshot["force_sigma_n"], snapshot["mass_scale_estimated"]
    adapting = ", adapting" if snapshot["mass_adapting"] else ""
    own = [
        ("Reported std. dev.", f"{np.linalg.norm(sigma):.2f} N" if np.isfinite(sigma).all() else "none"),
        ("To be mistrusted", "; ".join(FLAG_WORDS[flag] for flag in estimator_flags(snapshot)) or "no"),
        ("Estimated mass", f"{scale:.2f} of nominal{adapting}" if np.isfinite(scale) else "none"),
    ]
    force = snapshot["force_of_controller_n"]
    if np.isfinite(force).all():
        own.insert(0, ("Of the controller itself", ", ".join(f"{value:.1f}" for value in force) + " N"))
    rows += [f'<tr><td>{what}</td><td align="right">{value}</td></tr>' for what, value in own]
    table = f'<table style="width:100%">{"".join(rows)}</table>'
    return f'<div style="{theme.SMALL_TEXT}" data-forcelens="estimators">Error against truth, rms over 5 s{table}</div>'


class EstimatorsPanel:
    """Selection, errors over time and their legend; build it inside the container that shall hold it."""

    def __init__(self, gui: viser.GuiApi, sink: ConsoleSink) -> None:
        names = sink.available()["estimators"]
        self._history = History(len(names), WINDOW_S, SEND_PERIOD_S / 2.0)
        self._range_n = _RANGES_N[0]
        self._next_send_s = 0.0
        select = gui.add_button_group("Use", names, hint="The estimate of this one feeds the controller.")
        worker = Worker()

        @select.on_click
        async def _(event: viser.GuiEvent) -> None:
            name = select.value
            worker.submit(self, lambda: attempt(lambda: sink.select_estimator(name), event.client))

        series = [uplot.Series(label="age [s]")]
        series += [
            uplot.Series(label=name, stroke=theme.css(theme.ESTIMATORS[index]), width=2.0) for index, name in enumerate(names)
        ]
        self._chart = gui.add_uplot(
            (np.array([-WINDOW_S, 0.0]), *(np.full(2, np.nan) for _ in names)),
            tuple(series),
            title=f"error [N], last {WINDOW_S:.0f} s",
            scales=self._scales(),
            axes=(uplot.Axis(show=False), uplot.Axis(size=40)),
            legend=uplot.Legend(show=False),
            height=220,
            padding=(8, 12, 8, 0),
        )
        self.table = gui.add_html("")

    def _scales(self) -> dict[str, uplot.Scale]:
        return {"x": uplot.Scale(time=False, range=(-WINDOW_S, 0.0)), "y": uplot.Scale(range=(0.0, self._range_n))}

    def update(self, snapshot: np.void) -> None:
        """Take a SNAPSHOT record in and show it when it is due."""
        errors = snapshot["force_errors_rms_n"][: self._history.values.shape[1]]
        if not snapshot["past"]:
            self._history.append(float(snapshot["time_s"]), errors)
        now = time.monotonic()
        if now < self._next_send_s:
            return
        self._next_send_s = now + SEND_PERIOD_S
        range_n = next((r for r in _RANGES_N if r >= self._history.largest()), _RANGES_N[-1])
        if range_n != self._range_n:
            self._range_n = range_n
            self._chart.scales = self._scales()
        self._chart.data = (self._history.age_s, *self._history.values.T)
        self.table.content = estimators_html(snapshot)
