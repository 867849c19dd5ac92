"""A robot that stands in its nominal posture, and the law of the whole body on it, tick by tick."""

from dataclasses import replace

import numpy as np

from control.command.limits import DEFAULT_COMMAND
from control.frames import quaternion_from_rotation, rotation_heading_to_world
from control.joints import ARM_SLICE, DAMPING, JOINT_COUNT, NOMINAL_BASE_HEIGHT_M, NOMINAL_POSITION, STIFFNESS
from control.robot_model import RobotModel
from control.types import BaseState, SensorFrame
from control.whole_body.body_terms import body_terms
from control.whole_body.controller import ControllerInput
from control.whole_body.model_based import ModelBasedConfig, ModelBasedLaw
from control.whole_body.reference_correction import CORRECTION, NO_CORRECTION
from control.whole_body.task_memory import TaskMemory, TaskMemoryConfig
from control.whole_body.task_signals import task_signals


def inputs(model, command=DEFAULT_COMMAND, force=(0.0, 0.0, 0.0), tilt=0.0, joint_velocity=None, torque=None):
    """A robot in its nominal posture, pitched by `tilt` rad about its base."""
    c, s = np.cos(tilt), np.sin(tilt)
    rotation = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    zero = np.zeros(JOINT_COUNT)
    velocity = zero if joint_velocity is None else joint_velocity
    sensor = SensorFrame(
        0.0,
        quaternion_from_rotation(rotation),
        np.zeros(3),
        np.zeros(3),
        NOMINAL_POSITION,
        velocity,
        zero if torque is None else torque,
    )
    base = BaseState(rotation, np.zeros(3), np.zeros(3), NOMINAL_BASE_HEIGHT_M)
    model.update(rotation, NOMINAL_POSITION, np.zeros(3), np.zeros(3), velocity)
    return ControllerInput(sensor, base, model, command, np.array(force))


def hand_command(tick, **changes):
    """A command whose hand is exactly where the tick measures it."""
    heading = rotation_heading_to_world(tick.base.rotation_base_to_world)
    position = heading.T @ tick.model.end_effector_position + [0.0, 0.0, NOMINAL_BASE_HEIGHT_M]
    orientation = quaternion_from_rotation(heading.T @ tick.model.end_effector_rotation)
    return replace(DEFAULT_COMMAND, position_m=position, orientation_wxyz=orientation, **changes)


class Law:
    """The law of the whole body with its memory, tick by tick."""

    def __init__(self, model, config=None):
        self.law, self.memory = ModelBasedLaw(model, config or ModelBasedConfig()), TaskMemory(TaskMemoryConfig())

    def arm_torque(self, tick, correction=NO_CORRECTION):
        signals = task_signals(tick)
        self.memory.step(signals)
        targets = self.law.targets(body_terms(tick.model), signals, self.memory.values, correction)[0, ARM_SLICE]
        q, dq = tick.sensor.joint_position[ARM_SLICE], tick.sensor.joint_velocity[ARM_SLICE]
        return STIFFNESS[ARM_SLICE] * (targets - q) - DAMPING[ARM_SLICE] * dq


def arm_torque(tick):
    """Of a controller's first tick."""
    law = Law(RobotModel())
    return law.arm_torque(tick)


def correction_of(**parts):
    correction = np.zeros(1, CORRECTION)
    for name, value in parts.items():
        correction[name] = value
    return correction
