"""Why the robot does not do what it is told: the faults of the pipeline."""

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
    SELF_CONTACT_LIMIT = 1024
    OUT_OF_REACH = 2048
    BASE_BLOCKED = 4096
