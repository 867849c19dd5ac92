"""Charts of commanded (as applied), estimated and true force per heading axis, with the estimate's uncertainty as a band."""

import time
from typing import Protocol

import numpy as np
import viser
from viser import uplot

from control.frames import AXES
from web import theme
from web.history import History

WINDOW_S = 10.0
SAMPLE_PERIOD_S = 0.05
SEND_PERIOD_S = 0.15
"""Charts are sent whole, so they go out more rarely than poses."""

_RANGES_N = (10.0, 20.0, 50.0, 100.0, 200.0)
_TRACES = (("true", theme.TRUE, 3.0), ("estimated", theme.ESTIMATED, 1.6), ("commanded", theme.COMMANDED, 1.6))
_UPPER, _LOWER = len(_TRACES) + 1, len(_TRACES) + 2
_NO_SIGMA = "The selected estimator does not state its uncertainty."
_SIGMA = f"Shaded, and a cone at the hand: &plusmn; {theme.SHOWN_SIGMAS:.0f} standard deviations, as the estimator states them."


class Overlay(Protocol):
    """What was estimated otherwise: in another future, or by another estimator."""

    def force_estimated_n(self, time_s: np.ndarray) -> np.ndarray:
        """Force (n, 3) N at times (n,); NaN where there is none."""
        ...


class ForceHistory:
    """The last seconds of the three forces and of the estimate's standard deviation."""

    def __init__(self) -> None:
        self._history = History(12, WINDOW_S, SAMPLE_PERIOD_S)

    def append(self, snapshot: np.void) -> bool:
        """Add a SNAPSHOT record when the next sample is due."""
        command = snapshot["applied_command"]
        commanded = np.where(command["mask"] == 1, command["force_n"], np.nan)
        row = np.concatenate([snapshot["force_true_n"], snapshot["force_estimated_n"], commanded, snapshot["force_sigma_n"]])
        return self._history.append(float(snapshot["time_s"]), row)

    def largest_n(self) -> float:
        """Largest absolute force component in the history, N; zero when there is none."""
        return self._history.largest()

    def series(self, axis: int, overlay: Overlay | None = None) -> tuple[np.ndarray, ...]:
        """Age in s (n,), negative, then (n,) in N of one axis: true, estimated, commanded, upper and lower edge of the band,
        and what was estimated otherwise.

        Where the estimate came without a standard deviation the band has no width.
        """
        true, estimated, commanded, sigma = self._history.values[:, axis::3].T
        half_width = theme.SHOWN_SIGMAS * np.nan_to_num(sigma)
        times = self._history.time_s
        other = np.full(len(times), np.nan) if overlay is None else overlay.force_estimated_n(times)[:, axis]
        return self._history.age_s, true, estimated, commanded, estimated + half_width, estimated - half_width, other


def _scales(range_n: float) -> dict[str, uplot.Scale]:
    # A fixed y range: uPlot's own would trip over the NaN of traces that are not available.
    return {"x": uplot.Scale(time=False, range=(-WINDOW_S, 0.0)), "y": uplot.Scale(range=(-range_n, range_n))}


class ForceCharts:
    """Three charts, all with the same range so that axes compare."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._history = ForceHistory()
        self._next_send_s = 0.0
        self._pending = False
        self._range_n = _RANGES_N[0]
        self._charts = [self._add_chart(gui, axis) for axis in range(3)]
        self._has_sigma: bool | None = None
        self.note = gui.add_html("")

    def _add_chart(self, gui: viser.GuiApi, axis: int) -> viser.GuiUplotHandle:
        series = [uplot.Series(label="age [s]")]
        series += [uplot.Series(label=name, stroke=theme.css(color), width=width) for name, color, width in _TRACES]
        series += [uplot.Series(label=name, width=0.0) for name in ("upper", "lower")]
        series += [uplot.Series(label="estimated otherwise", stroke=theme.css(theme.ESTIMATED), width=1.2, dash=(5, 4))]
        empty = np.array([-WINDOW_S, 0.0]), *(np.full(2, np.nan) for _ in series[1:])
        return gui.add_uplot(
            empty,
            tuple(series),
            title=f"f{AXES[axis]} [N], last {WINDOW_S:.0f} s",
            bands=(uplot.Band(series=(_UPPER, _LOWER), fill=theme.css(theme.ESTIMATED) + "55"),),
            scales=_scales(self._range_n),
            axes=(uplot.Axis(show=False), uplot.Axis(size=40)),
            legend=uplot.Legend(show=False),
            height=138,
            padding=(8, 12, 8, 0),
        )

    def update(self, snapshot: np.void, overlay: Overlay | None = None) -> None:
        """Take a SNAPSHOT record in and, with what was estimated otherwise beside it, send the charts when they are due."""
        if snapshot["past"]:
            return
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
            chart.data = self._history.series(axis, overlay)
        self._range_n = range_n
        has_sigma = bool(np.isfinite(snapshot["force_sigma_n"]).all())
        if has_sigma != self._has_sigma:
            self._has_sigma = has_sigma
            self.note.content = f'<div style="{theme.SMALL_TEXT}">{_SIGMA if has_sigma else _NO_SIGMA}</div>'
