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
from control.kernels.small_algebra import rotate, rotate_back
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

    Every array attribute is a buffer that the next `update` overwrites: copy what must outlive the tick. Positions start at
    the base origin, world-aligned.

    Attributes:
        rotation_base_to_world, rotation_heading_to_world: (3, 3).
        end_effector_position: (3,) m.
        end_effector_rotation: (3, 3) end effector to world.
        wheel_contact_positions: (4, 3) m, lowest point of each wheel's ellipsoid, whatever its camber.
        wrench_jacobian: (18, 28) B^T of eq. (9): wheel contact points (12 rows), end-effector linear (3) and angular (3),
            world-aligned.
        joint_rows: (22,) generalized row of each joint of control.joints.
        mass_matrix: (28, 28) M, with armature.
        coriolis_matrix: (28, 28) C with Mdot = C + C^T.
        gravity: (28,) g.
        arm_gravity: (28,) the part of g that the arm's links cause.
        velocity: (28,) v.
        momentum: (28,) p = M v, eq. (3).
        momentum_drift: (28,) C^T v - g, which equals Mdot v - h of eq. (5).
        total_mass: kg, nominal, with what the hand carries.
        arm_mass: kg, the same of everything that the first arm joint carries.
        position_lower, position_upper: (22,) rad, infinite for wheels.
        joint_damping: (22,) N m s/rad, nominal.
        joint_friction: (22,) N m, nominal dry friction.
        imu_position_in_base: (3,) m.
    """

    STATE = ("_load", "total_mass", "arm_mass")
    SCRATCH = (
        "_data",
        "mass_matrix",
        "coriolis_matrix",
        "_joint_jacobian",
        "_arm_center",
        "_frame_positions",
        "end_effector_position",
        "end_effector_rotation",
        "_configuration",
        "rotation_base_to_world",
        "rotation_heading_to_world",
        "velocity",
        "momentum",
        "momentum_drift",
        "gravity",
        "arm_gravity",
        "_points",
        "wheel_contact_positions",
        "wrench_jacobian",
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
        self.arm_mass = float(sum(self._model.inertias[joint].mass for joint in arm))
        self._last_link, self._nominal_last_link = arm[-1], pin.Inertia(self._model.inertias[arm[-1]])
        self._load = 0.0, np.zeros(3), np.zeros(3)
        self.position_lower = self._model.lowerPositionLimit[self._position_rows]
        self.position_upper = self._model.upperPositionLimit[self._position_rows]
        self.joint_damping = self._model.damping[self.joint_rows]
        self.joint_friction = self._model.upperDryFrictionLimit[self.joint_rows]

        # Pinocchio's result matrices are exposed as views, so they are bound once.
        self.mass_matrix: np.ndarray = self._data.M
        self.coriolis_matrix: np.ndarray = self._data.C
        self._joint_jacobian: np.ndarray = self._data.J
        self.imu_position_in_base = self._model.frames[self._frame_index(IMU_FRAME, mjcf)].placement.translation.copy()
        self._end_effector_frame = self._frame_index(END_EFFECTOR_FRAME, mjcf)
        placements = [self._data.oMf[self._frame_index(name, mjcf)] for name in (*WHEEL_CENTER_FRAMES, END_EFFECTOR_FRAME)]
        self._arm_rows = self.joint_rows[ARM_SLICE]
        self._arm_center: np.ndarray = self._data.oYcrb[arm[0]].lever  # of all that the joint carries, world-aligned
        self._frame_positions = tuple(placement.translation for placement in placements)
        self.end_effector_position: np.ndarray = placements[-1].translation
        self.end_effector_rotation: np.ndarray = placements[-1].rotation
        self._wheel_rows = self.joint_rows[[JOINT_NAMES.index(name) for name in WHEEL_JOINT_NAMES]]
        self._supports = self._support_masks()

        size = self._model.nv
        self._configuration = pin.neutral(self._model)
        self._configuration[3:] = math.nan  # unlike whatever comes first
        self.rotation_base_to_world, self.rotation_heading_to_world = np.eye(3), np.eye(3)
        self.velocity = np.zeros(size)
        self.momentum = np.zeros(size)
        self.momentum_drift = np.zeros(size)
        self.gravity, self.arm_gravity = np.zeros(size), np.zeros(size)
        self._points = np.zeros((len(LEGS) + 1, 3))
        self.wheel_contact_positions = self._points[:-1]
        self.wrench_jacobian = np.zeros((WRENCH_SIZE, size))

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
        self.update_velocity(linear_velocity_in_base, angular_velocity_in_base, joint_velocity)

    def update_velocity(
        self, linear_velocity_in_base: np.ndarray, angular_velocity_in_base: np.ndarray, joint_velocity: np.ndarray
    ) -> None:
        """The rest of `update`, after `update_configuration` to the same configuration."""
        model, data, configuration, velocity = self._model, self._data, self._configuration, self.velocity
        stack_velocity(linear_velocity_in_base, angular_velocity_in_base, joint_velocity, self.joint_rows, velocity)
        pin.crba(model, data, configuration)
        pin.computeCoriolisMatrix(model, data, configuration, velocity)
        momentum_terms(
            self.mass_matrix,
            self.coriolis_matrix,
            self.rotation_base_to_world,
            velocity,
            self._arm_center,
            self.arm_mass,
            self._arm_rows,
            self.momentum,
            self.gravity,
            self.momentum_drift,
            self.arm_gravity,
        )
        if self.load_mass > 0.0:
            self._hang_load()

    def update_configuration(self, rotation_base_to_world: np.ndarray, joint_position: np.ndarray) -> None:
        """Move only the kinematics (frames, Jacobians); cheap when the configuration is already this one.

        Args:
            rotation_base_to_world: (3, 3).
            joint_position: (22,) rad.
        """
        rows, configuration = self._position_rows, self._configuration
        rotation, heading = self.rotation_base_to_world, self.rotation_heading_to_world
        if not configure(rotation_base_to_world, joint_position, rows, configuration, rotation, heading):
            return
        pin.computeJointJacobians(self._model, self._data, self._configuration)
        pin.updateFramePlacements(self._model, self._data)
        contact_geometry(
            self._joint_jacobian,
            self._frame_positions,
            self._wheel_rows,
            self._supports,
            self._points,
            self.wrench_jacobian,
        )

    def carry(self, mass_kg: float, center_of_mass_m: np.ndarray, inert_lever: bool = True) -> None:
        """Add a load to the last link from the next update on, in place of the last one.

        Args:
            mass_kg: none or more.
            center_of_mass_m: (3,) in the end effector's frame.
            inert_lever: its mass is inert where its centre is. Otherwise it weighs there, but is inert at the end effector.
        """
        added = mass_kg - self._load[0]
        self.arm_mass += added
        self.total_mass += added
        self._load = mass_kg, np.array(center_of_mass_m, dtype=float), inert_lever * np.array(center_of_mass_m, dtype=float)
        self._put_load()

    @property
    def load_mass(self) -> float:
        """kg, of the load that is carried."""
        return self._load[0]

    @property
    def load_center(self) -> np.ndarray:
        """(3,) m, of the load, from the end effector, world-aligned."""
        return self.end_effector_rotation @ self._load[1]

    @property
    def load_lever(self) -> np.ndarray:
        """(3,) m, of where the load is inert, from the end effector, world-aligned."""
        return self.end_effector_rotation @ self._load[2]

    def unpack_state(self) -> None:
        """Hang the load on again. The next update must not think that it was made already."""
        self._put_load()
        self._configuration[3:] = math.nan

    def _put_load(self) -> None:
        placement = self._model.frames[self._end_effector_frame].placement
        load = placement.act(pin.Inertia(self.load_mass, self._load[2], np.zeros((3, 3))))
        self._model.inertias[self._last_link] = self._nominal_last_link + load

    def _hang_load(self) -> None:
        """The load's weight, from where it is inert to its centre d away: g grows by J_w^T (d x m g e_z)."""
        x, y, _ = GRAVITY_MPS2 * self.load_mass * (self.load_center - self.load_lever)
        more = self.end_effector_jacobian[3:5].T @ np.array((y, -x))
        self.gravity += more
        self.arm_gravity += more
        self.momentum_drift -= more

    @property
    def joint_configuration(self) -> np.ndarray:
        """(22,) rad, joint angles of the last update in tree order."""
        return self._configuration[7:]

    @property
    def pinocchio_model(self) -> pin.Model:
        """For what else Pinocchio can compute from `pinocchio_data`."""
        return self._model

    @property
    def pinocchio_data(self) -> pin.Data:
        """Kinematics of the last update."""
        return self._data

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
        center = np.empty(3)
        mass_center(self.mass_matrix, self.rotation_base_to_world, self.total_mass, center)
        return center + self.load_mass / self.total_mass * (self.load_center - self.load_lever)

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


