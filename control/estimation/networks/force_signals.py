"""The signals of one 50 Hz step from which the force networks' features are made."""

from dataclasses import dataclass

import numpy as np

from control.estimation.adaptive_estimator import AdaptiveEstimator
from control.estimation.force_estimator import EstimatorInput
from control.estimation.projecting_estimator import ProjectingEstimator
from control.types import ForceEstimate


@dataclass(frozen=True, slots=True)
class Signals:
    """What one step offers, or many steps stacked in front: (..., n) each.

    The wheels always roll: there is no gait, and the paper's gait phase is the constant 0, as (sin, cos) = (0, 1).

    Attributes:
        joint_position, joint_velocity, joint_torque: (..., 22) rad, rad/s, N m, measured.
        gravity_in_base: (..., 3) unit vector of gravity in base: orientation without the yaw that no force depends on.
        angular_velocity: (..., 3) rad/s, in base.
        linear_acceleration: (..., 3) m/s^2, specific force in base.
        linear_velocity: (..., 3) m/s, estimated, in base.
        mask: (..., 3) applied 0 position, 1 force: the mode of eq. (13).
        nominal_force: (..., 3) N, in heading, of the model-based estimate that the network corrects.
        nominal_wheel_forces: (..., 12) N, in heading, of the same estimate.
        nominal_residual: (..., 28) N and N m, residual of its momentum observer, rows as force_features.GENERALIZED_NAMES.
        nominal_unexplained: (..., 28) what its projection leaves of it, same rows.
        nominal_mass_scale: (..., 2) its estimated mass over nominal of arm and rest, 1 where it estimates none.
    """

    joint_position: np.ndarray
    joint_velocity: np.ndarray
    joint_torque: np.ndarray
    gravity_in_base: np.ndarray
    angular_velocity: np.ndarray
    linear_acceleration: np.ndarray
    linear_velocity: np.ndarray
    mask: np.ndarray
    nominal_force: np.ndarray
    nominal_wheel_forces: np.ndarray
    nominal_residual: np.ndarray
    nominal_unexplained: np.ndarray
    nominal_mass_scale: np.ndarray


def signals_at(inputs: EstimatorInput, nominal: ProjectingEstimator, estimate: ForceEstimate) -> Signals:
    """Signals of a tick, (n,) each.

    Args:
        inputs: of the tick.
        nominal: the model-based estimator, after its `estimate` at this tick.
        estimate: what it gave.
    """
    sensor, base = inputs.sensor, inputs.base
    scale = nominal.mass_scales if isinstance(nominal, AdaptiveEstimator) else np.ones(2)
    return Signals(
        joint_position=sensor.joint_position,
        joint_velocity=sensor.joint_velocity,
        joint_torque=sensor.joint_torque,
        gravity_in_base=-base.rotation_base_to_world[2],
        angular_velocity=sensor.angular_velocity,
        linear_acceleration=sensor.linear_acceleration,
        linear_velocity=base.linear_velocity_in_base,
        mask=inputs.mask,
        nominal_force=estimate.force_estimated_n,
        nominal_wheel_forces=estimate.wheel_forces_in_heading.reshape(-1),
        nominal_residual=_joint_order(nominal.residual, inputs),
        nominal_unexplained=_joint_order(nominal.unexplained, inputs),
        nominal_mass_scale=scale,
    )


def _joint_order(generalized: np.ndarray, inputs: EstimatorInput) -> np.ndarray:
    """Rows (28,) of tree order with the joints in the order of control.joints."""
    return np.concatenate([generalized[:6], generalized[inputs.model.joint_rows]])
