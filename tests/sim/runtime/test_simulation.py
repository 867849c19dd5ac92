"""The simulation: the real pipeline on the simulated robot, and no more than sensors between them."""

from dataclasses import replace

import numpy as np
import pytest

from control.command.limits import DEFAULT_COMMAND
from control.faults import Fault
from control.pipeline import Pipeline, PipelineConfig
from control.types import Command, SensorFrame
from sim.runtime.simulation import Simulation, SimulationConfig
from sim.runtime.snapshot import SETPOINT, SNAPSHOT, Mode, command_from_record, command_to_record

SECOND = 500


def run(session: Simulation, command: Command, seconds: float) -> None:
    for _ in range(round(seconds * SECOND)):
        session.tick(command)


@pytest.fixture
def standing() -> Simulation:
    session = Simulation(SimulationConfig(seed=3))
    run(session, DEFAULT_COMMAND, 1.0)
    return session


def test_the_pipeline_runs_from_a_recorded_sensor_log_alone() -> None:
    session = Simulation(SimulationConfig(seed=1))
    command = replace(DEFAULT_COMMAND, base_velocity=np.array([0.3, 0.0, 0.2]), mask=np.array([0.0, 0.0, 1.0]))
    session.add_wrench(force_n=[4.0, -3.0, 6.0], duration_s=1.0, ramp_s=0.2)
    log: list[SensorFrame] = []
    recorded = []
    for _ in range(SECOND):
        log.append(session.backend.read())
        recorded.append(session.tick(command))

    replayed = Pipeline(PipelineConfig())
    for frame, original in zip(log, recorded, strict=True):
        output = replayed.step(frame, command)
        np.testing.assert_array_equal(output.joint_command.position, original.joint_command.position)
        np.testing.assert_array_equal(output.hand.force_estimated_n, original.hand.force_estimated_n)


@pytest.mark.slow
def test_the_estimate_follows_an_applied_force_and_returns_to_zero(standing: Simulation) -> None:
    force = np.array([6.0, -4.0, 8.0])
    standing.add_wrench(force_n=force, duration_s=1.5, ramp_s=0.2)
    run(standing, DEFAULT_COMMAND, 1.0)
    truth = standing.truth()
    np.testing.assert_allclose(truth.force_true_n, force, atol=0.2)
    assert np.linalg.norm(standing.output.hand.force_estimated_n - truth.force_true_n) < 2.0
    run(standing, DEFAULT_COMMAND, 1.5)
    assert np.linalg.norm(standing.output.hand.force_estimated_n) < 2.0


def test_all_estimators_run_side_by_side_and_any_can_be_selected(standing: Simulation) -> None:
    names = standing.pipeline.estimator_names
    assert set(standing.output.estimates) == set(names)
    for name in names:
        standing.select_estimator(name)
        run(standing, DEFAULT_COMMAND, 0.1)
        np.testing.assert_array_equal(standing.output.hand.force_estimated_n, standing.output.estimates[name].force_estimated_n)
    with pytest.raises(ValueError, match=r"unknown estimator 'nope'; available: gmo_pi"):
        standing.select_estimator("nope")
    with pytest.raises(ValueError, match="both k1 and k2"):
        standing.select_estimator(names[0], k1=6.0)


@pytest.mark.slow
def test_the_adaptive_estimator_notices_a_mass_that_nobody_tells_it(standing: Simulation) -> None:
    standing.reset()
    standing.set_mismatch(1.2)
    run(standing, DEFAULT_COMMAND, 4.0)
    assert standing.output.estimates["adaptive"].mass_scale == pytest.approx(1.2, abs=0.05)
    fixed_model = np.linalg.norm(standing.output.estimates["gmo_cqp"].force_estimated_n)
    assert np.linalg.norm(standing.output.estimates["adaptive"].force_estimated_n) < 0.5 * fixed_model


@pytest.mark.slow
def test_the_snapshot_says_while_the_masses_are_found_anew(standing: Simulation) -> None:
    drive = replace(DEFAULT_COMMAND, base_velocity=np.array([0.3, 0.0, 0.2]))

    def adapting_after(seconds: float, command: Command = DEFAULT_COMMAND) -> bool:
        run(standing, command, seconds)
        snapshot = np.zeros(1, SNAPSHOT)[0]
        standing.fill(snapshot)
        return bool(snapshot["mass_adapting"])

    assert not adapting_after(5.0)
    assert not adapting_after(2.0, drive)  # an ordinary disturbance is no change of mass
    standing.set_mismatch(1.2)
    assert adapting_after(1.0)
    assert np.linalg.norm(standing.output.hand.force_estimated_n) > 1.5  # which sigma does not tell
    assert not adapting_after(20.0)
    standing.select_estimator("gmo_cqp")
    standing.set_mismatch(1.0)
    assert not adapting_after(1.0)  # has no masses to find


@pytest.mark.slow
def test_the_estop_damps_and_outlives_a_reset(standing: Simulation) -> None:
    standing.estop()
    assert standing.mode is Mode.ESTOP
    run(standing, DEFAULT_COMMAND, 0.1)
    assert standing.output.safety.damping
    assert not standing.output.joint_command.stiffness.any()
    standing.reset()
    assert standing.mode is Mode.ESTOP
    standing.clear_estop()
    run(standing, DEFAULT_COMMAND, 3.0)
    truth = standing.truth()
    assert truth.base_position[2] > 0.32


