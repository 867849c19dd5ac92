"""The process that talks to the robot at 500 Hz and outlives everybody who tells it what to do.

`python -m sim.backends.hardware.io.process --config JSON` is started by HardwareBackend in a session of its own.
When control, policy or page die or fall silent it damps the robot; it ends by itself only when nobody controls and the
robot lies at rest.

Signals: SIGUSR1 is an e-stop. SIGTERM and SIGINT damp, wait until the robot is at rest (at most 5 s), and end. The same comes
by mail (sim.backends.hardware.mailbox), also when the shared memory has been removed.

It wakes with every state of the robot. When states stop it ticks by its own clock, so that damping reaches the wire at 500 Hz.
"""

import argparse
import ctypes
import gc
import logging
import signal
import sys
import time
from collections.abc import Sequence
from typing import Any

from control.robot_model import RobotModel
from control.timing import TICK_S
from sim.backends.hardware.config import HardwareConfig
from sim.backends.hardware.io.loop import IoLoop
from sim.backends.hardware.io.supervisor import Supervisor
from sim.backends.hardware.mailbox import Answer, Mailbox, Order, mailbox_name
from sim.backends.hardware.records import IoMemory, memory_path
from sim.backends.hardware.robot import Robot
from sim.backends.hardware.states import DriveState, Trip
from sim.backends.protocol import BackendError
from sim.backends.unitree.dds import DdsBaseLink
from sim.processes.heap import return_freed_memory
from sim.processes.realtime import request_realtime
from sim.processes.standard_streams import protect_standard_streams

PATIENCE_S = 0.0035
"""A state this late is not waited for: the tick goes ahead without it."""

END_AFTER_S = 5.0
ORPHANED_S = 1.0
"""Without a sign of life of a control process."""

FIFO_PRIORITY = 30
EXIT_REFUSED = 3
_LOCK_CURRENT_AND_FUTURE = 3

_log = logging.getLogger("forcelens.io")


class IoProcess:
    """Pacing and ending of one IoLoop."""

    def __init__(self, config: HardwareConfig) -> None:
        """Raises BackendError when the robot is taken or its network cannot be used."""
        self.config = config
        self._mailbox = Mailbox(mailbox_name(config))
        # Before the network, whose receiving thread inherits it: on a busy machine states would come late without.
        self._realtime = request_realtime(FIFO_PRIORITY)
        model = RobotModel()
        robot = Robot(DdsBaseLink(config.base), config.arm, config.limits, config.dry_run, config.echo_tick)
        supervisor = Supervisor(config, robot, model.position_lower, model.position_upper)
        self._path = memory_path(config)
        self._memory = IoMemory(self._path, create=True)
        self.loop = IoLoop(config, robot, supervisor, self._memory)
        self._end_asked_s: float | None = None
        self._idle_since_s: float | None = None

    def run(self) -> None:
        """Tick until told to end, or nobody needs it any more."""
        signal.signal(signal.SIGUSR1, self._on_estop)
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._on_end)
        _lock_memory()
        gc.collect()
        gc.freeze()
        link = self.loop.robot.base.link
        last = time.monotonic()
        patience = PATIENCE_S
        while True:
            link.wait(last + patience - time.monotonic())
            now = last = time.monotonic()
            senders = self._take_orders()
            # Once states have stopped, its own clock keeps the rate.
            patience = PATIENCE_S if self.loop.tick(now, self._realtime) else TICK_S
            answer = Answer(self.loop.supervisor.state, not self._orphaned(now))
            for sender in senders:
                self._mailbox.answer(sender, answer)
            if self._finished(now):
                break
        self.loop.robot.close()
        if self._memory.has_name:
            self._path.unlink(missing_ok=True)
        self._mailbox.close()

    def _take_orders(self) -> list[Any]:
        """Obey what has come by mail; who is to be answered after the tick."""
        senders = []
        for order, sender in self._mailbox.take():
            senders.append(sender)
            if order is Order.ESTOP:
                self._on_estop()
            elif order is Order.END:
                self._on_end()
        return senders

    def _orphaned(self, now: float) -> bool:
        return now - self.loop.control_heard_s > ORPHANED_S

    def _finished(self, now: float) -> bool:
        supervisor = self.loop.supervisor
        quiet = supervisor.state in (DriveState.DISCONNECTED, DriveState.OBSERVE)
        gone = now - self.loop.robot.base.received_s > self.config.limits.orphan_s
        resting = quiet or self.config.dry_run or supervisor.at_rest or gone
        if self._end_asked_s is not None:
            return resting or now - self._end_asked_s > END_AFTER_S
        orphaned = self._orphaned(now)
        if orphaned and not self._memory.has_name:
            _log.error("the shared memory was removed, and with control silent nobody can command any more; ending")
            self._on_end()
            return False
        settled = quiet or (supervisor.state in (DriveState.DAMPED, DriveState.FAULT) and resting)
        if not (orphaned and settled):
            self._idle_since_s = None
            return False
        if self._idle_since_s is None:
            self._idle_since_s = now
        return now - self._idle_since_s > self.config.limits.orphan_s

    def _on_estop(self, *_: Any) -> None:
        self.loop.signalled |= Trip.ESTOP

    def _on_end(self, *_: Any) -> None:
        self.loop.signalled |= Trip.SIGNAL
        self.loop.ending = True
        if self._end_asked_s is None:
            self._end_asked_s = time.monotonic()


def _lock_memory() -> None:
    try:
        failed = ctypes.CDLL(None, use_errno=True).mlockall(_LOCK_CURRENT_AND_FUTURE)
    except (OSError, AttributeError):
        failed = True
    if failed:
        _log.info("memory is not locked; a page fault may delay a tick")


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--config", type=HardwareConfig.from_json, default=HardwareConfig(), help="HardwareConfig as JSON")
    options = parser.parse_args(arguments)
    protect_standard_streams()
    return_freed_memory()
    logging.basicConfig(level=logging.INFO, format="%(name)s: %(levelname)s: %(message)s")
    try:
        process = IoProcess(options.config)
    except BackendError as error:
        _log.error("%s", error)
        sys.stdout.write(str(error))  # for the process that started this one
        return EXIT_REFUSED
    process.run()
    return 0


if __name__ == "__main__":
    sys.exit(main())
