"""The model-based controller: the whole law, and in closed loop on noisy sensors."""

from dataclasses import replace

import numpy as np
import pytest

from control.command.limits import DEFAULT_COMMAND, CommandLimits
from control.joints import JOINT_COUNT, NOMINAL_BASE_HEIGHT_M
from control.robot_model import RobotModel
from control.timing import TICK_S
from control.whole_body.model_based import ModelBasedController
from sim.backends.simulation.wrenches import Spring
from sim.runtime.simulation import Simulation
from tests.control.whole_body.standing import inputs


@pytest.fixture
def model():
    return RobotModel()


def test_targets_are_a_fresh_array_and_repeat_after_reset(model):
    controller = ModelBasedController(model)
    tick = inputs(model, replace(DEFAULT_COMMAND, base_velocity=np.array([0.2, 0.0, 0.2])), force=(2.0, 1.0, 0.0))
    first = controller.step(tick)
    second = controller.step(tick)
    assert first.shape == (JOINT_COUNT,)
    assert first is not second
    controller.reset()
    assert np.array_equal(controller.step(tick), first)


def run(session, command, seconds):
    for _ in range(round(seconds / TICK_S)):
        session.tick(command)


def true_state(session):
    truth = session.truth()
    return truth


def true_hand_in_heading(session):
    truth = true_state(session)
    return (truth.end_effector_position - truth.base_position * [1.0, 1.0, 0.0]) @ truth.rotation_heading_to_world


@pytest.mark.slow
def test_in_closed_loop_the_hand_settles_and_a_spring_is_pressed_with_the_commanded_force():
    session = Simulation()
    target = replace(DEFAULT_COMMAND, position_m=np.array([0.5, 0.12, 0.5]))
    run(session, target, 2.0)
    assert np.linalg.norm(true_hand_in_heading(session) - target.position_m) < 0.015

    anchor = true_state(session).end_effector_position
    session.backend.wrenches.add(Spring(anchor, np.array([0.0, 0.0, 400.0]), np.array([0.0, 0.0, 8.0])))
    pressing = replace(target, mask=np.array([0.0, 0.0, 1.0]), force_n=np.array([0.0, 0.0, 15.0]))
    run(session, pressing, 2.0)
    assert true_state(session).force_true_n[2] == pytest.approx(15.0, abs=2.0)
    error = true_hand_in_heading(session) - target.position_m
    assert np.linalg.norm(error[:2]) < 0.015


@pytest.mark.slow
def test_in_closed_loop_the_robot_drives_and_turns_and_stops():
    session = Simulation()
    run(session, replace(DEFAULT_COMMAND, base_velocity=np.array([0.4, 0.0, 0.3])), 2.5)
    truth = true_state(session)
    forward = truth.base_linear_velocity @ truth.rotation_heading_to_world[:, 0]
    assert forward == pytest.approx(0.4, abs=0.08)
    # Skid steering scrubs: with four wheels of fixed heading some of the turn is lost.
    assert 0.15 < truth.base_angular_velocity[2] < 0.35
    run(session, DEFAULT_COMMAND, 1.2)
    assert np.linalg.norm(true_state(session).base_linear_velocity[:2]) < 0.05


@pytest.mark.slow
def test_in_closed_loop_the_robot_stands_up_again_after_the_e_stop():
    session = Simulation()
    run(session, DEFAULT_COMMAND, 0.4)
    session.estop()
    run(session, DEFAULT_COMMAND, 0.7)
    assert true_state(session).base_position[2] < 0.25
    session.clear_estop()
    run(session, DEFAULT_COMMAND, 3.5)
    assert true_state(session).base_position[2] == pytest.approx(NOMINAL_BASE_HEIGHT_M, abs=0.01)
    assert np.linalg.norm(true_hand_in_heading(session) - DEFAULT_COMMAND.position_m) < 0.03


@pytest.mark.slow
def test_in_closed_loop_a_force_that_meets_nothing_leaves_the_hand_at_the_border_of_the_workspace():
    session = Simulation()
    run(session, replace(DEFAULT_COMMAND, mask=np.array([0.0, 1.0, 0.0]), force_n=np.array([0.0, -20.0, 0.0])), 3.0)
    hand = true_hand_in_heading(session)
    assert hand[1] == pytest.approx(CommandLimits().position_y_m[1], abs=0.03)
    assert np.linalg.norm((hand - DEFAULT_COMMAND.position_m)[[0, 2]]) < 0.02