@pytest.mark.parametrize("ticks", [1, 2, 6, 9, 10])
def test_a_cleared_estop_is_no_fault_from_the_next_tick_on(standing: Simulation, ticks: int) -> None:
    run(standing, DEFAULT_COMMAND, ticks / SECOND)
    standing.estop()
    run(standing, DEFAULT_COMMAND, 1 / SECOND)
    standing.clear_estop()
    run(standing, DEFAULT_COMMAND, 1 / SECOND)
    assert standing.mode is Mode.RUNNING
    assert standing.output.safety.faults == Fault.NONE


def test_a_drag_pulls_while_its_operator_is_alive(standing: Simulation) -> None:
    setpoint = np.zeros(1, SETPOINT)[0]
    command_to_record(DEFAULT_COMMAND, setpoint["command"])
    truth = standing.truth()
    setpoint["drag_active"] = True
    setpoint["drag_target_in_world"] = truth.end_effector_position + [0.1, 0.0, 0.0]
    snapshot = np.zeros(1, SNAPSHOT)[0]
    for _ in range(200):
        standing.tick_setpoint(setpoint, age_s=0.0)
    standing.fill(snapshot)
    assert snapshot["drag_active"]
    assert snapshot["force_true_n"][0] > 3.0
    np.testing.assert_allclose(snapshot["force_true_n"], snapshot["drag_force_n"], atol=1e-6)
    standing.tick_setpoint(setpoint, age_s=1.0)
    standing.fill(snapshot)
    assert not snapshot["drag_active"]
    np.testing.assert_allclose(snapshot["force_true_n"], 0.0, atol=1e-9)


def test_a_snapshot_is_complete(standing: Simulation) -> None:
    snapshot = np.zeros(1, SNAPSHOT)[0]
    standing.track_errors(0.02)
    standing.fill(snapshot)
    for name in ("base_position", "joint_position", "end_effector_position", "force_true_n", "wheel_force_true_n"):
        assert np.isfinite(snapshot[name]).all(), name
    count = len(standing.pipeline.estimator_names)
    assert np.isfinite(snapshot["force_estimates_n"][:count]).all()
    assert np.isfinite(snapshot["force_errors_rms_n"][:count]).all()
    assert np.isnan(snapshot["force_estimates_n"][count:]).all()
    # In position mode at rest the hand is where it is told to be, in both frames.
    np.testing.assert_allclose(snapshot["end_effector_position"], DEFAULT_COMMAND.position_m, atol=0.03)
    np.testing.assert_allclose(snapshot["end_effector_position_in_world"], snapshot["target_position_in_world"], atol=0.03)
    np.testing.assert_allclose(snapshot["wheel_force_true_n"][:, 2].sum(), 9.81 * standing.pipeline.model.total_mass, rtol=0.05)


def test_the_uncertainty_shown_is_the_one_that_the_selected_estimator_states(standing: Simulation) -> None:
    snapshot = np.zeros(1, SNAPSHOT)[0]
    stated = {name: estimate.sigma_n for name, estimate in standing.output.estimates.items()}
    assert any(sigma is None for sigma in stated.values())
    for name, sigma in stated.items():
        standing.select_estimator(name)
        standing.fill(snapshot)
        np.testing.assert_array_equal(snapshot["force_sigma_n"], np.full(3, np.nan) if sigma is None else sigma)


def test_commands_survive_their_record() -> None:
    record = np.zeros(1, SETPOINT)[0]["command"]
    command = replace(DEFAULT_COMMAND, mask=np.array([1.0, 0.0, 1.0]), guidance=True)
    command_to_record(command, record)
    back = command_from_record(record)
    assert back.guidance
    np.testing.assert_array_equal(back.mask, command.mask)
    np.testing.assert_array_equal(back.position_m, command.position_m)


def test_a_base_that_stopped_for_want_of_its_operator_goes_on_only_when_asked_again(standing: Simulation) -> None:
    setpoint = np.zeros(1, SETPOINT)[0]
    command_to_record(replace(DEFAULT_COMMAND, base_velocity=np.array([0.3, 0.0, 0.0])), setpoint["command"])
    setpoint["sequence"] = 4

    def speed_after(ticks: int, age_s: float) -> float:
        for _ in range(ticks):
            standing.tick_setpoint(setpoint, age_s)
        return float(standing.output.applied_command.base_velocity[0])

    assert speed_after(SECOND, 0.0) > 0.25
    assert speed_after(SECOND, 2.0) == pytest.approx(0.0, abs=1e-3)
    assert speed_after(SECOND, 0.0) == pytest.approx(0.0, abs=1e-3)
    snapshot = np.zeros(1, SNAPSHOT)[0]
    standing.fill(snapshot)
    assert not snapshot["command"]["base_velocity"].any()
    setpoint["sequence"] += 1
    assert speed_after(SECOND, 0.0) > 0.25
