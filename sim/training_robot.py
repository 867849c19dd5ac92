"""Many simulated robots stepped together on mujoco.batch, and their kinematics as arrays.

The training model trades detail for speed: 10 ms steps, pyramidal friction cones, wheels without torsional friction, no
self-collision, no dry joint friction except in the share of robots that randomisation gives it. Checkpoints are judged on
the full model (sim.policy_score).
"""

from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco.batch import Batch

from control.controller import CONTROL_PERIOD_S
from control.joints import (
    ARM_JOINT_NAMES,
    JOINT_COUNT,
    JOINT_NAMES,
    LEGS,
    NOMINAL_BASE_HEIGHT_M,
    NOMINAL_POSITION,
    TORQUE_LIMIT,
    WHEEL_CENTER_FRAMES,
    WHEEL_HALF_WIDTH_M,
    WHEEL_RADIUS_M,
    WHEEL_SLICE,
)
from sim import scenes
from sim.batch_rotations import cross, headings, rotate, rotations_from_quaternions

TIMESTEP_S = 0.01
SUBSTEPS = round(CONTROL_PERIOD_S / TIMESTEP_S)


@dataclass(frozen=True, slots=True)
class Randomization:
    """Ranges of what differs between robots; uniform.

    Attributes:
        mass_scale: of every link.
        tool_mass_scale: of the last arm link and the tool, on top.
        wheel_friction: coefficient of the wheels on the ground.
        gain_scale: of each drive's stiffness, and apart from it of its damping.
        dry_friction_share: share of robots with `dry_friction_nm` on every joint.
        late_share: share of robots whose targets arrive one step (10 ms) late.
    """

    mass_scale: tuple[float, float] = (0.8, 1.2)
    tool_mass_scale: tuple[float, float] = (0.85, 1.25)
    wheel_friction: tuple[float, float] = (0.5, 1.4)
    gain_scale: tuple[float, float] = (0.9, 1.1)
    dry_friction_share: float = 0.25
    dry_friction_nm: tuple[float, float] = (0.1, 0.3)
    late_share: float = 0.3


NO_RANDOMIZATION = Randomization((1.0, 1.0), (1.0, 1.0), (0.8, 0.8), (1.0, 1.0), 0.0, (0.0, 0.0), 0.0)


def training_model() -> mujoco.MjModel:
    """The free scene, simplified."""
    model = scenes.build("free").model
    model.opt.timestep = TIMESTEP_S
    model.opt.cone = mujoco.mjtCone.mjCONE_PYRAMIDAL
    model.opt.impratio = 1.0
    model.dof_frictionloss[:] = 0.0
    floor = model.geom("floor").id
    model.geom_contype[:], model.geom_conaffinity[:] = 1, 0
    model.geom_contype[floor], model.geom_conaffinity[floor] = 0, 1
    for leg in LEGS:
        model.geom_condim[model.geom(f"{leg}_wheel").id] = 3
    return model


