"""Snapshot to JSON: what is not available is null, never NaN and never zero."""

import json

import numpy as np
import pytest

from control.faults import Fault
from server.answers.state import StateAnswer
from server.silence import Silence
from server.state import SECTIONS, encode, estimator_errors, state_json
from sim.backends.hardware.states import TRIP_TEXT, Trip
from sim.runtime.fault_words import CONTROL_PROCESS_DEAD, CONTROL_PROCESS_SILENT, FAULT_WORDS, SILENCE_WORDS
from sim.runtime.snapshot import SNAPSHOT, Mode
from tests.server.contract import check_fit


@pytest.fixture
def on_hardware() -> np.void:
    """A snapshot without truth."""
    record = np.zeros(1, SNAPSHOT)[0]
    record["mode"] = Mode.RUNNING
    record["faults"] = Fault.TILT | Fault.STALE_SETPOINT
    record["estimator_names"][:2] = ("gmo_pi", "gmo_cqp")
    record["force_estimates_n"][1] = np.nan
    record["force_errors_rms_n"][:] = np.nan
    for name in ("force_true_n", "force_sigma_n", "wheel_force_true_n", "mass_scale_true", "mass_scale_estimated"):
        record[name] = np.nan
    return record


def test_missing_truth_is_null(on_hardware: np.void) -> None:
    state = json.loads(encode(state_json(on_hardware)))
    assert state["end_effector"]["force_true_n"] is None
    assert state["end_effector"]["force_sigma_n"] is None
    assert state["mass_scale_true"] is None
    assert all(contact["force_true_n"] is None for contact in state["contacts"])
    assert state["end_effector"]["force_estimated_n"] == [0.0, 0.0, 0.0]


def test_a_stated_uncertainty_is_given_per_axis(on_hardware: np.void) -> None:
    on_hardware["force_sigma_n"] = [0.1, 0.2, 0.3]
    assert state_json(on_hardware)["end_effector"]["force_sigma_n"] == [0.1, 0.2, 0.3]


def test_estimators_that_do_not_run_are_null_and_unused_slots_are_absent(on_hardware: np.void) -> None:
    assert state_json(on_hardware)["end_effector"]["force_estimates_n"] == {"gmo_pi": [0.0, 0.0, 0.0], "gmo_cqp": None}
    assert estimator_errors(on_hardware) == {"gmo_pi": None, "gmo_cqp": None}


def test_faults_are_named_and_come_with_words(on_hardware: np.void) -> None:
    state = state_json(on_hardware)
    assert state["faults"] == ["TILT", "STALE_SETPOINT"] == list(state["fault_words"])
    for fault in Fault:
        on_hardware["faults"] = int(fault)
        assert state_json(on_hardware)["fault_words"] == {fault.name: FAULT_WORDS[fault]}


def test_every_fault_of_the_drives_comes_with_words(on_hardware: np.void) -> None:
    on_hardware["backend"], on_hardware["mode"], on_hardware["faults"] = b"hardware", Mode.FAULT, 0
    assert set(TRIP_TEXT) == set(Trip)
    for trip in Trip:
        on_hardware["drive_faults"] = int(trip)
        state = state_json(on_hardware)
        assert state["drive"]["faults"] == [TRIP_TEXT[trip]]
        assert state["message"] == f"Fault: motors are damping only ({TRIP_TEXT[trip]})."


def test_a_fault_names_its_culprit(on_hardware: np.void) -> None:
    on_hardware["mode"], on_hardware["faults"] = Mode.FAULT, int(Fault.CONTROLLER_ERROR | Fault.ESTIMATOR_ERROR)
    on_hardware["controller_error"], on_hardware["estimator_error"] = b"mine, KeyError: 'gain'", "tcn, ü".encode()[:-1]
    state = state_json(on_hardware)
    assert state["fault_words"]["CONTROLLER_ERROR"].endswith("mine, KeyError: 'gain'")
    assert "tcn, " in state["fault_words"]["ESTIMATOR_ERROR"]
    assert "mine, KeyError: 'gain'" in state["message"]


def test_what_ended_the_backend_is_a_fault(on_hardware: np.void) -> None:
    on_hardware["mode"], on_hardware["faults"], on_hardware["failure"] = Mode.FAULT, 0, b"the simulation diverged"
    state = state_json(on_hardware)
    assert state["faults"] == ["BACKEND_FAILED"]
    assert state["message"] == "Stopped: the simulation diverged."
    assert "the simulation diverged" in state["fault_words"]["BACKEND_FAILED"]


@pytest.mark.parametrize(("share", "named"), [(0.0, False), (0.04, False), (0.09, True)])
def test_a_loop_that_does_not_keep_its_rate_is_a_fault(on_hardware: np.void, share: float, named: bool) -> None:
    on_hardware["overrun_share"] = share
    assert ("LOOP_OVERRUNS" in state_json(on_hardware)["faults"]) is named
    assert ("LOOP_OVERRUNS" in state_json(on_hardware)["fault_words"]) is named
    assert state_json(on_hardware)["loop"]["overrun_share"] == share


@pytest.mark.parametrize("mode", list(Mode))
def test_modes_are_named(on_hardware: np.void, mode: Mode) -> None:
    on_hardware["mode"] = mode
    assert state_json(on_hardware)["mode"] == mode.name.lower()
    check_fit(StateAnswer, encode(state_json(on_hardware)).decode())


@pytest.mark.parametrize("fault", [CONTROL_PROCESS_DEAD, CONTROL_PROCESS_SILENT])
def test_a_process_that_is_dead_or_hangs_is_a_fault_whatever_its_last_snapshot_says(on_hardware: np.void, fault: str) -> None:
    on_hardware["loop_rate_hz"] = 500.0
    state = state_json(on_hardware, silence=Silence(2.5, fault))
    assert state["mode"] == "fault"
    assert state["stale_s"] == 2.5
    assert state["faults"][-1] == fault
    assert state["fault_words"][fault] == state["message"] == SILENCE_WORDS[fault]
    assert state["loop"]["rate_hz"] == 0.0


@pytest.mark.parametrize("unknown", [np.nan, np.inf])
def test_whatever_cannot_be_measured_or_estimated_is_null_by_the_schema(on_hardware: np.void, unknown: float) -> None:
    signals = ("base_", "joint_", "end_effector_", "force_", "wheel_force_", "mass_scale_")
    for name in SNAPSHOT.names or ():
        if name.startswith(signals):
            on_hardware[name] = unknown
    on_hardware["backend"] = "hardware"
    check_fit(StateAnswer, encode(state_json(on_hardware)).decode())


def test_whatever_is_not_finite_is_no_json(on_hardware: np.void) -> None:
    on_hardware["joint_velocity"] = np.nan
    on_hardware["real_time_factor"] = np.inf
    text = encode(state_json(on_hardware)).decode()
    assert "NaN" not in text and "Infinity" not in text
    assert set(json.loads(text)) == set(SECTIONS)
