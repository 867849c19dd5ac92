"""The state machine of the drives: what is asked, what is healthy, and so what is sent, at every 2 ms tick."""

from typing import NamedTuple

import numpy as np

from control.types import JointCommand, SensorFrame
from sim.backends.hardware.config import HardwareConfig
from sim.backends.hardware.io.command_limiter import CommandLimiter, UnsoundCommandError
from sim.backends.hardware.io.monitor import Health, HealthMonitor
from sim.backends.hardware.io.motions import Postures, blend, min_jerk
from sim.backends.hardware.io.self_test import SelfTest
from sim.backends.hardware.robot import Robot
from sim.backends.hardware.states import ACTIVE, ALLOWED_FROM, DriveState, Request, Trip, describe
from sim.backends.unitree.mode_release import ModeRelease
from sim.backends.z1.frames import ArmMode

_SILENT = Trip.STALE_STATE | Trip.STALE_ARM
_HINT = {
    Request.ENGAGE: "engage from OBSERVE",
    Request.STAND: "stand up from DAMPED",
    Request.START: "start the controller from READY",
    Request.HOLD: "hold from POLICY",
    Request.SIT: "sit from STANDING_UP, READY or POLICY",
    Request.DAMP: "damp while engaged",
    Request.RELEASE: "release from DAMPED",
    Request.CLEAR: "clear from FAULT",
}


class ControlInput(NamedTuple):
    """What the control process has said, newest first.

    Attributes:
        command: its newest joint command, None before the first.
        command_age_s: age of that command.
        silent_s: time since the control process was last heard at all.
        operator_silent_s: time since the console's web process was last heard, as the control process reports it.
        request, request_sequence: newest request; a sequence is acted on once.
        estop: somebody asks for an e-stop.
    """

    command: JointCommand | None = None
    command_age_s: float = np.inf
    silent_s: float = np.inf
    operator_silent_s: float = 0.0
    request: Request = Request.NONE
    request_sequence: int = 0
    estop: Trip = Trip.NONE


