"""A robot's I/O process as any process of this user can reach it, whether or not a control process lives."""

import contextlib
import time

import numpy as np

from sim.backends.hardware.config import HardwareConfig
from sim.backends.hardware.mailbox import Answer, Order, ask, mailbox_name
from sim.backends.hardware.records import IoMemory, memory_path
from sim.backends.hardware.status import HardwareStatus, status_from_record
from sim.backends.protocol import BackendError

ALIVE_S = 1.0
"""An I/O process that has not reported for this long is dead."""


class HardwareRemote:
    """Looks, stops and ends; only the control process commands.

    Args:
        config: names the robot's network.
    """

    def __init__(self, config: HardwareConfig) -> None:
        self.config = config

    def status(self) -> HardwareStatus | None:
        """What the I/O process reports, None when none runs."""
        try:
            _, record = self._find()
        except BackendError:
            return None
        return status_from_record(record, time.monotonic())

    def report(self) -> Answer | None:
        """What the I/O process itself answers, without shared memory; None when none runs, or when it hangs."""
        return ask(mailbox_name(self.config), Order.REPORT)

    def estop(self) -> None:
        """Latch FAULT: damping from the I/O process's next tick on. Without one, nothing of ours moves the robot.

        It goes two ways: one may be full of a stranger's messages, the other's file may have been removed.
        """
        with contextlib.suppress(BackendError):
            self._find()[0].estop = True
        ask(mailbox_name(self.config), Order.ESTOP)

    def end(self) -> None:
        """Tell the I/O process to damp and to end when the robot is at rest; nothing happens when none runs."""
        ask(mailbox_name(self.config), Order.END)

    def _find(self) -> tuple[IoMemory, np.void]:
        memory = IoMemory(memory_path(self.config))
        newest = memory.state.read()
        # The file of a process that was killed stays.
        if newest is None or time.monotonic() - float(newest[0]["time_s"]) > ALIVE_S:
            raise BackendError("no I/O process runs, so Forcelens sends the robot nothing; use the robot's own stop")
        return memory, newest[0]
