"""The charts' history."""

import numpy as np
import pytest
import viser

from control.timing import TICK_S
from web.charts import SAMPLE_PERIOD_S, WINDOW_S, ForceCharts, ForceHistory
from web.theme import SHOWN_SIGMAS


@pytest.fixture
def history() -> ForceHistory:
    return ForceHistory()


def feed(history: ForceHistory, snapshot: np.void, times: np.ndarray) -> int:
    taken = 0
    for now in times:
        snapshot["time_s"] = now
        snapshot["force_true_n"] = [np.sin(now), 0.0, 5.0]
        taken += history.append(snapshot)
    return taken


def test_it_spans_the_window_and_ends_now(history: ForceHistory, snapshot: np.void) -> None:
    feed(history, snapshot, np.arange(0.0, 30.0, SAMPLE_PERIOD_S))
    age, true, *_ = history.series(0)
    assert age[-1] == 0.0
    assert WINDOW_S <= -age[0] <= 1.5 * WINDOW_S
    assert (np.diff(age) > 0.0).all()
    np.testing.assert_allclose(true, np.sin(snapshot["time_s"] + age))


def test_it_samples_no_faster_than_its_period(history: ForceHistory, snapshot: np.void) -> None:
    taken = feed(history, snapshot, np.arange(0.0, 2.0, TICK_S))
    assert taken <= 2.0 / SAMPLE_PERIOD_S + 1


def test_time_that_stands_still_adds_nothing(history: ForceHistory, snapshot: np.void) -> None:
    assert feed(history, snapshot, np.full(5, 1.0)) == 1


@pytest.mark.parametrize("jump", [0.0, 100.0])
def test_a_reset_or_a_long_gap_starts_afresh(history: ForceHistory, snapshot: np.void, jump: float) -> None:
    feed(history, snapshot, np.arange(5.0, 10.0, 0.05))
    feed(history, snapshot, np.array([jump]))
    age, true, *_ = history.series(0)
    assert np.isfinite(true).sum() == 1
    assert np.isfinite(age).all()


def test_the_commanded_trace_exists_on_force_axes_only(history: ForceHistory, snapshot: np.void) -> None:
    snapshot["applied_command"]["mask"] = [0, 0, 1]
    snapshot["applied_command"]["force_n"] = [3.0, 0.0, -20.0]
    history.append(snapshot)
    assert np.isnan(history.series(0)[3]).all()
    assert history.series(2)[3][-1] == -20.0
    assert history.largest_n() == 20.0


def test_an_empty_history_has_no_force(history: ForceHistory) -> None:
    assert history.largest_n() == 0.0


def test_the_band_spans_what_the_estimator_states_and_nothing_where_it_states_nothing(
    history: ForceHistory, snapshot: np.void
) -> None:
    snapshot["force_estimated_n"] = [1.0, 2.0, 10.0]
    for now, sigma in ((0.0, 0.5), (0.1, np.nan)):
        snapshot["time_s"], snapshot["force_sigma_n"] = now, [9.0, 9.0, sigma]
        history.append(snapshot)
    *_, upper, lower, _ = history.series(2)
    np.testing.assert_allclose(upper[-2:], [10.0 + SHOWN_SIGMAS * 0.5, 10.0])
    np.testing.assert_allclose(lower[-2:], [10.0 - SHOWN_SIGMAS * 0.5, 10.0])


def test_the_charts_say_whether_there_is_an_uncertainty(server: viser.ViserServer, snapshot: np.void) -> None:
    charts = ForceCharts(server.gui)
    snapshot["force_sigma_n"] = np.nan
    charts.update(snapshot)
    assert "does not state" in charts.note.content
