"""The legs' law: ground forces that balance, and the joint torques that make them."""

from dataclasses import replace

import numpy as np
import pytest

from control.frames import skew
from control.joints import (
    ARM_SLICE,
    DAMPING,
    LEG_SLICE,
    NOMINAL_BASE_HEIGHT_M,
    NOMINAL_POSITION,
    STIFFNESS,
    WHEEL_RADIUS_M,
    WHEEL_SLICE,
)
from control.kernels.records import packed
from control.robot_model import GRAVITY_MPS2, RobotModel
from control.whole_body.body_terms import body_terms
from control.whole_body.legs import LEG_STATE, LEGS, LegConfig, ground_forces, leg_targets
from control.whole_body.task_signals import task_signals
from tests.control.whole_body.standing import arm_torque, hand_command, inputs


@pytest.fixture
def model():
    return RobotModel()


def test_an_arm_and_legs_of_other_estimated_masses_carry_those(model):
    tick = inputs(model)
    tick = replace(tick, command=hand_command(tick), mass_scales=np.array([1.2, 0.9]))
    assert np.allclose(arm_torque(tick), 1.2 * model.gravity[model.joint_rows[ARM_SLICE]], atol=1e-9)
    forces = np.empty((4, 3))
    ground_forces(packed(LEGS, LegConfig())[0], body_terms(model)[0], task_signals(tick)[0], np.zeros(3), forces)
    weight = (1.2 * model.arm_mass + 0.9 * (model.total_mass - model.arm_mass)) * GRAVITY_MPS2
    assert forces[:, 2].sum() == pytest.approx(weight)


def balance(tick, hand_force=(0.0, 0.0, 0.0)):
    legs, forces = packed(LEGS, LegConfig(), total_mass=tick.model.total_mass), np.empty((4, 3))
    ground_forces(legs[0], body_terms(tick.model)[0], task_signals(tick)[0], np.array(hand_force), forces)
    return forces


@pytest.mark.parametrize("force", [(0.0, 0.0, 0.0), (20.0, -10.0, 0.0), (0.0, 15.0, -20.0)])
def test_ground_forces_balance_weight_and_hand_force(model, force):
    ground = balance(inputs(model), force)
    weight = np.array([0.0, 0.0, -model.total_mass * GRAVITY_MPS2])
    assert np.allclose(ground.sum(axis=0) + force + weight, 0.0, atol=1e-8)
    moment = skew(model.end_effector_position - model.center_of_mass) @ np.array(force)
    for position, contact_force in zip(model.wheel_contact_positions, ground, strict=True):
        moment = moment + skew(position - model.center_of_mass) @ contact_force
    assert np.allclose(moment, 0.0, atol=1e-8)


def test_no_other_ground_forces_that_balance_are_smaller(model):
    ground = balance(inputs(model, tilt=0.1), (20.0, -10.0, 5.0))
    grasp = np.concatenate([np.concatenate([np.eye(3), skew(r)]) for r in model.wheel_contact_positions], axis=1)
    smallest = np.linalg.pinv(grasp) @ (grasp @ ground.reshape(12))
    assert np.allclose(ground.reshape(12), smallest, atol=1e-8)


def test_a_pitched_trunk_gets_a_restoring_moment(model):
    gain = (balance(inputs(model, tilt=0.1)) - balance(inputs(model)))[:, 2]
    front, rear = slice(0, 2), slice(2, 4)
    assert gain[front].sum() > gain[rear].sum()


def own(model, **fields):
    """Ground forces beside those of the nominal stance, with something of the signals changed."""
    tick = inputs(model)
    legs, terms = packed(LEGS, LegConfig())[0], body_terms(model)[0]
    forces = []
    for changes in ({}, fields):
        signals, out = task_signals(tick), np.empty((4, 3))
        for name, value in changes.items():
            signals[name] = value
        ground_forces(legs, terms, signals[0], np.zeros(3), out)
        forces.append(out)
    return forces[1] - forces[0]


def test_a_low_base_is_lifted_and_a_rising_one_is_braked(model):
    lift = own(model, base_height=NOMINAL_BASE_HEIGHT_M - 0.02).sum(axis=0)
    assert lift == pytest.approx([0.0, 0.0, 0.02 * LegConfig().height_stiffness], abs=1e-9)
    brake = own(model, base_linear_velocity=(0.0, 0.0, 0.1)).sum(axis=0)
    assert brake == pytest.approx([0.0, 0.0, -0.1 * LegConfig().height_damping], abs=1e-9)


