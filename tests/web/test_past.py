"""Looking back at a simulation, and what is drawn of the future that it had."""

import numpy as np
import pytest
import viser

from tests.web.recording_sink import RecordingSink
from web.again_panel import AgainPanel
from web.charts import ForceHistory
from web.ghost import Ghost
from web.history_panel import HistoryPanel
from web.other_future import OtherFuture
from web.record_panel import RecordPanel
from web.replay_panel import ReplayPanel


def at(snapshot: np.void, time_s: float, *, branch: int = 0, past: bool = False, force_n: float = 0.0) -> np.void:
    snapshot["time_s"], snapshot["branch"], snapshot["past"] = time_s, branch, past
    snapshot["history_start_s"], snapshot["history_end_s"] = 1.0, 11.0
    snapshot["force_estimated_n"] = force_n
    return snapshot


@pytest.fixture
def parted(snapshot: np.void) -> OtherFuture:
    """Ran to 10 s, was set back to 5 s, and went on otherwise to 6 s."""
    future = OtherFuture()
    for tick in range(100):
        future.update(at(snapshot, 0.1 * tick, force_n=1.0))
    for tick in range(10):
        future.update(at(snapshot, 5.0 + 0.1 * tick, branch=1, force_n=2.0))
    return future


def test_what_lay_ahead_when_it_was_set_back_is_the_other_future(parted: OtherFuture) -> None:
    seen = parted.at(6.04)
    assert seen is not None
    assert (seen.time_s, seen.force_estimated_n[0]) == (pytest.approx(6.0), 1.0)
    assert parted.at(4.9) is None
    assert parted.at(10.0) is None
    forces = parted.force_estimated_n(np.array([4.0, 6.0, 12.0]))[:, 0]
    np.testing.assert_array_equal(forces, [np.nan, 1.0, np.nan])


def test_looking_back_parts_no_future_and_a_reset_forgets_it(parted: OtherFuture, snapshot: np.void) -> None:
    parted.update(at(snapshot, 3.0, branch=1, past=True))
    assert parted.at(6.0) is not None
    parted.update(at(snapshot, 0.0, branch=1))
    assert parted.samples == []


def test_the_ghost_stands_where_the_robot_was(server: viser.ViserServer, parted: OtherFuture) -> None:
    ghost = Ghost(server)
    ghost.update(4.0, parted)
    assert not ghost.visible
    ghost.update(6.0, parted)
    assert ghost.visible
    ghost.update(4.0, parted)
    assert not ghost.visible


def test_a_step_back_pauses_and_shows_an_earlier_moment(
    server: viser.ViserServer, sink: RecordingSink, snapshot: np.void
) -> None:
    panel = HistoryPanel(server, sink)
    panel.update(at(snapshot, 11.0))
    panel.step_back()
    assert sink.calls == [("set_run", ("paused", None)), ("seek", pytest.approx(10.9))]
    panel.update(at(snapshot, 1.05, past=True))
    assert "The past" in panel.note.content
    sink.calls.clear()
    snapshot["mode"] = 1
    panel.update(snapshot)
    panel.step_back()
    assert sink.calls == [("seek", 1.0)]


def test_it_goes_on_with_what_is_chosen(server: viser.ViserServer, sink: RecordingSink, snapshot: np.void) -> None:
    panel = HistoryPanel(server, sink)
    panel.update(at(snapshot, 5.0, past=True))
    panel.estimator.value, panel.mass.value = "gmo_pi", "1.2"
    panel.go_on()
    assert sink.calls[1:] == [("branch", {"estimator": "gmo_pi", "mass_scale": 1.2}), ("set_run", ("running", None))]


def test_without_a_history_it_says_why(server: viser.ViserServer, sink: RecordingSink, snapshot: np.void) -> None:
    snapshot["history_end_s"] = np.nan
    panel = HistoryPanel(server, sink)
    panel.update(snapshot)
    assert not panel.back.visible
    assert "cannot be set back" in panel.note.content


def test_a_recording_under_way_is_told_and_can_be_ended(
    server: viser.ViserServer, sink: RecordingSink, snapshot: np.void
) -> None:
    panel = RecordPanel(server.gui, sink)
    panel.update(snapshot)
    assert (panel.start.visible, panel.stop.visible) == (True, False)
    snapshot["recording"], snapshot["recording_s"], snapshot["recording_bytes"] = b"one", 61.0, 12_340_000
    panel.update(snapshot)
    assert (panel.start.visible, panel.stop.visible) == (False, True)
    assert "61 s, 12.3 MB" in panel.note.content


def test_a_recording_that_is_shown_says_so(server: viser.ViserServer, sink: RecordingSink, snapshot: np.void) -> None:
    panel = ReplayPanel(server.gui, sink)
    panel.refresh()
    assert panel.recordings.options == ("20261128-b", "20261128-a")
    panel.show()
    assert sink.calls[-1] == ("set_backend", ("replay", {"recording": "20261128-b"}))
    panel.update(snapshot)
    assert not panel.time.visible
    snapshot["backend"] = b"replay"
    panel.update(snapshot)
    assert panel.time.visible
    assert "Nothing is sent to any robot" in panel.note.content


def test_what_an_estimator_says_again_goes_into_the_charts_of_the_recording_that_it_ran_over(
    server: viser.ViserServer, sink: RecordingSink, snapshot: np.void
) -> None:
    panel = AgainPanel(server.gui, sink)
    panel.update()
    assert not panel.folder.visible
    sink.estimates.shown = "20261128-b"
    panel.update()
    assert panel.folder.visible
    panel.estimator.value, panel.gains.value = "adaptive", (12.0, 80.0)
    panel.run()
    assert sink.calls[-1] == ("again", ("adaptive", (12.0, 80.0)))
    assert "12, 80: 1.50 N rms from what was estimated then; 0.50 N from the truth, then 2.00 N" in panel.note.content
    history = ForceHistory()
    for time_s in (0.5, 1.0, 1.5, 3.0):
        history.append(at(snapshot, time_s))
    other = history.series(0, panel)[-1]
    assert other[-4:-1].tolist() == [25.0, 50.0, 75.0]
    assert np.isnan(other[-1]), "it ends after two seconds"
    sink.estimates.shown = "20261128-a"
    panel.update()
    assert not panel.ready
    assert np.isnan(panel.force_estimated_n(np.array([1.0]))).all()
