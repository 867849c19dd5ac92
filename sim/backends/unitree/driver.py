"""The base behind a link: states in, commands out, in joint order and SI, with everything that went wrong counted."""

import struct
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from sim.backends.unitree import motors
from sim.backends.unitree.layout import LOW_COMMAND, LOW_STATE
from sim.backends.unitree.link import BaseLink
from sim.backends.unitree.messages import LowCommand, LowState, WireError
from sim.backends.wire_fields import byte_index

STATE_PERIOD_MS = 2
RESTART_S = 1.0
"""A clock that has gone back after a silence this long is that of a robot that was switched off and on."""

_TICK_RANGE = 1 << 32
_REMOTE_STOP = 0x0220
"""Buttons L2 (bit 5) and B (bit 9) of the remote control, the vendor's own combination for damping."""

_COUNT = motors.BASE_JOINT_COUNT
_TARGETS = byte_index(LOW_COMMAND, "motor", ("q", "dq", "kp", "kd", "tau"), motors.SLOT_OF_JOINT)
_SCALARS = struct.Struct("<IfBH")
"""tick, power_v, bms_soc, buttons of the remote control."""

_INERTIAL_COUNT = 10
_NUMBERS_END = 4 * (_INERTIAL_COUNT + 3 * _COUNT)
_HEALTH_END = _NUMBERS_END + 6 * _COUNT


def _state_bytes() -> np.ndarray:
    """Index of what is read of a state: inertial numbers, those of the joints, the motors' health, scalars."""
    fields: Any = LOW_STATE.fields

    def at(name: str, skip: int, count: int) -> np.ndarray:
        return fields[name][1] + skip + np.arange(count)

    numbers = byte_index(LOW_STATE, "motor", ("q", "dq", "tau_est"), motors.SLOT_OF_JOINT)
    health = byte_index(LOW_STATE, "motor", ("mode", "temperature"), motors.SLOT_OF_JOINT)
    health[0, motors.SLOT_OF_JOINT == 0] = fields["first_mode"][1]
    lost = byte_index(LOW_STATE, "motor", ("lost",), motors.SLOT_OF_JOINT)
    scalars = (at("tick", 0, 4), at("power_v", 0, 4), at("bms_soc", 0, 1), at("wireless_remote", 2, 2))
    parts = (at("imu_quaternion", 0, 4 * _INERTIAL_COUNT), numbers.ravel(), health.ravel(), lost.ravel(), *scalars)
    return np.concatenate(parts)


_STATE = _state_bytes()


class MotorsReading(NamedTuple):
    """What changes slowly about the motors of the base.

    Attributes:
        temperature: (16,) degrees Celsius; `hottest` of them.
        lost: (16,) packets each motor has lost, as counted by the robot.
        active: whether all motors are in servo mode.
    """

    temperature: np.ndarray
    hottest: float
    lost: np.ndarray
    active: bool


class BaseReading(NamedTuple):
    """One state of the base. Joints are 16: legs, then wheels, in the order of control.joints.

    Attributes:
        tick_ms: the robot's own clock; only its differences mean anything.
        inertial: (10,) orientation_wxyz, angular_velocity and linear_acceleration, as in control.types.SensorFrame.
        joints: (3, 16) position in rad, velocity in rad/s, torque in N m (estimated by the drives).
        motors: their health.
        battery_percent: state of charge.
        battery_v: supply voltage.
        remote_stop: L2 and B are pressed on the remote control.
    """

    tick_ms: int
    inertial: np.ndarray
    joints: np.ndarray
    motors: MotorsReading
    battery_percent: int
    battery_v: float
    remote_stop: bool


class BaseDriver:
    """Counts states, gaps, unsound samples and restarts of the robot; encodes commands in place.

    Args:
        link: the network.
        echo_tick: copy the state's tick into the command's spare word, so that an emulator can match the two. The robot
            gets zeros there, as from the vendor's software.
    """

    def __init__(self, link: BaseLink, echo_tick: bool = False) -> None:
        self.link = link
        self._echo_tick = echo_tick
        self._command = _idle_command()
        self.reading: BaseReading | None = None
        self.received_s = -np.inf
        self.received = 0
        self.bad_samples = 0
        self.missed = 0
        self.restarts = 0
        self.sent = 0
        self._last_tick: int | None = None

    def poll(self, now: float) -> bool:
        """Take in what has arrived; True when there is a new state. `now` is monotonic seconds."""
        newest = None
        for sample in self.link.receive():
            try:
                message = LowState.decode(sample)
            except WireError:
                self.bad_samples += 1
                continue
            newest = _reading(message)
            self._count(newest.tick_ms, now)
            self.received += 1
        if newest is None:
            return False
        self.received_s = now
        self.reading = newest
        return True

    def _count(self, tick: int, now: float) -> None:
        if self._last_tick is not None:
            ahead = (tick - self._last_tick) % _TICK_RANGE
            if ahead < _TICK_RANGE // 2:
                self.missed += max(0, ahead // STATE_PERIOD_MS - 1)
            elif now - self.received_s > RESTART_S:
                self.restarts += 1
        self._last_tick = tick

    def write(self, targets: np.ndarray) -> None:
        """Publish position, velocity, stiffness, damping and torque, (5, 16) in joint order and SI."""
        self._command.data[_TARGETS] = targets.astype("<f4").view(np.uint8)
        if self._echo_tick and self.reading is not None:
            self._command.record["reserve"] = self.reading.tick_ms
        self.link.send(self._command.encode())
        self.sent += 1

    def close(self) -> None:
        """Leave the network."""
        self.link.close()


def _idle_command() -> LowCommand:
    command = LowCommand()
    command.record["head"] = motors.COMMAND_HEAD
    command.record["level_flag"] = motors.LEVEL_LOW
    command.motor_mode = np.full(len(command.motor), motors.MODE_SERVO)
    command.motor["q"][motors.UNUSED_SLOTS] = motors.POSITION_STOP
    command.motor["dq"][motors.UNUSED_SLOTS] = motors.VELOCITY_STOP
    return command


def _reading(message: LowState) -> BaseReading:
    data = message.data[_STATE]
    numbers = data[:_NUMBERS_END].view("<f4").astype(float)
    tick, battery_v, battery_percent, buttons = _SCALARS.unpack(data[_HEALTH_END:].tobytes())
    return BaseReading(
        tick,
        numbers[:_INERTIAL_COUNT],
        numbers[_INERTIAL_COUNT:].reshape(3, _COUNT),
        _motors_reading(data[_NUMBERS_END:_HEALTH_END].tobytes()),
        battery_percent,
        battery_v,
        buttons & _REMOTE_STOP == _REMOTE_STOP,
    )


@lru_cache(maxsize=4)
def _motors_reading(health: bytes) -> MotorsReading:
    """Of (16,) modes, temperatures and lost packets, which stay the same over many states."""
    temperature = np.frombuffer(health, np.uint8, _COUNT, offset=_COUNT).astype(float)
    lost = np.frombuffer(health, "<u4", _COUNT, offset=2 * _COUNT)
    return MotorsReading(temperature, float(temperature.max()), lost, health[:_COUNT] == bytes([motors.MODE_SERVO]) * _COUNT)
