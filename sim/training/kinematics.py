"""Kinematics of the training robots as the controller's laws need them, from MuJoCo's positions and axes of the batch."""

import numpy as np

from control.frames import rotation_from_quaternion, rotation_heading_to_world
from control.joints import ARM_SLICE, JOINT_COUNT, LEGS
from control.kernels.compiled import kernel
from control.kernels.records import record
from control.kernels.small_algebra import rotate
from control.robot_model import GRAVITY_MPS2
from control.wheel_geometry import lowest_point_from_center
from control.whole_body.body_terms import BODY_TERMS, LEG_OF_JOINT

KINEMATICS = record(
    base_position=3,
    rotation_base_to_world=(3, 3),
    rotation_heading_to_world=(3, 3),
    base_linear_velocity=3,
    base_angular_velocity=3,
    angular_velocity_in_base=3,
    joint_position=JOINT_COUNT,
    joint_velocity=JOINT_COUNT,
    hand_position=3,
    hand_velocity=3,
    hand_rotation=(3, 3),
    hand_velocity_from_arm=3,
    contact_positions=(4, 3),
    rolling_velocity=3,
)
"""In world unless named otherwise.

Fields:
    base_position, hand_position: m. base_linear_velocity, hand_velocity: m/s. base_angular_velocity: rad/s.
    joint_position, joint_velocity: rad, rad/s.
    hand_velocity_from_arm: m/s, what the arm's joints add to the base's motion.
    contact_positions: m, lowest points of the wheels.
    rolling_velocity: m/s, of the base if those points stand still on average (control.estimation.rolling_contact).
"""

_FIRST_WHEEL = 12
_ARM = ARM_SLICE.start
_WHEELS = len(LEGS)


@kernel("void(vector, vector, vector, f8[:])")
def _cross(a: np.ndarray, b: np.ndarray, origin: np.ndarray, out: np.ndarray) -> None:
    """a x (b - origin), each (3,)."""
    x, y, z = b[0] - origin[0], b[1] - origin[1], b[2] - origin[2]
    out[0], out[1], out[2] = a[1] * z - a[2] * y, a[2] * x - a[0] * z, a[0] * y - a[1] * x


@kernel("void(Kinematics, Terms)", Kinematics=KINEMATICS, Terms=BODY_TERMS)
def _velocities(k: np.record, terms: np.record) -> None:
    """Fill in the velocities that follow from those of base and joints."""
    across, middle = np.empty(3), np.zeros(3)
    for wheel in range(_WHEELS):
        for i in range(3):
            middle[i] += k.contact_positions[wheel, i] / _WHEELS
    _cross(k.base_angular_velocity, k.hand_position, k.base_position, across)
    for i in range(3):
        k.hand_velocity_from_arm[i] = 0.0
        for joint in range(6):
            k.hand_velocity_from_arm[i] += terms.hand_jacobian[i, joint] * k.joint_velocity[_ARM + joint]
        k.hand_velocity[i] = k.base_linear_velocity[i] + across[i] + k.hand_velocity_from_arm[i]
    _cross(k.base_angular_velocity, middle, k.base_position, across)
    for i in range(3):
        from_legs = 0.0
        for joint in range(_ARM):
            from_legs += terms.contact_jacobian[joint, i] * k.joint_velocity[joint] / _WHEELS
        k.rolling_velocity[i] = -across[i] - from_legs


@kernel(
    "void(i8[:], matrix, matrix, Array(f8, 3, 'A', True), Array(f8, 3, 'A', True), Array(f8, 3, 'A', True),"
    " Array(f8, 3, 'A', True), i8[:], i8[:], i8[:], i8[:], Kinematics[::1], Terms[::1])",
    Kinematics=KINEMATICS,
    Terms=BODY_TERMS,
)
def move(
    ids: np.ndarray,
    qpos: np.ndarray,
    qvel: np.ndarray,
    axes: np.ndarray,
    anchors: np.ndarray,
    site_positions: np.ndarray,
    site_rotations: np.ndarray,
    joint_ids: np.ndarray,
    qpos_rows: np.ndarray,
    dof_rows: np.ndarray,
    sites: np.ndarray,
    kinematics: np.ndarray,
    terms: np.ndarray,
) -> None:
    """Kinematics, and the kinematic part of the terms, of robots `ids` (m,) of a batch of n.

    Args:
        qpos, qvel: (n, 29), (n, 28). axes, anchors: (n, joints, 3) of MuJoCo's joints.
        site_positions, site_rotations: (n, sites, 3), (n, sites, 9).
        joint_ids, qpos_rows, dof_rows: (22,) of each joint of control.joints. sites: (5,) wheel centres, hand.
        kinematics: KINEMATICS (n,). terms: BODY_TERMS (n,).
    """
    for index in range(len(ids)):
        robot = int(ids[index])
        k, t = kinematics[robot], terms[robot]
        base, hand = qpos[robot, :3], site_positions[robot, sites[_WHEELS]]
        rotation = rotation_from_quaternion(qpos[robot, 3:7])
        heading = rotation_heading_to_world(rotation)
        rate = rotate(rotation, qvel[robot, 3:6])
        for i in range(3):
            k.base_position[i] = base[i]
            k.base_linear_velocity[i] = qvel[robot, i]
            k.angular_velocity_in_base[i] = qvel[robot, 3 + i]
            k.base_angular_velocity[i] = rate[i]
            k.hand_position[i] = hand[i]
            t.hand[i] = hand[i] - base[i]
            for j in range(3):
                k.rotation_base_to_world[i, j] = t.rotation_base_to_world[i, j] = rotation[i, j]
                k.rotation_heading_to_world[i, j] = t.rotation_heading_to_world[i, j] = heading[i, j]
                k.hand_rotation[i, j] = site_rotations[robot, sites[_WHEELS], 3 * i + j]
        for wheel in range(_WHEELS):
            lowest = lowest_point_from_center(axes[robot, joint_ids[_FIRST_WHEEL + wheel]])
            for i in range(3):
                k.contact_positions[wheel, i] = site_positions[robot, sites[wheel], i] + lowest[i]
                t.contacts[wheel, i] = k.contact_positions[wheel, i] - base[i]
        for joint in range(JOINT_COUNT):
            k.joint_position[joint] = qpos[robot, qpos_rows[joint]]
            k.joint_velocity[joint] = qvel[robot, dof_rows[joint]]
            axis, anchor = axes[robot, joint_ids[joint]], anchors[robot, joint_ids[joint]]
            if joint < _ARM:
                _cross(axis, k.contact_positions[LEG_OF_JOINT[joint]], anchor, t.contact_jacobian[joint])
            else:
                _cross(axis, hand, anchor, t.hand_jacobian[:3, joint - _ARM])
                for i in range(3):
                    t.hand_jacobian[3 + i, joint - _ARM] = axis[i]
        _velocities(k, t)


