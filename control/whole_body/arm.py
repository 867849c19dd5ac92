"""Hand tracking and force regulation by the arm: resolved velocity in an inertia-weighted joint loop plus a force term.

    tau = g + M K_v (dq_d - dq) + k_d dq_d + J^T F

A Jacobian-transpose spring of the same stiffness is unstable on the wrist at 50 Hz; weighting by the joint inertia M gives
every joint the same bandwidth K_v.
"""

from dataclasses import dataclass

import numpy as np

from control.command.axis_mask import force_share
from control.command.limits import CommandLimits
from control.estimation.rolling_contact import rolling_velocity
from control.frames import rotation_error, rotation_from_quaternion
from control.joints import ARM_SLICE, DAMPING, STIFFNESS, TORQUE_LIMIT
from control.timing import CONTROL_PERIOD_S
from control.whole_body.controller import ControllerInput
from control.whole_body.reference_correction import NO_CORRECTION, ReferenceCorrection


@dataclass(frozen=True, slots=True)
class ArmConfig:
    """Gains of the arm.

    Attributes:
        position_gain: 1/s, reference velocity per position error.
        position_error_limit_m: error beyond which the approach speed grows no more.
        orientation_gain: 1/s. With less, a mass that the model does not know of turns the hand by degrees.
        orientation_scale_m: what one radian costs in metres when position and orientation conflict.
        damping: of the damped least squares, in m: a reach that stretches the arm gets slow instead of violent.
        joint_speed_limit_rps: of the resolved joint velocity.
        velocity_gain: K_v, 1/s.
        integral_gain: N per m s, of the hand force that removes what the model does not know about position axes.
        integral_limit_n: of that force. More would, with what `load_gain` adds, drag a pressing hand over its friction.
        force_gain: N per N of force error on force axes, on top of the commanded force fed forward. With more, a stiff
            contact rings: the estimate is late.
        force_integral_gain: 1/s.
        force_integral_limit_n: of the integral part.
        force_error_limit_n: force errors beyond it add no more, and the integral waits.
        force_velocity_feedback: share of the hand's velocity that force axes do not brake; below 1 the hand is damped.
        contact_share: of the commanded force, estimated, that counts as contact; less a noise of contact_noise_n. Until then
            a force axis moves towards contact under velocity control.
        contact_noise_n: smaller commanded forces need no contact.
        approach_gain: m/s per N of the commanded force, of the hand towards contact: a small
            commanded force gives a slow approach.
        approach_speed_limit_mps: of that speed.
        load_gain: share of the estimated force that axes in motion carry, so that a load deflects them less.
        load_limit_n: of that share.
        limit_margin_rad: joints this close to an end are not driven further.
    """

    position_gain: float = 6.0
    position_error_limit_m: float = 0.1
    orientation_gain: float = 8.0
    orientation_scale_m: float = 0.15
    damping: float = 0.04
    joint_speed_limit_rps: float = 3.0
    velocity_gain: float = 15.0
    integral_gain: float = 150.0
    integral_limit_n: float = 4.5
    force_gain: float = 0.2
    force_integral_gain: float = 5.0
    force_integral_limit_n: float = 6.0
    force_error_limit_n: float = 8.0
    force_velocity_feedback: float = 0.5
    contact_share: float = 0.3
    contact_noise_n: float = 1.0
    approach_gain: float = 0.03
    approach_speed_limit_mps: float = 0.3
    load_gain: float = 0.8
    load_limit_n: float = 10.0
    limit_margin_rad: float = 0.1


