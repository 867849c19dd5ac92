"""The signals of one 50 Hz step from which the force networks' features are made."""

import math

import numpy as np

from control.estimation.adaptive_estimator import AdaptiveEstimator
from control.estimation.force_estimator import EstimatorInput
from control.estimation.projecting_estimator import ProjectingEstimator
from control.kernels.compiled import kernel
from control.kernels.records import record
from control.types import ForceEstimate

SIGNALS = record(
    joint_position=22,
    joint_velocity=22,
    joint_torque=22,
    gravity_in_base=3,
    angular_velocity=3,
    linear_acceleration=3,
    linear_velocity=3,
    mask=3,
    nominal_force=3,
    nominal_wheel_forces=12,
    nominal_residual=28,
    nominal_unexplained=28,
    nominal_mass_scale=2,
    nominal_force_length=(),
    gait_phase=2,
)
"""What one step offers.

Fields:
    joint_position, joint_velocity, joint_torque: rad, rad/s, N m, measured.
    gravity_in_base: unit vector of gravity in base: orientation without the yaw that no force depends on.
    angular_velocity: rad/s, in base.
    linear_acceleration: m/s^2, specific force in base.
    linear_velocity: m/s, estimated, in base.
    mask: applied 0 position, 1 force: the mode of eq. (13).
    nominal_force: N, in heading, of the model-based estimate that the network corrects.
    nominal_wheel_forces: N, in heading, of the same estimate.
    nominal_residual: N and N m, residual of its momentum observer, rows as force_features.GENERALIZED_NAMES.
    nominal_unexplained: what its projection leaves of it, same rows.
    nominal_mass_scale: its estimated mass over nominal of arm and rest, 1 where it estimates none.
    nominal_force_length, gait_phase: of `derive`.
"""

_NO_SCALES = np.ones(2)


@kernel("void(Signals[::1])", Signals=SIGNALS)
def derive(signals: np.ndarray) -> None:
    """Fill in what follows from the other signals (n,): |f|, and the gait phase as (sin, cos).

    The wheels always roll: there is no gait, and the paper's gait phase is the constant 0.
    """
    for n in range(len(signals)):
        s = signals[n]
        force = s.nominal_force
        s.nominal_force_length = math.sqrt(force[0] * force[0] + force[1] * force[1] + force[2] * force[2])
        s.gait_phase[0], s.gait_phase[1] = 0.0, 1.0


def signals_at(inputs: EstimatorInput, nominal: ProjectingEstimator, estimate: ForceEstimate) -> np.ndarray:
    """SIGNALS (1,) of a tick.

    Args:
        inputs: of the tick.
        nominal: the model-based estimator, after its `estimate` at this tick.
        estimate: what it gave.
    """
    sensor, base = inputs.sensor, inputs.base
    signals = np.empty(1, SIGNALS)
    _fill(
        sensor.joint_position,
        sensor.joint_velocity,
        sensor.joint_torque,
        base.rotation_base_to_world,
        sensor.angular_velocity,
        sensor.linear_acceleration,
        base.linear_velocity_in_base,
        inputs.mask,
        estimate.force_estimated_n,
        estimate.wheel_forces_in_heading,
        nominal.momentum.residual,
        nominal.unexplained,
        nominal.mass_scales if isinstance(nominal, AdaptiveEstimator) else _NO_SCALES,
        inputs.model.joint_rows,
        signals,
    )
    return signals


@kernel(
    "void(vector, vector, vector, matrix, vector, vector, vector, vector, vector, matrix, vector, vector, vector, i8[::1],"
    " Signals[::1])",
    Signals=SIGNALS,
)
def _fill(
    joint_position: np.ndarray,
    joint_velocity: np.ndarray,
    joint_torque: np.ndarray,
    rotation_base_to_world: np.ndarray,
    angular_velocity: np.ndarray,
    linear_acceleration: np.ndarray,
    linear_velocity: np.ndarray,
    mask: np.ndarray,
    force: np.ndarray,
    wheel_forces: np.ndarray,
    residual: np.ndarray,
    unexplained: np.ndarray,
    mass_scale: np.ndarray,
    joint_rows: np.ndarray,
    out: np.ndarray,
) -> None:
    """Fill the signals (1,) of one robot.

    Args:
        rotation_base_to_world: (3, 3).
        wheel_forces: (4, 3) N.
        residual, unexplained: (28,) in tree order, of which `joint_rows` (22,) are the joints.
    """
    s = out[0]
    for i in range(3):
        s.gravity_in_base[i] = -rotation_base_to_world[2, i]
        s.angular_velocity[i] = angular_velocity[i]
        s.linear_acceleration[i] = linear_acceleration[i]
        s.linear_velocity[i] = linear_velocity[i]
        s.mask[i] = mask[i]
        s.nominal_force[i] = force[i]
        for wheel in range(4):
            s.nominal_wheel_forces[3 * wheel + i] = wheel_forces[wheel, i]
    for i in range(6):
        s.nominal_residual[i] = residual[i]
        s.nominal_unexplained[i] = unexplained[i]
    for joint in range(len(joint_rows)):
        s.joint_position[joint] = joint_position[joint]
        s.joint_velocity[joint] = joint_velocity[joint]
        s.joint_torque[joint] = joint_torque[joint]
        s.nominal_residual[6 + joint] = residual[joint_rows[joint]]
        s.nominal_unexplained[6 + joint] = unexplained[joint_rows[joint]]
    s.nominal_mass_scale[0], s.nominal_mass_scale[1] = mass_scale[0], mass_scale[1]
    derive(out)
