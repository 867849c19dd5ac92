"""One tick of a session as a row of doubles: recordings are made of it (sim.recording.tap), sim.runtime.tick_row writes it."""

import numpy as np

from control.joints import JOINT_COUNT
from control.timing import MOST_ESTIMATORS
from sim.runtime.snapshot import COMMAND

TICK = np.dtype(
    [
        ("time_s", "f8"),  # of the session, after the tick
        ("sensor_time_s", "f8"),
        ("orientation_wxyz", "f8", 4),
        ("angular_velocity", "f8", 3),
        ("linear_acceleration", "f8", 3),
        ("joint_position", "f8", JOINT_COUNT),
        ("joint_velocity", "f8", JOINT_COUNT),
        ("joint_torque", "f8", JOINT_COUNT),
        ("command", [(name, "f8", COMMAND[name].shape) for name in COMMAND.names or ()]),  # as it went into the pipeline
        ("command_age_s", "f8"),
        ("applied_mask", "f8", 3),  # of the command as applied, which the next tick's estimators read
        ("estimates_n", "f8", (MOST_ESTIMATORS, 3)),  # in the order of the pipeline's estimators, NaN where there is none
        ("sigma_n", "f8", 3),
        ("target_position", "f8", JOINT_COUNT),  # to the drives
        ("target_velocity", "f8", JOINT_COUNT),
    ]
)
"""One tick. Units SI; forces in heading, of the environment on the robot. Doubles only, so that it is written as one row."""
