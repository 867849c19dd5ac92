"""What the laws of arm, legs and wheels need of the rigid-body model at one configuration, in one record per robot."""

import numpy as np

from control.frames import rotation_heading_to_world
from control.kernels.compiled import kernel
from control.kernels.records import record
from control.robot_model import RobotModel

BODY_TERMS = record(
    rotation_base_to_world=(3, 3),
    rotation_heading_to_world=(3, 3),
    hand=3,
    center_of_mass=3,
    contacts=(4, 3),
    hand_jacobian=(6, 6),
    contact_jacobian=(16, 3),
    gravity_torque=22,
    arm_inertia=(6, 6),
    arm_mass=(),
    rest_mass=(),
)
"""Vectors are world-aligned and start at the base origin; masses are nominal.

Fields:
    hand, center_of_mass: m.
    contacts: m, lowest points of the wheels.
    hand_jacobian: linear (3 rows), then angular, of the arm's joints (columns).
    contact_jacobian: by joint of legs and wheels, of the contact point of its own leg.
    gravity_torque: N m, that holds each joint against gravity.
    arm_inertia: kg m^2, mass matrix of the arm's joints without a load: rate feedback that grows with a tool that was told
        but is not there shakes the arm, and the robot falls.
    arm_mass, rest_mass: kg, of the arm and of the rest of the robot.
"""

LEG_OF_JOINT = (0, 0, 0, 1, 1, 1, 2, 2, 2, 3, 3, 3, 0, 1, 2, 3)
"""The leg that each joint of legs and wheels belongs to."""

_FIRST_ARM_JOINT = 16
_HAND_ROW = 12


@kernel("void(f8, vector, f8[:,:], f8[:,:])")
def _without_load(mass: float, center: np.ndarray, hand_jacobian: np.ndarray, inertia: np.ndarray) -> None:
    """Take m J^T J of a point mass off a mass matrix (6, 6), J = J_v - [c]x J_w the linear Jacobian of its centre c."""
    linear = np.empty((3, 6))
    for joint in range(6):
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            turned = hand_jacobian[3 + j, joint] * center[k] - hand_jacobian[3 + k, joint] * center[j]
            linear[i, joint] = hand_jacobian[i, joint] + turned
    for row in range(6):
        for column in range(6):
            for i in range(3):
                inertia[row, column] -= mass * linear[i, row] * linear[i, column]


@kernel(
    "void(f8[:,::1], vector, matrix, matrix, f8[::1,:], vector, vector, i8[:], f8, f8, f8, vector, Terms[::1])",
    Terms=BODY_TERMS,
)
def _fill(
    rotation_base_to_world: np.ndarray,
    hand: np.ndarray,
    contacts: np.ndarray,
    wrench_jacobian: np.ndarray,
    mass_matrix: np.ndarray,
    center_of_mass: np.ndarray,
    gravity: np.ndarray,
    joint_rows: np.ndarray,
    arm_mass: float,
    total_mass: float,
    load_mass: float,
    load_lever: np.ndarray,
    out: np.ndarray,
) -> None:
    """Pick the terms (1,) of one robot out of the model's; shapes and units as in RobotModel and BODY_TERMS.

    Args:
        joint_rows: (22,) generalized row of each joint.
        arm_mass, total_mass: kg.
        load_mass, load_lever: kg, and m from the hand, world-aligned, where it is inert.
    """
    terms = out[0]
    terms.arm_mass, terms.rest_mass = arm_mass, total_mass - arm_mass
    heading = rotation_heading_to_world(rotation_base_to_world)
    for i in range(3):
        terms.center_of_mass[i] = center_of_mass[i]
        terms.hand[i] = hand[i]
        for j in range(3):
            terms.rotation_base_to_world[i, j] = rotation_base_to_world[i, j]
            terms.rotation_heading_to_world[i, j] = heading[i, j]
        for wheel in range(4):
            terms.contacts[wheel, i] = contacts[wheel, i]
        for joint in range(_FIRST_ARM_JOINT):
            terms.contact_jacobian[joint, i] = wrench_jacobian[3 * LEG_OF_JOINT[joint] + i, joint_rows[joint]]
    for joint in range(len(joint_rows)):
        terms.gravity_torque[joint] = gravity[joint_rows[joint]]
    for i in range(6):
        row = joint_rows[_FIRST_ARM_JOINT + i]
        for j in range(6):
            terms.hand_jacobian[j, i] = wrench_jacobian[_HAND_ROW + j, row]
            terms.arm_inertia[i, j] = mass_matrix[row, joint_rows[_FIRST_ARM_JOINT + j]]
    if load_mass > 0.0:
        _without_load(load_mass, load_lever, terms.hand_jacobian, terms.arm_inertia)


def body_terms(model: RobotModel) -> np.ndarray:
    """Terms (1,) of one robot, whose model is up to date."""
    terms = np.empty(1, BODY_TERMS)
    _fill(
        model.rotation_base_to_world,
        model.end_effector_position,
        model.wheel_contact_positions,
        model.wrench_jacobian,
        model.mass_matrix,
        model.center_of_mass,
        model.gravity,
        model.joint_rows,
        model.arm_mass,
        model.total_mass,
        model.load_mass,
        model.load_lever,
        terms,
    )
    return terms
