"""A controller with a defect on the simulated robot: the robot sinks upright, and stands up under another controller."""

import numpy as np
import pytest

from control.command.limits import DEFAULT_COMMAND
from control.faults import Fault
from control.pipeline import PipelineOutput
from control.timing import TICK_S
from sim.runtime.fault_words import fault_words, message
from sim.runtime.simulation import Simulation, SimulationConfig
from sim.runtime.snapshot import SNAPSHOT, Mode
from tests.misshapen_controller import Misshapen

SOUND_S = 2.5


def run(session: Simulation, seconds: float) -> PipelineOutput:
    for _ in range(round(seconds / TICK_S)):
        session.tick(DEFAULT_COMMAND)
    return session.output


def snapshot(session: Simulation) -> np.void:
    record = np.zeros(1, SNAPSHOT)[0]
    session.fill(record)
    return record


def height_and_tilt(session: Simulation) -> tuple[float, float]:
    truth = session.truth()
    assert truth is not None
    _, x, y, _ = truth.base_orientation_wxyz
    return float(truth.base_position[2]), 2.0 * float(np.hypot(x, y))


def test_the_robot_sinks_upright_and_stands_up_under_another_controller(caplog: pytest.LogCaptureFixture) -> None:
    session = Simulation(SimulationConfig(seed=4))
    pipeline = session.pipeline
    pipeline.add_controller("misshapen", Misshapen(pipeline.controllers["model_based"], SOUND_S))
    session.select_controller("misshapen")
    assert run(session, SOUND_S - 0.1).safety.faults == Fault.NONE
    assert session.mode is Mode.RUNNING

    output = run(session, 0.5)
    assert output.safety.damping and session.mode is Mode.FAULT
    record = snapshot(session)
    words = fault_words(record)["CONTROLLER_ERROR"]
    assert "misshapen, ValueError: operands could not be broadcast together with shapes (22,) (21,)" in words
    assert words in str(message(record))
    assert "in step" in caplog.text and "np.zeros(22 if" in caplog.text  # the line that failed
    run(session, 2.0)
    height_m, tilt_rad = height_and_tilt(session)
    assert height_m > 0.08 and tilt_rad < 0.3
    assert len(caplog.records) == 1

    session.select_controller("policy")
    output = run(session, 4.0)
    height_m, tilt_rad = height_and_tilt(session)
    assert session.mode is Mode.RUNNING and output.safety.faults == Fault.NONE
    assert height_m > 0.32 and tilt_rad < 0.1
    record = snapshot(session)
    assert fault_words(record) == {} and message(record) is None


def test_a_snapshot_of_an_estimator_that_has_never_estimated_says_that_there_is_no_force() -> None:
    session = Simulation(SimulationConfig(seed=4))

    def fail() -> None:
        raise ArithmeticError("größer als π\nsecond line")

    session.pipeline.estimators["hybrid"].estimate = fail  # pyright: ignore[reportAttributeAccessIssue]
    run(session, 0.1)
    record = snapshot(session)
    assert np.isnan(record["force_estimated_n"]).all()
    assert "hybrid, ArithmeticError: größer als π" in fault_words(record)["ESTIMATOR_ERROR"]
    assert record["mode"] == Mode.FAULT
