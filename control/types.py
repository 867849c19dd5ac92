"""What flows through the pipeline: sensors -> base state -> force estimate -> joint targets -> joint command.

Every force is the one that the environment exerts on the robot. Arrays are float64 and owned by their holder.
"""

from dataclasses import field

import numpy as np

from control.joints import JOINT_COUNT
from control.values import value


@value
class SensorFrame:
    """All that hardware offers at one tick. Orders and units: control.joints, SI.

    Attributes:
        time_s: sample time on a monotonic clock.
        orientation_wxyz: (4,) base to world from the IMU; yaw drifts on hardware.
        angular_velocity: (3,) rad/s, in base.
        linear_acceleration: (3,) m/s^2, specific force at the IMU, in base axes (+g on z at rest).
        joint_position: (22,) rad. Wheel angles are unbounded.
        joint_velocity: (22,) rad/s.
        joint_torque: (22,) N m, actuator torque over the interval that ends at this sample (estimated from current).
    """

    time_s: float
    orientation_wxyz: np.ndarray
    angular_velocity: np.ndarray
    linear_acceleration: np.ndarray
    joint_position: np.ndarray
    joint_velocity: np.ndarray
    joint_torque: np.ndarray


@value
class Command:
    """The paper's full command (c_b and c_e, Sec. II.E), in the heading frame.

    Attributes:
        mask: (3,) 0 position, 1 force, per axis x, y, z.
        force_n: (3,) desired force of the environment on the robot; used on force axes.
        position_m: (3,) desired end-effector position; used on position axes.
        orientation_wxyz: (4,) desired end-effector orientation.
        base_velocity: (3,) vx, vy in m/s and yaw rate in rad/s.
        guidance: zero-force guidance: overrides mask, force and base velocity, the robot follows the hand.
    """

    mask: np.ndarray
    force_n: np.ndarray
    position_m: np.ndarray
    orientation_wxyz: np.ndarray
    base_velocity: np.ndarray
    guidance: bool = False


@value
class BaseState:
    """Estimated state of the base (control.estimation.base_state).

    Attributes:
        rotation_base_to_world: (3, 3).
        linear_velocity_in_base: (3,) m/s, of the base origin.
        angular_velocity_in_base: (3,) rad/s.
        height_m: base origin above the ground under the wheels, from leg kinematics.
    """

    rotation_base_to_world: np.ndarray
    linear_velocity_in_base: np.ndarray
    angular_velocity_in_base: np.ndarray
    height_m: float


@value
class Odometry:
    """Where the robot has rolled to since the pipeline was reset (control.estimation.odometry).

    Attributes:
        position_m: (2,) of the base origin; its frame lay below the base at the reset, x ahead.
        yaw_rad: turned since, counterclockwise, without wrapping.
        sigma_m: standard deviation of the position's error, estimated.
    """

    position_m: np.ndarray
    yaw_rad: float
    sigma_m: float


@value
class ForceEstimate:
    """Output of a force estimator at one tick.

    Attributes:
        force_estimated_n: (3,) N, environment on end effector.
        wheel_forces_in_heading: (4, 3) N, ground on wheels.
        sigma_n: (3,) standard deviation, or None where the estimator gives none.
        mass_scale: estimated overall mass over nominal mass, or None.
        mass_scales: (2,) the same of the arm and of the rest, or None.
        mass_adapting: the estimated masses still move, and the force with them, beyond its standard deviation.
        stale: the projection failed this tick and the last good estimate is repeated.
    """

    force_estimated_n: np.ndarray
    wheel_forces_in_heading: np.ndarray
    sigma_n: np.ndarray | None = None
    mass_scale: float | None = None
    mass_scales: np.ndarray | None = None
    mass_adapting: bool = False
    stale: bool = False


@value
class JointCommand:
    """What a backend sends to the drives, each (22,).

    The drives apply stiffness (position - q) + damping (velocity - dq) + torque.
    """

    position: np.ndarray
    velocity: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray
    torque: np.ndarray = field(default_factory=lambda: np.zeros(JOINT_COUNT))
