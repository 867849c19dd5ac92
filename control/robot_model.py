"""Rigid-body model of the robot in Pinocchio, built from the MJCF that the simulator also loads.

The base sits at the origin: "world" here is the world turned as the IMU says, its origin at the base origin. Generalized
vectors have 28 rows in Pinocchio order: base linear velocity (3) and angular velocity (3), both in base, then the joints
in tree order; `joint_rows` finds a joint of control.joints among them.
"""

from pathlib import Path

import numpy as np
import pinocchio as pin

from control.joints import (
    ARM_JOINT_NAMES,
    END_EFFECTOR_FRAME,
    JOINT_NAMES,
    LEGS,
    WHEEL_CENTER_FRAMES,
    WHEEL_HALF_WIDTH_M,
    WHEEL_JOINT_NAMES,
    WHEEL_RADIUS_M,
    permutation,
)
from control.paths import ROBOT_MJCF

IMU_FRAME = "imu"
GRAVITY_MPS2 = 9.81
WRENCH_SIZE = 3 * len(LEGS) + 6
"""Length of the stacked wrench x = [lambda_c (12), f_e (3), m_e (3)] of eq. (10)."""

_AT_ORIGIN = np.zeros(3)
_CROSS_FROM_POINT = np.array(
    [
        [0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, -1.0, 0.0],
        [0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    ]
)
"""Linear map (3, 9) from a point p to -skew(p), row-major, so that `-skew(p) @ w` is w x p."""


class RobotModelError(ValueError):
    """The MJCF is not the robot that control.joints describes; the message names the missing piece."""


class RobotModel:
    """Kinematics and dynamics at one configuration and velocity.

    Every array attribute is a buffer that the next `update` overwrites: copy what must outlive the tick. Jacobians and
    contact points are computed on first use after an update.

    Attributes:
        joint_rows: (22,) generalized row of each joint of control.joints.
        mass_matrix: (28, 28) M, with armature.
        coriolis_matrix: (28, 28) C with Mdot = C + C^T.
        gravity: (28,) g.
        velocity: (28,) v.
        momentum: (28,) p = M v, eq. (5).
        momentum_drift: (28,) C^T v - g, which equals Mdot v - h of eq. (7).
        total_mass: kg, nominal.
        arm_mass: kg, nominal, of everything that the first arm joint carries.
        position_lower, position_upper: (22,) rad, infinite for wheels.
        joint_damping: (22,) N m s/rad, nominal.
        joint_friction: (22,) N m, nominal dry friction.
        imu_position_in_base: (3,) m.
    """

    def __init__(self, mjcf: Path = ROBOT_MJCF) -> None:
        """Build the model.

        Raises:
            FileNotFoundError: no such MJCF.
            RobotModelError: a joint or frame of control.joints is missing in it.
        """
        if not mjcf.is_file():
            raise FileNotFoundError(f"robot model {mjcf} does not exist; install Forcelens from its source tree")
        self._model = pin.buildModelFromMJCF(str(mjcf))
        self._data = self._model.createData()
        try:
            self.joint_rows = 6 + permutation(list(self._model.names)[2:], JOINT_NAMES)
        except ValueError as error:
            raise RobotModelError(f"{mjcf}: {error}") from error
        self._position_rows = self.joint_rows + 1

        self.total_mass = float(pin.computeTotalMass(self._model))
        self._arm_model = self._arm_only_model()
        self._arm_data = self._arm_model.createData()
        self.arm_mass = float(pin.computeTotalMass(self._arm_model))
        self.position_lower = self._model.lowerPositionLimit[self._position_rows]
        self.position_upper = self._model.upperPositionLimit[self._position_rows]
        self.joint_damping = self._model.damping[self.joint_rows]
        self.joint_friction = self._model.upperDryFrictionLimit[self.joint_rows]

        # Pinocchio's result matrices are exposed as views, so they are bound once.
        self.mass_matrix: np.ndarray = self._data.M
        self.coriolis_matrix: np.ndarray = self._data.C
        self._joint_jacobian: np.ndarray = self._data.J
        self.imu_position_in_base = self._model.frames[self._frame_index(IMU_FRAME, mjcf)].placement.translation.copy()
        placements = [self._data.oMf[self._frame_index(name, mjcf)] for name in (*WHEEL_CENTER_FRAMES, END_EFFECTOR_FRAME)]
        self._frame_positions = tuple(placement.translation for placement in placements)
        self._end_effector_rotation: np.ndarray = placements[-1].rotation
        self._wheel_rows = self.joint_rows[[JOINT_NAMES.index(name) for name in WHEEL_JOINT_NAMES]]
        self._supports = self._support_masks()

        size = self._model.nv
        self._configuration = pin.neutral(self._model)
        self._next_configuration = self._configuration.copy()
        self._rotation = np.eye(3)
        self.velocity = np.zeros(size)
        self.momentum = np.zeros(size)
        self.momentum_drift = np.zeros(size)
        self.gravity = np.zeros(size)
        self._points = np.zeros((len(LEGS) + 1, 3))
        self._wrench_jacobian = np.zeros((WRENCH_SIZE, size))
        self._geometry_fresh = False
        self._configuration_set = False

    def update(
        self,
        rotation_base_to_world: np.ndarray,
        joint_position: np.ndarray,
        linear_velocity_in_base: np.ndarray,
        angular_velocity_in_base: np.ndarray,
        joint_velocity: np.ndarray,
    ) -> None:
        """Compute the terms of the momentum dynamics, eqs. (5)-(7).

        Args:
            rotation_base_to_world: (3, 3).
            joint_position: (22,) rad.
            linear_velocity_in_base: (3,) m/s, of the base origin.
            angular_velocity_in_base: (3,) rad/s.
            joint_velocity: (22,) rad/s.
        """
        self.update_configuration(rotation_base_to_world, joint_position)
        velocity = self.velocity
        velocity[:3] = linear_velocity_in_base
        velocity[3:6] = angular_velocity_in_base
        velocity[self.joint_rows] = joint_velocity
        pin.crba(self._model, self._data, self._configuration)
        pin.computeCoriolisMatrix(self._model, self._data, self._configuration, velocity)
        np.dot(self.mass_matrix, velocity, out=self.momentum)
        # Uniform gravity acts as an upward acceleration of the base, so g = M[:, :3] R^T (0, 0, 9.81).
        np.dot(self.mass_matrix[:, :3], GRAVITY_MPS2 * self._rotation[2], out=self.gravity)
        np.dot(velocity, self.coriolis_matrix, out=self.momentum_drift)
        self.momentum_drift -= self.gravity

    def update_configuration(self, rotation_base_to_world: np.ndarray, joint_position: np.ndarray) -> None:
        """Move only the kinematics (frames, Jacobians); cheap when the configuration is already this one.

        Args:
            rotation_base_to_world: (3, 3).
            joint_position: (22,) rad.
        """
        candidate = self._next_configuration
        # Not pin.Quaternion(rotation), which leaks 80 bytes a call (Pinocchio 4.1).
        candidate[3:7] = pin.SE3ToXYZQUAT(pin.SE3(rotation_base_to_world, _AT_ORIGIN))[3:]
        candidate[self._position_rows] = joint_position
        if self._configuration_set and np.array_equal(candidate, self._configuration):
            return
        self._configuration, self._next_configuration = candidate, self._configuration
        self._rotation = np.array(rotation_base_to_world)
        pin.computeJointJacobians(self._model, self._data, self._configuration)
        pin.updateFramePlacements(self._model, self._data)
        self._configuration_set = True
        self._geometry_fresh = False

    @property
    def rotation_base_to_world(self) -> np.ndarray:
        """(3, 3) of the last update."""
        return self._rotation

    @property
    def end_effector_position(self) -> np.ndarray:
        """(3,) m, world-aligned, from the base origin."""
        return self._frame_positions[-1]

    @property
    def end_effector_rotation(self) -> np.ndarray:
        """(3, 3) end effector to world."""
        return self._end_effector_rotation

    @property
    def wheel_contact_positions(self) -> np.ndarray:
        """(4, 3) m, world-aligned, from the base origin: lowest point of each wheel's ellipsoid, whatever its camber."""
        self._refresh_geometry()
        return self._points[:-1]

    @property
    def wrench_jacobian(self) -> np.ndarray:
        """(18, 28) B^T of eq. (10): wheel contact points (12 rows), end-effector linear (3) and angular (3), world-aligned."""
        self._refresh_geometry()
        return self._wrench_jacobian

    @property
    def wheel_contact_jacobians(self) -> np.ndarray:
        """(4, 3, 28), world-aligned, of the wheel's material point at the contact, so the wheel's own row is explained."""
        return self.wrench_jacobian[: 3 * len(LEGS)].reshape(len(LEGS), 3, -1)

    @property
    def end_effector_jacobian(self) -> np.ndarray:
        """(6, 28), linear then angular, world-aligned."""
        return self.wrench_jacobian[3 * len(LEGS) :]

    @property
    def center_of_mass(self) -> np.ndarray:
        """(3,) m, world-aligned, from the base origin; needs `update`."""
        # The mass matrix couples base translation and rotation through -m skew(c), c in base.
        m = self.mass_matrix
        return self._rotation @ (np.array([m[1, 5], m[2, 3], m[0, 4]]) / self.total_mass)

    def arm_gravity(self) -> np.ndarray:
        """(28,) the part of g that the arm's links cause, computed at each call."""
        return pin.computeGeneralizedGravity(self._arm_model, self._arm_data, self._configuration)

    def _refresh_geometry(self) -> None:
        if self._geometry_fresh:
            return
        points, jacobian, angular = self._points, self._wrench_jacobian, self._joint_jacobian[3:]
        np.concatenate(self._frame_positions, out=points.reshape(-1))
        points[:-1] += _lowest_point_from_center(angular[:, self._wheel_rows].T)
        linear_rows = jacobian[:-3]
        np.dot((points @ _CROSS_FROM_POINT).reshape(-1, 3), angular, out=linear_rows)
        stacked = linear_rows.reshape(len(points), 3, -1)
        stacked += self._joint_jacobian[:3]
        stacked *= self._supports
        np.multiply(angular, self._supports[-1], out=jacobian[-3:])
        self._geometry_fresh = True

    def _frame_index(self, name: str, mjcf: Path) -> int:
        # A site may share its name with its body; both lie at the same place, and sites come last.
        matches = [index for index, frame in enumerate(self._model.frames) if frame.name == name]
        if not matches:
            raise RobotModelError(f"{mjcf}: frame {name!r} is missing; add a site of that name")
        return matches[-1]

    def _arm_only_model(self) -> pin.Model:
        """The same joints, with mass only where the first arm joint carries it."""
        model = pin.Model(self._model)
        arm = set(model.subtrees[model.getJointId(ARM_JOINT_NAMES[0])])
        for joint in range(model.njoints):
            if joint not in arm:
                model.inertias[joint] = pin.Inertia.Zero()
        return model

    def _support_masks(self) -> np.ndarray:
        """(5, 1, 28): 1 where a generalized velocity moves wheel FL, FR, RL, RR or the end effector."""
        mask = np.zeros((len(LEGS) + 1, 1, self._model.nv))
        bodies = [*WHEEL_JOINT_NAMES, JOINT_NAMES[-1]]
        for point, joint_name in enumerate(bodies):
            for joint in list(self._model.supports[self._model.getJointId(joint_name)])[1:]:
                start = self._model.joints[joint].idx_v
                mask[point, 0, start : start + self._model.joints[joint].nv] = 1.0
        return mask


def _lowest_point_from_center(axes: np.ndarray) -> np.ndarray:
    """Support point of wheel ellipsoids in direction -z, from their centres.

    Args:
        axes: (n, 3) unit wheel axes, world-aligned.

    Returns:
        (n, 3) m, D^2 d / sqrt(d^T D^2 d) with d = -z and D^2 = r^2 I + (b^2 - r^2) a a^T.
    """
    flattening = WHEEL_HALF_WIDTH_M**2 - WHEEL_RADIUS_M**2
    tilt = axes[:, 2:]
    offset = -flattening * tilt * axes
    offset[:, 2] -= WHEEL_RADIUS_M**2
    return offset / np.sqrt(WHEEL_RADIUS_M**2 + flattening * tilt * tilt)
