"""Kernels that write into a snapshot record; sim.runtime.snapshot_writer says what is written."""

import math

import numpy as np

from control.frames import quaternion_from_rotation, rotation_from_quaternion, rotation_heading_to_world
from control.kernels.compiled import kernel
from control.kernels.small_algebra import rotate, rotate_back
from sim.runtime.snapshot import COMMAND, SNAPSHOT

LOADED_WHEEL_N = 5.0
"""Estimated normal force above which a wheel counts as in contact where there is no truth."""


_COMMAND = np.dtype((np.record, COMMAND))


def _numbers_layout() -> np.dtype:
    all_fields = (SNAPSHOT.fields or {}).items()
    fields = {name: (layout, offset) for name, (layout, offset, *_) in all_fields if layout.base.kind != "S"}
    return np.dtype(
        (
            np.record,
            {
                "names": [*fields],
                "formats": [_known(layout) for layout, _ in fields.values()],
                "offsets": [offset for _, offset in fields.values()],
                "itemsize": SNAPSHOT.itemsize,
            },
        )
    )


def _known(layout: np.dtype) -> np.dtype:
    """How kernels know a field."""
    if layout == COMMAND:
        return _COMMAND
    return np.dtype((np.uint8, layout.shape)) if layout.shape and layout.base.kind == "b" else layout


NUMBERS = _numbers_layout()
"""A SNAPSHOT as kernels can know it, at the same places: without texts, and arrays of truth values as bytes."""


@kernel("void(Snapshot[::1], f8, i8, i8, i8)", Snapshot=NUMBERS)
def put_session(numbers: np.ndarray, time_s: float, mode: int, faults: int, command_sequence: int) -> None:
    """See `write_session`."""
    record = numbers[0]
    record.sequence += np.uint64(1)
    record.time_s = time_s
    record.mode, record.faults, record.command_sequence = mode, faults, command_sequence
    record.mass_scale_true = math.nan
    record.drag_target_in_world[:] = math.nan
    record.drag_force_n[:] = math.nan


@kernel("void(Snapshot[::1], f8, b1, vector, vector)", Snapshot=NUMBERS)
def put_simulation(
    numbers: np.ndarray, mass_scale: float, drag_active: bool, drag_target: np.ndarray, drag_force: np.ndarray
) -> None:
    """See `write_simulation`; the heading is that of the true base."""
    record = numbers[0]
    record.mass_scale_true, record.drag_active = mass_scale, drag_active
    c, s = math.cos(record.heading_yaw), math.sin(record.heading_yaw)
    for i in range(3):
        record.drag_target_in_world[i] = drag_target[i]
    record.drag_force_n[0] = c * drag_force[0] + s * drag_force[1]
    record.drag_force_n[1] = c * drag_force[1] - s * drag_force[0]
    record.drag_force_n[2] = drag_force[2]


@kernel("void(Command, vector, vector, vector, vector, vector, b1)", Command=_COMMAND)
def put_command(
    record: np.void,
    mask: np.ndarray,
    force_n: np.ndarray,
    position_m: np.ndarray,
    orientation_wxyz: np.ndarray,
    base_velocity: np.ndarray,
    guidance: bool,
) -> None:
    """Copy a command."""
    for i in range(3):
        record.mask[i] = np.uint8(mask[i])
        record.force_n[i], record.position_m[i], record.base_velocity[i] = force_n[i], position_m[i], base_velocity[i]
    for i in range(4):
        record.orientation_wxyz[i] = orientation_wxyz[i]
    record.guidance = guidance


@kernel(
    "void(Snapshot[::1], vector, vector, vector, vector, vector, b1, vector, vector, vector, vector, vector, b1)",
    Snapshot=NUMBERS,
)
def put_commands(
    numbers: np.ndarray,
    mask: np.ndarray,
    force_n: np.ndarray,
    position_m: np.ndarray,
    orientation_wxyz: np.ndarray,
    base_velocity: np.ndarray,
    guidance: bool,
    applied_mask: np.ndarray,
    applied_force_n: np.ndarray,
    applied_position_m: np.ndarray,
    applied_orientation_wxyz: np.ndarray,
    applied_base_velocity: np.ndarray,
    applied_guidance: bool,
) -> None:
    """Copy the commands asked for and applied."""
    record = numbers[0]
    put_command(record.command, mask, force_n, position_m, orientation_wxyz, base_velocity, guidance)
    put_command(
        record.applied_command,
        applied_mask,
        applied_force_n,
        applied_position_m,
        applied_orientation_wxyz,
        applied_base_velocity,
        applied_guidance,
    )


