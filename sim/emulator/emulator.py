"""The emulated robot as a whole: body, base board and arm controller, stepped at 500 Hz in real time or in lockstep."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from queue import SimpleQueue

import numpy as np

from control.joints import JOINT_COUNT
from control.timing import TICK_S
from control.types import JointCommand
from sim.backends.simulation.sensors import SensorConfig
from sim.backends.unitree.link import RobotLink
from sim.emulator.arm_controller import ArmController, ArmPorts
from sim.emulator.base_board import DEFAULT_MODE, BaseBoard
from sim.emulator.faults import Faults
from sim.emulator.physics import RobotBody

RESEND_S = 0.05
_BEHIND_S = 0.1


@dataclass(frozen=True, slots=True)
class EmulatorConfig:
    """What is emulated.

    Attributes:
        sensors: errors of the emulated robot's sensors.
        seed: of sensor errors, random faults and what the scene draws.
        scene, behind_m: where the robot is switched on, see RobotBody.
        mode: motion program that owns the motors at power-on; empty for none.
        arm: UDP ports of the arm.
    """

    sensors: SensorConfig = field(default_factory=SensorConfig)
    seed: int = 0
    scene: str = "free"
    behind_m: float = 0.0
    mode: str = DEFAULT_MODE
    arm: ArmPorts = field(default_factory=ArmPorts)


class Emulator:
    """One emulated robot on one link. Single-threaded: call `step`, or one of the `run_` methods.

    Attributes:
        faults: may be changed at any time between steps.
        command: what the motors did in the last step; for tests.
        steps: physics steps so far.
        resends: states sent again in lockstep because no answer came.
    """

    def __init__(self, config: EmulatorConfig, link: RobotLink) -> None:
        self.faults = Faults()
        self.body = RobotBody(config.sensors, config.seed, config.scene, config.behind_m)
        self.base = BaseBoard(link, self.body, self.faults, config.seed + 10, config.mode)
        self.arm = ArmController(config.arm, self.body, self.faults, config.seed + 20)
        self.command = JointCommand(*(np.zeros(JOINT_COUNT) for _ in range(5)))
        self.steps = 0
        self.resends = 0
        self._link = link
        self._orders: SimpleQueue[Callable[[], object]] = SimpleQueue()

    def between_steps(self, action: Callable[[], object]) -> None:
        """Run `action` before the next step, in the thread that steps. Any thread may ask."""
        self._orders.put(action)

    def step(self) -> None:
        """Take in commands, advance by 2 ms, publish."""
        while not self._orders.empty():
            self._orders.get()()
        self.arm.receive()
        self.base.receive()
        self.base.drive(self.command)
        self.arm.drive(self.command)
        self.body.step(self.command)
        self.steps += 1
        self.publish()

    def publish(self) -> None:
        """Send the present state of arm and base, the base last: its arrival starts the client's turn."""
        self.arm.publish()
        self.base.publish()

    def run_realtime(self, duration_s: float | None = None) -> None:
        """Step at 500 Hz of wall-clock time until `duration_s` is over or the "kill" fault is set."""
        start = due = time.perf_counter()
        while not self.faults.kill and (duration_s is None or time.perf_counter() - start < duration_s):
            due += TICK_S
            wait = due - time.perf_counter()
            if wait > 0:
                time.sleep(wait)
            elif wait < -_BEHIND_S:
                due = time.perf_counter()
            self.step()

    def run_lockstep(self, duration_s: float | None = None, give_up_s: float = 30.0) -> None:
        """Step whenever the command that echoes the last state's tick has arrived; sends that state again if none comes.

        Args:
            duration_s: simulated time to run, None for ever.
            give_up_s: end after this long without an answer.
        """
        self.publish()
        answered_s = sent_s = time.perf_counter()
        end = np.inf if duration_s is None else self.body.time_s + duration_s
        while self.body.time_s < end and not self.faults.kill:
            self._link.wait(RESEND_S)
            self.base.receive()
            now = time.perf_counter()
            if self.base.echoed_ms == round(1000 * self.body.time_s):
                self.step()
                answered_s = sent_s = now
            elif now - answered_s > give_up_s:
                return
            elif now - sent_s > RESEND_S:
                self.publish()
                self.resends += 1
                sent_s = now

    def close(self) -> None:
        """Leave the network."""
        self.arm.close()
        self._link.close()