@kernel("void(f8[::1,:], f8[:,::1], f8, f8[:])")
def mass_center(mass_matrix: np.ndarray, rotation_base_to_world: np.ndarray, total_mass: float, center: np.ndarray) -> None:
    """Centre of mass c (3,), m, world-aligned, from the base origin, of all that is inert where it weighs.

    The mass matrix (28, 28) couples base translation and rotation through -m skew(c), c in base.
    """
    m = mass_matrix
    in_base = np.array([m[1, 5] / total_mass, m[2, 3] / total_mass, m[0, 4] / total_mass])
    center[0], center[1], center[2] = rotate(rotation_base_to_world, in_base)


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


@kernel(
    "void(f8[::1,:], f8[::1,:], f8[:,::1], f8[::1], f8[::1], f8, i8[::1], f8[::1], f8[::1], f8[::1], f8[::1])",
)
def momentum_terms(
    mass_matrix: np.ndarray,
    coriolis_matrix: np.ndarray,
    rotation_base_to_world: np.ndarray,
    velocity: np.ndarray,
    arm_center: np.ndarray,
    arm_mass: float,
    arm_rows: np.ndarray,
    momentum: np.ndarray,
    gravity: np.ndarray,
    momentum_drift: np.ndarray,
    arm_gravity: np.ndarray,
) -> None:
    """Terms of eqs. (3)-(5): p = M v, g, and C^T v - g, which equals Mdot v - h.

    Uniform gravity acts as an upward acceleration of the base: g = M[:, :3] R^T (0, 0, 9.81). The arm's links cause all of it
    on their own rows, and on the base's rows the arm's weight at its centre of mass.

    Args:
        mass_matrix: (28, 28) M.
        coriolis_matrix: (28, 28) C with Mdot = C + C^T.
        rotation_base_to_world: (3, 3) R.
        velocity: (28,) v.
        arm_center: (3,) m, centre of mass of the arm, world-aligned, from the base origin.
        arm_mass: kg.
        arm_rows: (6,) generalized rows of the arm's joints.
        momentum, gravity, momentum_drift, arm_gravity: (28,) the results.
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
    r, (x, y, z) = rotation_base_to_world, rotate_back(rotation_base_to_world, arm_center)
    weight = GRAVITY_MPS2 * arm_mass
    up_x, up_y, up_z = weight * r[2, 0], weight * r[2, 1], weight * r[2, 2]
    arm_gravity[0], arm_gravity[1], arm_gravity[2] = up_x, up_y, up_z
    arm_gravity[3], arm_gravity[4], arm_gravity[5] = y * up_z - z * up_y, z * up_x - x * up_z, x * up_y - y * up_x
    for row in arm_rows:
        arm_gravity[row] = gravity[row]


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