@pytest.mark.parametrize("axis", [0, 1])
def test_sway_and_tilting_are_damped(model, axis):
    velocity = 0.2 * np.eye(3)[axis]
    sway = own(model, base_linear_velocity=velocity)
    assert sway.sum(axis=0) == pytest.approx(-LegConfig().sway_damping * velocity, abs=1e-9)
    rate = 0.3 * np.eye(3)[axis]
    moment = sum(np.cross(r, f) for r, f in zip(model.wheel_contact_positions, own(model, angular_velocity=rate), strict=True))
    assert moment == pytest.approx(-LegConfig().tilt_damping * rate, abs=1e-8)


def leg_torques(model, forces, **fields):
    """Torque (12,) of the legs' drives, of the wheels (4,), the support, and the state, in the nominal posture."""
    tick = inputs(model)
    signals, terms = task_signals(tick), body_terms(model)
    for name, value in fields.items():
        signals[name] = value
    state, targets, wheels = np.zeros(1, LEG_STATE), np.empty(12), np.empty(4)
    support = leg_targets(
        packed(LEGS, LegConfig())[0],
        terms[0],
        signals[0],
        forces.copy(),
        NOMINAL_POSITION[LEG_SLICE],
        state[0],
        targets,
        wheels,
    )
    q, dq = signals["joint_position"][0, LEG_SLICE], signals["joint_velocity"][0, LEG_SLICE]
    return STIFFNESS[LEG_SLICE] * (targets - q) - DAMPING[LEG_SLICE] * dq, wheels, support, state


def test_the_drives_of_a_standing_robot_make_the_forces_that_balance_it(model):
    """Statics by the model: gravity less what the ground does on every joint, and nothing left over for the base."""
    ground = balance(inputs(model), (15.0, -10.0, -20.0))
    wrench = np.zeros(18)
    for wheel in range(4):
        wrench[3 * wheel : 3 * wheel + 3] = ground[wheel]
    wrench[12:15] = (15.0, -10.0, -20.0)
    owed = model.gravity - model.wrench_jacobian.T @ wrench
    assert owed[:6] == pytest.approx(np.zeros(6), abs=1e-7)
    rows, torque = model.joint_rows, np.zeros(22)
    torque[WHEEL_SLICE] = owed[rows[WHEEL_SLICE]]
    legs, wheels, support, _ = leg_torques(model, ground, joint_torque=torque)
    assert legs == pytest.approx(owed[rows[LEG_SLICE]], abs=1e-9)
    assert wheels == pytest.approx(owed[rows[WHEEL_SLICE]], abs=1e-9)
    assert support == pytest.approx(4.0 * ground[:, 2].min() / ground[:, 2].sum())


def test_support_tells_of_a_wheel_that_is_about_to_lift(model):
    forces = np.zeros((4, 3))
    forces[:, 2] = (100.0, 100.0, 100.0, 0.0)
    assert leg_torques(model, forces)[2] == pytest.approx(0.0)


def test_targets_stay_near_the_posture_however_large_the_forces(model):
    forces = np.zeros((4, 3))
    forces[:, 2] = 1e4
    q = NOMINAL_POSITION[LEG_SLICE]
    offset = leg_torques(model, forces)[0] / STIFFNESS[LEG_SLICE]
    assert np.abs(offset).max() == pytest.approx(LegConfig().offset_limit_rad)
    below = leg_torques(model, 1e-4 * forces, joint_position=np.r_[q - 2.0, np.zeros(10)])[0] / STIFFNESS[LEG_SLICE]
    assert below == pytest.approx(np.full(12, 2.0 + LegConfig().offset_limit_rad))


def test_wheels_that_push_against_each_other_load_the_legs_and_those_that_push_together_do_not(model):
    ground, torque = balance(inputs(model)), np.zeros(22)
    balanced = leg_torques(model, ground)[1]
    torque[WHEEL_SLICE] = balanced
    level = leg_torques(model, ground, joint_torque=torque)
    torque[WHEEL_SLICE] = balanced + 2.0
    together = leg_torques(model, ground, joint_torque=torque)
    assert together[0] == pytest.approx(level[0], abs=1e-9)
    torque[WHEEL_SLICE] = balanced + 2.0 * np.array([1.0, -1.0, 1.0, -1.0])
    against = leg_torques(model, ground, joint_torque=torque)
    traction = LegConfig().traction_smoothing * 2.0 / WHEEL_RADIUS_M
    assert against[3]["traction"][0] == pytest.approx(traction)
    pushed = np.zeros((4, 3))
    pushed[:, 0] = traction * np.array([1.0, -1.0, 1.0, -1.0])
    wrench = np.concatenate([pushed.ravel(), np.zeros(6)])
    assert against[0] - level[0] == pytest.approx(-(model.wrench_jacobian.T @ wrench)[model.joint_rows[LEG_SLICE]], abs=1e-9)
