"""The reward, Sec. II.E, in two parts, one for each value head: locomotion and end effector. Judged by simulator truth."""

from dataclasses import dataclass

import numpy as np

from control.joints import ARM_SLICE, LEG_SLICE, NOMINAL_BASE_HEIGHT_M, NOMINAL_POSITION


@dataclass(frozen=True, slots=True)
class RewardScales:
    """Weight of each term, and its tolerance where it is an exponential. Narrow kernels sit beside wide ones: the wide one
    finds the goal, the narrow one still has a slope close to it.

    Attributes:
        velocity, velocity_width, velocity_fine, velocity_fine_width: exp(-(error / 1 m/s)^2 / width).
        yaw, yaw_width, yaw_fine, yaw_fine_width: the same of the yaw rate.
        lead: penalty per N of the force that a leading person has to exert: the base follows too slowly.
        position, position_m, orientation_rad: exp(-|error|_1 / position_m - |e_R|_1 / orientation_rad), the paper's r_pos.
        position_fine, position_fine_m: exp(-|error|_1 / position_fine_m).
        orientation_fine, orientation_fine_rad: exp(-|e_R|_1 / orientation_fine_rad); not while dragging, where what is held
            turns the hand and holding against it costs force.
        force, force_n2, force_fine, force_fine_n2: exp(-|error|^2 / n2), the paper's r_force.
        heave, rocking, tilt, height, leg_torque, leg_posture, leg_smoothness: penalties of squares.
        arm_torque, arm_velocity, arm_smoothness: penalties of squares.
        fall_locomotion, fall_end_effector: instead of the sums at a fall.
        overall: factor of both parts, which keeps values near 1.
    """

    velocity: float = 1.0
    velocity_width: float = 0.1
    velocity_fine: float = 0.6
    velocity_fine_width: float = 0.005
    yaw: float = 0.4
    yaw_width: float = 0.1
    yaw_fine: float = 1.0
    yaw_fine_width: float = 0.02
    lead: float = 0.3
    position: float = 1.0
    position_m: float = 0.15
    orientation_rad: float = 1.5
    position_fine: float = 0.4
    position_fine_m: float = 0.012
    orientation_fine: float = 1.5
    orientation_fine_rad: float = 0.06
    force: float = 1.0
    force_n2: float = 60.0
    force_fine: float = 1.6
    force_fine_n2: float = 1.5
    heave: float = 1.0
    rocking: float = 0.05
    tilt: float = 4.0
    height: float = 20.0
    leg_torque: float = 2e-4
    leg_posture: float = 0.3
    leg_smoothness: float = 0.01
    arm_torque: float = 2e-4
    arm_velocity: float = 0.002
    arm_smoothness: float = 0.01
    fall_locomotion: float = -5.0
    fall_end_effector: float = -2.0
    overall: float = 0.1


@dataclass(frozen=True, slots=True)
class RewardInput:
    """Truth of a batch after a control period, references as applied; heading frame.

    Attributes:
        velocity_error: (n, 2) m/s. yaw_error, heave, height: (n,). rocking, gravity_xy: (n, 2), in base.
        position_error: (n, 3) m, zero on force axes. orientation_error: (n, 3) rad. drags: (n,) bool.
        force_error: (n, 3) N, zero on position axes. lead_force: (n,) N, size of a leading person's force, zero without one.
        joint_position, joint_velocity, joint_torque, action_change: (n, 22). fallen: (n,) bool.
    """

    velocity_error: np.ndarray
    yaw_error: np.ndarray
    heave: np.ndarray
    height: np.ndarray
    rocking: np.ndarray
    gravity_xy: np.ndarray
    position_error: np.ndarray
    orientation_error: np.ndarray
    drags: np.ndarray
    force_error: np.ndarray
    lead_force: np.ndarray
    joint_position: np.ndarray
    joint_velocity: np.ndarray
    joint_torque: np.ndarray
    action_change: np.ndarray
    fallen: np.ndarray


def rewards(scales: RewardScales, state: RewardInput) -> np.ndarray:
    """(n, 2): locomotion and end effector."""
    k = scales
    velocity, yaw = _square(state.velocity_error), state.yaw_error**2
    posture = state.joint_position[:, LEG_SLICE] - NOMINAL_POSITION[LEG_SLICE]
    locomotion = (
        k.velocity * np.exp(-velocity / k.velocity_width)
        + k.velocity_fine * np.exp(-velocity / k.velocity_fine_width)
        + k.yaw * np.exp(-yaw / k.yaw_width)
        + k.yaw_fine * np.exp(-yaw / k.yaw_fine_width)
        - k.lead * state.lead_force
        - k.heave * state.heave**2
        - k.rocking * _square(state.rocking)
        - k.tilt * _square(state.gravity_xy)
        - k.height * (state.height - NOMINAL_BASE_HEIGHT_M) ** 2
        - k.leg_torque * _square(state.joint_torque[:, LEG_SLICE])
        - k.leg_posture * _square(posture)
        - k.leg_smoothness * _square(state.action_change[:, : ARM_SLICE.start])
    )
    position, orientation = np.abs(state.position_error).sum(axis=1), np.abs(state.orientation_error).sum(axis=1)
    force = _square(state.force_error)
    end_effector = (
        k.position * np.exp(-position / k.position_m - orientation / k.orientation_rad)
        + k.position_fine * np.exp(-position / k.position_fine_m)
        + k.orientation_fine * np.where(state.drags, 0.0, np.exp(-orientation / k.orientation_fine_rad))
        + k.force * np.exp(-force / k.force_n2)
        + k.force_fine * np.exp(-force / k.force_fine_n2)
        - k.arm_torque * _square(state.joint_torque[:, ARM_SLICE])
        - k.arm_velocity * _square(state.joint_velocity[:, ARM_SLICE])
        - k.arm_smoothness * _square(state.action_change[:, ARM_SLICE])
    )
    locomotion = np.where(state.fallen, k.fall_locomotion, locomotion)
    end_effector = np.where(state.fallen, k.fall_end_effector, end_effector)
    return k.overall * np.stack([locomotion, end_effector], axis=1)


def _square(values: np.ndarray) -> np.ndarray:
    return np.einsum("nk,nk->n", values, values)
