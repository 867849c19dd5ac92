"""The model-based controller (control.whole_body.model_based) for a whole batch: the teacher of the policy's warm start.

Same laws and gains, written over arrays; a test compares it with the controller itself on random states. Masses are the
nominal ones, as they are for the controller.
"""

import mujoco
import numpy as np

from control.command.limits import CommandLimits
from control.joints import (
    ARM_SLICE,
    DAMPING,
    JOINT_COUNT,
    LEG_SLICE,
    NOMINAL_BASE_HEIGHT_M,
    NOMINAL_POSITION,
    STIFFNESS,
    TORQUE_LIMIT,
    WHEEL_RADIUS_M,
    WHEEL_SLICE,
)
from control.robot_model import GRAVITY_MPS2, RobotModel
from control.timing import CONTROL_PERIOD_S
from control.whole_body.arm import ArmConfig
from control.whole_body.legs import LegConfig
from control.whole_body.reference_correction import NO_CORRECTION, ReferenceCorrection
from control.whole_body.stance import Stance, StanceConfig
from control.whole_body.wheels import HIPS_AND_THIGHS, WheelConfig
from sim.training.batch_rotations import cross, rotate, rotate_back, solve_positive
from sim.training.robot import LEG_OF_JOINT, BatchedRobot

_LEFT_MINUS_RIGHT = np.array([1.0, -1.0, 1.0, -1.0])


_LIMITS = CommandLimits()
_WORKSPACE = np.transpose([_LIMITS.position_x_m, _LIMITS.position_y_m, _LIMITS.position_z_m])


def _leg_rad_per_shift() -> np.ndarray:
    """(2, 12) rad/m: leg posture per shift of the stance, by the unit responses of control.whole_body.stance."""
    rows = []
    for axis in range(2):
        # A stance that is pressed far out on one side shifts by exactly one control period at full speed.
        stance = Stance(StanceConfig(dead_band_m=0.0, limit_m=1.0, gain=1e6, speed_mps=1.0), RobotModel())
        contacts = np.zeros((4, 3))
        contacts[0, axis] = 1.0
        posture = stance.step(np.array([1.0, 0.0, 0.0, 0.0]), contacts)
        rows.append((posture - NOMINAL_POSITION[LEG_SLICE]) / (stance.shift_velocity[axis] * CONTROL_PERIOD_S))
    return np.array(rows)


