"""Tasks in a session: they command, and hold, until an operator does, and what cannot begin is refused."""

import numpy as np
import pytest

from control.command.limits import DEFAULT_COMMAND
from control.estimation.registry import EstimatorsConfig
from control.pipeline import PipelineConfig
from control.timing import TICK_S
from sim.benchmarks.task_rows import row
from sim.runtime.session import SessionError
from sim.runtime.simulation import Simulation, SimulationConfig
from sim.runtime.snapshot import SETPOINT, SNAPSHOT, command_to_record, named
from sim.tasks.runner import Outcome
from sim.trials.task_trial import TaskPlan, play

LIGHT = PipelineConfig("model_based", "adaptive", policies=None, estimators=EstimatorsConfig(weights=None))


def simulation(scene: str) -> Simulation:
    session = Simulation(SimulationConfig(scene, seed=3, pipeline=LIGHT))
    for _ in range(100):
        session.tick(DEFAULT_COMMAND)
    return session


def setpoint(sequence: int) -> np.void:
    record = np.zeros(1, SETPOINT)[0]
    command_to_record(DEFAULT_COMMAND, record["command"])
    record["sequence"] = sequence
    return record


def snapshot(session: Simulation) -> np.void:
    record = np.zeros(1, SNAPSHOT)[0]
    session.fill(record)
    return record


def test_a_task_commands_until_the_operator_does() -> None:
    session = simulation("box")
    session.tick_setpoint(setpoint(7), 0.0)
    key = session.start_task("box", {}, sequence=7).id
    for _ in range(200):
        session.tick_setpoint(setpoint(7), 0.0)
    seen = snapshot(session)
    assert seen["task_in_charge"] and seen["task_name"] == b"box" and seen["task_phase"] == b"approach"
    assert seen["command"]["position_m"][2] < DEFAULT_COMMAND.position_m[2] - 0.1
    assert named(seen, "reading") == {"box_position_m": 0.0}
    with pytest.raises(SessionError, match="a task is at work"):
        session.start_task("box", {}, sequence=7)
    session.tick_setpoint(setpoint(8), 0.0)
    seen = snapshot(session)
    assert not seen["task_in_charge"]
    np.testing.assert_array_equal(seen["command"]["position_m"], DEFAULT_COMMAND.position_m)
    told = session.task_fields(key)
    assert (told["outcome"], told["reason"]) == ("aborted", "the operator took over")


@pytest.mark.parametrize("moving", [False, True])
def test_a_task_tares_a_resting_hand_before_it_touches_anything(moving: bool) -> None:
    session = simulation("box")
    session.set_mismatch(1.1)
    task = session.start_task("box", {}).runner
    while task.phase in ("approach", "zero"):
        tick = round(session.time_s / TICK_S)
        if moving and task.phase == "zero" and tick % 30 == 0:  # somebody shakes the hand
            session.add_wrench(force_n=[20.0 if tick % 60 else -20.0, 0.0, 0.0], duration_s=0.06, ramp_s=0.01)
        session.tick_setpoint(setpoint(0), 0.0)
    assert task.phase == "touch" and session.own_deeds["tare"] == int(not moving)
    assert bool(session.pipeline.hand_load.offset("adaptive").any()) is not moving


def test_an_aborted_task_holds_and_a_reset_or_the_estop_ends_it() -> None:
    session = simulation("box")
    session.start_task("box", {})
    for _ in range(50):
        session.tick_setpoint(setpoint(0), 0.0)
    assert session.abort_task()["outcome"] == "aborted"
    for _ in range(1000):
        session.tick_setpoint(setpoint(0), 0.0)
    assert session.tasks.in_charge and not session.tasks.running
    with pytest.raises(KeyError, match="no task is at work"):
        session.abort_task()
    second = session.start_task("box", {})
    session.estop()
    assert second.runner.outcome == Outcome.ABORTED and second.runner.reason == "the e-stop was pressed"
    with pytest.raises(SessionError, match="e-stop"):
        session.start_task("box", {})
    session.clear_estop()
    session.reset()
    assert not session.tasks.in_charge


def test_what_cannot_begin_here_is_refused() -> None:
    session = simulation("box")
    with pytest.raises(SessionError, match=r"'valve' needs scene 'valve', this is 'box'"):
        session.start_task("valve", {})
    with pytest.raises(ValueError, match="no task 'dance'"):
        session.start_task("dance", {})
    with pytest.raises(SessionError, match="out of reach"):
        session.start_task("box", {"site_x_m": 1.0})
    with pytest.raises(KeyError, match="no task has been begun"):
        session.task_fields()


@pytest.mark.slow
def test_the_board_is_wiped_on_estimates_alone() -> None:
    plan = TaskPlan("wipe", seed=5, controller="model_based", options={"loops": 1.0, "period_s": 6.0})
    trace = play(plan)
    assert trace.outcome == Outcome.SUCCEEDED, trace.reason
    assert trace.readings["wiped_share"][-1] > 0.9
    assert trace.metrics["force_rmse_n"] < 1.5
    assert not trace.touched
    scored = row(plan, trace)
    assert scored["success"] and scored["contact"] == "padded" and not scored["fell"]
    assert float(scored["position_rmse_cm"] or 9.0) < 2.9 and float(scored["contact_share"] or 0.0) > 0.98
    assert float(scored["control_rmse_n"] or 9.0) < 2.13 and float(scored["estimate_rmse_n"] or 9.0) < 2.74


@pytest.mark.slow
def test_a_door_opens_that_stands_aside_of_where_it_is_believed_by_half_of_its_lever() -> None:
    trace = play(TaskPlan("door", 3, options={"site_x_m": 0.0, "site_y_m": 0.07, "site_yaw_rad": 0.0}))
    assert (trace.outcome, trace.reason) == (Outcome.SUCCEEDED, "")
    assert "back" in trace.phase
