"""Balance by the legs: ground forces that carry the robot and whatever pulls at its hand, mapped to joint torques."""

from dataclasses import dataclass

import numpy as np

from control.estimation.rolling_contact import rolling_velocity
from control.frames import skew
from control.joints import (
    LEG_SLICE,
    NOMINAL_BASE_HEIGHT_M,
    STIFFNESS,
    WHEEL_RADIUS_M,
    WHEEL_SLICE,
)
from control.robot_model import GRAVITY_MPS2
from control.whole_body.controller import ControllerInput
from control.whole_body.stance import Stance

_IDENTITY = np.eye(3)
_LEFT_MINUS_RIGHT = np.array([1.0, -1.0, 1.0, -1.0])


@dataclass(frozen=True, slots=True)
class LegConfig:
    """Gains of height, attitude and posture.

    Attributes:
        height_stiffness: N/m.
        height_damping: N s/m.
        sway_damping: N s/m, of the base's planar velocity error.
        tilt_stiffness: N m per unit of sine of the tilt.
        tilt_damping: N m s/rad.
        posture_gain: share of the leg's position error that is added to its target, beside the drive's own.
        posture_damping: s, of joint velocity.
        offset_limit_rad: farthest target from the posture of the stance.
        traction_smoothing: weight of the newest wheel torques in the steering traction that the legs bear.
    """

    height_stiffness: float = 800.0
    height_damping: float = 80.0
    sway_damping: float = 100.0
    tilt_stiffness: float = 90.0
    tilt_damping: float = 6.0
    posture_gain: float = 1.0
    posture_damping: float = 0.02
    offset_limit_rad: float = 0.9
    traction_smoothing: float = 0.2


@dataclass(frozen=True, slots=True)
class LegTargets:
    """Result of one tick.

    Attributes:
        position: (12,) rad, of the legs.
        wheel_torque: (4,) N m, that the balance asks of the wheels.
        support: load of the least loaded wheel over the mean load: 1 evenly loaded, 0 about to lift.
    """

    position: np.ndarray
    wheel_torque: np.ndarray
    support: float


class LegControl:
    """Leg targets and wheel torques for the balance."""

    def __init__(self, config: LegConfig, stance: Stance) -> None:
        self.config = config
        self._stance = stance
        self.reset()

    def reset(self) -> None:
        """Forget the steering traction and the shift of the stance."""
        self._stance.reset()
        self._traction = 0.0

    def step(
        self, inputs: ControllerInput, rotation_heading_to_world: np.ndarray, hand_force_in_world: np.ndarray
    ) -> LegTargets:
        """Targets of one tick.

        Args:
            inputs: of the tick.
            rotation_heading_to_world: (3, 3).
            hand_force_in_world: (3,) N, environment on hand, expected or estimated.
        """
        config, model = self.config, inputs.model
        forces = self.ground_forces(inputs, rotation_heading_to_world, hand_force_in_world)
        # Static balance of the joint rows: tau = g - J_c^T lambda.
        jacobians = model.wheel_contact_jacobians.reshape(12, -1)
        torque = model.gravity - forces.reshape(12) @ jacobians
        wheel_torque = torque[model.joint_rows[WHEEL_SLICE]]
        # Skid steering pushes the left wheels against the right ones beyond the balance: the legs must bear that as well.
        # The common part stays out; fed forward it would drive the trunk's sway over the wheels.
        traction = (inputs.sensor.joint_torque[WHEEL_SLICE] - wheel_torque) @ _LEFT_MINUS_RIGHT / (4.0 * WHEEL_RADIUS_M)
        self._traction += config.traction_smoothing * (traction - self._traction)
        forward = rotation_heading_to_world[:, 0]
        torque -= np.outer(self._traction * _LEFT_MINUS_RIGHT, forward).reshape(12) @ jacobians
        leg_torque = torque[model.joint_rows[LEG_SLICE]]
        q, dq = inputs.sensor.joint_position[LEG_SLICE], inputs.sensor.joint_velocity[LEG_SLICE]
        posture = self._stance.step(forces[:, 2], model.wheel_contact_positions @ rotation_heading_to_world)
        offset = leg_torque / STIFFNESS[LEG_SLICE] + config.posture_gain * (posture - q) - config.posture_damping * dq
        targets = posture + np.clip(offset, -config.offset_limit_rad, config.offset_limit_rad)
        support = float(forces[:, 2].min() / forces[:, 2].mean())
        return LegTargets(targets, wheel_torque, support)

    def ground_forces(
        self, inputs: ControllerInput, rotation_heading_to_world: np.ndarray, hand_force_in_world: np.ndarray
    ) -> np.ndarray:
        """Least-norm ground forces (4, 3), N, world-aligned, that balance weight, hand force, height and tilt."""
        config, model, base = self.config, inputs.model, inputs.base
        rotation, heading = base.rotation_base_to_world, rotation_heading_to_world
        center = model.center_of_mass
        rate = rotation @ base.angular_velocity_in_base
        velocity = rolling_velocity(model)
        up = rotation[:, 2]

        wrench = np.empty(6)
        wrench[:3] = -hand_force_in_world
        wrench[2] += (
            model.total_mass * GRAVITY_MPS2
            + config.height_stiffness * (NOMINAL_BASE_HEIGHT_M - base.height_m)
            - config.height_damping * velocity[2]
        )
        # The trunk sways over the wheels on the legs' compliance; these forces damp it.
        planar = heading[:, :2]
        wrench[:3] += config.sway_damping * (planar @ (inputs.command.base_velocity[:2] - velocity @ planar))
        wrench[3:] = -skew(model.end_effector_position - center) @ hand_force_in_world
        wrench[3] += config.tilt_stiffness * up[1] - config.tilt_damping * rate[0]
        wrench[4] += -config.tilt_stiffness * up[0] - config.tilt_damping * rate[1]

        # f = G^T (G G^T)^-1 w with the grasp matrix G = [1 ...; skew(r_i) ...], its products written out.
        arms = model.wheel_contact_positions - center
        normal = np.empty((6, 6))
        normal[:3, :3] = len(arms) * _IDENTITY
        normal[3:, :3] = skew(arms.sum(axis=0))
        normal[:3, 3:] = normal[3:, :3].T
        normal[3:, 3:] = np.vdot(arms, arms) * _IDENTITY - arms.T @ arms
        multipliers = np.linalg.solve(normal, wrench)
        return multipliers[:3] + arms @ skew(multipliers[3:]).T
