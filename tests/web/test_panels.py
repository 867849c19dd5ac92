"""What the panels say and send."""

from types import SimpleNamespace

import numpy as np
import pytest
import viser

from control.faults import Fault
from sim.backends.simulation.mismatch import Mismatch
from sim.runtime.fault_words import FAULT_WORDS
from sim.runtime.snapshot import Mode
from tests.web.recording_sink import RecordingSink
from web.alert import alert_text
from web.command_panel import CommandPanel, reachable
from web.setup_panel import SetupPanel


@pytest.fixture
def panel(server: viser.ViserServer, sink: RecordingSink) -> CommandPanel:
    return CommandPanel(server, sink)


def test_each_axis_shows_only_the_target_of_its_mode(panel: CommandPanel, snapshot: np.void) -> None:
    snapshot["command"]["mask"] = [0, 1, 0]
    panel.update(snapshot)
    assert [force.visible for force in panel.forces] == [False, True, False]
    assert [position.visible for position in panel.positions] == [True, False, True]


def test_the_sliders_span_exactly_the_limits(panel: CommandPanel, sink: RecordingSink) -> None:
    limits = sink.limits
    boxes = (limits.position_x_m, limits.position_y_m, limits.position_z_m)
    assert [(slider.min, slider.max) for slider in panel.positions] == list(boxes)
    assert [(slider.min, slider.max) for slider in panel.forces] == [limits.force_n] * 3


def test_the_widgets_show_the_command_as_asked(panel: CommandPanel, snapshot: np.void) -> None:
    snapshot["command"]["force_n"] = [1.0, -2.0, 20.0]
    snapshot["command"]["position_m"] = [0.5, 0.1, 0.7]
    panel.update(snapshot)
    assert [slider.value for slider in panel.forces] == [1.0, -2.0, 20.0]
    assert [slider.value for slider in panel.positions] == [0.5, 0.1, 0.7]


def test_targets_out_of_reach_become_the_nearest_reachable(sink: RecordingSink) -> None:
    limits = sink.limits
    inside = [0.5, 0.1, 0.6]
    np.testing.assert_allclose(reachable(inside, limits), inside)
    corner = reachable([0.8, 0.35, 0.95], limits)
    assert np.linalg.norm(corner - limits.shoulder_m) <= limits.reach_m


def test_what_runs_is_shown(server: viser.ViserServer, sink: RecordingSink, snapshot: np.void) -> None:
    setup = SetupPanel(server, sink)
    sink.chosen_mismatch, snapshot["speed"] = Mismatch(mass_scale=1.2, payload_kg=0.75), 0.5
    setup.update(snapshot)
    assert (setup.mass.value, setup.payload.value, setup.speed.value) == (1.2, 0.75, 0.5)


def test_what_only_a_simulation_has_is_hidden_on_hardware(
    server: viser.ViserServer, sink: RecordingSink, snapshot: np.void
) -> None:
    setup = SetupPanel(server, sink)
    snapshot["backend"], snapshot["scene"], snapshot["mass_scale_true"] = b"hardware", b"robot", np.nan
    setup.update(snapshot)
    assert not setup.mass.visible and not setup.speed.visible
    snapshot["backend"], snapshot["scene"], snapshot["mass_scale_true"] = b"simulation", b"free", 1.1
    sink.chosen_mismatch = Mismatch(mass_scale=1.1)
    setup.update(snapshot)
    assert setup.mass.visible and setup.mass.value == 1.1


def test_everybody_is_told_of_another_scene_because_it_resets_the_command(
    server: viser.ViserServer, sink: RecordingSink, snapshot: np.void, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[str] = []
    client = SimpleNamespace(add_notification=lambda title, body, **_: told.append(f"{title}: {body}"))
    monkeypatch.setattr(server, "get_clients", lambda: {0: client, 1: client})
    setup = SetupPanel(server, sink)
    setup.update(snapshot)
    setup.update(snapshot)
    assert told == []
    snapshot["scene"] = b"box"
    setup.update(snapshot)
    setup.update(snapshot)
    assert len(told) == 2
    assert "Scene box" in told[0] and "command at its default" in told[0]
    for backend, scene in ((b"hardware", b"robot"), (b"simulation", b"free")):
        snapshot["backend"], snapshot["scene"] = backend, scene
        setup.update(snapshot)
    assert len(told) == 2  # another robot, not another scene


@pytest.mark.parametrize(
    ("mode", "faults", "words"),
    [
        (Mode.ESTOP, Fault.NONE, "E-stop is latched"),
        (Mode.FAULT, Fault.TILT | Fault.STALE_TARGETS, f"({FAULT_WORDS[Fault.TILT]}; {FAULT_WORDS[Fault.STALE_TARGETS]})"),
    ],
)
def test_an_alert_names_its_reason(snapshot: np.void, mode: Mode, faults: Fault, words: str) -> None:
    snapshot["mode"], snapshot["faults"] = mode, int(faults)
    alert = alert_text(snapshot)
    assert alert is not None
    assert words in alert[0]


def test_the_words_of_every_fault_reach_the_alert(snapshot: np.void) -> None:
    snapshot["mode"] = Mode.FAULT
    for fault in Fault:
        snapshot["faults"] = int(fault)
        alert = alert_text(snapshot)
        assert alert is not None
        assert FAULT_WORDS[fault] in alert[0]


def test_a_failed_backend_is_an_alert_with_its_cure(snapshot: np.void) -> None:
    snapshot["mode"], snapshot["failure"] = Mode.FAULT, b"the simulation diverged; reset it"
    alert = alert_text(snapshot)
    assert alert is not None and "reset it" in alert[0]


@pytest.mark.parametrize("mode", [Mode.RUNNING, Mode.PAUSED])
def test_there_is_no_alert_when_all_is_well(snapshot: np.void, mode: Mode) -> None:
    snapshot["mode"] = mode
    assert alert_text(snapshot) is None


def test_a_dead_control_process_is_an_alert() -> None:
    alert = alert_text(None)
    assert alert is not None
    assert "does not answer" in alert[0]
