"""Writes one tick's robot and forces into a snapshot record.

A record is written to slowly field by field, so kernels write all numbers; names are few.
"""

import math
from collections.abc import Mapping

import numpy as np

from control.baselines.baseline_controller import BaselineController
from control.faults import Fault
from control.hand_load.load import HandLoadState
from control.joints import LEGS
from control.pipeline import PipelineOutput
from control.policy.policy_controller import PolicyController
from control.types import Command, ForceEstimate, SensorFrame
from control.whole_body.controller import Controller
from sim.backends.protocol import GroundTruth
from sim.runtime.snapshot import MAX_ESTIMATORS, Mode
from sim.runtime.snapshot_kernels import (
    NUMBERS,
    put_commands,
    put_forces,
    put_hand_load,
    put_no_truth,
    put_policy,
    put_robot,
    put_session,
    put_simulation,
    put_true_forces,
    put_true_place,
)
from sim.tasks.desk import TaskDesk

_NO_ESTIMATE = ForceEstimate(np.full(3, np.nan), np.full((len(LEGS), 3), np.nan))
"""Of a selected estimator that has not given one yet."""


_UNKNOWN = np.full(3, np.nan)
_NOTHING_OBSERVED, _NOTHING_DONE = np.zeros(0, np.float32), np.zeros(0)


def numbers_of(record: np.void) -> np.ndarray:
    """NUMBERS (1,) of a SNAPSHOT record, in the same memory: what functions here call `numbers`."""
    return np.asarray(record).view(NUMBERS).reshape(1)


def write_session(numbers: np.ndarray, time_s: float, mode: Mode, faults: Fault, command_sequence: int) -> None:
    """Where the session stands; one more snapshot of it. What only a simulation knows is NaN."""
    put_session(numbers, time_s, int(mode), int(faults), command_sequence)


def write_simulation(
    numbers: np.ndarray, mass_scale: float, drag_target: np.ndarray | None, drag_force_in_world: np.ndarray
) -> None:
    """The operator's drag towards a point (3,) m in world, and the true total mass over nominal; after `write_robot`."""
    target = _UNKNOWN if drag_target is None else drag_target
    put_simulation(numbers, mass_scale, drag_target is not None, target, drag_force_in_world)


def write_failures(record: np.void, failures: Mapping[Fault, str]) -> None:
    """Who caused the faults of a SNAPSHOT record."""
    record["controller_error"] = failures.get(Fault.CONTROLLER_ERROR, "").encode(errors="replace")
    record["estimator_error"] = failures.get(Fault.ESTIMATOR_ERROR, "").encode(errors="replace")


def write_commands(numbers: np.ndarray, asked: Command, applied: Command) -> None:
    """The command as asked and as applied."""
    a, b = asked, applied
    put_commands(
        numbers,
        *(a.mask, a.force_n, a.position_m, a.orientation_wxyz, a.base_velocity, a.guidance),
        *(b.mask, b.force_n, b.position_m, b.orientation_wxyz, b.base_velocity, b.guidance),
    )


def write_robot(numbers: np.ndarray, sensor: SensorFrame, output: PipelineOutput, truth: GroundTruth | None) -> None:
    """Posture, base and hand of a SNAPSHOT record: in the world of the truth, or else in that of the odometry."""
    base, odometry, hand, target = output.base, output.odometry, output.hand, output.applied_command.position_m
    put_robot(
        numbers,
        sensor.joint_position,
        sensor.joint_velocity,
        sensor.joint_torque,
        base.rotation_base_to_world,
        base.linear_velocity_in_base,
        base.angular_velocity_in_base,
        base.height_m,
        odometry.position_m,
        odometry.yaw_rad,
        odometry.sigma_m,
        hand.position_in_heading,
        hand.rotation_to_heading,
        target,
    )
    if truth is not None:
        put_true_place(numbers, truth.base_position, truth.base_orientation_wxyz, truth.end_effector_position, target)


def newest_forces(estimates: Mapping[str, ForceEstimate], names: tuple[str, ...]) -> np.ndarray:
    """(MAX_ESTIMATORS, 3) N, newest force of each estimator of `names`, in their order; NaN where there is none."""
    forces = np.full((MAX_ESTIMATORS, 3), np.nan)
    for index, name in enumerate(names):
        if name in estimates:
            forces[index] = estimates[name].force_estimated_n
    return forces


def write_forces(
    numbers: np.ndarray,
    output: PipelineOutput,
    truth: GroundTruth | None,
    names: tuple[str, ...],
    selected: str,
    error_power: np.ndarray,
) -> None:
    """Estimated and true forces of a SNAPSHOT record, for estimators `names` of which `selected` feeds the controller.

    `error_power`: (len(names),) N^2, mean square of each one's error against truth.
    """
    estimate = output.estimates.get(selected, _NO_ESTIMATE)
    put_forces(
        numbers,
        newest_forces(output.estimates, names),
        error_power,
        estimate.force_estimated_n,
        estimate.wheel_forces_in_heading,
        _UNKNOWN if estimate.sigma_n is None else estimate.sigma_n,
        math.nan if estimate.mass_scale is None else estimate.mass_scale,
        estimate.mass_adapting,
        int(output.estimator_flags),
    )
    if truth is None:
        put_no_truth(numbers, estimate.wheel_forces_in_heading)
        return
    put_true_forces(
        numbers,
        truth.force_true_n,
        truth.wheel_forces,
        truth.wheel_in_contact,
        truth.wheel_contact_positions,
        truth.object_positions,
        truth.object_orientations_wxyz,
    )


def write_named(record: np.void, kind: str, values: Mapping[str, float]) -> None:
    """The readings or the parameters of a scene, as `kind` says, into a SNAPSHOT record."""
    names, numbers = record[f"{kind}_names"], record[f"{kind}s"]
    names[:], numbers[:] = b"", np.nan
    names[: len(values)], numbers[: len(values)] = list(values), list(values.values())


def write_task(record: np.void, tasks: TaskDesk) -> None:
    """The task that was begun last into a SNAPSHOT record."""
    task = tasks.current
    record["task_in_charge"] = tasks.in_charge
    if task is None:  # as after the simulation was set back
        record["task_id"], record["task_name"], record["task_phase"] = 0, b"", b""
        record["task_progress"], record["task_outcome"] = 0.0, 0
        return
    record["task_id"], record["task_name"] = task.id, task.name
    record["task_phase"] = task.runner.phase
    record["task_progress"], record["task_outcome"] = task.runner.progress, task.runner.outcome


def write_hand_load(record: np.void, numbers: np.ndarray, load: HandLoadState) -> None:
    """Tool and tare of a SNAPSHOT record."""
    record["tool_message"] = load.message.encode()
    progress = math.nan if load.identifying is None else load.identifying
    put_hand_load(numbers, load.tool.mass_kg, load.tool.center_of_mass_m, progress, load.offset_n)


def write_policy(record: np.void, numbers: np.ndarray, controller: Controller) -> None:
    """What the selected controller observed and did, if it is a policy, and what force it estimates, if it does."""
    own = controller.force_estimated_n if isinstance(controller, BaselineController) else _UNKNOWN
    if isinstance(controller, PolicyController):
        record["policy_form"] = controller.manifest.form
        put_policy(numbers, controller.observation, controller.action, own)
    else:
        record["policy_form"] = b""
        put_policy(numbers, _NOTHING_OBSERVED, _NOTHING_DONE, own)
