"""Rigid-body model of the robot in Pinocchio, built from the MJCF that the simulator also loads.

The base sits at the origin: "world" here is the world turned as the IMU says, its origin at the base origin. Generalized
vectors have 28 rows in Pinocchio order: base linear velocity (3) and angular velocity (3), both in base, then the joints
in tree order; `joint_rows` finds a joint of control.joints among them.
"""

import math
from pathlib import Path

import numpy as np
import pinocchio as pin

from control.frames import quaternion_from_rotation, rotation_heading_to_world
from control.joints import (
    ARM_JOINT_NAMES,
    ARM_SLICE,
    END_EFFECTOR_FRAME,
    JOINT_NAMES,
    LEGS,
    WHEEL_CENTER_FRAMES,
    WHEEL_JOINT_NAMES,
    permutation,
)
from control.kernels.compiled import kernel
from control.kernels.small_algebra import rotate
from control.paths import ROBOT_MJCF
from control.wheel_geometry import lowest_point_from_center

IMU_FRAME = "imu"
GRAVITY_MPS2 = 9.81
WRENCH_SIZE = 3 * len(LEGS) + 6
"""Length of the stacked wrench x = [lambda_c (12), f_e (3), m_e (3)] of eq. (9)."""


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
        momentum: (28,) p = M v, eq. (3).
        momentum_drift: (28,) C^T v - g, which equals Mdot v - h of eq. (5).
        total_mass: kg, nominal.
        arm_mass: kg, nominal, of everything that the first arm joint carries.
        position_lower, position_upper: (22,) rad, infinite for wheels.
        joint_damping: (22,) N m s/rad, nominal.
        joint_friction: (22,) N m, nominal dry friction.
        imu_position_in_base: (3,) m.
    """

    STATE = ()
    SCRATCH = (
        "_data",
        "mass_matrix",
        "coriolis_matrix",
        "_joint_jacobian",
        "_arm_rotations",
        "_arm_positions",
        "_frame_positions",
        "_end_effector_rotation",
        "_configuration",
        "_rotation",
        "_heading",
        "velocity",
        "momentum",
        "momentum_drift",
        "gravity",
        "_points",
        "_wrench_jacobian",
        "_geometry_fresh",
    )

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
        arm = [self._model.getJointId(name) for name in ARM_JOINT_NAMES]
        self._arm_masses = np.array([self._model.inertias[joint].mass for joint in arm])
        self._arm_centers = np.array([self._model.inertias[joint].lever for joint in arm])
        self.arm_mass = float(self._arm_masses.sum())
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
        self._arm_rows = self.joint_rows[ARM_SLICE]
        self._arm_rotations = tuple(self._data.oMi[joint].rotation for joint in arm)
        self._arm_positions = tuple(self._data.oMi[joint].translation for joint in arm)
        self._frame_positions = tuple(placement.translation for placement in placements)
        self._end_effector_rotation: np.ndarray = placements[-1].rotation
        self._wheel_rows = self.joint_rows[[JOINT_NAMES.index(name) for name in WHEEL_JOINT_NAMES]]
        self._supports = self._support_masks()

        size = self._model.nv
        self._configuration = pin.neutral(self._model)
        self._configuration[3:] = math.nan  # unlike whatever comes first
        self._rotation, self._heading = np.eye(3), np.eye(3)
        self.velocity = np.zeros(size)
        self.momentum = np.zeros(size)
        self.momentum_drift = np.zeros(size)
        self.gravity = np.zeros(size)
        self._points = np.zeros((len(LEGS) + 1, 3))
        self._wrench_jacobian = np.zeros((WRENCH_SIZE, size))
        self._geometry_fresh = False

    def update(
        self,
        rotation_base_to_world: np.ndarray,
        joint_position: np.ndarray,
        linear_velocity_in_base: np.ndarray,
        angular_velocity_in_base: np.ndarray,
        joint_velocity: np.ndarray,
    ) -> None:
        """Compute the terms of the momentum dynamics, eqs. (3)-(5).

        Args:
            rotation_base_to_world: (3, 3).
            joint_position: (22,) rad.
            linear_velocity_in_base: (3,) m/s, of the base origin.
            angular_velocity_in_base: (3,) rad/s.
            joint_velocity: (22,) rad/s.
        """
        self.update_configuration(rotation_base_to_world, joint_position)
        velocity = self.velocity
        stack_velocity(linear_velocity_in_base, angular_velocity_in_base, joint_velocity, self.joint_rows, velocity)
        pin.crba(self._model, self._data, self._configuration)
        pin.computeCoriolisMatrix(self._model, self._data, self._configuration, velocity)
        momentum_terms(
            self.mass_matrix,
            self.coriolis_matrix,
            self._rotation,
            velocity,
            self.momentum,
            self.gravity,
            self.momentum_drift,
        )

    def update_configuration(self, rotation_base_to_world: np.ndarray, joint_position: np.ndarray) -> None:
        """Move only the kinematics (frames, Jacobians); cheap when the configuration is already this one.

        Args:
            rotation_base_to_world: (3, 3).
            joint_position: (22,) rad.
        """
        rows, configuration = self._position_rows, self._configuration
        if not configure(rotation_base_to_world, joint_position, rows, configuration, self._rotation, self._heading):
            return
        pin.computeJointJacobians(self._model, self._data, self._configuration)
        pin.updateFramePlacements(self._model, self._data)
        self._geometry_fresh = False

    def unpack_state(self) -> None:
        """Nothing here is carried on, but the next update must not think that it was made already."""
        self._configuration[3:] = math.nan

    @property
    def rotation_base_to_world(self) -> np.ndarray:
        """(3, 3) of the last update."""
        return self._rotation

    @property
    def rotation_heading_to_world(self) -> np.ndarray:
        """(3, 3) of the last update."""
        return self._heading

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
        """(18, 28) B^T of eq. (9): wheel contact points (12 rows), end-effector linear (3) and angular (3), world-aligned."""
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
        return mass_center(self.mass_matrix, self._rotation, self.total_mass)

    def arm_gravity(self) -> np.ndarray:
        """(28,) the part of g that the arm's links cause, computed at each call."""
        gravity = np.zeros(len(self.velocity))
        links_gravity(
            self._arm_rotations,
            self._arm_positions,
            self._arm_masses,
            self._arm_centers,
            self._joint_jacobian,
            self._arm_rows,
            gravity,
        )
        return gravity

    def _refresh_geometry(self) -> None:
        if not self._geometry_fresh:
            contact_geometry(
                self._joint_jacobian,
                self._frame_positions,
                self._wheel_rows,
                self._supports,
                self._points,
                self._wrench_jacobian,
            )
            self._geometry_fresh = True

    def _frame_index(self, name: str, mjcf: Path) -> int:
        # A site may share its name with its body; both lie at the same place, and sites come last.
        matches = [index for index, frame in enumerate(self._model.frames) if frame.name == name]
        if not matches:
            raise RobotModelError(f"{mjcf}: frame {name!r} is missing; add a site of that name")
        return matches[-1]

    def _support_masks(self) -> np.ndarray:
        """(5, 28): whether a generalized velocity moves wheel FL, FR, RL, RR or the end effector."""
        mask = np.zeros((len(LEGS) + 1, self._model.nv), dtype=bool)
        bodies = [*WHEEL_JOINT_NAMES, JOINT_NAMES[-1]]
        for point, joint_name in enumerate(bodies):
            for joint in list(self._model.supports[self._model.getJointId(joint_name)])[1:]:
                start = self._model.joints[joint].idx_v
                mask[point, start : start + self._model.joints[joint].nv] = True
        return mask


