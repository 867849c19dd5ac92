"""Balance by the legs: ground forces that carry the robot and whatever pulls at its hand, mapped to joint torques."""

from dataclasses import dataclass

import numpy as np

from control.estimation.model_adaptation import ARM, REST
from control.joints import NOMINAL_BASE_HEIGHT_M, STIFFNESS, WHEEL_RADIUS_M
from control.kernels.compiled import kernel
from control.kernels.records import config_record, record
from control.kernels.small_algebra import clip, rotate, solve_positive
from control.robot_model import GRAVITY_MPS2
from control.whole_body.body_terms import BODY_TERMS, LEG_OF_JOINT
from control.whole_body.task_memory import LEFT_MINUS_RIGHT
from control.whole_body.task_signals import TASK_SIGNALS

_LEG_JOINTS = 12


@dataclass(frozen=True, slots=True)
class LegConfig:
    """Gains of height, attitude and posture.

    Attributes:
        height_stiffness: N/m.
        height_damping: N s/m.
        sway_damping: N s/m, of the base's planar velocity error. A sudden pull back and up on a floor that rises leans a light
            robot by one degree more at 100.
        tilt_stiffness: N m per unit of sine of the tilt, beside that of the legs' drives. A sudden pull aside rolls a light
            robot by up to 10.7 degrees at 20, 9.3 at 60, 7.7 at 120; but a hand that leads has to lean the trunk with it: at
            120 it pulls by up to 15 N, at 20 by 10.
        tilt_damping: N m s/rad. Without it the trunk rocks at about 1 Hz, and jerks at that rate lift its wheels and fell it;
            from 22 on, a trunk whose drives act 10 ms late begins to shake.
        posture_gain: share of the leg's position error that is added to its target, beside the drive's own.
        posture_damping: s, of joint velocity.
        offset_limit_rad: farthest target from the posture of the stance.
        traction_smoothing: weight of the newest wheel torques in the steering traction that the legs bear.
        surprise_n: what is felt at the hand beyond the force asked for, and beyond this, the legs prepare for. With 6 N the
            same pull leans it by one degree more.
    """

    height_stiffness: float = 800.0
    height_damping: float = 80.0
    sway_damping: float = 140.0
    tilt_stiffness: float = 50.0
    tilt_damping: float = 18.0
    posture_gain: float = 1.0
    posture_damping: float = 0.02
    offset_limit_rad: float = 0.9
    traction_smoothing: float = 0.2
    surprise_n: float = 3.0


LEGS = config_record(LegConfig())
"""The numbers of LegConfig."""

LEG_STATE = record(traction=())
"""Steering traction, N: push of the left wheels against the right ones beyond the balance; zero at rest."""


@kernel("void(Legs, Terms, Signals, vector, f8[:,::1])", Legs=LEGS, Terms=BODY_TERMS, Signals=TASK_SIGNALS)
def ground_forces(legs: np.record, terms: np.record, signals: np.record, hand_force: np.ndarray, out: np.ndarray) -> None:
    """Least-norm ground forces (4, 3), N, world-aligned, that balance weight, hand force, height and tilt.

    The force F and the moment M about the middle of the contacts that the ground owes are met by

        f_i = F / 4 + w x r_i,  sum_i (|r_i|^2 1 - r_i r_i^T) w = M

    with r_i from that middle to contact i.

    Args:
        hand_force: (3,) N, world-aligned, environment on hand, expected or estimated.
        out: (4, 3).
    """
    heading, velocity, command = terms.rotation_heading_to_world, signals.base_linear_velocity, signals.command
    rotation, h = terms.rotation_base_to_world, hand_force
    rate = rotate(rotation, signals.angular_velocity)
    # The trunk sways over the wheels on the legs' compliance; these forces damp it.
    sway = rotate(heading, np.array([command.base_velocity[0] - velocity[0], command.base_velocity[1] - velocity[1], 0.0]))
    fx = legs.sway_damping * sway[0] - h[0]
    fy = legs.sway_damping * sway[1] - h[1]
    mass = signals.mass_scales[ARM] * terms.arm_mass + signals.mass_scales[REST] * terms.rest_mass
    fz = mass * GRAVITY_MPS2 + legs.height_stiffness * (NOMINAL_BASE_HEIGHT_M - signals.base_height) - h[2]
    fz -= legs.height_damping * velocity[2]

    middle, arms, moment, spread = np.zeros(3), np.empty((4, 3)), np.empty(3), np.zeros((3, 3))
    for wheel in range(4):
        for i in range(3):
            middle[i] += 0.25 * terms.contacts[wheel, i]
    for wheel in range(4):
        for i in range(3):
            arms[wheel, i] = terms.contacts[wheel, i] - middle[i]
        for i in range(3):
            for j in range(3):
                square = arms[wheel, i] * arms[wheel, j]
                spread[i, j] -= square
                if i == j:
                    for k in range(3):
                        spread[k, k] += square
    cx, cy, cz = (terms.center_of_mass[0] - middle[0], terms.center_of_mass[1] - middle[1], terms.center_of_mass[2] - middle[2])
    lx, ly, lz = (
        terms.hand[0] - terms.center_of_mass[0],
        terms.hand[1] - terms.center_of_mass[1],
        terms.hand[2] - terms.center_of_mass[2],
    )
    moment[0] = cy * fz - cz * fy - (ly * h[2] - lz * h[1]) + legs.tilt_stiffness * rotation[1, 2] - legs.tilt_damping * rate[0]
    moment[1] = cz * fx - cx * fz - (lz * h[0] - lx * h[2]) - legs.tilt_stiffness * rotation[0, 2] - legs.tilt_damping * rate[1]
    moment[2] = cx * fy - cy * fx - (lx * h[1] - ly * h[0])
    solve_positive(spread, moment)
    wx, wy, wz = moment[0], moment[1], moment[2]
    for wheel in range(4):
        rx, ry, rz = arms[wheel, 0], arms[wheel, 1], arms[wheel, 2]
        out[wheel, 0] = 0.25 * fx + wy * rz - wz * ry
        out[wheel, 1] = 0.25 * fy + wz * rx - wx * rz
        out[wheel, 2] = 0.25 * fz + wx * ry - wy * rx


