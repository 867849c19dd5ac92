"""What a memoryless policy cannot know from one tick: integrals of its errors, the reference's motion, the held wheel angles.

The integrals are those of the model-based controller (arm_control, wheel_control), so a policy that sees them can be as free
of steady errors. Their limits belong to the policy's observation: trained weights depend on them. Works on one robot (batch
shape ()) and on many at once (batch shape (n,)).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from control.joints import WHEEL_RADIUS_M, WHEEL_SLICE
from control.timing import CONTROL_PERIOD_S

_LEFT_MINUS_RIGHT = np.array([1.0, -1.0, 1.0, -1.0])


@dataclass(frozen=True, slots=True)
class TaskMemoryConfig:
    """Attributes:
    position_limit_ms: m s, of the integrated position error.
    force_error_limit_n: force errors beyond it are not integrated.
    force_limit_ns: N s, of the integrated force error.
    yaw_limit_rad: of the integrated yaw rate error.
    rest_velocity: base velocity command (m/s, rad/s alike) below which the wheels are held.
    traction_smoothing: weight of the newest wheel torques in the steering traction.
    """

    position_limit_ms: float = 0.03
    force_error_limit_n: float = 8.0
    force_limit_ns: float = 1.2
    yaw_limit_rad: float = 0.8
    rest_velocity: float = 0.01
    traction_smoothing: float = 0.2


@dataclass(frozen=True, slots=True)
class TaskSignals:
    """One tick of one robot or of many: every array has the batch shape in front. Forces and references in heading.

    Attributes:
        angular_velocity: (..., 3) rad/s, in base.
        gravity: (..., 3) unit vector of gravity, in base.
        base_linear_velocity: (..., 3) m/s, of rolling contact (control.estimation.rolling_contact), in heading.
        base_height: (..., 1) m, from leg kinematics.
        yaw_rate: (..., 1) rad/s, about the vertical.
        joint_position, joint_velocity, joint_torque: (..., 22).
        hand_position: (..., 3) m, from kinematics.
        orientation_error: (..., 3) rad, rotation vector from the hand to its reference.
        force_estimated_n: (..., 3) N.
        mask, force, position: (..., 3) and orientation (..., 4) wxyz, base_velocity (..., 3): the applied command.
    """

    angular_velocity: np.ndarray
    gravity: np.ndarray
    base_linear_velocity: np.ndarray
    base_height: np.ndarray
    yaw_rate: np.ndarray
    joint_position: np.ndarray
    joint_velocity: np.ndarray
    joint_torque: np.ndarray
    hand_position: np.ndarray
    orientation_error: np.ndarray
    force_estimated_n: np.ndarray
    mask: np.ndarray
    force: np.ndarray
    position: np.ndarray
    orientation: np.ndarray
    base_velocity: np.ndarray

    @property
    def velocity_error(self) -> np.ndarray:
        """(..., 2) forward m/s and yaw rad/s, command minus measurement."""
        forward = self.base_velocity[..., :1] - self.base_linear_velocity[..., :1]
        return np.concatenate([forward, self.base_velocity[..., 2:] - self.yaw_rate], axis=-1)

    @property
    def position_error(self) -> np.ndarray:
        """(..., 3) m, reference minus hand, zero on force axes."""
        return (1.0 - self.mask) * (self.position - self.hand_position)

    @property
    def force_error(self) -> np.ndarray:
        """(..., 3) N, estimate minus reference, zero on position axes."""
        return self.mask * (self.force_estimated_n - self.force)


class TaskMemory:
    """Integrates once per control period.

    Attributes:
        position_integral: (..., 3) m s; zero on force axes.
        force_integral: (..., 3) N s; zero on position axes.
        yaw_integral: (..., 1) rad; zero without a yaw command.
        reference_velocity: (..., 3) m/s, of the position reference; zero on force axes.
        wheel_hold: (..., 4) rad, held wheel angle minus angle; zero while driving.
        steering_traction: (..., 1) N, mean push of the left wheels against the right ones.
    """

    def __init__(self, config: TaskMemoryConfig, batch_shape: tuple[int, ...] = ()) -> None:
        self._config = config
        # In the order of the batch's other arrays, see sim.training.batch_rotations.
        self.position_integral = np.zeros((*batch_shape, 3), order="F")
        self.force_integral = np.zeros((*batch_shape, 3), order="F")
        self.yaw_integral = np.zeros((*batch_shape, 1))
        self.reference_velocity = np.zeros((*batch_shape, 3), order="F")
        self.wheel_hold = np.zeros((*batch_shape, 4), order="F")
        self.steering_traction = np.zeros((*batch_shape, 1))
        self._reference = np.zeros((*batch_shape, 3), order="F")
        self._held = np.zeros((*batch_shape, 4), order="F")
        self._fresh = np.ones((*batch_shape, 1), bool)
        self._driving = np.ones((*batch_shape, 1), bool)

    def reset(self, index: Any = ...) -> None:
        """Forget everything, of all robots or of those at `index`."""
        for array in (
            self.position_integral,
            self.force_integral,
            self.yaw_integral,
            self.reference_velocity,
            self.wheel_hold,
            self.steering_traction,
        ):
            array[index] = 0.0
        self._fresh[index] = True
        self._driving[index] = True

    def step(self, signals: TaskSignals) -> None:
        """Take in one control period."""
        config, dt = self._config, CONTROL_PERIOD_S
        on_position = 1.0 - signals.mask
        limit = config.position_limit_ms
        integral = self.position_integral + dt * signals.position_error
        self.position_integral[...] = on_position * np.clip(integral, -limit, limit)
        limit = config.force_limit_ns
        # So large an error means that there is no contact yet: the integral waits.
        error = signals.force_error
        integral = self.force_integral + dt * np.where(np.abs(error) <= config.force_error_limit_n, error, 0.0)
        self.force_integral[...] = signals.mask * np.clip(integral, -limit, limit)

        last = np.where(self._fresh, signals.position, self._reference)
        self.reference_velocity[...] = on_position * (signals.position - last) / dt
        self._reference[...] = signals.position
        self._fresh[...] = False

        forward, yaw = signals.base_velocity[..., :1], signals.base_velocity[..., 2:]
        turning = np.abs(yaw) >= config.rest_velocity
        driving = turning | (np.abs(forward) >= config.rest_velocity)
        limit = config.yaw_limit_rad
        integral = np.clip(self.yaw_integral + dt * (yaw - signals.yaw_rate), -limit, limit)
        self.yaw_integral[...] = turning * integral
        angle = signals.joint_position[..., WHEEL_SLICE]
        self._held[...] = np.where(self._driving, angle, self._held)
        self.wheel_hold[...] = ~driving * (self._held - angle)
        self._driving[...] = driving

        torque = signals.joint_torque[..., WHEEL_SLICE] @ _LEFT_MINUS_RIGHT
        traction = torque[..., None] / (len(_LEFT_MINUS_RIGHT) * WHEEL_RADIUS_M)
        self.steering_traction += config.traction_smoothing * (traction - self.steering_traction)