class BatchedRobot:
    """n robots on flat ground. Arrays are refreshed by `step` and `reset`; vectors are in world unless named otherwise.

    Attributes:
        base_position: (n, 3) m; rotation_base_to_world, rotation_heading_to_world: (n, 3, 3).
        base_linear_velocity, base_angular_velocity: (n, 3), the latter in world; angular_velocity_in_base (n, 3).
        joint_position, joint_velocity, joint_torque: (n, 22).
        axes, anchors: (n, 22, 3) of the joints. body_positions: (n, bodies, 3), centres of mass.
        hand_position, hand_velocity: (n, 3); hand_rotation (n, 3, 3).
        contact_positions: (n, 4, 3), lowest points of the wheels.
        rolling_velocity: (n, 3) m/s, of the base if those points stand still on average (control.rolling_contact).
        mass_scale: (n,) total mass over nominal.
    """

    def __init__(self, count: int, threads: int, randomization: Randomization, random: np.random.Generator) -> None:
        self.count = count
        self._random = random
        self.model = model = training_model()
        self.nominal_dry_friction = scenes.build("free").model.dof_frictionloss[
            [model.joint(name).dofadr[0] for name in JOINT_NAMES]
        ]
        self.nominal_masses = model.body_mass.copy()
        self.nominal_inertias = model.body_inertia.copy()
        self.batch = batch = Batch(model, nsim=count, nthread=threads)
        joints = [model.joint(name) for name in JOINT_NAMES]
        self.joint_ids = np.array([joint.id for joint in joints])
        self._qpos_rows = np.array([joint.qposadr[0] for joint in joints])
        self._dof_rows = np.array([joint.dofadr[0] for joint in joints])
        self._actuators = np.array([model.actuator(name).id for name in JOINT_NAMES])
        self._hand = model.site("end_effector").id
        self._hand_body = model.body("end_effector").id
        self._wheel_centers = [model.site(name).id for name in WHEEL_CENTER_FRAMES]
        self.arm_bodies = [model.joint(name).bodyid[0] for name in ARM_JOINT_NAMES] + [self._hand_body]
        self._qpos, self._qvel, self._ctrl = batch.bind("qpos"), batch.bind("qvel"), batch.bind("ctrl")
        self._wrenches, self._actuator_force = batch.bind("xfrc_applied"), batch.bind("actuator_force")
        self._xanchor, self._xaxis = batch.bind("xanchor"), batch.bind("xaxis")
        self.body_positions, self.inertial_rotations = batch.bind("xipos"), batch.bind("ximat")
        self._site_positions, self._site_rotations = batch.bind("site_xpos"), batch.bind("site_xmat")
        self.late = random.random(count) < randomization.late_share
        self._randomize(randomization)
        self.reset(np.arange(count))

    def reset(self, ids: np.ndarray) -> None:
        """Put robots on their wheels near the nominal posture, facing anywhere."""
        random, count = self._random, len(ids)
        yaw = random.uniform(-np.pi, np.pi, count)
        qpos = np.zeros((count, self._qpos.shape[1]))
        qpos[:, 2] = NOMINAL_BASE_HEIGHT_M
        qpos[:, 3], qpos[:, 6] = np.cos(yaw / 2), np.sin(yaw / 2)
        spread = np.array([0.06] * 12 + [np.pi] * 4 + [0.25] * 6)
        qpos[:, self._qpos_rows] = NOMINAL_POSITION + random.uniform(-spread, spread, (count, JOINT_COUNT))
        self.batch.state[ids] = 0.0
        self._qpos[ids] = qpos
        self._qvel[ids] = random.uniform(-0.1, 0.1, (count, self._qvel.shape[1]))
        targets = NOMINAL_POSITION.copy()
        targets[WHEEL_SLICE] = 0.0
        self._ctrl[np.ix_(ids, self._actuators)] = targets
        self._wrenches[ids] = 0.0
        self.batch.forward(ids=ids, stage=mujoco.mjtStage.mjSTAGE_POS)
        self._refresh()
        self.joint_torque[ids] = 0.0

    def set_targets(self, targets: np.ndarray) -> None:
        """Joint targets (n, 22) for the steps to come; late robots keep their old ones through the next step."""
        self._pending = targets
        on_time = np.flatnonzero(~self.late)
        self._ctrl[np.ix_(on_time, self._actuators)] = targets[on_time]

    def apply_hand_force(self, force: np.ndarray) -> None:
        """Force (n, 3), N, in world, of the environment on the hand until it is set again."""
        body = self._hand_body
        self._wrenches[:, body, :3] = force
        self._wrenches[:, body, 3:] = cross(self.hand_position - self.body_positions[:, body], force)

    def step(self, refresh: bool) -> None:
        """Advance TIMESTEP_S. Without `refresh` only base and joint states and a first-order hand position are current."""
        if refresh:
            self.batch.step(nstep=1, stage=mujoco.mjtStage.mjSTAGE_POS)
            self._refresh()
        else:
            self.batch.step(nstep=1)
            self.hand_position = self.hand_position + TIMESTEP_S * self.hand_velocity
        self._ctrl[:, self._actuators] = self._pending

    def _refresh(self) -> None:
        qpos, qvel = self._qpos, self._qvel
        self.base_position = qpos[:, :3].copy()
        self.rotation_base_to_world = rotations_from_quaternions(qpos[:, 3:7])
        self.rotation_heading_to_world = headings(self.rotation_base_to_world)
        self.angular_velocity_in_base = qvel[:, 3:6].copy()
        self.base_linear_velocity = qvel[:, :3].copy()
        self.base_angular_velocity = rotate(self.rotation_base_to_world, self.angular_velocity_in_base)
        self.joint_position, self.joint_velocity = qpos[:, self._qpos_rows], qvel[:, self._dof_rows]
        self.joint_torque = np.clip(self._actuator_force[:, self._actuators], -TORQUE_LIMIT, TORQUE_LIMIT)
        self.axes, self.anchors = self._xaxis[:, self.joint_ids], self._xanchor[:, self.joint_ids]
        self.hand_position = self._site_positions[:, self._hand].copy()
        self.hand_rotation = self._site_rotations[:, self._hand].reshape(-1, 3, 3).copy()
        arm = slice(JOINT_COUNT - len(ARM_JOINT_NAMES), JOINT_COUNT)
        lever = self.hand_position[:, None] - self.anchors[:, arm]
        self.hand_jacobian = cross(self.axes[:, arm], lever)
        self.hand_velocity_from_arm = np.einsum("nkd,nk->nd", self.hand_jacobian, self.joint_velocity[:, arm])
        from_base = cross(self.base_angular_velocity, self.hand_position - self.base_position)
        self.hand_velocity = self.base_linear_velocity + from_base + self.hand_velocity_from_arm
        self.contact_positions = self._site_positions[:, self._wheel_centers] + _lowest_point(self.axes[:, WHEEL_SLICE])
        self.rolling_velocity = self._rolling_velocity()

    def _rolling_velocity(self) -> np.ndarray:
        lever = self.contact_positions.mean(axis=1) - self.base_position
        moving = cross(self.base_angular_velocity, lever)
        for wheel in range(len(LEGS)):
            rows = leg_rows(wheel)
            arms = self.contact_positions[:, wheel, None] - self.anchors[:, rows]
            turning = cross(self.axes[:, rows], arms)
            moving += np.einsum("nkd,nk->nd", turning, self.joint_velocity[:, rows]) / len(LEGS)
        return -moving

    def _randomize(self, config: Randomization) -> None:
        batch, model, random, count = self.batch, self.model, self._random, self.count
        scale = np.ones((count, model.nbody)) * random.uniform(*config.mass_scale, (count, 1))
        scale[:, self.arm_bodies[-2:]] *= random.uniform(*config.tool_mass_scale, (count, 1))
        masses, inertias = batch.expand("body_mass"), batch.expand("body_inertia")
        masses[:] = scale * self.nominal_masses
        inertias[:] = scale[:, :, None] * self.nominal_inertias
        self.mass_scale = masses.sum(axis=1) / self.nominal_masses.sum()
        friction = batch.expand("geom_friction")
        wheels = [model.geom(f"{leg}_wheel").id for leg in LEGS]
        friction[:, wheels, 0] = random.uniform(*config.wheel_friction, (count, 1))
        gains, biases = batch.expand("actuator_gainprm"), batch.expand("actuator_biasprm")
        stiffness = random.uniform(*config.gain_scale, (count, model.nu))
        gains[:, :, 0] *= stiffness
        biases[:, :, 1] *= stiffness
        # A wheel's gain is its damping: both must scale alike or its velocity would be off.
        is_wheel = np.isin(np.arange(model.nu), self._actuators[WHEEL_SLICE])
        biases[:, :, 2] *= np.where(is_wheel, stiffness, random.uniform(*config.gain_scale, (count, model.nu)))
        dry = random.uniform(*config.dry_friction_nm, count) * (random.random(count) < config.dry_friction_share)
        frictionloss = batch.expand("dof_frictionloss")
        frictionloss[:, self._dof_rows] = dry[:, None]
        batch.set_const()


def leg_rows(leg: int) -> list[int]:
    """Rows of control.joints that move the contact of a leg: hip, thigh, calf, wheel."""
    return [3 * leg, 3 * leg + 1, 3 * leg + 2, WHEEL_SLICE.start + leg]


def _lowest_point(axes: np.ndarray) -> np.ndarray:
    """Lowest point (n, 4, 3) of the wheel ellipsoids from their centres, axes (n, 4, 3), see control.robot_model."""
    flattening = WHEEL_HALF_WIDTH_M**2 - WHEEL_RADIUS_M**2
    tilt = axes[..., 2:]
    offset = -flattening * tilt * axes
    offset[..., 2] -= WHEEL_RADIUS_M**2
    return offset / np.sqrt(WHEEL_RADIUS_M**2 + flattening * tilt * tilt)
