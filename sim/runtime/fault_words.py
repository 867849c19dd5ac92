"""What is wrong with the robot of a snapshot, in words for people: REST, stream, page and console take them from here."""

import numpy as np

from control.faults import Fault, describe
from sim.backends.hardware import states
from sim.runtime.snapshot import Mode, on_hardware

BACKEND_ERROR = "BACKEND_ERROR"
CONTROL_PROCESS_DEAD = "CONTROL_PROCESS_DEAD"
CONTROL_PROCESS_DEAD_WORDS = "The control process has stopped. Nothing controls the robot."


def fault_words(record: np.void) -> dict[str, str]:
    """Words for each fault and limit of a SNAPSHOT record, by name."""
    details = {fault: _text(record, str(fault.name).lower()) for fault in (Fault.CONTROLLER_ERROR, Fault.ESTIMATOR_ERROR)}
    words = describe(Fault(int(record["faults"])), details)
    if record["backend_error"]:
        words[BACKEND_ERROR] = f"the backend failed: {_text(record, 'backend_error')}"
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
    reasons = "; ".join([*drive_fault_words(record), *fault_words(record).values()])
    return f"Fault: {reasons}." if record["backend_error"] else f"Fault: motors are damping only ({reasons})."


def _text(record: np.void, field: str) -> str:
    return record[field].decode(errors="replace")
