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
from control.kernels.compiled import kernel
from control.timing import TICK_S
from control.types import SensorFrame

_POSITION = slice(0, JOINT_COUNT)
_VELOCITY = slice(JOINT_COUNT, 2 * JOINT_COUNT)
_TORQUE = slice(2 * JOINT_COUNT, 3 * JOINT_COUNT)
_GYRO = slice(3 * JOINT_COUNT, 3 * JOINT_COUNT + 3)
_ACCELERATION = slice(3 * JOINT_COUNT + 3, 3 * JOINT_COUNT + 6)
_CHANNELS = 3 * JOINT_COUNT + 6
_ORIENTATION = slice(_CHANNELS, _CHANNELS + 4)
SAMPLE_SIZE = _CHANNELS + 4
"""Numbers of a sample: joint positions, velocities and torques, angular velocity, linear acceleration, then the orientation."""

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

    STATE = ("_random", "_attitude_drift", "_noise", "_noise_row", "_pending", "_torques")

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

    def measure(self, time_s: float, ideal: np.ndarray) -> SensorFrame:
        """What arrives at this tick: the distorted frame of `delay_ticks` ticks ago (the oldest one at start).

        Args:
            time_s: of this tick.
            ideal: (SAMPLE_SIZE,) of this tick.
        """
        config = self.config
        if config.torque_delay_ticks:
            self._torques.append(ideal[_TORQUE].copy())
            ideal[_TORQUE] = self._torques[0]
        measured = np.empty(SAMPLE_SIZE)
        _distort(
            ideal,
            self._scale,
            self._offset,
            self._noise,
            self._next_noise(),
            config.joint_position_quantum,
            config.joint_torque_quantum,
            self._attitude_bias,
            self._drift_decay,
            self._attitude_drift,
            measured,
        )
        self._pending.append(frame_of(time_s, measured))
        if len(self._pending) > config.delay_ticks + 1:
            self._pending.popleft()
        return self._pending[0]

    def _next_noise(self) -> int:
        """Row of the noise of this tick."""
        self._noise_row += 1
        if self._noise_row >= _NOISE_BLOCK:
            self._random.standard_normal(out=self._noise)
            self._noise *= self._noise_std
            self._noise_row = 0
        return self._noise_row


def frame_of(time_s: float, sample: np.ndarray) -> SensorFrame:
    """The frame of a sample (SAMPLE_SIZE,), in its memory."""
    return SensorFrame(
        time_s=time_s,
        orientation_wxyz=sample[_ORIENTATION],
        angular_velocity=sample[_GYRO],
        linear_acceleration=sample[_ACCELERATION],
        joint_position=sample[_POSITION],
        joint_velocity=sample[_VELOCITY],
        joint_torque=sample[_TORQUE],
    )


@kernel("f8(f8, f8)")
def _quantised(value: float, quantum: float) -> float:
    """The nearest whole number of quanta; `value` itself where the quantum is 0."""
    return quantum * np.rint(value / quantum) if quantum > 0.0 else value


@kernel("void(vector, f8[::1], f8[::1])")
def _turn(orientation_wxyz: np.ndarray, small_angle: np.ndarray, turned: np.ndarray) -> None:
    """An orientation (4,) turned by a small rotation vector (3,) rad in its own frame, into `turned` (4,)."""
    w, x, y, z = orientation_wxyz
    a, b, c = 0.5 * small_angle[0], 0.5 * small_angle[1], 0.5 * small_angle[2]
    turned[0] = w - x * a - y * b - z * c
    turned[1] = x + w * a + y * c - z * b
    turned[2] = y + w * b + z * a - x * c
    turned[3] = z + w * c + x * b - y * a
    turned /= math.sqrt(turned[0] ** 2 + turned[1] ** 2 + turned[2] ** 2 + turned[3] ** 2)


@kernel("void(f8[::1], f8[::1], f8[::1], f8[:,::1], i8, f8, f8, f8[::1], f8, f8[::1], f8[::1])")
def _distort(
    ideal: np.ndarray,
    scale: np.ndarray,
    offset: np.ndarray,
    noise: np.ndarray,
    row: int,
    position_quantum: float,
    torque_quantum: float,
    attitude_bias: np.ndarray,
    drift_decay: float,
    attitude_drift: np.ndarray,
    measured: np.ndarray,
) -> None:
    """measured = quantise(scale * ideal + offset + noise) per channel, and the attitude turned by its error.

    Args:
        ideal: (SAMPLE_SIZE,).
        scale, offset: (72,) of the channels, that is of the sample without the orientation.
        noise: (n, 75) of n ticks: of the channels, then the step of the attitude's drift.
        row: this tick's.
        position_quantum, torque_quantum: rad, N m.
        attitude_bias: (3,) rad.
        drift_decay: factor on the drift per tick.
        attitude_drift: (3,) rad, moved on.
        measured: (SAMPLE_SIZE,) the result.
    """
    channels = len(scale)
    for channel in range(channels):
        measured[channel] = ideal[channel] * scale[channel] + offset[channel] + noise[row, channel]
    for joint in range(JOINT_COUNT):
        measured[joint] = _quantised(measured[joint], position_quantum)
        measured[2 * JOINT_COUNT + joint] = _quantised(measured[2 * JOINT_COUNT + joint], torque_quantum)
    error = np.empty(3)
    for i in range(3):
        attitude_drift[i] = drift_decay * attitude_drift[i] + noise[row, channels + i]
        error[i] = attitude_bias[i] + attitude_drift[i]
    _turn(ideal[channels:], error, measured[channels:])
