"""The hardware panel offers what the drives' state allows, and says plainly what is known of the robot and what is not."""

from dataclasses import replace

import numpy as np
import pytest
import viser

from control.joints import JOINT_NAMES
from sim.backends.hardware.records import IO_STATE
from sim.backends.hardware.states import REQUEST_NAMES, DriveState, Trip
from sim.backends.hardware.status import HardwareStatus, status_from_record
from sim.runtime.snapshot import Mode
from tests.web.recording_sink import RecordingSink
from web.alert import alert_text
from web.hardware_panel import REQUESTS, HardwarePanel, backends_html, status_html


@pytest.fixture
def status() -> HardwareStatus:
    record = np.zeros(1, IO_STATE)[0]
    record["state"], record["temperature"], record["battery_percent"] = DriveState.DAMPED, 41.0, 77
    record["time_s"] = record["base_received_s"] = record["arm_received_s"] = 10.0
    return status_from_record(record, 10.004)


@pytest.fixture
def on_robot(snapshot: np.void) -> np.void:
    snapshot["backend"], snapshot["scene"], snapshot["drive_state"] = b"hardware", b"robot", DriveState.DAMPED
    return snapshot


def offered(panel: HardwarePanel) -> set[str]:
    return {request for request, button in panel.buttons.items() if button.visible}


def test_there_is_a_button_for_every_request_and_motion_is_asked_about() -> None:
    assert tuple(REQUESTS) == REQUEST_NAMES
    assert {request for request, (_, question) in REQUESTS.items() if question} == {"engage", "stand", "start", "sit", "damp"}


def test_only_what_the_state_allows_is_offered(
    server: viser.ViserServer, sink: RecordingSink, on_robot: np.void, status: HardwareStatus
) -> None:
    panel = HardwarePanel(server, sink)
    for state, wanted in (
        (DriveState.OBSERVE, {"engage"}),
        (DriveState.DAMPED, {"stand", "damp", "release"}),
        (DriveState.READY, {"start", "sit", "damp"}),
        (DriveState.POLICY, {"hold", "sit", "damp"}),
        (DriveState.FAULT, {"clear"}),
    ):
        sink.status = replace(status, state=state)
        panel._next_s = 0.0
        panel.update(on_robot)
        assert offered(panel) == wanted
    on_robot["backend"] = b"simulation"
    panel._next_s = 0.0
    panel.update(on_robot)
    assert offered(panel) == set()


def test_the_link_is_shown_while_the_control_process_is_dead(
    server: viser.ViserServer, sink: RecordingSink, on_robot: np.void, status: HardwareStatus
) -> None:
    panel = HardwarePanel(server, sink)
    panel.update(on_robot)
    assert "I/O process has died" in panel._status.content
    sink.status, panel._next_s = status, 0.0
    panel.update(None)
    assert "of the base 4 ms old" in panel._status.content


def test_the_picker_follows_the_backend_and_keeps_the_wish_for_a_dry_run(
    server: viser.ViserServer, sink: RecordingSink, snapshot: np.void
) -> None:
    panel = HardwarePanel(server, sink)
    assert panel.dry_run.value
    panel._choose("hardware")
    panel._choose("simulation")
    assert sink.calls == [("set_backend", ("hardware", {"dry_run": True})), ("set_backend", ("simulation", {}))]
    panel._set_dry_run(False)
    assert len(sink.calls) == 2  # in simulation it is only a wish
    snapshot["backend"], snapshot["dry_run"] = b"hardware", False
    panel.update(snapshot)
    assert panel.backend.value == "hardware" and not panel.dry_run.value
    panel._set_dry_run(True)
    assert sink.calls[-1] == ("set_backend", ("hardware", {"dry_run": True}))


def test_the_page_says_what_it_was_proved_on(status: HardwareStatus) -> None:
    text = status_html(replace(status, dry_run=True))
    assert "protocol-verified, not robot-verified" in text and "DRY RUN" in text
    assert "DRY RUN" not in status_html(status)
    assert all(f"<td>{joint}</td>" in text for joint in JOINT_NAMES)
    assert "41" in text and "77 %" in text
    unheard = status_html(replace(status, battery_percent=None, battery_v=float("nan")))
    assert "Battery unknown" in unheard


def test_a_hot_motor_and_one_that_counts_no_losses(status: HardwareStatus) -> None:
    motors = (replace(status.motors[0], temperature_c=72.0, lost=3), *status.motors[1:])
    text = status_html(replace(status, motors=motors))
    assert "color:#d55e00" in text.split("FL_hip")[0][-40:]
    assert "–" in text.split(JOINT_NAMES[-1])[1]


def test_a_message_from_the_robot_is_text(status: HardwareStatus) -> None:
    assert "&lt;b&gt;" in status_html(replace(status, message="<b>"))


def test_a_backend_that_cannot_be_used_says_why(sink: RecordingSink) -> None:
    text = backends_html(sink.available()["backends"])
    assert "hardware: not available. no robot &lt;answers&gt;" in text and "simulation" not in text


def test_a_fault_of_the_drives_is_an_alert(on_robot: np.void) -> None:
    on_robot["mode"], on_robot["drive_faults"] = Mode.FAULT, int(Trip.TILT | Trip.STALE_COMMAND)
    alert = alert_text(on_robot)
    assert alert is not None and "the control process is silent; the base is tilted" in alert[0]
    on_robot["drive_faults"] = int(Trip.TORQUE | Trip.TILT)
    on_robot["drive_fault_joints"] = 1 << JOINT_NAMES.index("RL_thigh")
    alert = alert_text(on_robot)
    assert alert is not None and "the base is tilted; a motor is at its torque limit: RL_thigh" in alert[0]