@kernel("f8[::1](f8[::1,:], f8[:,::1], f8)")
def mass_center(mass_matrix: np.ndarray, rotation_base_to_world: np.ndarray, total_mass: float) -> np.ndarray:
    """Centre of mass c (3,), m, world-aligned, from the base origin.

    The mass matrix (28, 28) couples base translation and rotation through -m skew(c), c in base.
    """
    m = mass_matrix
    in_base = np.array([m[1, 5] / total_mass, m[2, 3] / total_mass, m[0, 4] / total_mass])
    return np.array(rotate(rotation_base_to_world, in_base))


@kernel("b1(matrix, vector, i8[::1], f8[::1], f8[:,::1], f8[:,::1])")
def configure(
    rotation_base_to_world: np.ndarray,
    joint_position: np.ndarray,
    position_rows: np.ndarray,
    configuration: np.ndarray,
    rotation: np.ndarray,
    heading: np.ndarray,
) -> bool:
    """Write attitude and joints into Pinocchio's configuration; whether that changed it.

    Args:
        rotation_base_to_world: (3, 3).
        joint_position: (22,) rad, in the order of control.joints.
        position_rows: (22,) row of each joint in the configuration.
        configuration: (29,) base position (3), base orientation xyzw (4), joints in tree order.
        rotation: (3, 3) becomes the first argument.
        heading: (3, 3) becomes the heading frame's rotation to the world.
    """
    w, x, y, z = quaternion_from_rotation(rotation_base_to_world)
    changed = False
    for row, value in ((3, x), (4, y), (5, z), (6, w)):
        changed |= configuration[row] != value
        configuration[row] = value
    for joint in range(len(position_rows)):
        row = position_rows[joint]
        changed |= configuration[row] != joint_position[joint]
        configuration[row] = joint_position[joint]
    if changed:
        rotation[:] = rotation_base_to_world
        heading[:] = rotation_heading_to_world(rotation_base_to_world)
    return changed


@kernel("void(vector, vector, vector, i8[::1], f8[::1])")
def stack_velocity(
    linear: np.ndarray, angular: np.ndarray, joint_velocity: np.ndarray, joint_rows: np.ndarray, velocity: np.ndarray
) -> None:
    """Write v (28,) = [linear (3) m/s, angular (3) rad/s, both in base, joints (22) rad/s at `joint_rows`]."""
    for axis in range(3):
        velocity[axis] = linear[axis]
        velocity[3 + axis] = angular[axis]
    for joint in range(len(joint_rows)):
        velocity[joint_rows[joint]] = joint_velocity[joint]


