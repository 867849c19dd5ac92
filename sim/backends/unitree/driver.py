"""The base behind a link: states in, commands out, in joint order and SI, with everything that went wrong counted."""

from dataclasses import dataclass

import numpy as np

from sim.backends.unitree import motors
from sim.backends.unitree.link import BaseLink
from sim.backends.unitree.messages import LowCommand, LowState, WireError

STATE_PERIOD_MS = 2
RESTART_S = 1.0
"""A clock that has gone back after a silence this long is that of a robot that was switched off and on."""

_TICK_RANGE = 1 << 32
_REMOTE_STOP = 0x0220
"""Buttons L2 (bit 5) and B (bit 9) of the remote control, the vendor's own combination for damping."""

_REMOTE_BUTTONS = slice(2, 4)


@dataclass(frozen=True, slots=True)
class BaseReading:
    """One state of the base. Joint arrays are (16,): legs, then wheels, in the order of control.joints.

    Attributes:
        tick_ms: the robot's own clock; only its differences mean anything.
        orientation_wxyz, angular_velocity, linear_acceleration: as in control.types.SensorFrame.
        position, velocity, torque: rad, rad/s, N m (estimated by the drives).
        temperature: (16,) degrees Celsius.
        lost: (16,) packets each motor has lost, as counted by the robot.
        active: (16,) whether the motor is in servo mode.
        battery_percent: state of charge.
        battery_v: supply voltage.
        remote_stop: L2 and B are pressed on the remote control.
    """

    tick_ms: int
    orientation_wxyz: np.ndarray
    angular_velocity: np.ndarray
    linear_acceleration: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    torque: np.ndarray
    temperature: np.ndarray
    lost: np.ndarray
    active: np.ndarray
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
            self._count(int(message.record["tick"]), now)
            self.received += 1
            newest = message
        if newest is None:
            return False
        self.received_s = now
        self.reading = _reading(newest)
        return True

    def _count(self, tick: int, now: float) -> None:
        if self._last_tick is not None:
            ahead = (tick - self._last_tick) % _TICK_RANGE
            if ahead < _TICK_RANGE // 2:
                self.missed += max(0, ahead // STATE_PERIOD_MS - 1)
            elif now - self.received_s > RESTART_S:
                self.restarts += 1
        self._last_tick = tick

    def write(
        self, position: np.ndarray, velocity: np.ndarray, stiffness: np.ndarray, damping: np.ndarray, torque: np.ndarray
    ) -> None:
        """Publish targets and gains, (16,) each in joint order and SI."""
        order = motors.JOINT_OF_SLOT
        motor = self._command.motor
        count = motors.BASE_JOINT_COUNT
        motor["q"][:count] = position[order]
        motor["dq"][:count] = velocity[order]
        motor["kp"][:count] = stiffness[order]
        motor["kd"][:count] = damping[order]
        motor["tau"][:count] = torque[order]
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
    record, motor = message.record, message.motor
    buttons = int.from_bytes(record["wireless_remote"][_REMOTE_BUTTONS].tobytes(), "little")
    return BaseReading(
        tick_ms=int(record["tick"]),
        orientation_wxyz=record["imu_quaternion"].astype(float),
        angular_velocity=record["imu_gyroscope"].astype(float),
        linear_acceleration=record["imu_accelerometer"].astype(float),
        position=motors.used_slots(motor["q"]),
        velocity=motors.used_slots(motor["dq"]),
        torque=motors.used_slots(motor["tau_est"]),
        temperature=motors.used_slots(motor["temperature"]),
        lost=motor["lost"][motors.SLOT_OF_JOINT],
        active=message.motor_mode[motors.SLOT_OF_JOINT] == motors.MODE_SERVO,
        battery_percent=int(record["bms_soc"]),
        battery_v=float(record["power_v"]),
        remote_stop=buttons & _REMOTE_STOP == _REMOTE_STOP,
    )
