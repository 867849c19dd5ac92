"""What a robot's task looks like at one tick: measurements, estimates and the applied command, in one record per robot.

Everything is known on hardware. Controllers, memory and observation read it, on the robot and in the training batch.
"""

import numpy as np

from control.command.command_record import COMMAND
from control.estimation.model_adaptation import ARM, REST
from control.estimation.rolling_contact import rolling_velocity
from control.frames import rotation_error, rotation_from_quaternion, rotation_heading_to_world
from control.kernels.compiled import kernel
from control.kernels.records import record
from control.kernels.small_algebra import rotate_back
from control.whole_body.controller import ControllerInput

REST_VELOCITY = 0.01
"""Commanded base velocity, m/s and rad/s alike, below which the robot stands and holds its wheels."""

TASK_SIGNALS = record(
    angular_velocity=3,
    gravity=3,
    base_linear_velocity=3,
    base_height=(),
    yaw_rate=(),
    joint_position=22,
    joint_velocity=22,
    joint_torque=22,
    hand_position=3,
    orientation_error=3,
    force_estimated_n=3,
    mass_scales=2,
    command=COMMAND,
)
"""Vectors in heading unless named otherwise.

Fields:
    angular_velocity: rad/s, in base.
    gravity: unit vector of gravity, in base.
    base_linear_velocity: m/s, of rolling contact (control.estimation.rolling_contact).
    base_height: m, from leg kinematics.
    yaw_rate: rad/s, about the vertical.
    joint_position, joint_velocity, joint_torque: rad, rad/s, N m.
    hand_position: m, from kinematics.
    orientation_error: rad, rotation vector from the hand to its reference.
    force_estimated_n: N, environment on hand.
    mass_scales: of arm and rest, estimated over nominal.
    command: as applied.
"""


@kernel("f8(Signals, i8)", Signals=TASK_SIGNALS)
def position_error(signals: np.record, axis: int) -> float:
    """Reference minus hand, m, on one axis; zero on a force axis."""
    command = signals.command
    return (1.0 - command.mask[axis]) * (command.position_m[axis] - signals.hand_position[axis])


@kernel("f8(Signals, i8)", Signals=TASK_SIGNALS)
def force_error(signals: np.record, axis: int) -> float:
    """Estimate minus reference, N, on one axis; zero on a position axis."""
    command = signals.command
    return command.mask[axis] * (signals.force_estimated_n[axis] - command.force_n[axis])


@kernel("b1(Signals)", Signals=TASK_SIGNALS)
def stands(signals: np.record) -> bool:
    """Whether the base is commanded to stand: neither to roll nor to turn."""
    velocity = signals.command.base_velocity
    return abs(velocity[0]) < REST_VELOCITY and abs(velocity[2]) < REST_VELOCITY


@kernel(
    "void(matrix, vector, f8, vector, vector, vector, vector, vector, matrix, vector,"
    " vector, vector, vector, vector, vector, vector, Signals[::1])",
    Signals=TASK_SIGNALS,
)
def _fill(
    rotation_base_to_world: np.ndarray,
    angular_velocity: np.ndarray,
    base_height_m: float,
    joint_position: np.ndarray,
    joint_velocity: np.ndarray,
    joint_torque: np.ndarray,
    rolling_velocity: np.ndarray,
    hand_from_base: np.ndarray,
    hand_rotation: np.ndarray,
    force_estimated_n: np.ndarray,
    mass_scales: np.ndarray,
    mask: np.ndarray,
    force_n: np.ndarray,
    position_m: np.ndarray,
    orientation_wxyz: np.ndarray,
    base_velocity: np.ndarray,
    out: np.ndarray,
) -> None:
    """Fill the signals (1,) of one robot.

    Args:
        rotation_base_to_world: (3, 3).
        angular_velocity: (3,) rad/s, in base.
        base_height_m: m.
        joint_position, joint_velocity, joint_torque: (22,).
        rolling_velocity: (3,) m/s, world-aligned.
        hand_from_base: (3,) m, world-aligned, from the base origin.
        hand_rotation: (3, 3) hand to world.
        force_estimated_n: (3,) N, in heading.
        mass_scales: (2,) of arm and rest.
        mask, force_n, position_m, orientation_wxyz, base_velocity: of the command.
        out: TASK_SIGNALS (1,).
    """
    s = out[0]
    s.command.orientation_wxyz[:] = orientation_wxyz
    for i in range(3):
        s.command.mask[i], s.command.force_n[i] = mask[i], force_n[i]
        s.command.position_m[i], s.command.base_velocity[i] = position_m[i], base_velocity[i]
    heading = rotation_heading_to_world(rotation_base_to_world)
    # Both rotations to heading: the error is that of heading axes.
    hand_to_heading = np.empty((3, 3))
    for i in range(3):
        column = rotate_back(heading, hand_rotation[:, i])
        hand_to_heading[0, i], hand_to_heading[1, i], hand_to_heading[2, i] = column
    error = rotation_error(rotation_from_quaternion(s.command.orientation_wxyz), hand_to_heading)
    hand, velocity = rotate_back(heading, hand_from_base), rotate_back(heading, rolling_velocity)
    s.base_height = base_height_m
    s.yaw_rate = 0.0
    s.mass_scales[ARM], s.mass_scales[REST] = mass_scales[ARM], mass_scales[REST]
    for i in range(3):
        s.angular_velocity[i] = angular_velocity[i]
        s.gravity[i] = -rotation_base_to_world[2, i]
        s.base_linear_velocity[i] = velocity[i]
        s.yaw_rate += rotation_base_to_world[2, i] * angular_velocity[i]
        s.hand_position[i] = hand[i]
        s.orientation_error[i] = error[i]
        s.force_estimated_n[i] = force_estimated_n[i]
    s.hand_position[2] += base_height_m
    for i in range(len(joint_position)):
        s.joint_position[i] = joint_position[i]
        s.joint_velocity[i] = joint_velocity[i]
        s.joint_torque[i] = joint_torque[i]


def task_signals(inputs: ControllerInput) -> np.ndarray:
    """Signals (1,) of one robot."""
    sensor, base, model, command = inputs.sensor, inputs.base, inputs.model, inputs.command
    signals = np.empty(1, TASK_SIGNALS)
    _fill(
        base.rotation_base_to_world,
        base.angular_velocity_in_base,
        base.height_m,
        sensor.joint_position,
        sensor.joint_velocity,
        sensor.joint_torque,
        rolling_velocity(model),
        model.end_effector_position,
        model.end_effector_rotation,
        inputs.force_estimated_n,
        inputs.mass_scales,
        command.mask,
        command.force_n,
        command.position_m,
        command.orientation_wxyz,
        command.base_velocity,
        signals,
    )
    return signals
