"""What an object carries, through a file: the same bytes come out, and nothing is run that the file names."""

import json
import struct
from typing import Any

import pytest

from control.pipeline import Pipeline, PipelineConfig
from control.state.file import FORMAT, StateFileError, packed_state, unpack_state
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


def packed(tree: dict[str, Any]) -> bytes:
    text = json.dumps(tree).encode()
    return struct.pack("<Q", len(text)) + text


@pytest.mark.parametrize("named", ["os:system", "control.files:write_whole", "control.pipeline:Nothing"])
def test_a_file_names_nothing_but_our_state(named: str) -> None:
    tree = {"format": FORMAT, "nodes": [{"frozen": named, "fields": {}}]}
    with pytest.raises(StateFileError, match=r"no class whose state is kept|has no attribute"):
        unpack_state(packed(tree), object())


def test_another_format_is_refused() -> None:
    with pytest.raises(StateFileError, match="format 99"):
        unpack_state(packed({"format": 99, "nodes": []}), object())
