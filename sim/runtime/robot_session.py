"""The session of a real robot: the same pipeline, estimators and snapshots, and besides the states of its drives.

Before POLICY the pipeline watches: estimates are shown, its commands go nowhere. When the drives' state machine enters
POLICY the pipeline starts afresh from the measured posture, so that nothing of the time before jumps into the motors.
"""

from collections.abc import Mapping

import numpy as np

from control.faults import Fault
from control.pipeline import PipelineConfig, PipelineOutput
from control.types import Command
from sim.backends.hardware.backend import HardwareBackend
from sim.backends.hardware.states import REQUEST_NAMES, DriveState, Request
from sim.runtime.fault_words import ESTOP_LATCHED
from sim.runtime.session import Session, SessionError
from sim.runtime.snapshot import Mode
from sim.tasks.desk import TaskRecord

WATCHING_FAULTS = Fault.CONTROLLER_ERROR | Fault.ESTIMATOR_ERROR | Fault.ESTIMATOR_STALE | Fault.NOT_FINITE
"""Of a pipeline that only watches: what is wrong with it and what it reads. The others are about a robot that obeys it."""


class RobotSession(Session[HardwareBackend]):
    """A session around HardwareBackend.

    Args:
        backend: the robot; opened here.
        pipeline: how to make the pipeline.

    Raises:
        BackendError: the robot cannot be reached; the message names the cure.
        SnapshotLimitError: what is registered does not fit into a snapshot.
    """

    def __init__(self, backend: HardwareBackend, pipeline: PipelineConfig | None = None) -> None:
        self._drive_state = DriveState.DISCONNECTED
        super().__init__(backend, pipeline)

    @property
    def mode(self) -> Mode:
        """ESTOP while the e-stop is latched here, FAULT while the drives are in FAULT or damp because the pipeline does."""
        if self.pipeline.estop_latched:
            return Mode.ESTOP
        if self.backend.state == DriveState.FAULT:
            return Mode.FAULT
        # As of the last tick, whose output is the first that acts.
        return super().mode if self._drive_state == DriveState.POLICY else Mode.RUNNING

    def tick(self, command: Command, command_age_s: float = 0.0) -> PipelineOutput:
        """One 2 ms tick on the newest state. The operator's age goes to the I/O process, which damps when it grows."""
        self.backend.operator_silent_s = command_age_s
        state = self.backend.state
        if state != self._drive_state and state == DriveState.POLICY:
            self._reset_pipeline()
        if state != DriveState.POLICY:
            self.tasks.drop("the controller no longer moves the robot")
        self._drive_state = state
        return super().tick(command, command_age_s)

    def start_task(self, name: str, options: Mapping[str, float], sequence: int = 0) -> TaskRecord:
        """See Session; only while the controller moves the robot."""
        if self._drive_state != DriveState.POLICY:
            raise SessionError('the controller does not move the robot; POST /api/v1/hardware {"request": "start"} first')
        return super().start_task(name, options, sequence)

    def drive(self, request: str) -> int:
        """Ask for a change of the drives' state, by the name of a Request in lower case; returns its sequence number.

        Raises:
            ValueError: no such request.
            SessionError: the e-stop is latched.
        """
        if request not in REQUEST_NAMES:
            raise ValueError(f"request must be one of {', '.join(REQUEST_NAMES)}")
        if self.pipeline.estop_latched:
            raise SessionError(ESTOP_LATCHED)
        return self.backend.request(Request[request.upper()])

    def estop(self) -> None:
        """Latch the e-stop here and in the I/O process."""
        self.backend.estop()
        super().estop()

    def clear_estop(self) -> None:
        """Clear the e-stop here; the drives' FAULT is cleared too if the robot is at rest, and then needs STAND."""
        super().clear_estop()
        self.backend.request(Request.CLEAR)

    def fill(self, record: np.void) -> None:
        """See Session."""
        super().fill(record)
        backend = self.backend
        record["scene"] = "robot"
        record["drive_state"], record["drive_faults"] = backend.state, int(backend.faults)
        record["drive_fault_joints"] = backend.fault_joints
        record["dry_run"] = backend.config.dry_run
        if backend.state != DriveState.POLICY:
            record["faults"] &= int(WATCHING_FAULTS)