@kernel("void(Snapshot, f8, f8, matrix, vector)", Snapshot=NUMBERS)
def put_heading(record: np.void, origin_x: float, origin_y: float, heading: np.ndarray, target: np.ndarray) -> None:
    """Where the heading frame is in the world, and the position target (3,) m in it."""
    record.heading_yaw = math.atan2(heading[1, 0], heading[0, 0])
    x, y, z = rotate(heading, target)
    record.target_position_in_world[0] = origin_x + x
    record.target_position_in_world[1] = origin_y + y
    record.target_position_in_world[2] = z


@kernel(
    "void(Snapshot[::1], vector, vector, vector, f8[:,::1], vector, vector, f8, vector, f8, f8, vector, matrix, vector)",
    Snapshot=NUMBERS,
)
def put_robot(
    numbers: np.ndarray,
    joint_position: np.ndarray,
    joint_velocity: np.ndarray,
    joint_torque: np.ndarray,
    rotation: np.ndarray,
    linear_velocity: np.ndarray,
    angular_velocity: np.ndarray,
    height_m: float,
    odometry_position: np.ndarray,
    odometry_yaw: float,
    odometry_sigma: float,
    hand_position: np.ndarray,
    hand_rotation: np.ndarray,
    target: np.ndarray,
) -> None:
    """What sensors and estimates say; arguments as in SensorFrame, BaseState, Odometry and HandState.

    The world is the IMU's: turned like it, with the origin of the odometry.

    Args:
        target: (3,) m, applied position target, in heading.
    """
    record = numbers[0]
    for joint in range(len(joint_position)):
        record.joint_position[joint] = joint_position[joint]
        record.joint_velocity[joint] = joint_velocity[joint]
        record.joint_torque[joint] = joint_torque[joint]
    heading = rotation_heading_to_world(rotation)
    in_heading = rotate_back(heading, np.array(rotate(rotation, linear_velocity)))
    orientation, hand_orientation = quaternion_from_rotation(rotation), quaternion_from_rotation(hand_rotation)
    record.odometry_position[0], record.odometry_position[1] = odometry_position[0], odometry_position[1]
    record.odometry_yaw, record.odometry_sigma = odometry_yaw, odometry_sigma
    # The base seen from the odometry's origin, along the axes of today's heading.
    c, s = math.cos(odometry_yaw), math.sin(odometry_yaw)
    ahead = c * odometry_position[0] + s * odometry_position[1]
    aside = c * odometry_position[1] - s * odometry_position[0]
    origin_x, origin_y, _ = rotate(heading, np.array([ahead, aside, 0.0]))
    hand = rotate(heading, hand_position)
    for i in range(3):
        record.base_linear_velocity[i], record.base_angular_velocity[i] = in_heading[i], angular_velocity[i]
        record.end_effector_position[i] = hand_position[i]
    for i in range(4):
        record.base_orientation_wxyz[i], record.end_effector_orientation_wxyz[i] = orientation[i], hand_orientation[i]
    record.base_position[0], record.base_position[1], record.base_position[2] = origin_x, origin_y, height_m
    record.end_effector_position_in_world[0] = origin_x + hand[0]
    record.end_effector_position_in_world[1] = origin_y + hand[1]
    record.end_effector_position_in_world[2] = hand[2]
    put_heading(record, origin_x, origin_y, heading, target)


@kernel("void(Snapshot[::1], vector, vector, vector, vector)", Snapshot=NUMBERS)
def put_true_place(
    numbers: np.ndarray, base_position: np.ndarray, orientation_wxyz: np.ndarray, hand_position: np.ndarray, target: np.ndarray
) -> None:
    """Where base (3,), (4,) and hand (3,) truly are, in world; `target` as in `put_robot`."""
    record = numbers[0]
    for i in range(3):
        record.base_position[i], record.end_effector_position_in_world[i] = base_position[i], hand_position[i]
    for i in range(4):
        record.base_orientation_wxyz[i] = orientation_wxyz[i]
    heading = rotation_heading_to_world(rotation_from_quaternion(orientation_wxyz))
    put_heading(record, base_position[0], base_position[1], heading, target)