@kernel("f8(Terms, Signals, matrix, i8)", Terms=BODY_TERMS, Signals=TASK_SIGNALS)
def _balanced_torque(terms: np.record, signals: np.record, forces: np.ndarray, joint: int) -> float:
    """Static balance of a joint of legs or wheels under ground forces (4, 3): tau = g - J_c^T lambda, N m."""
    leg = LEG_OF_JOINT[joint]
    torque = signals.mass_scales[REST] * terms.gravity_torque[joint]
    for i in range(3):
        torque -= terms.contact_jacobian[joint, i] * forces[leg, i]
    return torque


@kernel(
    "f8(Legs, Terms, Signals, f8[:,::1], vector, State, f8[:], f8[:])",
    Legs=LEGS,
    Terms=BODY_TERMS,
    Signals=TASK_SIGNALS,
    State=LEG_STATE,
)
def leg_targets(
    legs: np.record,
    terms: np.record,
    signals: np.record,
    forces: np.ndarray,
    posture: np.ndarray,
    state: np.record,
    targets: np.ndarray,
    wheel_torque: np.ndarray,
) -> float:
    """Leg targets (12,), rad, and wheel torques (4,), N m, of the balance.

    target = posture + clip(tau / K_p + k (posture - q) - d dq, +-limit)

    Args:
        forces: (4, 3) N, ground forces of the balance; what the legs bear beyond it is added to them.
        posture: (12,) rad, of the stance.

    Returns:
        Load of the least loaded wheel over the mean load: 1 evenly loaded, 0 about to lift.
    """
    load, lightest, difference = 0.0, forces[0, 2], 0.0
    for wheel in range(4):
        load += 0.25 * forces[wheel, 2]
        lightest = min(lightest, forces[wheel, 2])
        wheel_torque[wheel] = _balanced_torque(terms, signals, forces, _LEG_JOINTS + wheel)
        difference += LEFT_MINUS_RIGHT[wheel] * (signals.joint_torque[_LEG_JOINTS + wheel] - wheel_torque[wheel])
    # Skid steering pushes the left wheels against the right ones beyond the balance: the legs must bear that as well.
    # The common part stays out; fed forward it would drive the trunk's sway over the wheels.
    state.traction += legs.traction_smoothing * (difference / (4.0 * WHEEL_RADIUS_M) - state.traction)
    for wheel in range(4):
        for i in range(3):
            forces[wheel, i] += state.traction * LEFT_MINUS_RIGHT[wheel] * terms.rotation_heading_to_world[i, 0]
    for joint in range(_LEG_JOINTS):
        q, dq = signals.joint_position[joint], signals.joint_velocity[joint]
        offset = _balanced_torque(terms, signals, forces, joint) / STIFFNESS[joint]
        offset += legs.posture_gain * (posture[joint] - q) - legs.posture_damping * dq
        targets[joint] = posture[joint] + clip(offset, -legs.offset_limit_rad, legs.offset_limit_rad)
    return lightest / load
