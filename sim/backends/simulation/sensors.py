"""Sensors as hardware has them: noise, bias, quantisation and delay on top of the ideal sample of the simulator.

Order of effects per channel: measured = quantise(scale * ideal + offset + white noise), then the whole frame is delayed.
Offsets, biases and scales are drawn once per seed. The attitude error is a rotation vector in the base frame: a constant
bias plus a first-order Gauss-Markov (AR(1)) process, since a filtered IMU attitude has no white error.
"""

import math
from collections import deque
from dataclasses import dataclass, fields

import numpy as np

from control.joints import JOINT_COUNT
from control.timing import TICK_S
from control.types import SensorFrame

_POSITION = slice(0, JOINT_COUNT)
_VELOCITY = slice(JOINT_COUNT, 2 * JOINT_COUNT)
_TORQUE = slice(2 * JOINT_COUNT, 3 * JOINT_COUNT)
_GYRO = slice(3 * JOINT_COUNT, 3 * JOINT_COUNT + 3)
_ACCELERATION = slice(3 * JOINT_COUNT + 3, 3 * JOINT_COUNT + 6)
_CHANNELS = 3 * JOINT_COUNT + 6
_NOISE_BLOCK = 32


@dataclass(frozen=True)
class SensorConfig:
    """Standard deviations (`_std`), one-step quanta (`_quantum`, 0 = none) and delay of all sensors; SI units.

    Attributes:
        joint_position_noise_std: rad, white.
        joint_position_offset_std: rad, per joint, constant: zero-position calibration error.
        joint_position_quantum: rad; 2 pi / 2^15, a 15-bit encoder on the joint.
        joint_velocity_noise_std: rad/s, white.
        joint_torque_noise_std: N m, white.
        joint_torque_scale_std: 1, per joint, constant: error of the torque constant.
        joint_torque_quantum: N m.
        gyro_noise_std, gyro_bias_std: rad/s.
        accelerometer_noise_std, accelerometer_bias_std: m/s^2.
        attitude_bias_std: rad per axis, constant.
        attitude_drift_std: rad per axis, stationary deviation of the AR(1) part.
        attitude_drift_time_s: s, correlation time of the AR(1) part.
        delay_ticks: whole frames of age at delivery.
        torque_delay_ticks: further age of the joint torques alone, as drives that filter the current have it.
    """

    joint_position_noise_std: float = 0.5e-3
    joint_position_offset_std: float = 3e-3
    joint_position_quantum: float = 2.0 * np.pi / 2**15
    joint_velocity_noise_std: float = 0.02
    joint_torque_noise_std: float = 0.05
    joint_torque_scale_std: float = 0.01
    joint_torque_quantum: float = 0.025
    gyro_noise_std: float = 0.005
    gyro_bias_std: float = 0.003
    accelerometer_noise_std: float = 0.05
    accelerometer_bias_std: float = 0.05
    attitude_bias_std: float = 4e-3
    attitude_drift_std: float = 3e-3
    attitude_drift_time_s: float = 5.0
    delay_ticks: int = 1
    torque_delay_ticks: int = 0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (np.isfinite(value) and value >= 0):
                raise ValueError(f"{field.name} is {value}; it must be finite and not negative")

    @classmethod
    def ideal(cls) -> "SensorConfig":
        """No error, no delay."""
        return cls(**dict.fromkeys((field.name for field in fields(cls)), 0))


