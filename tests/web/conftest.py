"""A snapshot to draw, a sink that remembers, and a Viser server to draw on."""

from collections.abc import Iterator

import numpy as np
import pytest
import viser

from control.command.limits import DEFAULT_COMMAND
from control.joints import NOMINAL_BASE_HEIGHT_M, NOMINAL_POSITION
from sim.runtime.snapshot import SNAPSHOT, command_to_record
from tests.web.recording_sink import RecordingSink


@pytest.fixture
def sink() -> RecordingSink:
    return RecordingSink()


@pytest.fixture
def snapshot() -> np.void:
    """The robot standing in the free scene, with a known force on the hand."""
    record = np.zeros(1, SNAPSHOT)[0]
    for name in ("command", "applied_command"):
        command_to_record(DEFAULT_COMMAND, record[name])
    record["backend"], record["scene"] = b"simulation", b"free"
    record["controller"], record["estimator"] = b"model_based", b"adaptive"
    record["estimator_names"][:2] = [b"gmo_pi", b"adaptive"]
    record["force_errors_rms_n"] = np.nan
    record["force_errors_rms_n"][:2] = [3.25, 0.5]
    record["base_position"] = [0.0, 0.0, NOMINAL_BASE_HEIGHT_M]
    record["base_orientation_wxyz"] = [1.0, 0.0, 0.0, 0.0]
    record["joint_position"] = NOMINAL_POSITION
    record["end_effector_position_in_world"] = DEFAULT_COMMAND.position_m
    record["target_position_in_world"] = DEFAULT_COMMAND.position_m
    record["force_estimated_n"], record["force_true_n"] = [0.0, 0.0, 10.0], [0.0, 0.0, 10.0]
    record["wheel_in_contact"] = True
    record["wheel_force_estimated_n"] = record["wheel_force_true_n"] = [0.0, 0.0, 45.0]
    record["mass_scale_estimated"], record["mass_scale_true"], record["speed"] = np.nan, 1.0, 1.0
    return record


@pytest.fixture(scope="module")
def server() -> Iterator[viser.ViserServer]:
    viser_server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    yield viser_server
    viser_server.stop()
