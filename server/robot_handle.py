"""The robot behind the control process: commanded through that process, but watched, stopped and let go without it."""

import time

from server.backend_choice import BackendChoice
from server.control_client import ControlClient
from server.errors import ControlTimeoutError, RefusedError
from server.schemas import DriveRequest
from server.validation import validated
from sim.backends.hardware.remote import HardwareRemote
from sim.backends.hardware.states import DriveState
from sim.backends.hardware.status import HardwareStatus

HANDLED_S = 1.0
"""The I/O process takes a request within a tick of 2 ms; a machine may be busier."""


class RobotHandle:
    """Any thread may call. In simulation there is no robot: nothing to watch, nothing to stop.

    Attributes:
        choice: what the control process drives, or is being started to drive.
    """

    def __init__(self, client: ControlClient) -> None:
        self.choice = BackendChoice()
        self._client = client

    def status(self) -> HardwareStatus | None:
        """What the I/O process reports, also while the control process is dead; None without a robot."""
        remote = self._remote
        return None if remote is None else remote.status()

    def require(self) -> HardwareStatus:
        """`status`.

        Raises:
            RefusedError: there is none.
        """
        status = self.status()
        if status is not None:
            return status
        if self.choice.hardware is None:
            raise RefusedError("the backend is the simulation; PUT /api/v1/backend with 'hardware' first")
        raise RefusedError("no I/O process runs, so the robot gets no commands; POST /api/v1/control/restart")

    def drive(self, request: str) -> HardwareStatus:
        """Ask the drives for a change of state, by the name of a Request; answers once it has begun.

        Raises:
            InvalidFieldError: no such request.
            RefusedError: the backend is not hardware, or the drives' state forbids it.
            ControlTimeoutError: the I/O process did not take it.
        """
        request = validated(DriveRequest, {"request": request})["request"]
        self.require()
        sequence = self._client.call("drive", request=request)
        deadline = time.monotonic() + HANDLED_S
        while (status := self.require()).request_sequence != sequence:
            if time.monotonic() > deadline:
                raise ControlTimeoutError(f"the I/O process did not take {request!r} within {HANDLED_S:g} s")
            time.sleep(0.005)
        if status.refused:
            raise RefusedError(status.message)
        return status

    def estop(self) -> None:
        """Latch the drives' FAULT. Without an I/O process nothing of ours moves the robot, and nothing happens."""
        if self._remote is not None:
            self._remote.estop()

    def stopped(self) -> bool:
        """Whether the I/O process reports that it damps in FAULT."""
        seen = self.status() or (None if self._remote is None else self._remote.report())
        return seen is not None and seen.state == DriveState.FAULT

    def end(self) -> None:
        """Tell the I/O process to damp and to end when the robot is at rest."""
        if self._remote is not None:
            self._remote.end()

    @property
    def _remote(self) -> HardwareRemote | None:
        return None if self.choice.hardware is None else HardwareRemote(self.choice.hardware)
