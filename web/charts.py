"""Live charts of commanded, estimated and true force, one per heading axis."""

import time

import numpy as np
import viser
from viser import uplot

from web import theme

WINDOW_S = 10.0
SAMPLE_PERIOD_S = 0.05
SEND_PERIOD_S = 0.12
"""Charts are sent whole, so they go out more rarely than poses."""

AXES = ("x", "y", "z")
_RANGES_N = (10.0, 20.0, 50.0, 100.0, 200.0)
_SAMPLES = int(WINDOW_S / SAMPLE_PERIOD_S)
_TRACES = (("true", theme.TRUE, 3.0), ("estimated", theme.ESTIMATED, 1.6), ("commanded", theme.COMMANDED, 1.6))


class ForceHistory:
    """The last seconds of the three forces: rows of (time, true xyz, estimated xyz, commanded xyz)."""

    def __init__(self) -> None:
        self._rows = np.full((_SAMPLES, 10), np.nan)

    def append(self, snapshot: np.void) -> bool:
        """Add a SNAPSHOT record when the next sample is due. A jump of the clock starts afresh."""
        now = float(snapshot["time_s"])
        elapsed = now - self._rows[-1, 0]
        if 0.0 <= elapsed < SAMPLE_PERIOD_S:
            return False
        if not 0.0 <= elapsed < WINDOW_S:
            self._rows[:] = np.nan
            self._rows[:, 0] = now - SAMPLE_PERIOD_S * np.arange(_SAMPLES, 0, -1)
        command = snapshot["applied_command"]
        self._rows[:-1] = self._rows[1:]
        self._rows[-1, 0] = now
        self._rows[-1, 1:4] = snapshot["force_true"]
        self._rows[-1, 4:7] = snapshot["force_estimated"]
        self._rows[-1, 7:10] = np.where(command["mask"] == 1, command["force_n"], np.nan)
        return True

    def largest_n(self) -> float:
        """Largest absolute force component in the history, N; zero when there is none."""
        forces = np.abs(self._rows[:, 1:])
        return float(forces[np.isfinite(forces)].max(initial=0.0))

    def series(self, axis: int) -> tuple[np.ndarray, ...]:
        """Age in s (n,), negative, then true, estimated and commanded force (n,) in N of one axis."""
        rows = self._rows
        return rows[:, 0] - rows[-1, 0], rows[:, 1 + axis], rows[:, 4 + axis], rows[:, 7 + axis]


def _scales(range_n: float) -> dict[str, uplot.Scale]:
    # A fixed y range: uPlot's own would trip over the NaN of traces that are not available.
    return {"x": uplot.Scale(time=False, range=(-WINDOW_S, 0.0)), "y": uplot.Scale(range=(-range_n, range_n))}


class ForceCharts:
    """Three charts in a panel of their own, all with the same range so that axes compare."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._history = ForceHistory()
        self._next_send_s = 0.0
        self._pending = False
        self._range_n = _RANGES_N[0]
        panel = server.gui.add_panel()
        with panel.add_tab("Force on the hand", viser.Icon.CHART_LINE):
            self._charts = [self._add_chart(server, axis) for axis in range(3)]
        panel.dock_left()
        panel.set_width(300)

    def _add_chart(self, server: viser.ViserServer, axis: int) -> viser.GuiUplotHandle:
        series = [uplot.Series(label="age [s]")]
        series += [uplot.Series(label=name, stroke=theme.css(color), width=width) for name, color, width in _TRACES]
        empty = np.array([-WINDOW_S, 0.0]), *(np.full(2, np.nan) for _ in _TRACES)
        return server.gui.add_uplot(
            empty,
            tuple(series),
            title=f"f{AXES[axis]} [N], last {WINDOW_S:.0f} s",
            scales=_scales(self._range_n),
            axes=(uplot.Axis(show=False), uplot.Axis(size=40)),
            legend=uplot.Legend(show=False),
            height=138,
            padding=(8, 12, 8, 0),
        )

    def update(self, snapshot: np.void) -> None:
        """Take a SNAPSHOT record in and send the charts when they are due."""
        self._pending |= self._history.append(snapshot)
        now = time.monotonic()
        if not self._pending or now < self._next_send_s:
            return
        self._pending = False
        self._next_send_s = now + SEND_PERIOD_S
        range_n = next((r for r in _RANGES_N if r >= self._history.largest_n()), _RANGES_N[-1])
        for axis, chart in enumerate(self._charts):
            if range_n != self._range_n:
                chart.scales = _scales(range_n)
            chart.data = self._history.series(axis)
        self._range_n = range_n
