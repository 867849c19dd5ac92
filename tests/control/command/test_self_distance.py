"""Distances between arm and body: against each other along motions, and the border that they make."""

from dataclasses import replace

import numpy as np
import pytest

from control.command.limits import DEFAULT_COMMAND
from control.command.self_distance import SelfDistance
from control.faults import Fault
from control.joints import ARM_SLICE, JOINT_COUNT, NOMINAL_POSITION
from control.robot_model import RobotModel
from sim.runtime.simulation import Simulation, SimulationConfig


@pytest.fixture(scope="module")
def model() -> RobotModel:
    return RobotModel()


def place(model: RobotModel, arm: np.ndarray) -> None:
    position = np.array(NOMINAL_POSITION)
    position[ARM_SLICE] = arm
    model.update(np.eye(3), position, np.zeros(3), np.zeros(3), np.zeros(JOINT_COUNT))


def test_the_rate_of_the_distance_is_that_of_its_nearest_point(model: RobotModel) -> None:
    random, distance, step = np.random.default_rng(1), SelfDistance(model), 1e-3
    for _ in range(20):
        arm = np.array(NOMINAL_POSITION[ARM_SLICE]) + random.uniform(-0.3, 0.3, 6)
        velocity = 0.1 * random.standard_normal(6)
        place(model, arm)
        before = distance.nearest()
        rate = distance.rate(before, velocity)
        place(model, arm + step * velocity)
        assert rate == pytest.approx((distance.nearest().distance_m - before.distance_m) / step, abs=2e-3)


def test_a_hand_drawn_towards_the_trunk_closes_in_and_one_drawn_away_does_not(model: RobotModel) -> None:
    place(model, np.array(NOMINAL_POSITION[ARM_SLICE]))
    distance = SelfDistance(model)
    nearest, inwards = distance.nearest(), np.array([-0.1, 0.0, -0.1, 0.0, 0.0, 0.0])
    assert distance.closing_speed(nearest, inwards) > 0.05
    assert distance.closing_speed(nearest, -inwards) < -0.05


def test_what_is_skipped_is_never_nearer_than_asked(model: RobotModel) -> None:
    random, exact, lazy = np.random.default_rng(2), SelfDistance(model), SelfDistance(model)
    arm, skipped = np.array(NOMINAL_POSITION[ARM_SLICE]), 0
    for _ in range(200):
        arm = np.clip(arm + random.uniform(-0.02, 0.02, 6), model.position_lower[ARM_SLICE], model.position_upper[ARM_SLICE])
        place(model, arm)
        found, true = lazy.nearest_within(0.2), exact.nearest().distance_m
        assert (found is not None) == (true <= 0.2)
        skipped += found is None
    assert skipped > 20


@pytest.mark.slow
@pytest.mark.parametrize(("position_m", "pitch"), [((0.3, 0.0, 0.1), 0.0), ((0.35, 0.0, 0.35), 1.2)])
def test_an_arm_that_is_sent_into_the_robot_stops_before_it_and_says_so(position_m: tuple[float, ...], pitch: float) -> None:
    session, faults, touched = Simulation(SimulationConfig(seed=9)), Fault.NONE, False
    orientation = np.array([np.cos(pitch / 2.0), 0.0, np.sin(pitch / 2.0), 0.0])
    inside = replace(DEFAULT_COMMAND, position_m=np.array(position_m), orientation_wxyz=orientation)
    for tick in range(2500):
        faults |= session.tick(DEFAULT_COMMAND if tick < 300 else inside).safety.faults
        if tick % 10 == 0:
            session.truth()
            touched |= session.backend.touches_itself()
    assert Fault.SELF_CONTACT_LIMIT in faults
    assert not touched
