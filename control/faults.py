"""Why the robot does not do what it is told: the faults of the pipeline, and their words for people."""

from collections.abc import Mapping
from enum import IntFlag


class Fault(IntFlag):
    """Reasons why the pipeline damps, limits, or makes do with less than it should have; bits of `faults`."""

    NONE = 0
    TILT = 1
    NOT_FINITE = 2
    STALE_SETPOINT = 4
    STALE_TARGETS = 8
    JOINT_LIMIT = 16
    TORQUE_LIMIT = 32
    ESTIMATOR_STALE = 64
    CONTROLLER_ERROR = 128
    TIP_OVER_LIMIT = 256
    ESTIMATOR_ERROR = 512


FAULT_WORDS: dict[Fault, str] = {
    Fault.TILT: "the base tilts too far",
    Fault.NOT_FINITE: "a measured value or a joint target is not finite",
    Fault.STALE_SETPOINT: "no fresh command arrives, so the base stops",
    Fault.STALE_TARGETS: "the controller delivers no new joint targets",
    Fault.JOINT_LIMIT: "a joint is at its limit",
    Fault.TORQUE_LIMIT: "a joint is at its torque limit",
    Fault.ESTIMATOR_STALE: "the force estimate is stale, its last good value is repeated",
    Fault.CONTROLLER_ERROR: "the controller failed, select another one",
    Fault.TIP_OVER_LIMIT: "commanded force reduced, the robot would tip over",
    Fault.ESTIMATOR_ERROR: "a force estimator failed",
}


def describe(faults: Fault, details: Mapping[Fault, str]) -> dict[str, str]:
    """Words of each fault by its name, followed by the details of those that have any."""
    return {
        str(fault.name): f"{FAULT_WORDS[fault]}: {details[fault]}" if details.get(fault) else FAULT_WORDS[fault]
        for fault in faults
    }
