"""What is wrong with the robot of a snapshot, in words for people: REST, stream, page and console take them from here.

Only the words for a drive's own reasons stand beside them, in `sim.backends.hardware.states`: the I/O process says them too.
"""

from collections.abc import Mapping

import numpy as np

from control.estimation.mistrust import EstimatorFlag
from control.faults import Fault
from sim.backends.hardware import states
from sim.runtime.snapshot import Mode, on_hardware

BACKEND_FAILED = "BACKEND_FAILED"
"""Its reason is the snapshot's `failure`."""

LOOP_OVERRUNS = "LOOP_OVERRUNS"
OVERRUN_SHARE_LIMIT = 0.05
"""More missed deadlines than this, and the loop does not keep its rate."""

ESTOP_LATCHED = "the e-stop is latched; POST /api/v1/estop/clear first"
"""Why a request is refused."""

CONTROL_PROCESS_DEAD = "CONTROL_PROCESS_DEAD"
CONTROL_PROCESS_SILENT = "CONTROL_PROCESS_SILENT"
SILENCE_WORDS = {
    CONTROL_PROCESS_DEAD: "The control process has stopped: nothing controls the robot. Restart it.",
    CONTROL_PROCESS_SILENT: "The control process does not answer, and the state is the last known. Restart it.",
}

FAULT_WORDS: dict[Fault, str] = {
    Fault.TILT: "the base tilts too far",
    Fault.NOT_FINITE: "a measured value or a joint target is not finite",
    Fault.STALE_SETPOINT: "no fresh command arrives, so the base stops",
    Fault.STALE_TARGETS: "the controller delivers no new joint targets",
    Fault.JOINT_LIMIT: "a joint is at its limit",
    Fault.TORQUE_LIMIT: "a joint is at its torque limit",
    Fault.ESTIMATOR_STALE: "the force estimate is stale, its last good value is repeated",
    Fault.CONTROLLER_ERROR: "the controller failed, select another one",
    Fault.TIP_OVER_LIMIT: "the robot would tip over: commanded force reduced, or the base drives under the load",
    Fault.ESTIMATOR_ERROR: "a force estimator failed",
    Fault.SELF_CONTACT_LIMIT: "the arm would touch the robot, so the hand stops",
    Fault.OUT_OF_REACH: "the hand cannot reach where it is asked to be",
    Fault.BASE_BLOCKED: "the base does not go where it is driven, so it stops; drive the other way",
}

FLAG_WORDS: dict[EstimatorFlag, str] = {
    EstimatorFlag.JOINT_AT_STOP: "an arm joint is at its end",
    EstimatorFlag.SELF_CONTACT: "the arm may touch the robot",
    EstimatorFlag.CONTACT_ELSEWHERE: "something else than the hand is touched",
    EstimatorFlag.MASS_ADAPTING: "masses are adapting",
}


def describe(faults: Fault, details: Mapping[Fault, str]) -> dict[str, str]:
    """Words of each fault by its name, followed by the details of those that have any."""
    return {
        str(fault.name): f"{FAULT_WORDS[fault]}: {details[fault]}" if details.get(fault) else FAULT_WORDS[fault]
        for fault in faults
    }


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
    if not on_hardware(record):
        return []
    return states.describe(states.Trip(int(record["drive_faults"])), int(record["drive_fault_joints"]))


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


def estimator_flags(record: np.void) -> list[EstimatorFlag]:
    """Why the selected estimate of a SNAPSHOT record is to be mistrusted."""
    return list(EstimatorFlag(int(record["estimator_flags"])))