class BatchedTeacher:
    """Joint targets of every robot. Integrals live in the batch's TaskMemory, stepped before `targets`."""

    def __init__(self, robot: BatchedRobot, arm: ArmConfig) -> None:
        self._robot = robot
        self._arm, self._legs, self._wheels = arm, LegConfig(), WheelConfig()
        self._stance = StanceConfig()
        self._leg_rad_per_shift = _leg_rad_per_shift()
        model = robot.model
        self._masses, self._total_mass = robot.nominal_masses, robot.nominal_masses.sum()
        carries = self._carried(model)
        self._carried_masses = carries * self._masses
        self._arm_carries = carries[ARM_SLICE][:, robot.arm_bodies]
        self._armature = model.dof_armature[model.jnt_dofadr[robot.joint_ids[ARM_SLICE]]]
        wheels = robot.joint_ids[WHEEL_SLICE]
        # The model's dry friction, which the training model leaves out, is part of the controller's compensation.
        self._wheel_damping = model.dof_damping[model.jnt_dofadr[wheels]]
        self._wheel_friction = robot.nominal_dry_friction[WHEEL_SLICE]
        margin = self._arm.limit_margin_rad
        ranges = model.jnt_range[robot.joint_ids[ARM_SLICE]]
        self._lower, self._upper = ranges[:, 0] + margin, ranges[:, 1] - margin
        self._traction = np.zeros(robot.count)
        self._relief = np.ones(robot.count)
        self._shift, self._shift_velocity = (np.zeros((robot.count, 2), order="F") for _ in range(2))
        self._held_shift = np.zeros(robot.count)

    def reset(self, ids: np.ndarray) -> None:
        """Forget the history of robots."""
        self._traction[ids] = 0.0
        self._relief[ids] = 1.0
        self._shift[ids] = 0.0
        self._held_shift[ids] = 0.0

    def targets(self, signals: np.ndarray, memory: np.ndarray, correction: ReferenceCorrection = NO_CORRECTION) -> np.ndarray:
        """Joint targets (n, 22), see control.whole_body.controller, with the references corrected."""
        gravity = self._gravity_torque()
        targets = np.empty((self._robot.count, JOINT_COUNT), order="F")
        targets[:, LEG_SLICE], wheel_torque, support = self._leg_targets(signals, gravity)
        targets[:, WHEEL_SLICE] = self._wheel_targets(signals, memory, wheel_torque, support, correction)
        targets[:, ARM_SLICE] = self._arm_targets(signals, memory, gravity[:, ARM_SLICE], correction)
        return targets

    def _arm_targets(
        self, signals: np.ndarray, memory: np.ndarray, gravity: np.ndarray, correction: ReferenceCorrection
    ) -> np.ndarray:
        config, robot = self._arm, self._robot
        heading, mask = robot.rotation_heading_to_world, signals["command"]["mask"]
        q, dq = signals["joint_position"][:, ARM_SLICE], signals["joint_velocity"][:, ARM_SLICE]
        axes = robot.axes[:, ARM_SLICE]

        lever = robot.hand_position - robot.base_position
        rate = rotate(robot.rotation_base_to_world, signals["angular_velocity"])
        rocking = np.empty_like(lever)
        rocking[:, 0] = rate[:, 1] * lever[:, 2]
        rocking[:, 1] = -rate[:, 0] * lever[:, 2]
        rocking[:, 2] = rate[:, 0] * lever[:, 1] - rate[:, 1] * lever[:, 0] + signals["base_linear_velocity"][:, 2]
        error = signals["command"]["position_m"] - signals["hand_position"]
        limit = config.position_error_limit_m
        tracking = memory["reference_velocity"] + config.position_gain * np.clip(error, -limit, limit)
        tracking -= rotate_back(heading, rocking)
        arm_velocity = rotate_back(robot.hand_jacobian, dq)
        fastest = config.approach_speed_limit_mps
        approach = np.clip(-config.approach_gain * signals["command"]["force_n"], -fastest, fastest)
        to_lower, to_upper = _WORKSPACE[:, None] - signals["hand_position"]
        approach = np.clip(approach, config.position_gain * to_lower, config.position_gain * to_upper)
        on_force = self._on_force(signals)
        motion = (1.0 - mask) * (tracking + correction.hand_velocity) + mask * approach
        yielding = config.force_velocity_feedback * rotate_back(heading, arm_velocity)
        linear = rotate(heading, (1.0 - on_force) * motion + on_force * yielding)
        turning = config.orientation_gain * signals["orientation_error"] + correction.hand_angular_velocity
        angular = rotate(heading, turning)
        angular[:, :2] -= rate[:, :2]

        scale = config.orientation_scale_m
        scaled = np.concatenate([robot.hand_jacobian, scale * axes], axis=2)
        normal = np.einsum("nik,njk->nij", scaled, scaled) + config.damping**2 * np.eye(6)
        twist = np.concatenate([linear, scale * angular], axis=1)
        velocity = solve_positive(normal, rotate(scaled, twist))
        velocity *= np.minimum(1.0, config.joint_speed_limit_rps / np.maximum(np.abs(velocity).max(axis=1), 1e-9))[:, None]
        velocity[((q > self._upper) & (velocity > 0.0)) | ((q < self._lower) & (velocity < 0.0))] = 0.0

        near = np.clip(
            (signals["command"]["mask"] * (signals["force_estimated_n"] - signals["command"]["force_n"])),
            -config.force_error_limit_n,
            config.force_error_limit_n,
        )
        regulation = (
            config.force_gain * near + config.force_integral_gain * memory["force_integral"] - signals["command"]["force_n"]
        )
        load = np.clip(config.load_gain * signals["force_estimated_n"], -config.load_limit_n, config.load_limit_n)
        regulation += correction.hand_force
        hand_force = on_force * regulation - (1.0 - on_force) * load + config.integral_gain * memory["position_integral"]
        force = rotate(heading, hand_force)
        torque = (
            gravity
            + self._arm_torque(config.velocity_gain * (velocity - dq))
            + DAMPING[ARM_SLICE] * velocity
            + rotate(robot.hand_jacobian, force)
        )
        limit = TORQUE_LIMIT[ARM_SLICE]
        return q + np.clip(torque, -limit, limit) / STIFFNESS[ARM_SLICE]

    def _on_force(self, signals: np.ndarray) -> np.ndarray:
        """Share (n, 3), 0 to 1, of force control per axis."""
        config = self._arm
        needed = config.contact_share * np.abs(signals["command"]["force_n"]) - config.contact_noise_n
        pressed = signals["force_estimated_n"] * np.sign(signals["command"]["force_n"])
        contact = np.where(needed > 0.0, np.clip(pressed / np.maximum(needed, 1e-9), 0.0, 1.0), 1.0)
        return signals["command"]["mask"] * contact

    def _leg_targets(self, signals: np.ndarray, gravity: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Leg targets (n, 12), wheel torques (n, 4) of the balance, and support (n,) of the least loaded wheel."""
        config, robot = self._legs, self._robot
        on_force = self._on_force(signals)
        expected = on_force * signals["command"]["force_n"] + (1.0 - on_force) * signals["force_estimated_n"]
        forces = self._ground_forces(signals, rotate(robot.rotation_heading_to_world, expected))
        wheel_torque = gravity[:, WHEEL_SLICE] - self._contact_torque(forces, WHEEL_SLICE)
        excess = (signals["joint_torque"][:, WHEEL_SLICE] - wheel_torque) @ _LEFT_MINUS_RIGHT / (4.0 * WHEEL_RADIUS_M)
        self._traction += config.traction_smoothing * (excess - self._traction)
        forward = robot.rotation_heading_to_world[:, None, :, 0]
        steering = (self._traction[:, None] * _LEFT_MINUS_RIGHT)[:, :, None] * forward
        torque = gravity[:, LEG_SLICE] - self._contact_torque(forces + steering, LEG_SLICE)
        q, dq = signals["joint_position"][:, LEG_SLICE], signals["joint_velocity"][:, LEG_SLICE]
        posture = self._stance_step(forces[:, :, 2])
        support = forces[:, :, 2].min(axis=1) / forces[:, :, 2].mean(axis=1)
        offset = torque / STIFFNESS[LEG_SLICE] + config.posture_gain * (posture - q) - config.posture_damping * dq
        return posture + np.clip(offset, -config.offset_limit_rad, config.offset_limit_rad), wheel_torque, support

    def _ground_forces(self, signals: np.ndarray, hand_force: np.ndarray) -> np.ndarray:
        """Least-norm ground forces (n, 4, 3): f = F / 4 + w x r, r from the middle of the contacts, F and w of the wrench."""
        config, robot = self._legs, self._robot
        center = (self._masses @ robot.body_positions.T).T / self._total_mass
        up = robot.rotation_base_to_world[:, :, 2]
        rate = rotate(robot.rotation_base_to_world, signals["angular_velocity"])
        sway = signals["command"]["base_velocity"][:, :2] - signals["base_linear_velocity"][:, :2]
        force = config.sway_damping * rotate(robot.rotation_heading_to_world[:, :, :2], sway) - hand_force
        force[:, 2] += (
            self._total_mass * GRAVITY_MPS2
            + config.height_stiffness * (NOMINAL_BASE_HEIGHT_M - signals["base_height"])
            - config.height_damping * signals["base_linear_velocity"][:, 2]
        )
        middle = robot.contact_positions.mean(axis=1)
        moment = cross(center - middle, force) - cross(robot.hand_position - center, hand_force)
        moment[:, 0] += config.tilt_stiffness * up[:, 1] - config.tilt_damping * rate[:, 0]
        moment[:, 1] += -config.tilt_stiffness * up[:, 0] - config.tilt_damping * rate[:, 1]
        lever = robot.contact_positions - middle[:, None]
        squares = np.einsum("nwi,nwj->nij", lever, lever)
        spread = np.trace(squares, axis1=1, axis2=2)[:, None, None] * np.eye(3) - squares
        return force[:, None] / 4.0 + cross(solve_positive(spread, moment)[:, None], lever)

    def _stance_step(self, vertical_forces: np.ndarray) -> np.ndarray:
        """Leg posture (n, 12) of the shifted stance, see control.whole_body.stance."""
        config, robot = self._stance, self._robot
        relative = robot.contact_positions - robot.base_position[:, None]
        pressure = rotate_back(relative, vertical_forces) / np.maximum(vertical_forces.sum(axis=1), 1.0)[:, None]
        offset = rotate_back(robot.rotation_heading_to_world, pressure - relative.mean(axis=1))[:, :2]
        excess = offset - np.clip(offset, -config.dead_band_m, config.dead_band_m)
        velocity = config.gain * excess - config.return_gain * self._shift
        velocity = np.clip(velocity, -config.speed_mps, config.speed_mps)
        last = self._shift
        self._shift = np.clip(last + velocity * CONTROL_PERIOD_S, -config.limit_m, config.limit_m)
        self._shift_velocity = (self._shift - last) / CONTROL_PERIOD_S
        return NOMINAL_POSITION[LEG_SLICE] + self._shift @ self._leg_rad_per_shift

    def _wheel_targets(
        self,
        signals: np.ndarray,
        memory: np.ndarray,
        torque: np.ndarray,
        support: np.ndarray,
        correction: ReferenceCorrection,
    ) -> np.ndarray:
        config, robot = self._wheels, self._robot
        forward, yaw = signals["command"]["base_velocity"][:, :1], signals["command"]["base_velocity"][:, 2:]
        feed_forward = torque / DAMPING[WHEEL_SLICE]
        at_rest = np.maximum(np.abs(forward), np.abs(yaw)) < config.rest_velocity
        shift = self._shift_velocity[:, :1] / WHEEL_RADIUS_M
        self._held_shift = at_rest[:, 0] * (self._held_shift + CONTROL_PERIOD_S * shift[:, 0])
        held = memory["wheel_hold"] + self._held_shift[:, None]
        hold = np.clip(config.hold_gain * held, -config.hold_limit_rps, config.hold_limit_rps)
        integral = config.yaw_integral_gain * memory["yaw_integral"][:, None]
        steering = yaw + config.yaw_gain * (yaw - signals["yaw_rate"][:, None]) + integral + correction.base_velocity[..., 1:]
        turn = self._relieve(signals, support, at_rest[:, 0])[:, None] * steering
        lateral = rotate(robot.contact_positions - robot.base_position[:, None], robot.rotation_heading_to_world[:, :, 1])
        rolling = shift + (forward + correction.base_velocity[..., :1] - turn * lateral) / WHEEL_RADIUS_M
        drag = self._wheel_damping * rolling + self._wheel_friction * np.tanh(rolling)
        return feed_forward + np.where(at_rest, shift + hold, rolling + drag / DAMPING[WHEEL_SLICE])

    def _relieve(self, signals: np.ndarray, support: np.ndarray, at_rest: np.ndarray) -> np.ndarray:
        config = self._wheels
        share = np.abs(signals["joint_torque"][:, HIPS_AND_THIGHS]) / TORQUE_LIMIT[HIPS_AND_THIGHS]
        bearable = np.clip((config.effort_end - share.max(axis=1)) / (config.effort_end - config.effort_start), 0.0, 1.0)
        bearable *= np.clip(support / config.full_turn_support, 0.0, 1.0)
        relief = np.minimum(bearable, self._relief + CONTROL_PERIOD_S / config.relief_time_s)
        self._relief = np.where(at_rest, self._relief, relief)
        return self._relief

    def _contact_torque(self, forces: np.ndarray, joints: slice) -> np.ndarray:
        """J_c^T lambda (n, k) of some of the joints of legs and wheels, for ground forces (n, 4, 3)."""
        return np.einsum("nkd,nkd->nk", self._robot.contact_jacobian[:, joints], forces[:, LEG_OF_JOINT[joints]])

    def _gravity_torque(self) -> np.ndarray:
        """Torque (n, 22) that holds each joint's subtree against gravity."""
        robot = self._robot
        moments = (self._carried_masses @ robot.body_positions.T).T
        lever = moments - robot.anchors * self._carried_masses.sum(axis=1)[:, None]
        return GRAVITY_MPS2 * (robot.axes[:, :, 0] * lever[:, :, 1] - robot.axes[:, :, 1] * lever[:, :, 0])

    def _arm_torque(self, acceleration: np.ndarray) -> np.ndarray:
        """Torque (n, 6) that accelerates the arm's joints by (n, 6) rad/s^2 from rest: Newton and Euler, base held."""
        robot, bodies = self._robot, self._robot.arm_bodies
        origin = robot.anchors[:, ARM_SLICE.start, None]
        axes, anchors = robot.axes[:, ARM_SLICE], robot.anchors[:, ARM_SLICE] - origin
        centers, rotations = robot.body_positions[:, bodies] - origin, robot.arm_inertial_rotations
        turning = axes * acceleration[:, :, None]
        # Sums over the joints that carry a body.
        angular, shift = ((self._arm_carries.T @ each.T).T for each in (turning, cross(turning, anchors)))
        linear = cross(angular, centers) - shift
        force = self._masses[bodies][:, None] * linear
        principal = self._robot.nominal_inertias[bodies] * np.einsum("nbij,nbi->nbj", rotations, angular)
        moment = np.einsum("nbij,nbj->nbi", rotations, principal) + cross(centers, force)
        # Sums over the bodies that a joint carries.
        force, moment = ((self._arm_carries @ each.T).T for each in (force, moment))
        torque = np.einsum("nkd,nkd->nk", axes, moment - cross(anchors, force))
        return torque + self._armature * acceleration

    def _carried(self, model: mujoco.MjModel) -> np.ndarray:
        """(22, bodies): 1 where a joint carries a body."""
        carried = np.zeros((JOINT_COUNT, model.nbody))
        for row, joint in enumerate(self._robot.joint_ids):
            for body in range(1, model.nbody):
                ancestor = body
                while ancestor not in (0, model.jnt_bodyid[joint]):
                    ancestor = model.body_parentid[ancestor]
                carried[row, body] = ancestor != 0
        return carried
