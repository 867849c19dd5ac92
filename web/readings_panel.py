"""Chart of what can be read off the scene, such as the angle of a valve, and sliders of what of the scene can be changed."""

import time

import numpy as np
import viser
from viser import uplot

from sim.runtime.snapshot import MAX_READINGS, named
from sim.scenes import SCENE_NAMES, parameters
from web import theme
from web.history import History
from web.sink import ConsoleSink
from web.widget_binding import Binding, Worker

WINDOW_S, SAMPLE_PERIOD_S, SEND_PERIOD_S = 30.0, 0.1, 0.3
_NOTHING = "There is nothing to read in this scene."


class ReadingsPanel:
    """One chart per reading, and one slider per parameter; built anew when another scene is loaded."""

    def __init__(self, server: viser.ViserServer, sink: ConsoleSink) -> None:
        self._gui, self._sink = server.gui, sink
        self._worker = Worker()
        self._scene = ""
        self._history = History(MAX_READINGS, WINDOW_S, SAMPLE_PERIOD_S)
        self._next_send_s = 0.0
        self._folder = self._gui.add_folder("Scene")
        self.note = self._gui.add_html(f'<div style="{theme.SMALL_TEXT}">{_NOTHING}</div>')
        self.charts: dict[str, viser.GuiUplotHandle] = {}
        self.sliders: dict[str, viser.GuiSliderHandle[float]] = {}
        self._bindings: list[Binding] = []

    def update(self, snapshot: np.void) -> None:
        """Show the readings and the parameters of a SNAPSHOT record."""
        readings = named(snapshot, "reading")
        scene = snapshot["scene"].decode()
        if scene != self._scene:
            self._rebuild(scene, list(readings))
        for binding in self._bindings:
            binding.sync(snapshot)
        row = np.full(MAX_READINGS, np.nan)
        row[: len(readings)] = list(readings.values())
        if not self._history.append(float(snapshot["time_s"]), row) or time.monotonic() < self._next_send_s:
            return
        self._next_send_s = time.monotonic() + SEND_PERIOD_S
        for index, (name, chart) in enumerate(self.charts.items()):
            values = self._history.values[:, index]
            finite = values[np.isfinite(values)]
            low, high = (finite.min(), finite.max()) if len(finite) else (0.0, 0.0)
            margin = max(0.05, 0.1 * (high - low))
            chart.scales = _scales(float(low - margin), float(high + margin))
            chart.data = (self._history.age_s, values)
            words, _, unit = name.rpartition("_")
            chart.title = f"{words.replace('_', ' ')} [{unit}]: {readings.get(name, np.nan):.3f}"

    def _rebuild(self, scene: str, names: list[str]) -> None:
        for widget in (*self.charts.values(), *self.sliders.values()):
            widget.remove()
        self._scene, self.charts, self.sliders, self._bindings = scene, {}, {}, []
        self._history = History(MAX_READINGS, WINDOW_S, SAMPLE_PERIOD_S)
        self.note.visible = not names
        with self._folder:
            for name in names:
                self.charts[name] = self._gui.add_uplot(
                    (np.array([-WINDOW_S, 0.0]), np.full(2, np.nan)),
                    (uplot.Series(label="age [s]"), uplot.Series(label=name, stroke=theme.css(theme.ESTIMATED), width=1.6)),
                    title=name,
                    scales=_scales(0.0, 1.0),
                    axes=(uplot.Axis(show=False), uplot.Axis(size=48)),
                    legend=uplot.Legend(show=False),
                    height=138,
                )
            for parameter in parameters(scene) if scene in SCENE_NAMES else ():
                slider = self._gui.add_slider(
                    parameter.name.replace("_", " "), parameter.minimum, parameter.maximum, 0.001, parameter.default
                )
                self.sliders[parameter.name] = slider
                self._bindings.append(
                    Binding(
                        slider,
                        lambda snapshot, name=parameter.name: named(snapshot, "parameter").get(name, np.nan),
                        lambda value, name=parameter.name: self._sink.set_parameters({name: value}),
                        self._worker,
                    )
                )


def _scales(low: float, high: float) -> dict[str, uplot.Scale]:
    return {"x": uplot.Scale(time=False, range=(-WINDOW_S, 0.0)), "y": uplot.Scale(range=(low, high))}
