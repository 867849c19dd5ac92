"""What the law of the whole body must not see: which way the robot faces; and that left and right are alike."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from control.command.limits import DEFAULT_COMMAND
from control.frames import quaternion_from_rotation
from control.joints import JOINT_COUNT, JOINT_NAMES, NOMINAL_BASE_HEIGHT_M, NOMINAL_POSITION
from control.robot_model import RobotModel
from control.types import BaseState, Command, SensorFrame
from control.whole_body.controller import ControllerInput
from control.whole_body.model_based import ModelBasedController

MIRROR = np.diag([1.0, -1.0, 1.0])
_SWAP = {"FL": "FR", "FR": "FL", "RL": "RR", "RR": "RL"}
_OPPOSITE = ("_hip", "arm_joint1", "arm_joint5", "arm_joint6")


def mirrored_joints(values):
    """Joint values of the robot's image in its middle plane: the legs change sides, and what turns about x or z its sign."""
    names = [_SWAP.get(name[:2], name[:2]) + name[2:] for name in JOINT_NAMES]
    signs = [-1.0 if name.endswith(_OPPOSITE) else 1.0 for name in JOINT_NAMES]
    return np.array(signs) * values[[JOINT_NAMES.index(name) for name in names]]


def mirrored_rotation(rotation):
    return MIRROR @ rotation @ MIRROR


class Robot:
    """Random states and commands of one robot, near its nominal posture."""

    def __init__(self, seed):
        random = np.random.default_rng(seed)
        self.tilt = Rotation.from_rotvec(0.1 * random.normal(size=3) * [1.0, 1.0, 0.0]).as_matrix()
        self.rate, self.velocity = 0.2 * random.normal(size=(2, 3))
        self.position = NOMINAL_POSITION + 0.05 * random.normal(size=JOINT_COUNT)
        self.joint_velocity, self.torque = 0.2 * random.normal(size=(2, JOINT_COUNT))
        self.force, self.orientation = 8.0 * random.normal(size=3), Rotation.from_rotvec(random.normal(size=3)).as_matrix()
        self.command = replace(
            DEFAULT_COMMAND,
            mask=random.integers(0, 2, 3).astype(float),
            force_n=10.0 * random.normal(size=3),
            position_m=DEFAULT_COMMAND.position_m + 0.05 * random.normal(size=3),
            base_velocity=np.array([0.4, 0.0, 0.3]) * random.normal(size=3),
        )

    def mirrored(self):
        """Its image."""
        image = object.__new__(Robot)
        image.tilt, image.orientation = mirrored_rotation(self.tilt), mirrored_rotation(self.orientation)
        image.rate, image.velocity, image.force = -MIRROR @ self.rate, MIRROR @ self.velocity, MIRROR @ self.force
        image.position, image.joint_velocity = mirrored_joints(self.position), mirrored_joints(self.joint_velocity)
        image.torque = mirrored_joints(self.torque)
        image.command = replace(
            self.command,
            mask=self.command.mask,
            force_n=MIRROR @ self.command.force_n,
            position_m=MIRROR @ self.command.position_m,
            base_velocity=self.command.base_velocity * [1.0, -1.0, -1.0],
        )
        return image

    def inputs(self, model, yaw):
        """What its controller is given, while it faces `yaw` rad."""
        rotation = Rotation.from_euler("z", yaw).as_matrix() @ self.tilt
        zero = np.zeros(3)
        sensor = SensorFrame(
            0.0, quaternion_from_rotation(rotation), zero, zero, self.position, self.joint_velocity, self.torque
        )
        base = BaseState(rotation, self.velocity, self.rate, NOMINAL_BASE_HEIGHT_M)
        model.update(rotation, self.position, self.velocity, self.rate, self.joint_velocity)
        command: Command = replace(self.command, orientation_wxyz=quaternion_from_rotation(self.orientation))
        return ControllerInput(sensor, base, model, command, self.force)


def targets(robot, yaw=0.0, periods=3):
    """Of a fresh controller after some periods of the same."""
    model = RobotModel()
    controller = ModelBasedController(model)
    target = np.empty(JOINT_COUNT)
    for _ in range(periods):
        target = controller.step(robot.inputs(model, yaw))
    return target


@pytest.mark.parametrize("seed", range(8))
def test_it_does_the_same_whichever_way_the_robot_faces(seed):
    robot = Robot(seed)
    assert targets(robot, yaw=2.3) == pytest.approx(targets(robot), abs=1e-8)


@pytest.mark.parametrize("seed", range(8))
def test_the_image_of_a_robot_is_given_the_image_of_its_targets(seed):
    robot = Robot(seed)
    assert targets(robot.mirrored()) == pytest.approx(mirrored_joints(targets(robot)), abs=2e-3)
