"""Writes one tick's robot and forces into a snapshot record."""

from collections.abc import Mapping

import numpy as np

from control.faults import Fault
from control.frames import quaternion_from_rotation, rotation_heading_to_world
from control.joints import LEGS
from control.pipeline import PipelineOutput
from control.policy.policy_controller import PolicyController
from control.types import ForceEstimate, Odometry, SensorFrame
from control.whole_body.controller import Controller
from sim.backends.protocol import GroundTruth
from sim.runtime.snapshot import command_to_record
from sim.tasks.desk import TaskDesk

LOADED_WHEEL_N = 5.0
"""Estimated normal force above which a wheel counts as in contact where there is no truth."""

_NO_ESTIMATE = ForceEstimate(np.full(3, np.nan), np.full((len(LEGS), 3), np.nan))
"""Of a selected estimator that has not given one yet."""


def write_faults(record: np.void, output: PipelineOutput) -> None:
    """Faults of a SNAPSHOT record and who caused them."""
    record["faults"] = int(output.safety.faults)
    for fault in (Fault.CONTROLLER_ERROR, Fault.ESTIMATOR_ERROR):
        record[str(fault.name).lower()] = output.failures.get(fault, "").encode(errors="replace")


def write_robot(record: np.void, sensor: SensorFrame, output: PipelineOutput, truth: GroundTruth | None) -> None:
    """Posture, base, hand and applied command of a SNAPSHOT record."""
    base = output.base
    heading_in_imu = rotation_heading_to_world(base.rotation_base_to_world)
    record["joint_position"] = sensor.joint_position
    record["joint_velocity"] = sensor.joint_velocity
    record["joint_torque"] = sensor.joint_torque
    record["base_linear_velocity"] = base.rotation_base_to_world @ base.linear_velocity_in_base @ heading_in_imu
    odometry = output.odometry
    record["odometry_position"] = odometry.position_m
    record["odometry_yaw"] = odometry.yaw_rad
    record["odometry_sigma"] = odometry.sigma_m
    record["base_angular_velocity"] = base.angular_velocity_in_base
    record["end_effector_position"] = output.hand.position_in_heading
    record["end_effector_orientation_wxyz"] = quaternion_from_rotation(output.hand.rotation_to_heading)
    if truth is None:
        heading = heading_in_imu
        origin = np.append(heading[:2, :2] @ _turned_back(odometry), 0.0)
        record["base_position"] = [*origin[:2], base.height_m]
        record["base_orientation_wxyz"] = quaternion_from_rotation(base.rotation_base_to_world)
        record["end_effector_position_in_world"] = origin + heading @ output.hand.position_in_heading
    else:
        origin, heading = truth.base_position * [1.0, 1.0, 0.0], truth.rotation_heading_to_world
        record["base_position"] = truth.base_position
        record["base_orientation_wxyz"] = truth.base_orientation_wxyz
        record["end_effector_position_in_world"] = truth.end_effector_position
    record["heading_yaw"] = np.arctan2(heading[1, 0], heading[0, 0])
    record["target_position_in_world"] = origin + heading @ output.applied_command.position_m
    command_to_record(output.applied_command, record["applied_command"])


def _turned_back(odometry: Odometry) -> np.ndarray:
    """Position (2,) of the base seen from the odometry's origin, along the axes of today's heading."""
    c, s = np.cos(odometry.yaw_rad), np.sin(odometry.yaw_rad)
    return np.array([[c, s], [-s, c]]) @ odometry.position_m


def write_forces(
    record: np.void, output: PipelineOutput, truth: GroundTruth | None, names: tuple[str, ...], selected: str
) -> None:
    """Estimated and true forces of a SNAPSHOT record, for estimators `names` of which `selected` feeds the controller."""
    record["estimator_names"] = [*names] + [""] * (len(record["estimator_names"]) - len(names))
    record["force_estimates_n"] = np.nan
    for index, name in enumerate(names):
        if name in output.estimates:
            record["force_estimates_n"][index] = output.estimates[name].force_estimated_n
    estimate = output.estimates.get(selected, _NO_ESTIMATE)
    record["force_estimated_n"] = estimate.force_estimated_n
    record["force_sigma_n"] = np.nan if estimate.sigma_n is None else estimate.sigma_n
    record["wheel_force_estimated_n"] = estimate.wheel_forces_in_heading
    record["mass_adapting"] = estimate.mass_adapting
    record["mass_scale_estimated"] = np.nan if estimate.mass_scale is None else estimate.mass_scale
    record["object_position"] = record["object_orientation_wxyz"] = np.nan
    if truth is None:
        record["force_true_n"] = record["wheel_force_true_n"] = np.nan
        record["wheel_in_contact"] = estimate.wheel_forces_in_heading[:, 2] > LOADED_WHEEL_N
        record["wheel_contact_position_in_world"] = np.nan
        record["object_count"] = 0
        return
    record["force_true_n"] = truth.force_true_n
    record["wheel_force_true_n"] = truth.wheel_forces
    record["wheel_in_contact"] = truth.wheel_in_contact
    record["wheel_contact_position_in_world"] = truth.wheel_contact_positions
    count = len(truth.object_positions)
    record["object_count"] = count
    record["object_position"][:count] = truth.object_positions[:count]
    record["object_orientation_wxyz"][:count] = truth.object_orientations_wxyz[:count]


def write_named(record: np.void, kind: str, values: Mapping[str, float]) -> None:
    """The readings or the parameters of a scene, as `kind` says, into a SNAPSHOT record."""
    names, numbers = record[f"{kind}_names"], record[f"{kind}s"]
    names[:], numbers[:] = b"", np.nan
    names[: len(values)], numbers[: len(values)] = list(values), list(values.values())


def write_task(record: np.void, tasks: TaskDesk) -> None:
    """The task that was begun last into a SNAPSHOT record."""
    task = tasks.current
    record["task_in_charge"] = tasks.in_charge
    if task is None:
        return
    record["task_id"], record["task_name"] = task.id, task.name
    record["task_phase"] = task.runner.phase
    record["task_progress"], record["task_outcome"] = task.runner.progress, task.runner.outcome


def write_policy(record: np.void, controller: Controller) -> None:
    """What the selected controller observed and did, if it is a policy, into a SNAPSHOT record."""
    record["policy_observation"] = record["policy_action"] = 0.0
    if not isinstance(controller, PolicyController):
        record["policy_form"] = b""
        return
    record["policy_form"] = controller.manifest.form
    record["policy_observation"][: len(controller.observation)] = controller.observation
    record["policy_action"] = controller.action