@kernel("void(f8[::1,:], f8[::1,:], f8[:,::1], f8[::1], f8[::1], f8[::1], f8[::1])")
def momentum_terms(
    mass_matrix: np.ndarray,
    coriolis_matrix: np.ndarray,
    rotation_base_to_world: np.ndarray,
    velocity: np.ndarray,
    momentum: np.ndarray,
    gravity: np.ndarray,
    momentum_drift: np.ndarray,
) -> None:
    """Terms of eqs. (3)-(5): p = M v, g, and C^T v - g, which equals Mdot v - h.

    Uniform gravity acts as an upward acceleration of the base: g = M[:, :3] R^T (0, 0, 9.81).

    Args:
        mass_matrix: (28, 28) M.
        coriolis_matrix: (28, 28) C with Mdot = C + C^T.
        rotation_base_to_world: (3, 3) R.
        velocity: (28,) v.
        momentum, gravity, momentum_drift: (28,) the results.
    """
    size = len(velocity)
    for i in range(size):
        product, drift = 0.0, 0.0
        for j in range(size):  # down the columns, as they lie in memory; M is symmetric
            product += mass_matrix[j, i] * velocity[j]
            drift += coriolis_matrix[j, i] * velocity[j]
        momentum[i] = product
        gravity[i] = 0.0
        for axis in range(3):
            gravity[i] += mass_matrix[i, axis] * (GRAVITY_MPS2 * rotation_base_to_world[2, axis])
        momentum_drift[i] = drift - gravity[i]


@kernel("void(UniTuple(f8[::1,:], 6), UniTuple(f8[::1], 6), f8[::1], f8[:,::1], f8[::1,:], i8[::1], f8[::1])")
def links_gravity(
    rotations: tuple[np.ndarray, ...],
    positions: tuple[np.ndarray, ...],
    masses: np.ndarray,
    centers: np.ndarray,
    joint_jacobian: np.ndarray,
    rows: np.ndarray,
    gravity: np.ndarray,
) -> None:
    """What the weights of the links of a chain at the base do to base and chain: g = sum_i -J_i^T m_i (0, 0, -9.81).

    Args:
        rotations, positions: (3, 3) and (3,) m, of each link's joint to world.
        masses: (6,) kg.
        centers: (6, 3) m, centre of mass of each link in its joint's frame.
        joint_jacobian: (6, 28) of every joint's own frame at the world's origin, linear then angular.
        rows: (6,) generalized row of each joint, the base's side first.
        gravity: (28,) the result; rows of other joints are left alone.
    """
    for link in range(len(rotations)):
        x, y, _ = rotate(rotations[link], centers[link])
        x, y = x + positions[link][0], y + positions[link][1]
        weight = GRAVITY_MPS2 * masses[link]
        for k in range(6 + link + 1):
            row = k if k < 6 else rows[k - 6]
            upward = joint_jacobian[2, row] + joint_jacobian[3, row] * y - joint_jacobian[4, row] * x
            gravity[row] += weight * upward


@kernel("void(f8[::1,:], UniTuple(f8[::1], 5), i8[::1], b1[:,::1], f8[:,::1], f8[:,::1])")
def contact_geometry(
    joint_jacobian: np.ndarray,
    centers: tuple[np.ndarray, ...],
    wheel_rows: np.ndarray,
    supports: np.ndarray,
    points: np.ndarray,
    jacobian: np.ndarray,
) -> None:
    """Where wrenches act and B^T of eq. (9): the contact points of the wheels, then the end effector.

    Args:
        joint_jacobian: (6, 28) of every joint's own frame at the world's origin, linear then angular.
        centers: (3,) m each, wheels FL, FR, RL, RR, end effector.
        wheel_rows: (4,) generalized row of each wheel.
        supports: (5, 28) whether a generalized velocity moves a point.
        points: (5, 3) m, the results.
        jacobian: (18, 28) the linear rows of the points, then the angular ones of the end effector.
    """
    last = len(centers) - 1
    for index in range(len(centers)):
        x, y, z = centers[index]
        if index < last:
            offset = lowest_point_from_center(joint_jacobian[3:, wheel_rows[index]])
            x, y, z = x + offset[0], y + offset[1], z + offset[2]
        points[index, 0], points[index, 1], points[index, 2] = x, y, z
        for row in range(joint_jacobian.shape[1]):
            if supports[index, row]:
                w_x, w_y, w_z = joint_jacobian[3, row], joint_jacobian[4, row], joint_jacobian[5, row]
                jacobian[3 * index, row] = joint_jacobian[0, row] + w_y * z - w_z * y
                jacobian[3 * index + 1, row] = joint_jacobian[1, row] + w_z * x - w_x * z
                jacobian[3 * index + 2, row] = joint_jacobian[2, row] + w_x * y - w_y * x
                if index == last:
                    jacobian[3 * index + 3, row], jacobian[3 * index + 4, row], jacobian[3 * index + 5, row] = w_x, w_y, w_z
