"""What is wrong with the robot of a snapshot, in words for people: REST, stream, page and console take them from here."""

import numpy as np

from control.faults import Fault, describe
from sim.backends.hardware import states
from sim.runtime.snapshot import Mode, on_hardware

BACKEND_FAILED = "BACKEND_FAILED"
"""Its reason is the snapshot's `failure`."""

LOOP_OVERRUNS = "LOOP_OVERRUNS"
OVERRUN_SHARE_LIMIT = 0.05
"""More missed deadlines than this, and the loop does not keep its rate."""

NO_SNAPSHOT_WORDS = "The control process has stopped, or hangs. Restart it in the bar at the top."


def fault_words(record: np.void) -> dict[str, str]:
    """Words for each fault and limit of a SNAPSHOT record, by name."""
    words = {BACKEND_FAILED: f"the backend failed: {_text(record, 'failure')}"} if record["failure"] else {}
    details = {fault: _text(record, str(fault.name).lower()) for fault in (Fault.CONTROLLER_ERROR, Fault.ESTIMATOR_ERROR)}
    words |= describe(Fault(int(record["faults"])), details)
    if record["overrun_share"] >= OVERRUN_SHARE_LIMIT:
        words[LOOP_OVERRUNS] = "the control loop cannot keep its rate: one tick in twenty or more is late"
    return words


def drive_fault_words(record: np.void) -> list[str]:
    """Words for each fault of a robot's drives; none in simulation."""
    return states.describe(states.Trip(int(record["drive_faults"]))) if on_hardware(record) else []


def message(record: np.void) -> str | None:
    """Why the robot of a SNAPSHOT record does not obey, in one sentence; None while it does."""
    mode = Mode(int(record["mode"]))
    if mode is Mode.ESTOP:
        return "E-stop is latched: motors are damping only, and the robot may sink to the ground."
    if mode is not Mode.FAULT:
        return None
    if record["failure"]:
        return f"Stopped: {_text(record, 'failure')}."
    reasons = "; ".join([*drive_fault_words(record), *fault_words(record).values()])
    return f"Fault: motors are damping only ({reasons})."


def _text(record: np.void, field: str) -> str:
    return record[field].decode(errors="replace")
