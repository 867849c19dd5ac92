"""A controller or an estimator that raises: contained, named, logged once, and answered by the safety gate."""

import logging
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from control.command.limits import DEFAULT_COMMAND
from control.estimation.registry import EstimatorsConfig
from control.failures import RECOVERED_AFTER_S, FailureError
from control.faults import Fault
from control.joints import DAMPING, JOINT_COUNT, NOMINAL_POSITION, STIFFNESS
from control.pipeline import Pipeline, PipelineConfig, PipelineOutput
from control.safety import SafetyConfig
from control.timing import TICK_S
from control.types import ForceEstimate, SensorFrame
from control.whole_body.controller import ControllerInput

SAFETY = SafetyConfig()


class Stand:
    """A pipeline in front of a robot that stands still, one tick at a time."""

    def __init__(self) -> None:
        estimators = EstimatorsConfig(weights=None)
        self.pipeline = Pipeline(
            PipelineConfig(controller="model_based", estimator="adaptive", policies=None, estimators=estimators)
        )
        self.time_s = 0.0

    def run(self, seconds: float = TICK_S) -> PipelineOutput:
        """The output of the last tick."""
        return [self._tick() for _ in range(round(seconds / TICK_S))][-1]

    def _tick(self) -> PipelineOutput:
        zero, attitude, gravity = np.zeros(JOINT_COUNT), np.array([1.0, 0.0, 0.0, 0.0]), np.array([0.0, 0.0, 9.81])
        sensor = SensorFrame(self.time_s, attitude, np.zeros(3), gravity, NOMINAL_POSITION, zero, zero)
        self.time_s += TICK_S
        return self.pipeline.step(sensor, DEFAULT_COMMAND)

    def use(self, step: Callable[[ControllerInput], Any], name: str = "mine") -> None:
        """Select a controller of one's own."""
        self.pipeline.add_controller(name, Own(step))
        self.pipeline.select_controller(name)


class Own:
    """A contributor's controller."""

    def __init__(self, compute: Callable[[ControllerInput], Any]) -> None:
        self._compute = compute

    def reset(self) -> None:
        """Nothing is kept."""

    def step(self, inputs: ControllerInput) -> Any:
        return self._compute(inputs)


@pytest.fixture
def stand() -> Stand:
    stand = Stand()
    stand.run(0.5)
    return stand


def hold(_: ControllerInput) -> np.ndarray:
    return NOMINAL_POSITION.copy()


def misshapen(inputs: ControllerInput) -> np.ndarray:
    return inputs.sensor.joint_position + np.zeros(21)


def singular(_: ControllerInput) -> np.ndarray:
    return np.linalg.solve(np.zeros((22, 22)), np.ones(22))


def undefined(_: ControllerInput) -> np.ndarray:
    return {}["gain"]


def too_few(_: ControllerInput) -> np.ndarray:
    return np.zeros(21)


def forgotten(_: ControllerInput) -> None:
    """No return statement."""


def as_list(_: ControllerInput) -> list[float]:
    return [0.0] * JOINT_COUNT


@pytest.mark.parametrize("defect", [misshapen, singular, undefined, too_few, forgotten, as_list])
def test_a_controller_that_fails_is_named_held_and_damped_and_another_takes_over(
    stand: Stand, caplog: pytest.LogCaptureFixture, defect: Callable[[ControllerInput], Any]
) -> None:
    stand.use(hold)
    before = stand.run(0.5)
    assert before.failures == {} and before.safety.faults == Fault.NONE
    stand.use(defect, "defective")
    output = stand.run(SAFETY.hold_timeout_s)
    assert "defective" in output.failures[Fault.CONTROLLER_ERROR]
    assert Fault.CONTROLLER_ERROR in output.safety.faults
    np.testing.assert_allclose(output.joint_command.position, before.joint_command.position)  # held
    output = stand.run(SAFETY.damp_timeout_s)
    assert {Fault.CONTROLLER_ERROR, Fault.STALE_TARGETS} <= {*output.safety.faults}
    assert output.safety.damping and not output.joint_command.stiffness.any()
    (record,) = [record for record in caplog.records if record.levelno >= logging.ERROR]
    assert "defective" in record.getMessage() and record.exc_info is not None

    stand.pipeline.select_controller("model_based")
    output = stand.run(2 * SAFETY.start_blend_s)
    assert output.failures == {} and output.safety.faults == Fault.NONE
    np.testing.assert_array_equal(output.joint_command.stiffness, STIFFNESS)


def test_after_damping_another_controller_starts_at_the_torque_of_the_moment(stand: Stand) -> None:
    stand.use(misshapen)
    stand.run(1.0)
    stand.pipeline.select_controller("model_based")
    outputs = [stand.run() for _ in range(round(SAFETY.start_blend_s / TICK_S))]
    commands = [output.joint_command for output in outputs if not output.safety.damping]
    torque = [each.stiffness * (each.position - NOMINAL_POSITION) + DAMPING * each.velocity for each in commands]
    np.testing.assert_allclose(torque[0], 0.0, atol=1e-9)
    assert np.abs(np.diff(torque, axis=0)).max() < 2.0


