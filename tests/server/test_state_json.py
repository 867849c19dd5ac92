"""Snapshot to JSON: what is not available is null, never NaN and never zero."""

import json

import numpy as np
import pytest

from control.faults import Fault
from server.state import SECTIONS, encode, estimator_errors, state_json
from sim.runtime.snapshot import SNAPSHOT, Mode


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


def test_faults_are_named(on_hardware: np.void) -> None:
    assert set(state_json(on_hardware)["faults"]) == {"TILT", "STALE_SETPOINT"}


@pytest.mark.parametrize("mode", list(Mode))
def test_modes_are_named(on_hardware: np.void, mode: Mode) -> None:
    on_hardware["mode"] = mode
    assert state_json(on_hardware)["mode"] == mode.name.lower()


def test_a_dead_process_is_a_fault_whatever_its_last_snapshot_says(on_hardware: np.void) -> None:
    on_hardware["loop_rate_hz"] = 500.0
    state = state_json(on_hardware, alive=False)
    assert state["mode"] == "fault"
    assert state["faults"][-1] == "CONTROL_PROCESS_DEAD"
    assert state["loop"]["rate_hz"] == 0.0


def test_whatever_is_not_finite_is_no_json(on_hardware: np.void) -> None:
    on_hardware["joint_velocity"] = np.nan
    on_hardware["real_time_factor"] = np.inf
    text = encode(state_json(on_hardware)).decode()
    assert "NaN" not in text and "Infinity" not in text
    assert set(json.loads(text)) == set(SECTIONS)
