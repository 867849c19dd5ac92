"""The driver's stack and the emulated robot in one thread, in lockstep, over the same bytes as on the network."""

from collections.abc import Callable

from control.robot_model import RobotModel
from control.timing import TICK_S
from control.types import JointCommand
from sim.backends.hardware.config import HardwareConfig
from sim.backends.hardware.io.motions import MotionConfig
from sim.backends.hardware.io.supervisor import ControlInput, Supervisor
from sim.backends.hardware.limits import HardwareLimits
from sim.backends.hardware.robot import Robot
from sim.backends.hardware.states import DriveState, Request
from sim.backends.unitree.messages import LowCommand
from sim.backends.unitree.motors import used_slots
from sim.backends.z1.driver import Z1Config
from sim.emulator.arm_controller import ArmPorts
from sim.emulator.emulator import Emulator, EmulatorConfig
from sim.emulator.memory_link import MemoryBaseLink, MemoryRobotLink, MemoryWire
from sim.emulator.process import free_udp_port

BRISK = MotionConfig(fold_s=0.4, rise_s=1.3, sit_s=1.5, fade_s=0.2, blend_s=0.2)


class Rig:
    """Emulator, drivers and supervisor, with a short self-test and brisk motions. Time is the emulator's, while it lives."""

    def __init__(self, *, dry_run: bool = False, mode: str = "", seed: int = 0) -> None:
        self.wire = MemoryWire()
        self._ports = ArmPorts(free_udp_port(), free_udp_port())
        self._start_s = 100.0
        self.switch_on(mode, seed)
        arm = Z1Config("127.0.0.1", self._ports.command_port, self._ports.state_port, gain_ramp_s=0.3)
        limits = HardwareLimits(self_test_s=0.2, release_timeout_s=5.0)
        self.config = HardwareConfig(arm=arm, limits=limits, motion=BRISK, dry_run=dry_run)
        self.robot = Robot(MemoryBaseLink(self.wire), self.config.arm, self.config.limits, dry_run)
        model = RobotModel()
        self.supervisor = Supervisor(self.config, self.robot, model.position_lower, model.position_upper)
        self.command: JointCommand | None = None
        self.command_age_s = 0.0
        self.silent_s = 0.0
        self.operator_silent_s = 0.0
        self.request = Request.NONE
        self.sequence = 0

    def switch_on(self, mode: str, seed: int = 0) -> None:
        config = EmulatorConfig(mode=mode, arm=self._ports, seed=seed)
        self.emulator = Emulator(config, MemoryRobotLink(self.wire))

    def restart(self, mode: str) -> None:
        """Switch a killed robot on again; its clock starts at zero."""
        self._start_s = self.now
        self.emulator.close()
        self.switch_on(mode)

    @property
    def now(self) -> float:
        return self._start_s + self.emulator.body.time_s

    @property
    def state(self) -> DriveState:
        return self.supervisor.state

    def tick(self) -> None:
        if self.emulator.faults.kill:
            self._start_s += TICK_S
        else:
            self.emulator.step()
        fresh = self.robot.poll(self.now)
        control = ControlInput(
            self.command, self.command_age_s, self.silent_s, self.operator_silent_s, self.request, self.sequence
        )
        self.supervisor.step(self.now, fresh, control)

    def run(self, seconds: float, until: Callable[[], bool] = lambda: False) -> int:
        """Ticks until `until()` or the time is over; returns the number of ticks."""
        for tick in range(round(seconds / TICK_S)):
            self.tick()
            if until():
                return tick + 1
        return round(seconds / TICK_S)

    def ask(self, request: Request, seconds: float = 10.0, until: DriveState | None = None) -> None:
        self.request, self.sequence = request, self.sequence + 1
        self.run(seconds, lambda: until is not None and self.state in (until, DriveState.FAULT))
        if until is not None:
            assert self.state == until, (self.supervisor.message, self.supervisor.faults)

    def engage(self) -> None:
        self.run(0.05)
        self.ask(Request.ENGAGE, until=DriveState.DAMPED)

    def stand(self) -> None:
        self.ask(Request.STAND, until=DriveState.READY)

    def start_standing(self) -> None:
        """Put robot and supervisor into the held stance at once; test_drive_states walks the way there."""
        self.emulator.body.backend.reset()
        self.run(0.01)
        assert self.state == DriveState.OBSERVE
        self.supervisor._owns_motors = True
        self.supervisor._enter(DriveState.READY, self.now)
        self.run(0.4)
        assert self.state == DriveState.READY, self.supervisor.message

    @property
    def last_command(self) -> LowCommand:
        """Newest frame on the wire."""
        return LowCommand.decode(self.wire.log[-1])

    def damps(self) -> bool:
        """Whether the newest frame on the wire is pure damping."""
        motor = self.last_command.motor
        return not motor["kp"].any() and not motor["tau"].any() and bool((used_slots(motor["kd"]) > 0.0).all())

    def close(self) -> None:
        self.robot.close()
        self.emulator.close()