class Supervisor:
    """One robot's state machine. `step` polls nothing and sleeps never; it sends exactly one frame while it owns the motors.

    Attributes:
        state: now.
        faults: why FAULT is latched; message says it in words.
        fault_joints: whose they are (`joint_bits`).
        warnings: of the last tick.
        message: last refusal, self-test failure or fault, for the operator.
        request_sequence: of the last request that was handled.
        refused: whether that request was; message says why.
        sent: targets (5, 22) of the last tick, or None when it damped or was silent.
    """

    def __init__(self, config: HardwareConfig, robot: Robot, position_lower: np.ndarray, position_upper: np.ndarray) -> None:
        self.config = config
        self.state = DriveState.DISCONNECTED
        self.faults = self.warnings = Trip.NONE
        self.fault_joints = 0
        self.message = ""
        self.request_sequence = 0
        self.refused = False
        self.sent: np.ndarray | None = None
        self._robot = robot
        self._monitor = HealthMonitor(config.limits, position_lower, position_upper)
        self._limiter = CommandLimiter(config.limits, position_lower, position_upper)
        self._postures = Postures(config.motion)
        self._owns_motors = False
        self._restarts = 0
        self._arm_entered = False
        self._release: ModeRelease | None = None
        self._test: SelfTest | None = None
        self._since_s = 0.0
        self._start = np.zeros(0)
        self._held: JointCommand | None = None

    @property
    def engaging(self) -> bool:
        """Whether release or self-test is under way."""
        return self._release is not None or self._test is not None

    @property
    def foreign_writers(self) -> int:
        """Writers of motor commands besides ours."""
        return self._monitor.foreign_writers

    @property
    def at_rest(self) -> bool:
        """Whether legs and wheels lie still without stiffness."""
        return self._monitor.at_rest

    def progress(self, now: float) -> float:
        """Of the self-test or the motion under way, 0 to 1."""
        config = self._postures.config
        if self._test is not None:
            return self._test.progress(now)
        durations = {
            DriveState.STANDING_UP: config.fold_s + config.rise_s,
            DriveState.SITTING: config.sit_s + config.fade_s,
        }
        duration = durations.get(self.state)
        return 0.0 if duration is None else min(1.0, (now - self._since_s) / duration)

    def step(self, now: float, fresh: bool, control: ControlInput) -> None:
        """One tick after `Robot.poll`; `fresh` is what it returned."""
        health = self._monitor.check(now, self._robot, self.state in ACTIVE)
        self._connect(now, health)
        self._disown_restarted()
        damp = self._reasons_to_damp(health, control)
        self.warnings = health.warn | health.sit
        if self.state == DriveState.POLICY and control.command_age_s > self.config.limits.command_hold_s:
            self.warnings |= Trip.STALE_COMMAND
        if damp and self.state not in (DriveState.DISCONNECTED, DriveState.OBSERVE, DriveState.FAULT):
            self._fault(damp, health.joints)
        elif self.state == DriveState.FAULT:
            self.faults |= damp & ~(Trip.STALE_COMMAND | Trip.STALE_OPERATOR)
        elif control.estop:
            self._fault(control.estop)
        elif health.sit and self.state in (DriveState.STANDING_UP, DriveState.READY, DriveState.POLICY):
            self.message = f"sitting down: {'; '.join(describe(health.sit, health.joints))}"
            self._enter(DriveState.SITTING, now)
        self._handle(now, control)
        self._engage(now, fresh, health)
        self._act(now, control)

    def fail(self) -> None:
        """Latch FAULT and damp without looking at anything: a tick has gone wrong."""
        self._fault(Trip.INTERNAL)
        self.sent = None
        if self._owns_motors:
            self._robot.damp()

    def _disown_restarted(self) -> None:
        """A robot that was switched off and on has its own program commanding the motors again: nothing more is sent."""
        restarts = self._robot.base.restarts
        if restarts != self._restarts and self._owns_motors:
            self._owns_motors = False
            self._fault(Trip.RESTARTED)
        self._restarts = restarts

    def _connect(self, now: float, health: Health) -> None:
        """DISCONNECTED and OBSERVE follow whether states arrive."""
        if self.state not in (DriveState.DISCONNECTED, DriveState.OBSERVE):
            return
        silent = bool(health.damp & _SILENT) or self._robot.readings is None
        if self.state == DriveState.DISCONNECTED and not silent:
            self._enter(DriveState.OBSERVE, now)
        elif self.state == DriveState.OBSERVE and silent and not self.engaging:
            self._enter(DriveState.DISCONNECTED, now)

    def _reasons_to_damp(self, health: Health, control: ControlInput) -> Trip:
        limits = self.config.limits
        damp = health.damp | control.estop
        if self.state not in ACTIVE:
            # Damping already: a hot motor, a joint at its end or a silent operator changes nothing.
            return damp & (Trip.ESTOP | Trip.REMOTE_STOP | Trip.SIGNAL | Trip.FOREIGN_WRITER | Trip.STALE_STATE)
        late = self.state == DriveState.POLICY and control.command_age_s > limits.command_damp_s
        if late or control.silent_s > limits.control_damp_s:
            damp |= Trip.STALE_COMMAND
        if control.operator_silent_s > limits.operator_damp_s:
            damp |= Trip.STALE_OPERATOR
        arm = self._robot.arm.reading
        if not self.config.dry_run and arm is not None and self._arm_left(arm.mode):
            damp |= Trip.ARM
        return damp

    def _arm_left(self, mode: int) -> bool:
        """The arm has been in low-level mode since the motors were stiffened, and is not any more."""
        if mode == ArmMode.LOWCMD:
            self._arm_entered = True
        return self._arm_entered and mode != ArmMode.LOWCMD

    def _handle(self, now: float, control: ControlInput) -> None:
        if control.request_sequence == self.request_sequence:
            return
        self.request_sequence = control.request_sequence
        request = control.request
        if request == Request.NONE:
            return
        if self.state not in ALLOWED_FROM[request] or self.engaging:
            doing = "engaging" if self.engaging else self.state.name
            self._refuse(request, f"while {doing}: {_HINT[request]}")
            return
        self.message = ""
        self.refused = False
        match request:
            case Request.ENGAGE:
                self._release = ModeRelease(self._robot.base.link, now, self.config.limits.release_timeout_s)
                self._release.done = self.config.dry_run
            case Request.STAND:
                self._enter(DriveState.STANDING_UP, now)
            case Request.START:
                self._enter(DriveState.POLICY, now)
            case Request.HOLD:
                self._enter(DriveState.READY, now)
            case Request.SIT:
                self._enter(DriveState.SITTING, now)
            case Request.DAMP:
                self._enter(DriveState.DAMPED, now)
            case Request.RELEASE:
                self._owns_motors = False
                self._enter(DriveState.OBSERVE, now)
            case Request.CLEAR:
                self._clear(now, control)

    def _refuse(self, request: Request, why: str) -> None:
        self.message = f"{request.name} refused {why}"
        self.refused = True

    def _clear(self, now: float, control: ControlInput) -> None:
        if control.estop:
            self._refuse(Request.CLEAR, "while the e-stop is still pressed")
        elif not self.at_rest and self._owns_motors:
            self._refuse(Request.CLEAR, "while the robot is still moving, or silent")
        else:
            self.faults, self.fault_joints = Trip.NONE, 0
            self._monitor.reset(self._robot.base.link.foreign_frames(), self._robot.base.link.foreign_writers(), now)
            self._enter(DriveState.DAMPED if self._owns_motors else DriveState.OBSERVE, now)

    def _engage(self, now: float, fresh: bool, health: Health) -> None:
        """Release the robot's own program, then watch, then own the motors. Nothing is sent before the end."""
        if self._release is not None:
            self._release.step(now)
            if self._release.failure is not None:
                self.message = self._release.failure
                self._release = None
            elif self._release.done:
                self._release = None
                link = self._robot.base.link
                self._monitor.reset(link.foreign_frames(), link.foreign_writers(), now)
                self._test = SelfTest(self.config.limits, self._robot, now)
        elif self._test is not None:
            self._test.step(now, fresh, health.damp & ~Trip.FOREIGN_WRITER, health.joints)
            if self._test.done:
                failures = self._test.failures
                self._test = None
                if failures:
                    self.message = "self-test failed: " + "; ".join(failures)
                else:
                    self._owns_motors = True
                    self._enter(DriveState.DAMPED, now)

    def _act(self, now: float, control: ControlInput) -> None:
        self.sent = None
        if not self._owns_motors:
            self._robot.observe(now)
            return
        frame = self._robot.frame
        if self.state not in ACTIVE or frame is None:
            self._robot.damp()
            return
        command, finished = self._command(control, now - self._since_s)
        if command is None:
            self._robot.damp()
            return
        targets, clipped = self._limiter.limit(command, self._robot.joints)
        if clipped:
            self.warnings |= Trip.TORQUE_CLIPPED
        self._robot.write(now, targets)
        self.sent = targets
        if finished:
            self._finish(now, frame)

    def _command(self, control: ControlInput, elapsed: float) -> tuple[JointCommand | None, bool]:
        match self.state:
            case DriveState.STANDING_UP:
                return self._postures.stand_up(self._start, elapsed)
            case DriveState.SITTING:
                return self._postures.sit_down(self._start, elapsed)
            case DriveState.READY:
                return self._postures.stance(), False
        if control.command is not None:
            try:
                self._limiter.check(control.command)
            except UnsoundCommandError as error:
                self._fault(Trip.NOT_FINITE)
                self.message = str(error)
                return None, False
            self._held = control.command
        # A command that is late but not yet stale is repeated; before the first, the stance is held.
        if self._held is None:
            return self._postures.stance(), False
        weight = min_jerk(elapsed / self._postures.config.blend_s)
        if weight < 1.0:
            return blend(self._postures.stance(), self._held, weight), False
        return self._held, False

    def _finish(self, now: float, frame: SensorFrame) -> None:
        if self.state == DriveState.SITTING:
            self._enter(DriveState.DAMPED, now)
        elif self._postures.reached(frame.joint_position) or self.config.dry_run:
            self._enter(DriveState.READY, now)
        else:
            self._fault(Trip.STAND_UP)

    def _enter(self, state: DriveState, now: float) -> None:
        if state in ACTIVE and self.state not in ACTIVE:
            self._arm_entered = False
        self.state = state
        self._since_s = now
        self._held = None
        if self._robot.frame is not None:
            self._start = self._robot.frame.joint_position.copy()

    def _fault(self, reasons: Trip, joints: int = 0) -> None:
        self._release = self._test = None
        self.faults |= reasons
        self.fault_joints |= joints
        self.message = "; ".join(describe(reasons, joints))
        self.state = DriveState.FAULT
