"""The estimators side by side."""

import numpy as np
import viser

from sim.runtime.snapshot import MAX_ESTIMATORS
from tests.web.recording_sink import RecordingSink
from web import theme
from web.estimators_panel import UNAVAILABLE, EstimatorsPanel, estimators_html, legend_html


def test_each_is_compared_with_the_truth_and_the_selected_one_is_marked(snapshot: np.void) -> None:
    text = estimators_html(snapshot)
    assert "gmo_pi<" in text
    assert "3.25 N" in text
    assert "adaptive (feeds the controller)" in text


def test_without_truth_an_error_is_unavailable(snapshot: np.void) -> None:
    snapshot["force_errors_rms_n"] = np.nan
    text = estimators_html(snapshot)
    assert text.count(UNAVAILABLE) == 2
    assert "nan" not in text


def test_what_the_selected_one_states_is_shown_or_said_to_be_missing(snapshot: np.void) -> None:
    snapshot["force_sigma_n"] = np.nan
    assert "none" in estimators_html(snapshot)
    snapshot["force_sigma_n"], snapshot["mass_scale_estimated"] = [0.3, 0.4, 1.2], 1.17
    text = estimators_html(snapshot)
    assert "1.30 N" in text
    assert "1.17 of nominal<" in text
    snapshot["mass_adapting"] = True
    assert "1.17 of nominal, adapting" in estimators_html(snapshot)


def test_the_table_follows_the_snapshot(server: viser.ViserServer, sink: RecordingSink, snapshot: np.void) -> None:
    panel = EstimatorsPanel(server.gui, sink)
    snapshot["estimator"] = b"gmo_pi"
    panel.update(snapshot)
    assert "gmo_pi (feeds the controller)" in panel.table.content
    assert sink.calls == []


def test_every_estimator_has_a_colour_of_its_own() -> None:
    colors = {*theme.ESTIMATORS, theme.ESTIMATED, theme.COMMANDED, theme.TRUE}
    assert len(theme.ESTIMATORS) == MAX_ESTIMATORS
    assert len(colors) == MAX_ESTIMATORS + 3
    assert theme.css(theme.ESTIMATORS[1]) in legend_html(["a", "b"])
