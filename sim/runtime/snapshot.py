"""One consistent record of everything a console shows: what the control process publishes and pages, REST and streams read.

A snapshot is a numpy scalar record of dtype SNAPSHOT. Units SI; heading frame unless the name says world. NaN means
"not available" (truth on hardware, an estimator that does not run).
"""

from enum import IntEnum

import numpy as np

from control.joints import JOINT_COUNT, LEGS
from control.timing import MOST_ESTIMATORS
from control.types import Command

NAME_BYTES = 16
MAX_ESTIMATORS = MOST_ESTIMATORS
MAX_OBJECTS = 8
TICK_CLASSES = 17
MAX_READINGS = 8
MAX_PARAMETERS = 8
MAX_OBSERVATION = 160
"""sim.runtime.snapshot_limits refuses what is longer or more."""


class Mode(IntEnum):
    """What the control process is doing."""

    RUNNING = 0
    PAUSED = 1
    ESTOP = 2
    FAULT = 3


COMMAND = np.dtype(
    [
        ("mask", "u1", 3),
        ("force_n", "f8", 3),
        ("position_m", "f8", 3),
        ("orientation_wxyz", "f8", 4),
        ("base_velocity", "f8", 3),
        ("guidance", "?"),
    ]
)

NAME = f"S{NAME_BYTES}"

SNAPSHOT = np.dtype(
    [
        ("sequence", "u8"),  # counts snapshots
        ("time_s", "f8"),  # simulated (or robot) time
        ("wall_time_s", "f8"),  # time.time() of the tick
        ("published_s", "f8"),  # time.monotonic() of the snapshot
        ("mode", "u1"),  # Mode
        ("faults", "u4"),  # control.faults.Fault bits
        ("controller_error", "S160"),  # name and exception of the controller that failed, with the bit of that name
        ("estimator_error", "S160"),  # of the estimators that failed
        ("failure", "S160"),  # why the backend steps no more, and the cure; empty while it does
        ("backend", NAME),
        ("drive_state", "u1"),  # sim.backends.hardware.states.DriveState; on hardware only, as the next three
        ("drive_faults", "u4"),  # Trip bits
        ("drive_fault_joints", "u4"),  # whose they are: sim.backends.hardware.states.joint_bits
        ("dry_run", "?"),  # nothing is sent to the robot
        ("scene", NAME),
        ("controller", NAME),
        ("estimator", NAME),
        ("command_sequence", "u8"),  # of the newest set-point that took effect
        ("command", COMMAND),  # as asked
        ("applied_command", COMMAND),  # as applied: after guidance, limits, the tip-over limit and rate limits
        ("base_position", "f8", 3),  # in world; truth in simulation, odometry on hardware
        ("base_orientation_wxyz", "f8", 4),
        ("base_linear_velocity", "f8", 3),  # in heading, estimated
        ("odometry_position", "f8", 2),
        ("odometry_yaw", "f8"),
        ("odometry_sigma", "f8"),
        ("base_angular_velocity", "f8", 3),  # in base, measured
        ("joint_position", "f8", JOINT_COUNT),
        ("joint_velocity", "f8", JOINT_COUNT),
        ("joint_torque", "f8", JOINT_COUNT),
        ("end_effector_position", "f8", 3),  # in heading
        ("end_effector_orientation_wxyz", "f8", 4),  # in heading
        ("end_effector_position_in_world", "f8", 3),
        ("target_position_in_world", "f8", 3),  # applied position target, for the gizmo
        ("heading_yaw", "f8"),  # rad, heading frame in world
        ("force_estimated_n", "f8", 3),  # by the selected estimator, in heading
        ("force_sigma_n", "f8", 3),
        ("estimator_flags", "u4"),  # control.estimation.mistrust.EstimatorFlag bits
        ("force_true_n", "f8", 3),
        ("estimator_names", NAME, MAX_ESTIMATORS),
        ("force_estimates_n", "f8", (MAX_ESTIMATORS, 3)),
        ("force_of_controller_n", "f8", 3),  # estimated by the controller itself, in heading; NaN where it does not
        ("force_errors_rms_n", "f8", MAX_ESTIMATORS),  # N, last seconds, vector error against truth
        ("wheel_in_contact", "?", len(LEGS)),
        ("wheel_force_estimated_n", "f8", (len(LEGS), 3)),
        ("wheel_force_true_n", "f8", (len(LEGS), 3)),
        ("wheel_contact_position_in_world", "f8", (len(LEGS), 3)),
        ("policy_form", NAME),  # observation form of the selected policy (control.policy.observation), empty without one
        ("policy_observation", "f4", MAX_OBSERVATION),
        ("policy_action", "f4", JOINT_COUNT),
        ("mass_scale_estimated", "f8"),
        ("mass_scale_true", "f8"),
        ("tool_mass", "f8"),  # kg, what the hand carries as set or found
        ("tool_center_of_mass", "f8", 3),  # m, in the end effector's frame
        ("tool_progress", "f8"),  # of the motion that finds the tool, 0 to 1; NaN without one
        ("tool_message", "S160"),  # why the last motion found none, or why the tool seems not to be there
        ("tare_n", "f8", 3),  # N, in heading, taken from the selected estimate
        ("mass_adapting", "?"),  # the masses that the selected estimator finds still move
        ("object_count", "u1"),
        ("object_position", "f8", (MAX_OBJECTS, 3)),  # movable bodies of the scene, in world; NaN from their number on
        ("object_orientation_wxyz", "f8", (MAX_OBJECTS, 4)),
        ("reading_names", NAME, MAX_READINGS),  # of the scene; empty from their number on
        ("readings", "f8", MAX_READINGS),
        ("parameter_names", NAME, MAX_PARAMETERS),  # of the scene
        ("parameters", "f8", MAX_PARAMETERS),
        ("task_id", "u4"),  # of the task begun last, 0 before the first
        ("task_name", NAME),
        ("task_phase", NAME),
        ("task_progress", "f8"),
        ("task_outcome", "u1"),  # sim.tasks.runner.Outcome
        ("task_in_charge", "?"),  # `command` is the task's, not the operator's
        ("drag_active", "?"),
        ("drag_target_in_world", "f8", 3),
        ("drag_force_n", "f8", 3),  # in heading
        ("loop_rate_hz", "f8"),
        ("real_time_factor", "f8"),
        ("overruns", "u8"),  # since the start
        ("overruns_last_minute", "u8"),
        ("overrun_share", "f8"),  # of the ticks of the last seconds
        ("rebases", "u4"),  # times the loop fell so far behind that it dropped the lost time
        ("held_s", "f8"),  # time spent on slow work that was asked for, such as loading a scene
        ("lateness_p99_ms", "f8"),
        ("tick_median_us", "f8"),
        ("realtime_scheduling", "?"),  # SCHED_FIFO was granted
        ("speed", "f8"),
        ("tick_histogram", "u8", TICK_CLASSES),  # ticks by duration, see server.pacing
        ("tick_total_s", "f8"),  # sum of their durations
        ("history_start_s", "f8"),  # simulated time that can be gone back to; NaN where none
        ("history_end_s", "f8"),
        ("past", "?"),  # an earlier moment is shown than the newest
        ("recording", "S64"),  # id of the recording under way, empty without one
        ("recording_s", "f8"),
        ("recording_bytes", "u8"),
        ("branch", "u4"),  # counts how often the simulation has gone on from an earlier moment
    ]
)