class SensorModel:
    """Turns ideal samples, one per tick, into what the robot's sensors would deliver."""

    def __init__(self, config: SensorConfig, seed: int, period_s: float = TICK_S) -> None:
        """`period_s` is the time between two samples; the same seed gives the same errors."""
        self.config = config
        self._random = np.random.default_rng(seed)
        self._scale = np.ones(_CHANNELS)
        self._scale[_TORQUE] += config.joint_torque_scale_std * self._random.standard_normal(JOINT_COUNT)
        self._offset = np.zeros(_CHANNELS)
        self._offset[_POSITION] = config.joint_position_offset_std * self._random.standard_normal(JOINT_COUNT)
        self._offset[_GYRO] = config.gyro_bias_std * self._random.standard_normal(3)
        self._offset[_ACCELERATION] = config.accelerometer_bias_std * self._random.standard_normal(3)
        self._attitude_bias = config.attitude_bias_std * self._random.standard_normal(3)
        self._attitude_drift = config.attitude_drift_std * self._random.standard_normal(3)
        time_constant = config.attitude_drift_time_s
        self._drift_decay = float(np.exp(-period_s / time_constant)) if time_constant > 0 else 0.0
        drift_step_std = config.attitude_drift_std * np.sqrt(1.0 - self._drift_decay**2)
        self._noise_std = np.concatenate(
            [
                np.full(JOINT_COUNT, config.joint_position_noise_std),
                np.full(JOINT_COUNT, config.joint_velocity_noise_std),
                np.full(JOINT_COUNT, config.joint_torque_noise_std),
                np.full(3, config.gyro_noise_std),
                np.full(3, config.accelerometer_noise_std),
                np.full(3, drift_step_std),
            ]
        )
        # White noise is drawn in blocks: one call per tick costs more, and a large block would stall the tick that draws it.
        self._noise = np.empty((_NOISE_BLOCK, _CHANNELS + 3))
        self._noise_row = _NOISE_BLOCK
        self._pending: deque[SensorFrame] = deque()
        self._torques: deque[np.ndarray] = deque(maxlen=config.torque_delay_ticks + 1)

    def measure(self, ideal: SensorFrame) -> SensorFrame:
        """What arrives at the tick of `ideal`: the distorted frame of `delay_ticks` ticks ago (the oldest one at start)."""
        self._pending.append(self._distort(ideal))
        if len(self._pending) > self.config.delay_ticks + 1:
            self._pending.popleft()
        return self._pending[0]

    def _distort(self, ideal: SensorFrame) -> SensorFrame:
        config = self.config
        noise = self._next_noise()
        self._torques.append(ideal.joint_torque)
        joint_torque = self._torques[0]
        values = np.concatenate(
            (ideal.joint_position, ideal.joint_velocity, joint_torque, ideal.angular_velocity, ideal.linear_acceleration)
        )
        values *= self._scale
        values += self._offset
        values += noise[:_CHANNELS]
        position, torque = values[_POSITION], values[_TORQUE]
        if config.joint_position_quantum:
            position[:] = config.joint_position_quantum * np.rint(position / config.joint_position_quantum)
        if config.joint_torque_quantum:
            torque[:] = config.joint_torque_quantum * np.rint(torque / config.joint_torque_quantum)
        self._attitude_drift = self._drift_decay * self._attitude_drift + noise[_CHANNELS:]
        return SensorFrame(
            time_s=ideal.time_s,
            orientation_wxyz=_turned(ideal.orientation_wxyz, self._attitude_bias + self._attitude_drift),
            angular_velocity=values[_GYRO],
            linear_acceleration=values[_ACCELERATION],
            joint_position=position,
            joint_velocity=values[_VELOCITY],
            joint_torque=torque,
        )

    def _next_noise(self) -> np.ndarray:
        if self._noise_row == _NOISE_BLOCK:
            self._random.standard_normal(out=self._noise)
            self._noise *= self._noise_std
            self._noise_row = 0
        row = self._noise[self._noise_row]
        self._noise_row += 1
        return row


def _turned(orientation_wxyz: np.ndarray, small_angle: np.ndarray) -> np.ndarray:
    """Orientation (4,) wxyz turned by a small rotation vector (3,) rad in its own frame. On floats, which is faster here."""
    w, x, y, z = orientation_wxyz.tolist()
    a, b, c = (0.5 * small_angle).tolist()
    turned = (w - x * a - y * b - z * c, x + w * a + y * c - z * b, y + w * b + z * a - x * c, z + w * c + x * b - y * a)
    norm = math.sqrt(sum(value * value for value in turned))
    return np.array(turned) / norm
