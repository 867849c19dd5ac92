"""What an object carries, through a file: the same bytes come out, and nothing is run that the file names."""

import io
import json

import numpy as np
import pytest

from control.pipeline import Pipeline, PipelineConfig
from control.state.file import StateFileError, packed_state, unpack_state
from sim.runtime.simulation import Simulation, SimulationConfig
from tests.sim.runtime.test_state_capture import run


def test_a_pipeline_in_motion_goes_into_a_file_and_into_a_fresh_one() -> None:
    session = Simulation(SimulationConfig(seed=4))
    run(session, 0, 163)
    packed = packed_state(session.pipeline)
    fresh = Pipeline(PipelineConfig())
    unpack_state(packed, fresh)
    assert fresh.estimator_name == session.pipeline.estimator_name
    for tick in range(60):
        sensor = session.backend.read()
        original = session.tick(session._command)
        again = fresh.step(sensor, session._command)
        assert again.joint_command.position.tobytes() == original.joint_command.position.tobytes(), tick
        for name, estimate in original.estimates.items():
            assert again.estimates[name].force_estimated_n.tobytes() == estimate.force_estimated_n.tobytes(), (tick, name)
    fresh.select_estimator("gmo_pi", (9.0, 40.0))
    assert fresh.estimators["gmo_cqp"].momentum.gains.k1 == 9.0  # pyright: ignore[reportAttributeAccessIssue]


@pytest.mark.parametrize("named", ["os:system", "control.files:write_whole", "control.pipeline:Nothing"])
def test_a_file_names_nothing_but_our_state(named: str) -> None:
    tree = {"format": 1, "root": {"id": 0, "frozen": named, "fields": {}}}
    file = io.BytesIO()
    np.savez(file, tree=np.frombuffer(json.dumps(tree).encode(), np.uint8))
    with pytest.raises(StateFileError):
        unpack_state(file.getvalue(), object())


def test_another_format_is_refused() -> None:
    file = io.BytesIO()
    np.savez(file, tree=np.frombuffer(b'{"format": 99, "root": null}', np.uint8))
    with pytest.raises(StateFileError, match="format 99"):
        unpack_state(file.getvalue(), object())