class ArmControl:
    """Arm targets from the hand's references. Integrates the error of each axis while the axis keeps its mode."""

    def __init__(self, config: ArmConfig, lower: np.ndarray, upper: np.ndarray, limits: CommandLimits) -> None:
        """`lower`, `upper`: (6,) rad, ends of the arm joints. `limits` hold the box that the hand does not leave by itself."""
        self.config = config
        self._workspace = np.transpose([limits.position_x_m, limits.position_y_m, limits.position_z_m])
        self._lower = lower + config.limit_margin_rad
        self._upper = upper - config.limit_margin_rad
        self.reset()

    def reset(self) -> None:
        """Forget integrals and the last reference."""
        self._position_integral = np.zeros(3)
        self._force_integral = np.zeros(3)
        self._last_reference: np.ndarray | None = None

    def step(
        self,
        inputs: ControllerInput,
        rotation_heading_to_world: np.ndarray,
        on_force: np.ndarray,
        correction: ReferenceCorrection = NO_CORRECTION,
    ) -> np.ndarray:
        """Position targets (6,), rad, that carry the torque of the law above; `on_force` (3,) is that of this tick."""
        config, model = self.config, inputs.model
        rows = model.joint_rows[ARM_SLICE]
        jacobian = model.end_effector_jacobian[:, rows]
        q, dq = inputs.sensor.joint_position[ARM_SLICE], inputs.sensor.joint_velocity[ARM_SLICE]
        heading = rotation_heading_to_world

        twist = self._reference_twist(inputs, heading, jacobian @ dq, on_force, correction)
        joint_velocity = self._resolve(jacobian, twist)
        joint_velocity[(q > self._upper) & (joint_velocity > 0.0)] = 0.0
        joint_velocity[(q < self._lower) & (joint_velocity < 0.0)] = 0.0

        force = heading @ (self._hand_force(inputs, on_force) + on_force * correction.hand_force)
        inertia = model.mass_matrix[np.ix_(rows, rows)]
        torque = (
            model.gravity[rows]
            + inertia @ (config.velocity_gain * (joint_velocity - dq))
            + DAMPING[ARM_SLICE] * joint_velocity
            + jacobian[:3].T @ force
        )
        limit = TORQUE_LIMIT[ARM_SLICE]
        return q + np.clip(torque, -limit, limit) / STIFFNESS[ARM_SLICE]

    def on_force(self, inputs: ControllerInput) -> np.ndarray:
        """Share (3,), 0 to 1, of force control per axis: 0 on position axes and before contact."""
        config, command, estimated = self.config, inputs.command, inputs.force_estimated_n
        axes = zip(command.mask, command.force_n, estimated, strict=True)
        return np.array([force_share(*axis, config.contact_share, config.contact_noise_n) for axis in axes])

    def _reference_twist(
        self,
        inputs: ControllerInput,
        heading: np.ndarray,
        arm_twist: np.ndarray,
        on_force: np.ndarray,
        correction: ReferenceCorrection,
    ) -> np.ndarray:
        """Hand twist (6,), world-aligned, that the arm should add to the base's motion."""
        config, model, command, base = self.config, inputs.model, inputs.command, inputs.base
        lever = model.end_effector_position
        position = heading.T @ lever
        position[2] += base.height_m
        error = command.position_m - position
        on_position = 1.0 - command.mask
        self._integrate_position(error, on_position)

        last = self._last_reference
        reference_velocity = np.zeros(3) if last is None else (command.position_m - last) / CONTROL_PERIOD_S * on_position
        self._last_reference = command.position_m

        # The heading frame follows the base over the ground but not its tilting and heaving: the arm takes those out.
        rotation = base.rotation_base_to_world
        rate = rotation @ base.angular_velocity_in_base
        heave = rolling_velocity(model)[2]
        rocking = np.array([rate[1] * lever[2], -rate[0] * lever[2], rate[0] * lever[1] - rate[1] * lever[0] + heave])

        limit = config.position_error_limit_m
        tracking = reference_velocity + config.position_gain * np.clip(error, -limit, limit) - heading.T @ rocking
        fastest = config.approach_speed_limit_mps
        approach = np.clip(-config.approach_gain * command.force_n, -fastest, fastest)
        # Where nothing is met, the search ends at the border of the workspace.
        to_lower, to_upper = self._workspace - position
        approach = np.clip(approach, config.position_gain * to_lower, config.position_gain * to_upper)
        motion = on_position * (tracking + correction.hand_velocity) + command.mask * approach
        yielding = config.force_velocity_feedback * (heading.T @ arm_twist[:3])
        linear = heading @ ((1.0 - on_force) * motion + on_force * yielding)

        target = heading @ rotation_from_quaternion(command.orientation_wxyz)
        angular = config.orientation_gain * rotation_error(target, model.end_effector_rotation)
        angular[:2] -= rate[:2]
        return np.concatenate([linear, angular + heading @ correction.hand_angular_velocity])

    def _resolve(self, jacobian: np.ndarray, twist: np.ndarray) -> np.ndarray:
        """Damped least-squares joint velocity (6,) of a hand twist (6,)."""
        config = self.config
        scale = np.array([1.0, 1.0, 1.0] + [config.orientation_scale_m] * 3)
        scaled = scale[:, None] * jacobian
        normal = scaled.T @ scaled
        normal[np.diag_indices(6)] += config.damping**2
        velocity = np.linalg.solve(normal, scaled.T @ (scale * twist))
        return velocity * min(1.0, config.joint_speed_limit_rps / max(np.abs(velocity).max(), 1e-9))

    def _integrate_position(self, error: np.ndarray, on_position: np.ndarray) -> None:
        limit = self.config.integral_limit_n / self.config.integral_gain
        integral = self._position_integral + error * CONTROL_PERIOD_S
        self._position_integral = np.clip(integral, -limit, limit) * on_position

    def _hand_force(self, inputs: ControllerInput, on_force: np.ndarray) -> np.ndarray:
        """Force (3,), N, heading frame, that the hand shall exert on the environment."""
        config, command, measured = self.config, inputs.command, inputs.force_estimated_n
        error = measured - command.force_n
        near = np.clip(error, -config.force_error_limit_n, config.force_error_limit_n)
        limit = config.force_integral_limit_n / config.force_integral_gain
        integral = self._force_integral + np.where(near == error, error, 0.0) * CONTROL_PERIOD_S
        self._force_integral = np.clip(integral, -limit, limit) * command.mask
        regulation = config.force_gain * near + config.force_integral_gain * self._force_integral - command.force_n
        load = np.clip(config.load_gain * measured, -config.load_limit_n, config.load_limit_n)
        return on_force * regulation - (1.0 - on_force) * load + config.integral_gain * self._position_integral
