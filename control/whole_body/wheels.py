"""Driving and turning by four wheels of fixed heading (skid steering)."""

from dataclasses import dataclass

import numpy as np

from control.joints import DAMPING, TORQUE_LIMIT, WHEEL_RADIUS_M, WHEEL_SLICE
from control.timing import CONTROL_PERIOD_S
from control.whole_body.controller import ControllerInput
from control.whole_body.legs import LegTargets
from control.whole_body.reference_correction import NO_CORRECTION, ReferenceCorrection

HIPS_AND_THIGHS = np.array([0, 1, 3, 4, 6, 7, 9, 10])


@dataclass(frozen=True, slots=True)
class WheelConfig:
    """Gains of the drive.

    Attributes:
        yaw_gain: of the yaw rate error; skid steering turns less than its kinematics.
        yaw_integral_gain: 1/s.
        yaw_integral_limit_rad: of the integrated error.
        effort_start, effort_end: shares of its torque limit. Turning scrubs the wheels sideways and loads hips and thighs:
            as the busiest of them goes from one to the other, the turn is given up. Saturated (1.0), a leg would splay and
            the robot fall.
        full_turn_support: of LegTargets.support: below it the turn is given up in proportion.
        relief_time_s: in which a turn that was given up is taken up again.
        hold_gain: 1/s, of the wheel angles that are held while the robot is commanded to stand.
        hold_limit_rps: of the correction.
        rest_velocity: base velocity (m/s, rad/s alike) below which the robot is commanded to stand.
    """

    yaw_gain: float = 0.8
    yaw_integral_gain: float = 2.0
    yaw_integral_limit_rad: float = 0.8
    effort_start: float = 0.9
    effort_end: float = 1.0
    full_turn_support: float = 0.3
    relief_time_s: float = 0.5
    hold_gain: float = 2.0
    hold_limit_rps: float = 1.0
    rest_velocity: float = 0.01


class WheelControl:
    """Wheel velocity targets. Holds the wheel angles while standing."""

    def __init__(self, config: WheelConfig, joint_damping: np.ndarray, joint_friction: np.ndarray) -> None:
        """`joint_damping` (4,) N m s/rad and `joint_friction` (4,) N m of the wheels, compensated while they roll."""
        self.config = config
        self._joint_damping = joint_damping
        self._joint_friction = joint_friction
        self.reset()

    def reset(self) -> None:
        """Forget the integral and the held angles."""
        self._yaw_integral = 0.0
        self._relief = 1.0
        self._held: np.ndarray | None = None

    def step(
        self,
        inputs: ControllerInput,
        lateral_m: np.ndarray,
        legs: LegTargets,
        shift_mps: float,
        correction: ReferenceCorrection = NO_CORRECTION,
    ) -> np.ndarray:
        """Wheel velocity targets (4,), rad/s.

        Args:
            inputs: of the tick.
            lateral_m: (4,) distance of each contact to the left of the base.
            legs: balance of this tick; its wheel torque is fed forward through the drive's damping gain.
            shift_mps: speed at which the stance moves the wheels ahead under the trunk.
            correction: of the base velocity; its turn is given up with the rest.
        """
        config = self.config
        forward, _, yaw = inputs.command.base_velocity
        angle = inputs.sensor.joint_position[WHEEL_SLICE]
        feed_forward = legs.wheel_torque / DAMPING[WHEEL_SLICE]
        shift = shift_mps / WHEEL_RADIUS_M
        if max(abs(forward), abs(yaw)) < config.rest_velocity:
            self._yaw_integral = 0.0
            if self._held is None:
                self._held = angle.copy()
            self._held += shift * CONTROL_PERIOD_S
            hold = config.hold_gain * (self._held - angle)
            return feed_forward + shift + np.clip(hold, -config.hold_limit_rps, config.hold_limit_rps)
        self._held = None

        rotation = inputs.base.rotation_base_to_world
        error = yaw - rotation[2] @ inputs.base.angular_velocity_in_base
        limit = config.yaw_integral_limit_rad
        if abs(yaw) < config.rest_velocity:
            self._yaw_integral = 0.0
        else:
            self._yaw_integral = float(np.clip(self._yaw_integral + error * CONTROL_PERIOD_S, -limit, limit))
        turn = self._relieve(inputs, legs.support) * (
            yaw + config.yaw_gain * error + config.yaw_integral_gain * self._yaw_integral + correction.base_velocity[1]
        )
        rolling = shift + (forward + correction.base_velocity[0] - turn * lateral_m) / WHEEL_RADIUS_M
        drag = self._joint_damping * rolling + self._joint_friction * np.tanh(rolling)
        return rolling + feed_forward + drag / DAMPING[WHEEL_SLICE]

    def _relieve(self, inputs: ControllerInput, support: float) -> float:
        """Share of the turn, 0 to 1, that the legs can bear; falls at once and recovers slowly."""
        config = self.config
        effort = float(np.max(np.abs(inputs.sensor.joint_torque[HIPS_AND_THIGHS]) / TORQUE_LIMIT[HIPS_AND_THIGHS]))
        bearable = min(1.0, max(0.0, (config.effort_end - effort) / (config.effort_end - config.effort_start)))
        bearable *= min(1.0, max(0.0, support / config.full_turn_support))
        self._relief = min(bearable, self._relief + CONTROL_PERIOD_S / config.relief_time_s)
        return self._relief
