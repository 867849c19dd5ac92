"""What the robot can bear at its hand: against a linear program over the ground forces, and on the simulated robot."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from scipy.optimize import linprog

from control.command.limits import DEFAULT_COMMAND, CommandLimits
from control.command.tip_over import feasible_force_scale
from control.faults import Fault
from control.frames import rotation_from_quaternion, rotation_z, skew
from control.joints import ARM_SLICE, JOINT_COUNT, NOMINAL_BASE_HEIGHT_M, NOMINAL_POSITION
from control.pipeline import PipelineConfig
from control.robot_model import GRAVITY_MPS2, RobotModel
from control.types import Command
from sim.backends.simulation.wrenches import Spring
from sim.runtime.simulation import Simulation, SimulationConfig

UPSETTING_N = np.array([-80.0, 80.0, 80.0])
"""Environment on hand: would push the robot back, to the left and up, twice what may be asked for on each axis."""
ARM_LOWER, ARM_UPPER = [-0.8, 0.3, -2.0, -0.8, 0.0, 0.0], [0.8, 1.8, -0.5, 0.8, 0.0, 0.0]


def standing(arm: np.ndarray, yaw: float = 0.0) -> RobotModel:
    """A robot at rest in its stance with this arm posture (6,)."""
    model, posture = RobotModel(), NOMINAL_POSITION.copy()
    posture[ARM_SLICE] = arm
    rotation = rotation_from_quaternion(np.array([np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)]))
    model.update(rotation, posture, np.zeros(3), np.zeros(3), np.zeros(JOINT_COUNT))
    return model


def largest_share(force: np.ndarray, model: RobotModel) -> float:
    """Of `force`, in world, that ground forces with no pull can balance: all six equations of statics, solved as a program."""
    contacts, hand = model.wheel_contact_positions.copy(), model.end_effector_position
    contacts[:, 2] = contacts[:, 2].mean()
    weight = np.array([0.0, 0.0, -model.total_mass * GRAVITY_MPS2])
    balance = np.zeros((6, 13))
    for wheel, point in enumerate(contacts):
        balance[:3, 3 * wheel : 3 * wheel + 3] = np.eye(3)
        balance[3:, 3 * wheel : 3 * wheel + 3] = skew(point)
    balance[:3, 12], balance[3:, 12] = force, np.cross(hand, force)
    rest = -np.concatenate([weight, np.cross(model.center_of_mass, weight)])
    bounds = [(None, None), (None, None), (0.0, None)] * 4 + [(0.0, 1.0)]
    return linprog(-np.eye(13)[12], A_eq=balance, b_eq=rest, bounds=bounds).x[12]


def test_the_share_is_the_largest_that_statics_allow():
    random = np.random.default_rng(0)
    shares = []
    for _ in range(60):
        arm, yaw = random.uniform(ARM_LOWER, ARM_UPPER), random.uniform(-np.pi, np.pi)
        model = standing(arm, yaw)
        force = random.uniform(-50.0, 50.0, 3)
        shares.append(feasible_force_scale(force, model, margin_m=0.0))
        assert shares[-1] == pytest.approx(largest_share(rotation_z(yaw) @ force, model), abs=0.01)
    assert 10 < np.count_nonzero(np.array(shares) < 1.0) < 50


def test_the_margin_shortens_the_way_of_the_centre_of_pressure():
    model = standing(NOMINAL_POSITION[ARM_SLICE])
    contacts, hand = model.wheel_contact_positions, model.end_effector_position
    push = np.array([-100.0, 0.0, 0.0])
    for margin in (0.0, 0.03, 0.08):
        share = feasible_force_scale(push, model, margin)
        # A push at the hand's height moves it back by moment over weight, from below the centre of mass.
        moment = share * push[0] * (hand[2] - contacts[:, 2].mean())
        pressure = model.center_of_mass[0] + moment / (model.total_mass * GRAVITY_MPS2)
        assert pressure - contacts[2:, 0].mean() == pytest.approx(margin, abs=1e-3)


@pytest.mark.slow
def test_twenty_newtons_on_every_axis_are_borne_whole_wherever_the_hand_is():
    random, margin, places = np.random.default_rng(1), CommandLimits().tip_over_margin_m, 0
    while places < 40:
        model = standing(random.uniform(ARM_LOWER, ARM_UPPER))
        x, y, z = model.end_effector_position + [0.0, 0.0, NOMINAL_BASE_HEIGHT_M]
        if 0.42 < x < 0.72 and abs(y) < 0.25 and 0.25 < z < 0.75:
            places += 1
            for signs in product((-1.0, 1.0), repeat=3):
                assert feasible_force_scale(20.0 * np.array(signs), model, margin) == 1.0


def test_a_robot_beyond_its_edge_bears_what_brings_it_back_alone():
    model = standing(NOMINAL_POSITION[ARM_SLICE])
    leaning = rotation_from_quaternion(np.array([np.cos(0.4), 0.0, np.sin(0.4), 0.0]))
    model.update(leaning, NOMINAL_POSITION, np.zeros(3), np.zeros(3), np.zeros(JOINT_COUNT))
    forward = np.array([10.0, 0.0, 0.0])
    assert model.center_of_mass[0] > model.wheel_contact_positions[:, 0].max()
    assert feasible_force_scale(forward, model, margin_m=0.0) == 0.0
    assert feasible_force_scale(-forward, model, margin_m=0.0) == 1.0


@pytest.mark.slow
@pytest.mark.parametrize(("margin_m", "falls"), [(CommandLimits().tip_over_margin_m, False), (-1.0, True)])
def test_a_force_that_would_tip_the_robot_is_reduced(margin_m: float, falls: bool):
    limits = replace(CommandLimits(), tip_over_margin_m=margin_m)
    session = Simulation(SimulationConfig(seed=2, pipeline=PipelineConfig(controller="model_based", limits=limits)))
    for _ in range(400):
        session.tick(DEFAULT_COMMAND)
    anchor = DEFAULT_COMMAND.position_m + UPSETTING_N / 300.0
    session.backend.wrenches.add(Spring(anchor, 300.0, 12.0, frame="heading"))
    command = replace(DEFAULT_COMMAND, mask=np.ones(3), force_n=UPSETTING_N)
    faults = Fault.NONE
    for _ in range(2000):
        faults |= session.tick(command).safety.faults
        if Fault.TILT in faults:
            break
    assert (Fault.TIP_OVER_LIMIT in faults) != falls
    assert (Fault.TILT in faults) == falls


def test_what_is_limited_is_told_while_the_command_acts_and_no_longer():
    session = Simulation(SimulationConfig(seed=2, pipeline=PipelineConfig(controller="model_based")))
    command = replace(DEFAULT_COMMAND, mask=np.ones(3), force_n=UPSETTING_N)

    def faults(asked: Command, ticks: int) -> Fault:
        for _ in range(ticks):
            session.tick(asked)
        return session.output.safety.faults

    assert faults(DEFAULT_COMMAND, 300) == Fault.NONE
    assert Fault.TIP_OVER_LIMIT in faults(command, 20)
    session.estop()
    assert Fault.TIP_OVER_LIMIT not in faults(command, 20)
