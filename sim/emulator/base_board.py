"""The base's main board: publishes LowState_, obeys LowCmd_ while no motion program owns the motors, answers calls."""

import json

import numpy as np

from control.joints import LEG_SLICE, NOMINAL_POSITION, TORQUE_LIMIT
from control.types import JointCommand
from sim.backends.unitree import motors
from sim.backends.unitree.link import RobotLink
from sim.backends.unitree.messages import LowCommand, LowState, WireError
from sim.backends.unitree.rpc import MOTION_SWITCHER, MotionSwitcherApi, RpcRequest, RpcResponse, SportApi
from sim.emulator.faults import Faults, FaultyChannel
from sim.emulator.joint_readings import JointReadings
from sim.emulator.physics import CROUCH, RobotBody, hold

COMMAND_TIMEOUT_S = 0.1
"""Without a sound command for this long the motors damp. The real firmware's reaction is unknown."""

TIMEOUT_DAMPING = 2.0
STAND_S = 2.0
RELEASED = ""
DEFAULT_MODE = "normal"
_ERROR_UNKNOWN_API = 3203
_ERROR_PARAMETER = 3204
_STAND = NOMINAL_POSITION
_REMOTE_STOP = (0x20, 0x02)
_BASE = motors.BASE_SLICE


class BaseBoard:
    """Motors 0-15 of the base, IMU, battery, motion switcher and sport service.

    Attributes:
        mode: name of the motion program that owns the motors, empty when released.
        accepted, refused, bad_commands: LowCmd_ samples obeyed, ignored because a program owns the motors, and unsound.
        echoed_ms: the state's tick that the newest command answers, if its sender echoes ticks.
    """

    def __init__(self, link: RobotLink, body: RobotBody, faults: Faults, seed: int, mode: str = DEFAULT_MODE) -> None:
        self._link = link
        self._body = body
        self._faults = faults
        self._incoming = FaultyChannel(faults, seed)
        self._outgoing = FaultyChannel(faults, seed + 1)
        self._state = LowState()
        self._state.record["head"] = motors.COMMAND_HEAD
        self._state.record["level_flag"] = motors.LEVEL_LOW
        self._command: LowCommand | None = None
        self._command_s = -np.inf
        self._posture_start = self._posture_goal = CROUCH
        self._posture_s = -np.inf
        self._joints = JointReadings(body, faults)
        self.battery_percent = 80.0
        self.mode = mode
        self.accepted = self.refused = self.bad_commands = 0
        self.echoed_ms = -1

    def receive(self) -> None:
        """Take in commands and calls."""
        now = self._body.time_s
        if self._faults.freeze:
            self._link.receive()
            return
        for sample in self._link.receive():
            arrived = self._incoming.corrupt(sample)
            if arrived is None:
                continue
            try:
                command = LowCommand.decode(arrived)
            except WireError:
                self.bad_commands += 1
                continue
            self.echoed_ms = int(command.record["reserve"])
            if self.mode != RELEASED:
                self.refused += 1
                continue
            self.accepted += 1
            self._command, self._command_s = command, now
        for request in self._link.requests():
            self._link.respond(self._answer(request))

    def drive(self, command: JointCommand) -> None:
        """Fill the base's part of a command for this physics step, in place."""
        position, velocity = command.position[_BASE], command.velocity[_BASE]
        stiffness, damping, torque = command.stiffness[_BASE], command.damping[_BASE], command.torque[_BASE]
        if self.mode != RELEASED:
            program = hold(self._posture())
            position[:], velocity[:] = program.position[_BASE], 0.0
            stiffness[:], damping[:] = program.stiffness[_BASE], program.damping[_BASE]
            torque[:] = 0.0
        elif self._command is None or self._body.time_s - self._command_s > COMMAND_TIMEOUT_S:
            position[:] = velocity[:] = stiffness[:] = torque[:] = 0.0
            damping[:] = TIMEOUT_DAMPING if self._command is not None else 0.0
        else:
            motor = self._command.motor
            on = self._command.motor_mode[motors.SLOT_OF_JOINT] == motors.MODE_SERVO
            for target, name in ((position, "q"), (velocity, "dq"), (stiffness, "kp"), (damping, "kd"), (torque, "tau")):
                target[:] = motor[name][motors.SLOT_OF_JOINT]
            stiffness *= on
            damping *= on
            torque *= on

    def publish(self) -> None:
        """Send the state of this moment."""
        faults = self._faults
        if faults.second_writer:
            self._link.intrude(_intruding_command())
        if faults.freeze:
            return
        self._fill()
        for sample in self._outgoing.delayed(self._outgoing.corrupt(self._state.encode()), self._body.time_s):
            self._link.send(sample)

    def _fill(self) -> None:
        body, faults, record, motor = self._body, self._faults, self._state.record, self._state.motor
        frame = body.frame
        position, velocity, temperature = self._joints.take()
        count, order = motors.BASE_JOINT_COUNT, motors.JOINT_OF_SLOT
        motor["q"][:count] = position[_BASE][order]
        motor["dq"][:count] = velocity[_BASE][order]
        motor["tau_est"][:count] = frame.joint_torque[_BASE][order]
        motor["temperature"][:count] = np.minimum(temperature[_BASE][order], 255.0)
        mode = self._state.motor_mode
        mode[:count] = motors.MODE_SERVO
        self._state.motor_mode = mode
        record["imu_quaternion"] = frame.orientation_wxyz
        record["imu_gyroscope"] = frame.angular_velocity
        record["imu_accelerometer"] = frame.linear_acceleration
        record["imu_rpy"] = _roll_pitch_yaw(frame.orientation_wxyz)
        record["imu_temperature"] = 45
        load = float(np.abs(frame.joint_torque / TORQUE_LIMIT).mean())
        self.battery_percent = max(0.0, self.battery_percent - 1e-5 * (0.1 + load))
        record["bms_soc"] = self.battery_percent if faults.battery_percent < 0 else faults.battery_percent
        record["power_v"] = 25.0 + 0.045 * float(record["bms_soc"])
        record["tick"] = round(1000 * body.time_s)
        record["wireless_remote"][2:4] = _REMOTE_STOP if faults.remote_stop else (0, 0)

    def _answer(self, request: RpcRequest) -> RpcResponse:
        code, data = 0, ""
        if request.service == MOTION_SWITCHER:
            match request.api_id:
                case MotionSwitcherApi.CHECK_MODE:
                    data = json.dumps({"form": "0", "name": self.mode})
                case MotionSwitcherApi.SELECT_MODE:
                    code = self._select(request.parameter)
                case MotionSwitcherApi.RELEASE_MODE:
                    self.mode = RELEASED
                    self._command = None
                case _:
                    code = _ERROR_UNKNOWN_API
        else:
            match request.api_id:
                case SportApi.STAND_UP:
                    self._go_to(_STAND)
                case SportApi.STAND_DOWN:
                    self._go_to(CROUCH)
                case _:
                    code = _ERROR_UNKNOWN_API
        return RpcResponse(request.service, request.id, request.api_id, code, data)

    def _select(self, parameter: str) -> int:
        try:
            name = json.loads(parameter)["name"]
        except (json.JSONDecodeError, KeyError, TypeError):
            return _ERROR_PARAMETER
        self.mode = str(name)
        self._go_to(self._body.frame.joint_position)
        return 0

    def _go_to(self, posture: np.ndarray) -> None:
        self._posture_start, self._posture_goal = self._body.frame.joint_position.copy(), posture
        self._posture_s = self._body.time_s

    def _posture(self) -> np.ndarray:
        progress = min(1.0, (self._body.time_s - self._posture_s) / STAND_S)
        posture = self._posture_start + progress * (self._posture_goal - self._posture_start)
        posture[LEG_SLICE.stop : _BASE.stop] = 0.0
        return posture


def _intruding_command() -> bytes:
    """A harmless but foreign command: every gain zero."""
    command = LowCommand()
    command.record["head"] = motors.COMMAND_HEAD
    command.record["level_flag"] = motors.LEVEL_LOW
    return command.encode()


def _roll_pitch_yaw(wxyz: np.ndarray) -> tuple[float, float, float]:
    w, x, y, z = wxyz.tolist()
    return (
        float(np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))),
        float(np.arcsin(np.clip(2 * (w * y - z * x), -1, 1))),
        float(np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))),
    )