def test_a_failure_now_and_then_is_shown_all_the_time_and_logged_once(stand: Stand, caplog: pytest.LogCaptureFixture) -> None:
    calls = 0

    def shaky(inputs: ControllerInput) -> np.ndarray:
        nonlocal calls
        calls += 1
        return hold(inputs) if calls % 3 else misshapen(inputs)

    stand.use(shaky)
    output = stand.run(0.1)
    for _ in range(50):
        output = stand.run(0.02)
        assert Fault.CONTROLLER_ERROR in output.failures
        assert not output.safety.damping
    assert len(caplog.records) == 1
    with pytest.raises(FailureError, match=r"mine, ValueError: operands"):
        output.raise_failures()


def test_who_works_again_is_forgiven_and_a_relapse_is_logged_again(stand: Stand, caplog: pytest.LogCaptureFixture) -> None:
    for relapses in (1, 2):
        once = iter([misshapen])
        stand.use(lambda inputs, once=once: next(once, hold)(inputs))
        output = stand.run(RECOVERED_AFTER_S / 2)
        assert Fault.CONTROLLER_ERROR in output.safety.faults
        output = stand.run(RECOVERED_AFTER_S)
        assert output.failures == {} and output.safety.faults == Fault.NONE
        assert len(caplog.records) == relapses


def test_choosing_a_failing_controller_again_is_a_fresh_start(stand: Stand, caplog: pytest.LogCaptureFixture) -> None:
    stand.use(misshapen)
    stand.run(0.5)
    stand.pipeline.select_controller("mine")
    stand.run(0.5)
    assert len(caplog.records) == 2


def test_a_controller_that_cannot_reset_does_not_act(stand: Stand) -> None:
    class Unready(Own):
        def reset(self) -> None:
            raise RuntimeError("no weights")

    stand.pipeline.add_controller("unready", Unready(hold))
    stand.pipeline.select_controller("unready")
    output = stand.run(0.5)
    assert "no weights" in output.failures[Fault.CONTROLLER_ERROR]
    assert output.safety.damping


def test_a_failing_first_controller_damps_from_the_first_tick() -> None:
    stand = Stand()
    stand.use(misshapen)
    output = stand.run()
    assert output.safety.damping and Fault.CONTROLLER_ERROR in output.safety.faults
    stand.run(0.5)
    stand.pipeline.select_controller("model_based")
    assert not stand.run(0.5).safety.damping


def test_a_controller_may_return_the_same_array_every_time(stand: Stand) -> None:
    buffer = NOMINAL_POSITION.copy()
    stand.use(lambda _: buffer)
    output = stand.run(1.0)
    assert output.safety.faults == Fault.NONE and not output.safety.damping


def raising(error: Exception) -> Callable[..., Any]:
    def method(*_: Any) -> Any:
        raise error

    return method


def not_finite() -> ForceEstimate:
    return ForceEstimate(np.array([np.nan, 0.0, 0.0]), np.zeros((4, 3)))


DEFECTS = [
    ("observe", raising(ValueError("operands could not be broadcast together"))),
    ("estimate", raising(np.linalg.LinAlgError("Singular matrix"))),
    ("estimate", not_finite),
    ("estimate", lambda: ForceEstimate(np.zeros(2), np.zeros((4, 3)))),
    ("estimate", lambda: None),
]


@pytest.mark.parametrize(("method", "defect"), DEFECTS)
def test_an_estimator_that_is_only_shown_stops_nobody(method: str, defect: Callable[..., Any], caplog: Any) -> None:
    sound, broken = Stand(), Stand()
    for stand in (sound, broken):
        stand.run(0.2)
    setattr(broken.pipeline.estimators["gmo_pi"], method, defect)
    output = broken.run()
    sound.run()
    for _ in range(100):
        expected, output = sound.run(), broken.run()
        np.testing.assert_array_equal(output.joint_command.position, expected.joint_command.position)
        for name in ("gmo_cqp", "adaptive"):
            np.testing.assert_array_equal(output.estimates[name].force_estimated_n, expected.estimates[name].force_estimated_n)
    assert output.safety.faults == Fault.ESTIMATOR_ERROR
    assert "gmo_pi" in output.failures[Fault.ESTIMATOR_ERROR]
    assert output.estimates["gmo_pi"].stale
    assert len(caplog.records) == 1


@pytest.mark.parametrize(("method", "defect"), DEFECTS)
def test_the_last_good_estimate_of_the_selected_estimator_holds_and_another_takes_over(
    stand: Stand, method: str, defect: Callable[..., Any]
) -> None:
    good = stand.run().hand.force_estimated_n
    setattr(stand.pipeline.estimators["adaptive"], method, defect)
    output = stand.run(0.3)
    np.testing.assert_array_equal(output.hand.force_estimated_n, good)
    assert Fault.ESTIMATOR_ERROR | Fault.ESTIMATOR_STALE in output.safety.faults
    assert not output.safety.damping
    stand.pipeline.select_estimator("gmo_cqp")
    output = stand.run()
    assert Fault.ESTIMATOR_ERROR in output.safety.faults  # it is still shown
    assert Fault.ESTIMATOR_STALE not in output.safety.faults
    assert not output.estimates["gmo_cqp"].stale


def test_no_controller_acts_on_a_force_that_nobody_has_estimated() -> None:
    stand = Stand()
    stand.pipeline.estimators["adaptive"].estimate = raising(RuntimeError("no idea"))
    output = stand.run(0.2)
    assert output.safety.damping
    assert {Fault.ESTIMATOR_ERROR, Fault.ESTIMATOR_STALE} <= {*output.safety.faults}
    assert "adaptive" not in output.estimates
    stand.pipeline.select_estimator("gmo_cqp")
    assert not stand.run(0.2).safety.damping