@kernel(
    "void(i8[:], matrix, Array(f8, 3, 'A', True), Array(f8, 3, 'A', True), Array(f8, 3, 'A', True), Array(f8, 3, 'A', True),"
    " i8[:], vector, matrix, matrix, vector, Terms[::1])",
    Terms=BODY_TERMS,
)
def weigh(
    ids: np.ndarray,
    base_positions: np.ndarray,
    axes: np.ndarray,
    anchors: np.ndarray,
    centers: np.ndarray,
    rotations: np.ndarray,
    joint_ids: np.ndarray,
    masses: np.ndarray,
    inertias: np.ndarray,
    carries: np.ndarray,
    armature: np.ndarray,
    terms: np.ndarray,
) -> None:
    """The terms of nominal masses of robots `ids` (m,) of n: masses, their centre, gravity torques, the arm's inertia.

    tau_k = g z . (a_k x sum_b m_b (c_b - p_k)) over the bodies b that joint k carries, with its axis a_k and anchor p_k;
    M_jk = sum_b m_b v_bj . v_bk + (R_b^T a_j) . I_b (R_b^T a_k) with v_bk = a_k x (c_b - p_k), over those that both carry.

    Args:
        base_positions: (n, 3) m. axes, anchors: (n, joints, 3) of MuJoCo's joints.
        centers, rotations: (n, bodies, 3), (n, bodies, 9): centres of mass m and principal axes.
        joint_ids: (22,) of each joint of control.joints.
        masses, inertias: (bodies,) kg, (bodies, 3) kg m^2, nominal.
        carries: (22, bodies) 1 where a joint carries a body.
        armature: (6,) kg m^2 of the arm's joints.
        terms: BODY_TERMS (n,).
    """
    bodies = len(masses)
    total = masses.sum()
    linear, angular = np.empty((6, 3)), np.empty((6, 3))
    for index in range(len(ids)):
        robot = int(ids[index])
        t = terms[robot]
        t.arm_mass = (masses * carries[_ARM]).sum()
        t.rest_mass = total - t.arm_mass
        for i in range(3):
            moment = 0.0
            for body in range(bodies):
                moment += masses[body] * centers[robot, body, i]
            t.center_of_mass[i] = moment / total - base_positions[robot, i]
        for joint in range(JOINT_COUNT):
            axis, anchor = axes[robot, joint_ids[joint]], anchors[robot, joint_ids[joint]]
            x, y = 0.0, 0.0
            for body in range(bodies):
                mass = carries[joint, body] * masses[body]
                x += mass * (centers[robot, body, 0] - anchor[0])
                y += mass * (centers[robot, body, 1] - anchor[1])
            t.gravity_torque[joint] = GRAVITY_MPS2 * (axis[0] * y - axis[1] * x)
        t.arm_inertia[:] = 0.0
        for joint in range(6):
            t.arm_inertia[joint, joint] = armature[joint]
        for body in range(bodies):
            if carries[_ARM, body] == 0.0:
                continue
            carried = 0
            while carried < 6 and carries[_ARM + carried, body] > 0.0:
                axis, anchor = axes[robot, joint_ids[_ARM + carried]], anchors[robot, joint_ids[_ARM + carried]]
                _cross(axis, centers[robot, body], anchor, linear[carried])
                for i in range(3):
                    angular[carried, i] = 0.0
                    for j in range(3):
                        angular[carried, i] += rotations[robot, body, 3 * j + i] * axis[j]
                carried += 1
            for j in range(carried):
                for k in range(carried):
                    for i in range(3):
                        t.arm_inertia[j, k] += masses[body] * linear[j, i] * linear[k, i]
                        t.arm_inertia[j, k] += inertias[body, i] * angular[j, i] * angular[k, i]