@kernel("void(Snapshot[::1], matrix, vector, vector, matrix, vector, f8, b1, i8)", Snapshot=NUMBERS)
def put_forces(
    numbers: np.ndarray,
    forces: np.ndarray,
    error_power: np.ndarray,
    force: np.ndarray,
    wheel_forces: np.ndarray,
    sigma: np.ndarray,
    mass_scale: float,
    mass_adapting: bool,
    flags: int,
) -> None:
    """All estimates, and the selected one's `force` (3,) with what it says beside; arguments as in `write_forces`."""
    record = numbers[0]
    for index in range(len(forces)):
        record.force_errors_rms_n[index] = math.sqrt(error_power[index]) if index < len(error_power) else math.nan
        for i in range(3):
            record.force_estimates_n[index, i] = forces[index, i]
    for i in range(3):
        record.force_estimated_n[i], record.force_sigma_n[i] = force[i], sigma[i]
        for wheel in range(len(wheel_forces)):
            record.wheel_force_estimated_n[wheel, i] = wheel_forces[wheel, i]
    record.mass_adapting, record.mass_scale_estimated, record.estimator_flags = mass_adapting, mass_scale, flags
    record.object_position[:] = math.nan
    record.object_orientation_wxyz[:] = math.nan


@kernel("void(Snapshot[::1], matrix)", Snapshot=NUMBERS)
def put_no_truth(numbers: np.ndarray, wheel_forces: np.ndarray) -> None:
    """NaN where only a simulation knows; a wheel stands if its estimated force (4, 3) N says so."""
    record = numbers[0]
    record.force_true_n[:] = math.nan
    record.wheel_force_true_n[:] = math.nan
    record.wheel_contact_position_in_world[:] = math.nan
    for wheel in range(len(wheel_forces)):
        record.wheel_in_contact[wheel] = wheel_forces[wheel, 2] > LOADED_WHEEL_N
    record.object_count = 0


@kernel(
    "void(Snapshot[::1], vector, matrix, Array(b1, 1, 'A', readonly=True), matrix, matrix, matrix)",
    Snapshot=NUMBERS,
)
def put_true_forces(
    numbers: np.ndarray,
    force: np.ndarray,
    wheel_forces: np.ndarray,
    in_contact: np.ndarray,
    contacts: np.ndarray,
    object_positions: np.ndarray,
    object_orientations: np.ndarray,
) -> None:
    """Forces, contacts and objects of a GroundTruth."""
    record = numbers[0]
    for i in range(3):
        record.force_true_n[i] = force[i]
    for wheel in range(len(in_contact)):
        record.wheel_in_contact[wheel] = in_contact[wheel]
        for i in range(3):
            record.wheel_force_true_n[wheel, i] = wheel_forces[wheel, i]
            record.wheel_contact_position_in_world[wheel, i] = contacts[wheel, i]
    record.object_count = len(object_positions)
    for index in range(len(object_positions)):
        for i in range(3):
            record.object_position[index, i] = object_positions[index, i]
        for i in range(4):
            record.object_orientation_wxyz[index, i] = object_orientations[index, i]


@kernel("void(Snapshot[::1], f8, vector, f8, vector)", Snapshot=NUMBERS)
def put_hand_load(numbers: np.ndarray, mass: float, center: np.ndarray, progress: float, tare: np.ndarray) -> None:
    """See HandLoadState."""
    record = numbers[0]
    record.tool_mass, record.tool_progress = mass, progress
    for i in range(3):
        record.tool_center_of_mass[i], record.tare_n[i] = center[i], tare[i]


@kernel("void(Snapshot[::1], Array(f4, 1, 'A', readonly=True), vector, vector)", Snapshot=NUMBERS)
def put_policy(numbers: np.ndarray, observation: np.ndarray, action: np.ndarray, own_force: np.ndarray) -> None:
    """Observation (o,) and action (22,) of a policy, or nothing of both, zeros beyond; force (3,), N, that it estimates."""
    record = numbers[0]
    record.force_of_controller_n[:] = own_force
    for i in range(len(record.policy_observation)):
        record.policy_observation[i] = observation[i] if i < len(observation) else np.float32(0.0)
    for i in range(len(record.policy_action)):
        record.policy_action[i] = np.float32(action[i]) if i < len(action) else np.float32(0.0)


@kernel("void(matrix, vector, f8, f8[::1])")
def track_error_power(forces: np.ndarray, true_force: np.ndarray, weight: float, power: np.ndarray) -> None:
    """Low-pass the squared error of each estimator: p <- p + weight (|f_hat - f|^2 - p), from the first error on.

    Args:
        forces: (>= n, 3) N, newest estimates; one that is NaN changes nothing.
        true_force: (3,) N, f.
        weight: of the newest error.
        power: (n,) N^2, changed; NaN before the first error.
    """
    for index in range(len(power)):
        square = 0.0
        for i in range(3):
            square += (forces[index, i] - true_force[i]) ** 2
        if not math.isnan(square):
            last = power[index]
            power[index] = square if math.isnan(last) else last + weight * (square - last)