SETPOINT = np.dtype(
    [
        ("sequence", "u8"),  # counts changes of `command`
        ("heartbeat_s", "f8"),  # time.monotonic() of the web process's last sign of life, 0 before the first
        ("command", COMMAND),
        ("drag_active", "?"),
        ("drag_target_in_world", "f8", 3),
    ]
)
"""What the web process writes, latest wins: the command as asked (within limits) and the operator's drag spring."""


def on_hardware(record: np.void) -> bool:
    """Whether a SNAPSHOT record is of a robot behind its wire, real or emulated, not of the simulation."""
    return record["backend"] == b"hardware"


def named(record: np.void, kind: str) -> dict[str, float]:
    """The readings or the parameters of the scene, as `kind` says, of a SNAPSHOT record."""
    pairs = zip(record[f"{kind}_names"].tolist(), record[f"{kind}s"].tolist(), strict=True)
    return {name.decode(): value for name, value in pairs if name}


def command_from_record(record: np.void) -> Command:
    """Command of a COMMAND record (copied)."""
    return Command(
        mask=record["mask"].astype(float),
        force_n=record["force_n"].copy(),
        position_m=record["position_m"].copy(),
        orientation_wxyz=record["orientation_wxyz"].copy(),
        base_velocity=record["base_velocity"].copy(),
        guidance=bool(record["guidance"]),
    )


def command_to_record(command: Command, record: np.void) -> None:
    """Write a command into a COMMAND record."""
    record["mask"] = command.mask
    record["force_n"] = command.force_n
    record["position_m"] = command.position_m
    record["orientation_wxyz"] = command.orientation_wxyz
    record["base_velocity"] = command.base_velocity
    record["guidance"] = command.guidance
